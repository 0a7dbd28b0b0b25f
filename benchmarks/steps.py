"""The steps of the chain, each with what it needs at least and with what people use instead.

A step computes from what the steps before it keep in the cache; its own result is not read from there.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import healpy as hp
from sklearn import decomposition

from benchmarks import floors
from benchmarks.alternatives import (
    evenly,
    plain_polynomials,
    plain_power_laws,
    plain_residual,
)
from himap.maps import sphere
from himap.paper import cleaned, pipeline
from himap.paper.methods import methods_for, paper_beams, table_1
from himap.removal.base import SeparationWarning
from himap.removal.beam_subspace import BeamSubspace
from himap.removal.parametric import Parametric
from himap.removal.pca import PCA
from himap.sky.emission import emission_maps

N_SAMPLES = 6  # channels that an alternative is timed on
N_LINES = 64  # lines of sight


@dataclass(frozen=True, kw_only=True)
class Step:
    """One row of the table.

    Attributes
    ----------
    name
        What it is called.
    target
        (seconds, GB) that it should stay within at preset `paper`, on 2 cores and an idle machine.
    work
        Called with the `Case`; its time is what is measured.
    needs
        Called with the `Survey` and what `work` returned: its `Needs`.
    beside
        Called with the `Case`: (name of the alternative, a function, how many times its work is ours).
    """

    name: str
    target: tuple
    work: Callable
    needs: Callable
    beside: Callable | None = None


def light_cone(case):
    """The HI maps, from random numbers."""
    pipeline.hi_of_sky.compute(case.survey.sky)


def observations(case):
    """All foregrounds, three beams, noise: three observations, from HI maps that are there."""
    cases = [replace(case, beam=beam) for beam in paper_beams().values()]
    sky, galaxy = case.survey.sky, case.galaxy
    steps = [
        (pipeline.components_of_sky, (sky, galaxy)),
        (pipeline.hi_alms_of_sky, (sky,)),
        (pipeline.noise_alms, (case.survey,)),
        (pipeline.foreground_modes_of_sky, (sky, galaxy, case.dimming)),
        *((product, (one,)) for product in (pipeline.observation, pipeline.foreground_seen) for one in cases),
    ]
    for product, call in steps:
        product.forget(*call)
        product(*call)


def beside_observations(case):
    """One channel with healpy: convolved HI, noise and foregrounds, float64, no shared analysis."""
    hi = pipeline.hi_of_sky(case.survey.sky)
    channels = evenly(case.survey.n_channels, N_SAMPLES)
    components = pipeline.components_of_sky(case.survey.sky, case.galaxy)
    bright = emission_maps(components, case.survey.freqs[channels]).astype(float)
    windows = [beam.of_survey(case.survey) for beam in paper_beams().values()]

    def smooth(pixels, beam):
        alm = hp.map2alm(pixels, iter=sphere.N_ITER)
        return hp.alm2map(hp.almxfl(alm, beam), case.survey.nside)

    def work():
        for channel, pixels in zip(channels, bright, strict=True):
            for window in windows:
                smooth(pixels, window.total[channel])
                smooth(hi[channel].astype(float), window.total[channel])
                if window.resmoothing is not None:
                    smooth(pixels, window.resmoothing[channel])

    return "healpy, each beam and component by itself", work, case.survey.n_channels / len(channels)


def peaks(case):
    """Peak masking of one observation."""
    pipeline.peak_masked.compute(case)


def beside_polynomials(case):
    """numpy, a float64 block of lines at once and one by one where clipped."""
    maps = pipeline.observation(case).maps
    lines = evenly(maps.shape[1], 64 * N_LINES)
    return "numpy legfit, in blocks", lambda: plain_polynomials(maps[:, lines]), maps.shape[1] / len(lines)


def _cleaner(name):
    """The work of the method called `name`, as the paper uses it."""

    def work(case):
        (method,) = (method for method in methods_for(case.beam) if method.name == name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeparationWarning)
            return cleaned.separation.compute(case, method)

    return work


def beside_pca(case):
    """scikit-learn's, float64."""
    maps, masked = pipeline.observation(case).maps, pipeline.peak_masked(case).maps
    model = decomposition.PCA(table_1(case.beam)["n_sources"])
    return "scikit-learn PCA", lambda: plain_residual(model, maps, masked), 1


