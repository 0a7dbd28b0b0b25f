"""The chain of products: sky, observation, separation, spectra. Each is computed once and kept.

A `Case` names one observation; every product is a function of a case or of a survey, so a notebook
asks for what it shows and what is behind it is made, or found, on the way.
"""

from dataclasses import dataclass, field

import numpy as np

from himap.errors import InputError
from himap.instrument.beams.base import Beam
from himap.instrument.beams.degraded import Degraded
from himap.instrument.noise import noise_maps, noise_sigma
from himap.instrument.observe import observe
from himap.maps import sphere
from himap.maps.blocked import centred, projection
from himap.maps.modes import HarmonicModes
from himap.measures import diagnostics
from himap.measures.difference import FAINT, Moments, line_errors
from himap.measures.power_spectra import (
    AngularPower,
    angular_power_pair,
    frequency_power,
    recovered_angular_power,
)
from himap.measures.results import Assessment, PowerSpectra
from himap.products.memory import check_memory
from himap.products.store import product
from himap.removal import harmonic, peaks
from himap.removal.analysis import analysed
from himap.removal.beam_projection import on_sky, seen_through
from himap.sky.dimming import Dimming
from himap.sky.emission import emission_maps, emission_modes
from himap.sky.foregrounds import foreground_components
from himap.sky.galaxy import Galaxy
from himap.sky.hi import hi_maps
from himap.survey import Survey

__all__ = [
    "Case",
    "analysis",
    "assessment",
    "components",
    "components_of_sky",
    "error",
    "foreground_analysed",
    "foreground_modes_of_sky",
    "foreground_seen",
    "foregrounds",
    "hi",
    "hi_alms_of_sky",
    "hi_of_sky",
    "noise_alms",
    "observation",
    "peak_masked",
    "power_spectra",
    "residual",
    "separation",
    "true_spectra",
    "truth",
    "truth_alms",
]


@dataclass(frozen=True, kw_only=True)
class Case:
    """One observation of one sky.

    Attributes
    ----------
    survey
        `Survey`.
    galaxy
        `Galaxy`.
    beam
        A `Beam`, such as those of `himap.paper.methods.paper_beams`.
    dimming
        A `Dimming` of the foregrounds along the Galactic plane, or None.
    """

    survey: Survey = field(default_factory=Survey)
    galaxy: Galaxy = field(default_factory=Galaxy)
    beam: Beam = field(default_factory=Degraded)
    dimming: Dimming | None = None

    def __post_init__(self):
        if not (isinstance(self.survey, Survey) and isinstance(self.galaxy, Galaxy)):
            raise InputError("a Case takes a Survey and a Galaxy, such as Galaxy(source='synthetic').")
        if not isinstance(self.beam, Beam):
            raise InputError(
                f"a Case takes a beam, such as Degraded(), got {self.beam!r}; himap.instrument.beams.named "
                "makes one of its name."
            )
        if not isinstance(self.dimming, Dimming | None):
            raise InputError(f"dimming must be a Dimming or None, got {self.dimming!r}.")
        self.beam.of_survey(self.survey)  # fails now, not after the sky is made


def hi(survey):
    """HI maps before the beam, mK, (n_channels, n_pix)."""
    return hi_of_sky(survey.sky)


@product
def hi_of_sky(survey):
    """`hi`, kept for the sky alone: surveys that differ in their instrument share it."""
    check_memory(survey, steps=["HI light cone"])
    return hi_maps(survey, survey.rng("hi"))


@product
def hi_alms_of_sky(survey):
    """Harmonic coefficients of `hi`, to 3 nside - 1, complex64: the beams share them."""
    return sphere.analyse(hi_of_sky(survey), n_iter=sphere.N_ITER_FLAT)


@product
def noise_alms(survey):
    """Harmonic coefficients of the noise before any smoothing, to 3 nside - 1, complex64."""
    return sphere.analyse(noise_maps(survey, survey.rng("noise")), n_iter=sphere.N_ITER_FLAT)


def components(survey, galaxy):
    """The foregrounds as a list of `PowerLaw`."""
    return components_of_sky(survey.sky, galaxy)


@product
def components_of_sky(survey, galaxy):
    """`components`, kept for the sky alone."""
    return foreground_components(survey, galaxy)


@product
def foreground_modes_of_sky(survey, galaxy, dimming):
    """The foregrounds before the beam, a `HarmonicModes`: few, and shared by the beams."""
    spectra, maps = emission_modes(components_of_sky(survey, galaxy), survey.freqs)
    if dimming is not None:
        maps *= dimming.weights(survey.nside)
    return HarmonicModes(spectra=spectra, alms=sphere.analyse(maps))


