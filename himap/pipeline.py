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
from himap.removal import peaks
from himap.sky.emission import emission_maps
from himap.sky.foregrounds import foreground_components
from himap.sky.galaxy import Galaxy
from himap.sky.hi import hi_maps
from himap.spectra import AngularPower, FrequencyPower, angular_power, frequency_power
from himap.store import product
from himap.survey import Survey

__all__ = [
    "Case",
    "Residual",
    "Spectra",
    "cleaned",
    "components",
    "components_of_sky",
    "foregrounds",
    "hi",
    "hi_of_sky",
    "observation",
    "peak_masked",
    "spectra",
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
    """

    survey: Survey = field(default_factory=Survey)
    galaxy: Galaxy = field(default_factory=Galaxy)
    beam: str | Beam = "degraded"
    ripple: str = "bracket"

    def __post_init__(self):
        if not (isinstance(self.survey, Survey) and isinstance(self.galaxy, Galaxy)):
            raise InputError("a Case takes a Survey and a Galaxy, such as Galaxy(source='synthetic').")
        if not isinstance(self.ripple, str) or self.ripple not in RIPPLES:
            raise InputError(f"unknown ripple {self.ripple!r}; there are {', '.join(RIPPLES)}.")
        self.beam_of_survey()  # fails now, not after the sky is made

    def beam_of_survey(self):
        """The `Beam` of this case."""
        if isinstance(self.beam, Beam):
            return self.beam
        return beam_model(self.beam, self.survey, ripple=self.ripple)


@dataclass(frozen=True, kw_only=True)
class Residual:
    """What a method leaves, `maps` (n_channels, n_pix) in mK, and the rest of its `Separation`."""

    maps: np.ndarray
    mixing: np.ndarray
    sources: np.ndarray
    converged: bool
    n_iterations: int
    flagged: np.ndarray | None


@dataclass(frozen=True, kw_only=True)
class Spectra:
    """Both spectra of one cube."""

    angular: AngularPower
    frequency: FrequencyPower


def hi(survey):
    """HI maps before the beam, mK, (n_channels, n_pix)."""
    return hi_of_sky(survey.sky)


@product
def hi_of_sky(survey):
    """`hi`, kept for the sky alone: surveys that differ in their instrument share it."""
    return hi_maps(survey, survey.rng("hi"))


def components(survey, galaxy):
    """The foregrounds as a list of `PowerLaw`."""
    return components_of_sky(survey.sky, galaxy)


@product
def components_of_sky(survey, galaxy):
    """`components`, kept for the sky alone."""
    return foreground_components(survey, galaxy)


def foregrounds(survey, galaxy):
    """Foreground maps before the beam, mK, (n_channels, n_pix); quick to make, so not kept."""
    return emission_maps(components(survey, galaxy), survey.freqs)


@product
def observation(case):
    """The `Observation` of a `Case`; all cases of a survey share sky and noise."""
    survey = case.survey
    bright = foregrounds(survey, case.galaxy)  # first: a bad template shows before the long work on HI
    return observe(
        hi(survey),
        bright,
        noise_maps(survey, survey.rng("noise")),
        case.beam_of_survey(),
        survey,
        provenance={"survey": asdict(survey), "galaxy": asdict(case.galaxy), "ripple": case.ripple},
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


@product
def spectra(case, remover=None, mask_peaks=True):
    """The `Spectra` of a case: of the truth, or of what `remover` leaves, found as in `cleaned`."""
    maps = observation(case).truth if remover is None else cleaned(case, remover, mask_peaks).maps
    return Spectra(angular=angular_power(maps), frequency=frequency_power(maps, case.survey.channel_width))
