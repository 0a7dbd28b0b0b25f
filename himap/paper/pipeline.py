"""The chain of products from the sky to observations and their truth, each computed once and stored.

A `Case` defines one observation; every product is a function of a case or of a survey. A notebook requests
what it shows, and everything behind it is computed or read from the cache. Results of methods on an
observation are in `himap.paper.cleaned`.
"""

from dataclasses import dataclass, field

import numpy as np

from himap.core.errors import InputError
from himap.core.memory import check_memory, estimate, memory_limit
from himap.core.survey import Survey
from himap.instrument.beams.base import Beam
from himap.instrument.beams.paper import Degraded
from himap.instrument.noise import noise_maps
from himap.instrument.observe import observe
from himap.maps import sphere
from himap.maps.low_rank import HarmonicModes, centred, projection
from himap.measures.low_rank_spectra import masked_power
from himap.measures.spectra import PowerSpectra, frequency_power
from himap.removal import harmonic, peaks
from himap.removal.analysis import cube_modes
from himap.removal.covariance import channel_covariance
from himap.removal.spectral_filter import on_sky, seen_through
from himap.sky.box import file_bytes
from himap.sky.emission import emission_modes
from himap.sky.galaxy import Dimming, Galaxy, foreground_components
from himap.sky.hi import hi_maps
from himap.store.store import product


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
        self.beam.of_survey(self.survey)  # fails early, not after the sky is simulated


@product
def hi_of_sky(survey):
    """HI maps before the beam, mK, (n_channels, n_pix).

    `survey` is a `Survey.sky`, as for all products of a sky: surveys with other instruments share it.
    """
    rng = survey.rng("hi")
    if estimate(survey)["HI light cone"] <= memory_limit():
        return hi_maps(survey, rng)
    check_memory(survey, "HI light cone", in_files=True)
    with hi_of_sky.workplace(survey, n_bytes=file_bytes(survey.box_cells)) as folder:
        return hi_maps(survey, rng, folder=folder)


@product
def hi_alms_of_sky(survey):
    """Harmonic coefficients of `hi_of_sky`, up to 3 nside - 1, complex64, shared by all beams."""
    return sphere.analyse(hi_of_sky(survey), n_iter=sphere.N_ITER_FLAT)


@product
def noise_alms(survey):
    """Harmonic coefficients of the noise before any smoothing, up to 3 nside - 1, complex64."""
    return sphere.analyse(noise_maps(survey, survey.rng("noise")), n_iter=sphere.N_ITER_FLAT)


@product
def components_of_sky(survey, galaxy):
    """The foregrounds as a list of `PowerLaw`."""
    return foreground_components(survey, galaxy)


@product
def foreground_modes_of_sky(survey, galaxy, dimming):
    """The foregrounds before the beam, a `HarmonicModes`: few, and shared by the beams."""
    spectra, maps = emission_modes(components_of_sky(survey, galaxy), survey.freqs)
    if dimming is not None:
        maps *= dimming.weights(survey.nside)
    return HarmonicModes(spectra=spectra, alms=sphere.analyse(maps))


@product
def observation(case):
    """The `Observation` of a `Case`; all cases of a survey share sky and noise."""
    survey = case.survey
    components_of_sky(survey.sky, case.galaxy)  # a bad template fails before the long work
    check_memory(survey, "observing")
    bright = foreground_modes_of_sky(survey.sky, case.galaxy, case.dimming)
    windows = case.beam.of_survey(survey)
    smoothed = windows.resmoothing is not None
    noise = noise_alms(survey) if smoothed else noise_maps(survey, survey.rng("noise"))
    return observe(hi_alms_of_sky(survey.sky), bright, noise, windows, survey)


@product
def peak_masked(case, spread=True):
    """The observed maps with their peaks masked, a `PeakMasked` (paper, Sect. 4.1).

    `spread` is a name in `peaks.SPREADS`, or True for that of the line.
    """
    observed = observation(case)
    return peaks.mask_peaks(observed.maps, observed.freqs, spread="line" if spread is True else spread)


@product
def covariance(case, mask_peaks=True):
    """The `channel_covariance` of the maps in which the foreground is estimated, shared by all methods."""
    return channel_covariance(centred(basis(case, mask_peaks)))


@product
def analysis(case, mask_peaks=True):
    """The `CubeModes` of the maps in which the foreground is estimated, less their channel means."""
    return cube_modes(centred(basis(case, mask_peaks)), covariance=covariance(case, mask_peaks))


def basis(case, mask_peaks):
    """The maps in which the foreground is estimated, (n_channels, n_pix), mK.

    `mask_peaks` is False for the observed maps, True for the peak-masked ones, or a name in `peaks.SPREADS`.
    """
    if not mask_peaks:
        return observation(case).maps
    return peak_masked(case, mask_peaks).maps


def signal(case, mask_peaks=True, lmax=None):
    """HI and noise in `basis`, less their channel means, up to `lmax`: the truth less what peak masking
    removed; (n_channels, n_pix) float32, mK, not stored.
    """
    observed = observation(case)
    # The terms far brighter than HI come first, and cancel.
    maps = np.empty(observed.truth.shape, dtype=np.float32)
    np.subtract(basis(case, mask_peaks), observed.maps, out=maps, casting="same_kind")
    maps += observed.truth
    maps -= maps.mean(axis=1, keepdims=True, dtype=np.float64)
    return maps if lmax is None else cut_cube(maps, lmax)