def foregrounds(survey, galaxy):
    """Foreground maps before the beam, mK, (n_channels, n_pix); quick to make, so not kept."""
    return emission_maps(components(survey, galaxy), survey.freqs)


@product
def observation(case):
    """The `Observation` of a `Case`; all cases of a survey share sky and noise."""
    survey = case.survey
    components(survey, case.galaxy)  # a bad template shows before the long work
    check_memory(survey, steps=["observing"])
    bright = foreground_modes_of_sky(survey.sky, case.galaxy, case.dimming)
    windows = case.beam.of_survey(survey)
    return observe(
        hi_alms_of_sky(survey.sky),
        (bright.spectra, bright.alms),
        noise_maps(survey, survey.rng("noise")),
        windows,
        survey,
        noise_alms=None if windows.resmoothing is None else noise_alms(survey),
    )


@product
def peak_masked(case):
    """The observed maps with their peaks masked, a `PeakMasked` (paper, Sect. 4.1)."""
    observed = observation(case)
    return peaks.mask_peaks(observed.maps, observed.freqs)


@product
def analysis(case, mask_peaks=True):
    """The `CubeModes` of the maps that the foreground is found in, less their channel means."""
    return analysed(centred(_basis(case, mask_peaks)))


def _basis(case, mask_peaks):
    return peak_masked(case).maps if mask_peaks else observation(case).maps


@product
def separation(case, remover, mask_peaks=True):
    """The `Separation` that `remover`, a `ForegroundRemover` such as PCA(n_sources=3), makes of a case.

    With `mask_peaks` the foreground is found in the peak-masked maps; it is subtracted from those observed.
    The method comes as an object, not by name, so that its result depends on the code of that method alone.
    """
    remover.check(case.survey.n_channels)
    observed = observation(case)
    return remover.separate(
        _basis(case, mask_peaks),
        freqs=observed.freqs,
        beams=observed.beams,
        noise=noise_sigma(case.survey),
        rng=case.survey.rng(f"removal {remover.name}"),
        modes=analysis(case, mask_peaks) if remover.needs_modes else None,
    )


def residual(case, remover, mask_peaks=True):
    """The cube that `remover` leaves, mK, (n_channels, n_pix) float32; not kept."""
    found = separation.once(case, remover, mask_peaks)
    modes = None if found.lmax is None else analysis(case, mask_peaks)
    return found.left_of(observation(case).maps, _basis(case, mask_peaks), modes)


@product
def foreground_seen(case):
    """The foreground through the beam, a `HarmonicModes`: what an observation is more than its truth."""
    bright = foreground_modes_of_sky(case.survey.sky, case.galaxy, case.dimming)
    return seen_through(
        harmonic.to_modes(bright.alms), bright.spectra, case.beam.of_survey(case.survey).total
    )


@product
def foreground_analysed(case, mask_peaks=True):
    """The foreground as the analysis of the maps has it, a `HarmonicModes`.

    HEALPix holds no exact quadrature, so what is bright comes out of `analysis` with an error that may be as
    large as HI where l is large. A method that works on those coefficients takes that error with the rest; to
    the true foreground it would be one of the method.
    """
    modes, seen = analysis(case, mask_peaks), foreground_seen(case)
    nside, axes = case.survey.nside, modes.spectra
    bright = on_sky(seen, nside)
    faint = projection(axes.T, _basis(case, mask_peaks)) - (axes.T @ bright.spectra) @ bright.maps
    alms = harmonic.from_modes(modes.bright) - sphere.analyse(faint, n_iter=sphere.N_ITER_FLAT)
    rest = seen.spectra - axes @ (axes.T @ seen.spectra)
    return HarmonicModes(spectra=np.hstack([axes, rest]), alms=np.concatenate([alms, seen.alms]))


def error(case, remover, mask_peaks=True):
    """What `remover` leaves more than the truth, a `MapModes` less its channel means; not kept.

    An observation is the truth and the foreground, so this is the foreground less that which was found. Where
    the method ends at some l, it is that of what is left up to there against the truth up to there.
    """
    return _error(case, separation.once(case, remover, mask_peaks), mask_peaks)


def _error(case, found, mask_peaks):
    there = foreground_seen(case) if found.lmax is None else foreground_analysed(case, mask_peaks)
    whole = on_sky(there, case.survey.nside, found.lmax) + -found.foreground
    return whole.condensed(FAINT * _variance(true_spectra(case).angular))