def beside_fastica(case):
    """scikit-learn's with its quicker whitening."""
    maps, masked = pipeline.observation(case).maps, pipeline.peak_masked(case).maps
    n_sources = table_1(case.beam)["n_sources"]
    model = decomposition.FastICA(n_sources, whiten_solver="eigh", random_state=0)
    return "scikit-learn FastICA", lambda: plain_residual(model, maps, masked), 1


def beside_parametric(case):
    """scipy, line by line."""
    masked, remover = pipeline.peak_masked(case).maps, Parametric()
    lines = masked[:, evenly(masked.shape[1], N_LINES)].T.astype(float)
    x = case.survey.freqs / remover.nu0
    return (
        "scipy least_squares, line by line",
        lambda: [plain_power_laws(line, x, remover.beta_min, remover.beta_max) for line in lines],
        masked.shape[1] / len(lines),
    )


def analysis(case):
    """Coefficients of every channel of the peak-masked maps, which methods that know the beam share."""
    pipeline.analysis.compute(case)


def beside_analysis(case):
    """healpy's map2alm without refinements, float64, channel by channel."""
    maps = pipeline.observation(case).maps
    sample = maps[evenly(len(maps), N_SAMPLES)].astype(float)
    return (
        "healpy map2alm, no refinement",
        lambda: [hp.map2alm(pixels, iter=0) for pixels in sample],
        len(maps) / len(sample),
    )


def beam_subspace(case):
    """BeamSubspace with three sources, from coefficients that are there."""
    return cleaned.separation.compute(case, BeamSubspace(n_sources=3))


def measures(case):
    """C_l, P(k), correlation and errors of what PCA leaves, found already."""
    cleaned.assessment.compute(case, _pca(case))


def _pca(case):
    return PCA(n_sources=table_1(case.beam)["n_sources"])


def prepare(case):
    """Keep what steps begin with: the observation, its truth and analysis, and what PCA finds in it."""
    pipeline.true_spectra(case)
    pipeline.foreground_seen(case)
    pipeline.analysis(case)
    cleaned.separation(case, _pca(case))


def beside_spectra(case):
    """healpy's anafast, channel by channel."""
    residual = cleaned.residual(case, _pca(case))
    sample = residual[evenly(len(residual), N_SAMPLES)].astype(float)
    return (
        "healpy anafast, channel by channel",
        lambda: [hp.anafast(pixels, iter=sphere.N_ITER) for pixels in sample],
        len(residual) / len(sample),
    )


STEPS = [
    Step(name="HI light cone", target=(300, 12), work=light_cone, needs=floors.light_cone),
    Step(
        name="observations, three beams",
        target=(240, 6),
        work=observations,
        needs=floors.observations,
        beside=beside_observations,
    ),
    Step(name="peak masking", target=(10, 8), work=peaks, needs=floors.lines, beside=beside_polynomials),
    Step(name="PCA", target=(8, 3), work=_cleaner("pca"), needs=floors.pca, beside=beside_pca),
    Step(
        name="polynomial",
        target=(8, 3),
        work=_cleaner("polynomial"),
        needs=floors.lines,
        beside=beside_polynomials,
    ),
    Step(
        name="FastICA", target=(12, 3), work=_cleaner("fastica"), needs=floors.fastica, beside=beside_fastica
    ),
    Step(
        name="parametric",
        target=(8, 3),
        work=_cleaner("parametric"),
        needs=floors.parametric,
        beside=beside_parametric,
    ),
    Step(name="GMCA", target=(80, 10), work=_cleaner("gmca"), needs=floors.gmca),
    Step(
        name="harmonic analysis",
        target=(60, 6),
        work=analysis,
        needs=floors.analysis,
        beside=beside_analysis,
    ),
    Step(name="BeamSubspace", target=(25, 3), work=beam_subspace, needs=floors.beam_subspace),
    Step(name="SDecGMCA", target=(150, 8), work=_cleaner("sdecgmca"), needs=floors.sdecgmca),
    Step(
        name="all measures",
        target=(6, 3),
        work=measures,
        needs=floors.spectra,
        beside=beside_spectra,
    ),
]