def cut_cube(maps, lmax):
    """Maps (n_channels, n_pix) limited to `lmax`, float32."""
    alms = (sphere.analyse(channel, lmax, n_iter=sphere.N_ITER_FLAT) for channel in maps)
    return sphere.synthesise_cube(
        alms, sphere.nside_of(maps), n_channels=len(maps), label=f"maps to l = {lmax}"
    )


@product
def signal_analysed(case, mask_peaks=True, lmax=None):
    """The `CubeModes` of `signal`, shared by methods with a beam."""
    return cube_modes(signal(case, mask_peaks, lmax))


@product
def foreground_seen(case):
    """The foreground through the beam, a `HarmonicModes`: the observation less its truth."""
    bright = foreground_modes_of_sky(case.survey.sky, case.galaxy, case.dimming)
    return seen_through(
        harmonic.to_modes(bright.alms), bright.spectra, case.beam.of_survey(case.survey).total
    )


@product
def foreground_analysed(case, mask_peaks=True):
    """The foreground as seen by the analysis of the maps, a `HarmonicModes`.

    HEALPix has no exact quadrature, so bright emission has an error in `analysis` that may be as large as HI
    at large l. A method that works on those coefficients removes this error with the foreground; relative to
    the true foreground it would count as an error of the method.
    """
    modes, seen = analysis(case, mask_peaks), foreground_seen(case)
    nside, axes = case.survey.nside, modes.spectra
    bright = on_sky(seen, nside)
    faint = projection(axes.T, basis(case, mask_peaks)) - (axes.T @ bright.spectra) @ bright.maps
    alms = harmonic.from_modes(modes.bright) - sphere.analyse(faint, n_iter=sphere.N_ITER_FLAT)
    rest = seen.spectra - axes @ (axes.T @ seen.spectra)
    return HarmonicModes(spectra=np.hstack([axes, rest]), alms=np.concatenate([alms, seen.alms]))


OF_SKIES = (hi_of_sky, hi_alms_of_sky, noise_alms, foreground_modes_of_sky)
OF_CASES = (
    *(observation, peak_masked, covariance, analysis, signal_analysed),
    *(foreground_seen, foreground_analysed),
)
"""Products of a sky or a case that are as large as a cube: too large for many disks, or needed only together
with a cube."""


def hi_seen(case):
    """HI through the beam, without the noise, mK, (n_channels, n_pix) float32; not stored."""
    survey = case.survey
    pairs = zip(hi_alms_of_sky(survey.sky), case.beam.of_survey(survey).total, strict=True)
    alms = (sphere.multiply_beam(alm, window) for alm, window in pairs)
    return sphere.synthesise_cube(alms, survey.nside, n_channels=survey.n_channels, label="HI")


def truth_alms(case, lmax=None, channels=slice(None), *, hi=None):
    """Coefficients of the truth less its channel means, to 3 nside - 1 or `lmax`; complex64, not stored.

    `hi` are those of HI before the beam, if not `hi_alms_of_sky`.
    """
    return truth_alms_of(case, lmax, hi)(channels)


def truth_alms_of(case, lmax=None, hi=None):
    """A function that returns the `truth_alms` of a slice of channels."""
    windows = case.beam.of_survey(case.survey)
    sky = hi_alms_of_sky(case.survey.sky) if hi is None else hi
    noise = noise_alms(case.survey)
    lmax = case.survey.lmax if lmax is None else min(lmax, case.survey.lmax)
    total, resmoothing = windows.total, windows.resmoothing

    def alms_of(channels):
        numbers = range(len(sky))[channels]
        alms = np.empty((len(numbers), sphere.alm_size(lmax)), dtype=np.complex64)
        for n, out in zip(numbers, alms, strict=True):
            out[:] = sphere.multiply_beam(sphere.alms_upto(sky[n], lmax), total[n])
            low = sphere.alms_upto(noise[n], lmax)
            out += low if resmoothing is None else sphere.multiply_beam(low, resmoothing[n])
        alms[:, 0] = 0
        return alms

    return alms_of


def truth(case, lmax=None, channels=slice(None)):
    """The truth, (n_channels, n_pix) float32, mK; with `lmax`, computed up to it less its channel means."""
    if lmax is None:
        return observation(case).truth[channels]
    alms = truth_alms(case, lmax, channels)
    return sphere.synthesise_cube(alms, case.survey.nside, n_channels=len(alms), label="truth")


@product
def true_spectra(case):
    """The `PowerSpectra` of the truth."""
    return spectra_of(observation(case).truth, truth_alms(case), case.survey)


def spectra_of(maps, alms, survey):
    """`PowerSpectra` of a cube (n_channels, n_pix), mK, of a survey, given its coefficients."""
    frequency = frequency_power(maps, survey.channel_width, taper=survey.taper)
    return PowerSpectra(angular=masked_power(alms), frequency=frequency)