def _variance(angular):
    """Variance, mK^2, summed over channels, of an `AngularPower` of the whole sky."""
    return float(np.sum(angular.cl @ (2 * angular.degrees + 1)) / (4 * np.pi))


def truth_alms(case, lmax=None):
    """Coefficients of the truth less its channel means, to 3 nside - 1 or `lmax`; complex64, not kept."""
    windows = case.beam.of_survey(case.survey)
    sky, noise = hi_alms_of_sky(case.survey.sky), noise_alms(case.survey)
    lmax = case.survey.lmax if lmax is None else min(lmax, case.survey.lmax)
    alms = np.empty((len(sky), sphere.alm_size(lmax)), dtype=np.complex64)
    for n, out in enumerate(alms):
        out[:] = sphere.multiply_beam(sphere.alms_upto(sky[n], lmax), windows.total[n])
        low, resmoothing = sphere.alms_upto(noise[n], lmax), windows.resmoothing
        out += low if resmoothing is None else sphere.multiply_beam(low, resmoothing[n])
    alms[:, 0] = 0
    return alms


def truth(case, lmax=None):
    """The truth up to `lmax`, (n_channels, n_pix) float32, mK; the whole one is kept, others are made."""
    if lmax is None:
        return observation(case).truth
    return _truth_of(truth_alms(case, lmax), case.survey.nside)


def _truth_of(alms, nside):
    return sphere.synthesise_cube(alms, nside, n_channels=len(alms), label="truth")


@product
def true_spectra(case):
    """The `PowerSpectra` of the truth."""
    return _spectra(observation(case).truth, truth_alms(case), case.survey.channel_width)


@product
def assessment(case, remover, mask_peaks=True, post_mask=False):
    """The `Assessment` of what `remover` leaves of a case, found as in `separation`.

    No cube but the truth is there for it: all follows from the error, which is a few spectra times maps. With
    `post_mask` the lines of sight whose error stands out are left out of a second pair of spectra (paper,
    Sect. 5.1).
    """
    found = separation.once(case, remover, mask_peaks)
    wrong, lmax, width = _error(case, found, mask_peaks), found.lmax, case.survey.channel_width
    alms = truth_alms(case, lmax)
    true = observation(case).truth if lmax is None else _truth_of(alms, case.survey.nside)
    spectra = true_spectra(case) if lmax is None else _spectra(true, alms, width)
    moments = Moments.of(true, wrong)
    errors = line_errors(wrong)
    masked = masked_truth = None
    if post_mask:
        mask = ~diagnostics.flagged_lines(errors)
        masked, masked_truth = _masked_spectra(case, true, wrong, mask, alms, lmax)
    return Assessment(
        power_spectra=PowerSpectra(
            angular=recovered_angular_power(alms, wrong),
            frequency=moments.frequency_power(spectra.frequency, width),
        ),
        correlation=moments.correlation,
        line_errors=errors,
        masked=masked,
        masked_truth=masked_truth,
        converged=found.converged,
        n_iterations=found.n_iterations,
        mixing=found.mixing,
        truth=None if lmax is None else spectra,
    )


def _masked_spectra(case, true, wrong, mask, alms, lmax):
    """`PowerSpectra` of what is left and of the truth on the lines of sight in `mask`."""
    if lmax is not None:
        alms = sphere.alms_padded(alms, case.survey.lmax)  # a mask mixes multipoles
    angular = angular_power_pair(true, wrong, mask=mask, truth_alms=alms)
    frequency = frequency_power(true, case.survey.channel_width, mask=mask)
    recovered = Moments.of(true, wrong, mask=mask).frequency_power(frequency, case.survey.channel_width)
    return tuple(
        PowerSpectra(angular=power.upto(lmax), frequency=along)
        for power, along in zip(angular, (recovered, frequency), strict=True)
    )


def _spectra(maps, alms, width):
    """`PowerSpectra` of a cube whose coefficients are at hand."""
    cl = sphere.power_spectrum(alms)
    angular = AngularPower(degrees=np.arange(cl.shape[1], dtype=float), cl=cl)
    return PowerSpectra(angular=angular, frequency=frequency_power(maps, width))


def power_spectra(case, remover=None, mask_peaks=True):
    """The `PowerSpectra` of a case: of the truth, or of what `remover` leaves, found as in `separation`."""
    return true_spectra(case) if remover is None else assessment(case, remover, mask_peaks).power_spectra
