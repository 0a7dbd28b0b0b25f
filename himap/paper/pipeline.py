"""The chain of products: sky, observation, cleaned maps, spectra. Each is computed once and kept.

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
from himap.maps.blocked import centred
from himap.measures import diagnostics
from himap.measures.power_spectra import (
    AngularPower,
    angular_power_pair,
    frequency_power,
    recovered_angular_power,
)
from himap.measures.results import Assessment, Modes, PowerSpectra, Residual
from himap.products.memory import check_memory
from himap.products.store import product
from himap.removal import peaks
from himap.removal.analysis import analysed
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
    "cleaned",
    "components",
    "components_of_sky",
    "cut_truth",
    "foreground_modes_of_sky",
    "foregrounds",
    "hi",
    "hi_alms_of_sky",
    "hi_of_sky",
    "noise_alms",
    "observation",
    "peak_masked",
    "power_spectra",
    "true_spectra",
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
    """The foregrounds before the beam, a `Modes`: few, and shared by the beams."""
    spectra, maps = emission_modes(components_of_sky(survey, galaxy), survey.freqs)
    if dimming is not None:
        maps *= dimming.weights(survey.nside)
    return Modes(spectra=spectra, alms=sphere.analyse(maps))


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
def cleaned(case, remover, mask_peaks=True):
    """The `Residual` of a case cleaned by `remover`, a `ForegroundRemover` such as PCA(n_sources=3).

    With `mask_peaks` the foreground is found in the peak-masked maps, and subtracted from those observed.
    The method comes as an object, not by name, so that its result depends on the code of that method alone.
    """
    remover.check(case.survey.n_channels)
    observed = observation(case)
    result = remover.clean(
        observed.maps,
        freqs=observed.freqs,
        beams=observed.beams,
        noise=noise_sigma(case.survey),
        rng=case.survey.rng(f"removal {remover.name}"),
        separate_on=_basis(case, mask_peaks) if mask_peaks else None,
        modes=analysis(case, mask_peaks) if remover.needs_modes else None,
    )
    separation = result.separation
    return Residual(
        maps=result.residual,
        mixing=separation.mixing,
        sources=separation.sources,
        converged=separation.converged,
        n_iterations=separation.n_iterations,
        flagged=separation.flagged,
        lmax=separation.lmax,
    )


def truth_alms(case):
    """Harmonic coefficients of the truth less its channel means, to 3 nside - 1; complex64, not kept."""
    windows = case.beam.of_survey(case.survey)
    sky, noise = hi_alms_of_sky(case.survey.sky), noise_alms(case.survey)
    alms = np.empty(sky.shape, dtype=np.complex64)
    for n, out in enumerate(alms):
        out[:] = sphere.multiply_beam(sky[n], windows.total[n])
        resmoothing = windows.resmoothing
        out += noise[n] if resmoothing is None else sphere.multiply_beam(noise[n], resmoothing[n])
    alms[:, 0] = 0
    return alms


@product
def true_spectra(case):
    """The `PowerSpectra` of the truth."""
    return _spectra(observation(case).truth, truth_alms(case), case.survey.channel_width, None)


@product
def assessment(case, remover, mask_peaks=True, post_mask=False):
    """The `Assessment` of what `remover` leaves of a case, found as in `cleaned`.

    A cleaned cube that is not kept yet is not kept for this either: a scan over many methods would fill the
    disk. With `post_mask` the lines of sight whose error stands out are left out of a second pair of spectra
    (paper, Sect. 5.1).
    """
    residual, truth = cleaned.once(case, remover, mask_peaks), observation(case).truth
    maps, alms, lmax = residual.maps, truth_alms(case), residual.lmax
    if lmax is not None:
        maps, (truth, alms) = sphere.cut_cube(maps, lmax), cut_truth(case, lmax)
    errors = diagnostics.line_errors(maps, truth)
    width = case.survey.channel_width
    masked = masked_truth = None
    if post_mask:
        mask = ~diagnostics.flagged_lines(errors)
        pair = angular_power_pair(maps, truth, mask=mask, truth_alms=alms)
        masked, masked_truth = (
            PowerSpectra(angular=angular.upto(lmax), frequency=frequency_power(cube, width, mask=mask))
            for angular, cube in zip(pair, (maps, truth), strict=True)
        )
    return Assessment(
        power_spectra=PowerSpectra(
            angular=recovered_angular_power(maps, truth, alms).upto(lmax),
            frequency=frequency_power(maps, width),
        ),
        correlation=diagnostics.correlation(maps, truth),
        line_errors=errors,
        masked=masked,
        masked_truth=masked_truth,
        converged=residual.converged,
        n_iterations=residual.n_iterations,
        mixing=residual.mixing,
        truth=None if lmax is None else _spectra(truth, alms, width, lmax),
    )


def cut_truth(case, lmax):
    """(maps, coefficients to 3 nside - 1) of the truth cut at `lmax`; not kept."""
    alms = truth_alms(case)
    low = (sphere.alms_upto(alm, lmax) for alm in alms)
    maps = sphere.synthesise_cube(low, case.survey.nside, n_channels=len(alms), label="truth")
    alms[:, sphere.alm_degree(case.survey.lmax) > lmax] = 0
    return maps, alms


def _spectra(maps, alms, width, lmax):
    """`PowerSpectra` of a cube whose coefficients are at hand, up to `lmax`."""
    cl = sphere.power_spectrum(alms)
    angular = AngularPower(degrees=np.arange(cl.shape[1], dtype=float), cl=cl)
    return PowerSpectra(angular=angular.upto(lmax), frequency=frequency_power(maps, width))


def power_spectra(case, remover=None, mask_peaks=True):
    """The `PowerSpectra` of a case: of the truth, or of what `remover` leaves, found as in `cleaned`."""
    return true_spectra(case) if remover is None else assessment(case, remover, mask_peaks).power_spectra
