"""The chain of products: sky, observation, cleaned maps, spectra. Each is computed once and kept.

A `Case` names one observation; every product is a function of a case or of a survey, so a notebook
asks for what it shows and what is behind it is made, or found, on the way.
"""

from dataclasses import asdict, dataclass, field

import numpy as np

from himap.errors import InputError
from himap.instrument.beams import RIPPLES, Beam, beam_model
from himap.instrument.noise import noise_maps
from himap.instrument.observe import observe
from himap.maps import sphere
from himap.measures import diagnostics
from himap.measures.power_spectra import (
    AngularPower,
    angular_power_pair,
    frequency_power,
    recovered_angular_power,
)
from himap.measures.results import Assessment, Modes, Residual, Spectra
from himap.products.memory import check_memory
from himap.products.store import product
from himap.removal import peaks
from himap.sky.dimming import Dimming
from himap.sky.emission import emission_maps, emission_modes
from himap.sky.foregrounds import foreground_components
from himap.sky.galaxy import Galaxy
from himap.sky.hi import hi_maps
from himap.survey import Survey

__all__ = [
    "Assessment",
    "Case",
    "Modes",
    "Residual",
    "Spectra",
    "assessment",
    "cleaned",
    "components",
    "components_of_sky",
    "foreground_modes_of_sky",
    "foregrounds",
    "hi",
    "hi_alms_of_sky",
    "hi_of_sky",
    "noise_alms",
    "observation",
    "peak_masked",
    "prepare",
    "spectra",
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
        "degraded", "evolving", "oscillating", or a `Beam` of your own (`beam_from_array`).
    ripple
        Reading of the oscillating beam's ripple, one of `himap.instrument.beams.RIPPLES`.
    dimming
        A `Dimming` of the foregrounds along the Galactic plane, or None.
    """

    survey: Survey = field(default_factory=Survey)
    galaxy: Galaxy = field(default_factory=Galaxy)
    beam: str | Beam = "degraded"
    ripple: str = "bracket"
    dimming: Dimming | None = None

    def __post_init__(self):
        if not (isinstance(self.survey, Survey) and isinstance(self.galaxy, Galaxy)):
            raise InputError("a Case takes a Survey and a Galaxy, such as Galaxy(source='synthetic').")
        if not isinstance(self.ripple, str) or self.ripple not in RIPPLES:
            raise InputError(f"unknown ripple {self.ripple!r}; there are {', '.join(RIPPLES)}.")
        if not isinstance(self.dimming, Dimming | None):
            raise InputError(f"dimming must be a Dimming or None, got {self.dimming!r}.")
        self.beam_of_survey()  # fails now, not after the sky is made

    def beam_of_survey(self):
        """The `Beam` of this case."""
        if isinstance(self.beam, Beam):
            return self.beam
        return beam_model(self.beam, self.survey, ripple=self.ripple)


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


def prepare(cases):
    """Make what the observations of `cases` share, once, before several processes ask for it."""
    for case in cases:
        components(case.survey, case.galaxy)  # a bad template shows before the long work
        hi_alms_of_sky(case.survey.sky)
        noise_alms(case.survey)
        foreground_modes_of_sky(case.survey.sky, case.galaxy, case.dimming)


@product
def observation(case):
    """The `Observation` of a `Case`; all cases of a survey share sky and noise."""
    survey = case.survey
    components(survey, case.galaxy)  # a bad template shows before the long work
    check_memory(survey, steps=["observing"])
    bright = foreground_modes_of_sky(survey.sky, case.galaxy, case.dimming)
    beam = case.beam_of_survey()
    return observe(
        hi_alms_of_sky(survey.sky),
        (bright.spectra, bright.alms),
        noise_maps(survey, survey.rng("noise")),
        beam,
        survey,
        noise_alms=None if beam.after is None else noise_alms(survey),
        provenance={
            "survey": asdict(survey),
            "galaxy": asdict(case.galaxy),
            "ripple": case.ripple,
            "dimming": case.dimming and asdict(case.dimming),
        },
    )


@product
def peak_masked(case):
    """The observed maps with their peaks masked, a `PeakMasked` (paper, Sect. 4.1)."""
    seen = observation(case)
    return peaks.mask_peaks(seen.maps, seen.freqs)


@product
def cleaned(case, remover, mask_peaks=True):
    """The `Residual` of a case cleaned by `remover`, a `ForegroundRemover` such as PCA(n_sources=3).

    With `mask_peaks` the foreground is found in the peak-masked maps, and subtracted from those observed.
    The method comes as an object, not by name, so that its result depends on the code of that method alone.
    """
    remover.check(case.survey.n_channels)
    seen = observation(case)
    result = remover.clean(
        seen.maps,
        freqs=seen.freqs,
        beams=seen.beams,
        rng=case.survey.rng(f"removal {remover.name}"),
        separate_on=peak_masked(case).maps if mask_peaks else None,
    )
    found = result.separation
    return Residual(
        maps=result.residual,
        mixing=found.mixing,
        sources=found.sources,
        converged=found.converged,
        n_iterations=found.n_iterations,
        flagged=found.flagged,
    )


def truth_alms(case):
    """Harmonic coefficients of the truth less its channel means, to 3 nside - 1; complex64, not kept."""
    beam = case.beam_of_survey()
    seen = hi_alms_of_sky(case.survey.sky), beam.transfer, noise_alms(case.survey), beam.after
    alms = np.empty(seen[0].shape, dtype=np.complex64)
    for n, out in enumerate(alms):
        hi, transfer, noise, after = (one if one is None else one[n] for one in seen)
        out[:] = sphere.multiply_beam(hi, transfer)
        out += noise if after is None else sphere.multiply_beam(noise, after)
    alms[:, 0] = 0
    return alms


@product
def true_spectra(case):
    """The `Spectra` of the truth."""
    cl = sphere.power_spectrum(truth_alms(case))
    return Spectra(
        angular=AngularPower(degrees=np.arange(cl.shape[1], dtype=float), cl=cl),
        frequency=frequency_power(observation(case).truth, case.survey.channel_width),
    )


@product
def assessment(case, remover, mask_peaks=True, post_mask=False):
    """The `Assessment` of what `remover` leaves of a case, found as in `cleaned`.

    The cleaned cube is taken from the cache if `cleaned` keeps it there, and is not kept for this: a
    scan over many methods would fill the disk. With `post_mask` the lines of sight whose error stands out are
    left out of a second pair of spectra (paper, Sect. 5.1).
    """
    make = cleaned if cleaned.is_cached(case, remover, mask_peaks) else cleaned.compute
    left, truth = make(case, remover, mask_peaks), observation(case).truth
    errors = diagnostics.line_errors(left.maps, truth)
    alms = truth_alms(case)
    width = case.survey.channel_width
    masked = masked_truth = None
    if post_mask:
        kept = ~diagnostics.flagged_lines(errors)
        pair = angular_power_pair(left.maps, truth, mask=kept, truth_alms=alms)
        masked, masked_truth = (
            Spectra(angular=angular, frequency=frequency_power(maps, width, mask=kept))
            for angular, maps in zip(pair, (left.maps, truth), strict=True)
        )
    return Assessment(
        spectra=Spectra(
            angular=recovered_angular_power(left.maps, truth, alms),
            frequency=frequency_power(left.maps, width),
        ),
        correlation=diagnostics.correlation(left.maps, truth),
        line_errors=errors,
        masked=masked,
        masked_truth=masked_truth,
        converged=left.converged,
        n_iterations=left.n_iterations,
    )


def spectra(case, remover=None, mask_peaks=True):
    """The `Spectra` of a case: of the truth, or of what `remover` leaves, found as in `cleaned`."""
    return true_spectra(case) if remover is None else assessment(case, remover, mask_peaks).spectra
