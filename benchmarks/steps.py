"""The steps of the chain, each with what it needs at least and with what people use instead.

A step computes from what the steps before it keep in the cache; its own result is not read from there.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import healpy as hp

from benchmarks import floors
from benchmarks.alternatives import alternatives_to, evenly
from himap import removal
from himap.maps import sphere
from himap.paper import cleaned, pipeline
from himap.paper.methods import paper_beams, sdecgmca_for, table_1
from himap.removal.base import SeparationWarning
from himap.sky.emission import emission_maps

N_SAMPLES = 6  # channels that an alternative is timed on


@dataclass(frozen=True, kw_only=True)
class Step:
    """One row of the table; a process of its own gets it, so that it holds no lambdas.

    What is timed is `work`, called with the `Case`. With what that returned, `alternatives` are called for
    what `alternatives_to` gives, and `needs`, with the `Survey`, for its `Needs`. The `target` are (seconds,
    GB) that it should stay within at preset `paper`, on 2 cores and an idle machine.
    """

    name: str
    work: Callable
    alternatives: Callable | None = None
    target: tuple = ()
    needs: Callable | None = None


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


def usual_observations(case, _):
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

    return [("healpy, each beam and component by itself", work, case.survey.n_channels / len(channels))]


def peaks(case):
    """Peak masking of one observation."""
    pipeline.peak_masked.compute(case)


def usual_peaks(case, _):
    """The alternatives to a fit of polynomials."""
    return alternatives_to(case, None, None)


def method_of(beam, name, **changed):
    """The method called `name` with the paper's parameters for a beam, but for `changed`."""
    if name == "sdecgmca":
        return sdecgmca_for(beam, **changed)
    method = removal.create(name, **changed)
    if hasattr(method, "n_sources") and not changed:
        method = replace(method, n_sources=table_1(beam)["n_sources"])
    return method


def separate(case, name, **changed):
    """The separation by a method, from what the cache holds of the observation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeparationWarning)
        return cleaned.separation.compute(case, method_of(case.beam, name, **changed))


def usual_method(case, found, name, **changed):
    """The alternatives to a method."""
    return alternatives_to(case, method_of(case.beam, name, **changed), found)


def step_of(name, label="", *, target=(), needs=None, **changed):
    """The step of one method, with the parameters of `method_of`."""
    options = {"name": name, **changed}
    return Step(
        name=label or name,
        target=target,
        work=partial(separate, **options),
        needs=needs,
        alternatives=partial(usual_method, **options),
    )


def analysis(case):
    """Coefficients of every channel of the peak-masked maps, which methods that know the beam share."""
    pipeline.analysis.compute(case)


def usual_analysis(case, _):
    """healpy's map2alm without refinements, float64, channel by channel."""
    return _by_channel(
        "healpy map2alm, no refinement", pipeline.observation(case).maps, partial(hp.map2alm, iter=0)
    )


def _by_channel(name, maps, work):
    """The alternative that does `work` on each channel of some maps, on a sample of them."""
    sample = maps[evenly(len(maps), N_SAMPLES)].astype(float)
    return [(name, lambda: [work(pixels) for pixels in sample], len(maps) / len(sample))]


def measures(case):
    """C_l, P(k), correlation and errors of what PCA leaves, found already."""
    cleaned.assessment.compute(case, method_of(case.beam, "pca"))


def prepare(case):
    """Keep what steps begin with: the observation, its truth and analysis, and what PCA finds in it."""
    pipeline.true_spectra(case)
    pipeline.foreground_seen(case)
    pipeline.analysis(case)
    cleaned.separation(case, method_of(case.beam, "pca"))


def usual_spectra(case, _):
    """healpy's anafast, channel by channel."""
    residual = cleaned.residual(case, method_of(case.beam, "pca"))
    return _by_channel(
        "healpy anafast, channel by channel", residual, partial(hp.anafast, iter=sphere.N_ITER)
    )


STEPS = [
    Step(name="HI light cone", target=(300, 12), work=light_cone, needs=floors.light_cone),
    Step(
        name="observations, three beams",
        target=(240, 6),
        work=observations,
        needs=floors.observations,
        alternatives=usual_observations,
    ),
    Step(name="peak masking", target=(10, 8), work=peaks, needs=floors.lines, alternatives=usual_peaks),
    step_of("pca", "PCA", target=(8, 3), needs=floors.pca),
    step_of("polynomial", target=(8, 3), needs=floors.lines),
    step_of("fastica", "FastICA", target=(12, 3), needs=floors.fastica),
    step_of("parametric", target=(8, 3), needs=floors.parametric),
    step_of("gmca", "GMCA", target=(80, 10), needs=floors.gmca),
    Step(
        name="harmonic analysis",
        target=(60, 6),
        work=analysis,
        needs=floors.analysis,
        alternatives=usual_analysis,
    ),
    step_of("beam_subspace", "BeamSubspace", target=(25, 3), needs=floors.beam_subspace, n_sources=3),
    step_of("sdecgmca", "SDecGMCA", target=(150, 8), needs=floors.sdecgmca),
    Step(name="all measures", target=(6, 3), work=measures, needs=floors.spectra, alternatives=usual_spectra),
]
