"""Time every step of the chain, and the ratio to the usual alternative in the same run.

    python -m benchmarks.chain --preset quick

A ratio above 1 means that the alternative takes longer. Times depend on the machine, ratios less so.
"""

import resource
import sys
import time

import click
import healpy as hp
import numpy as np
from sklearn.decomposition import PCA as SklearnPCA

from himap import spectra, sphere
from himap.instrument.beams import beam_model
from himap.instrument.noise import noise_maps
from himap.instrument.observe import observe
from himap.removal.pca import PCA
from himap.sky.foregrounds import foreground_maps
from himap.sky.galaxy import Galaxy
from himap.sky.hi import hi_maps
from himap.survey import PRESETS, Survey

N_SAMPLES = 8  # maps that an alternative is timed on


def timed(function, *args, **kwargs):
    """Result and seconds of a call."""
    start = time.perf_counter()
    result = function(*args, **kwargs)
    return result, time.perf_counter() - start


def peak_memory():
    """Peak memory of the process so far, GB."""
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB on Linux
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9


def per_map(function, maps):
    """Seconds per map of `function`, over `N_SAMPLES` maps after one that does not count."""
    function(maps[0])
    _, seconds = timed(lambda: [function(pixels) for pixels in maps[:N_SAMPLES]])
    return seconds / min(N_SAMPLES, len(maps))


def report(step, seconds, alternative="", ratio=None):
    """One line: time, peak memory of the process so far, and the ratio."""
    versus = f"{ratio:6.2f} x  {alternative}" if ratio else ""
    click.echo(f"{step:28s} {seconds:8.3g} s  {peak_memory():6.2f} GB  {versus}".rstrip())


def plain_frequency_power(maps, width):
    """The frequency power spectrum in one numpy expression, on a float64 copy of the cube."""
    centred = maps - maps.mean(axis=1, keepdims=True, dtype=float)
    return (np.abs(width * np.fft.rfft(centred, axis=0)) ** 2).mean(axis=1) / (len(maps) * width)


@click.command()
@click.option("--preset", type=click.Choice(list(PRESETS)), default="quick", show_default=True)
def main(preset):
    """Time the chain at one preset."""
    survey = Survey.preset(preset)
    hi_maps(Survey.preset("ci", box_cells=16, nside=4), survey.rng("warm up"))  # compiles
    hi, seconds = timed(hi_maps, survey, survey.rng("hi"))
    report("HI light cone", seconds)
    foregrounds, seconds = timed(foreground_maps, survey, Galaxy())
    report("foregrounds", seconds)
    noise = noise_maps(survey, survey.rng("noise"))
    beam = beam_model("degraded", survey)
    seen, seconds = timed(observe, hi, foregrounds, noise, beam, survey)
    report("observation, degraded beam", seconds)

    sample = foregrounds[:N_SAMPLES].astype(float)
    ours = per_map(sphere.analyse, sample)
    report(
        "analysis of a map", ours, "healpy.map2alm, iter=sphere.N_ITER", per_map(hp.map2alm, sample) / ours
    )
    alms = sphere.analyse(sample)
    ours = per_map(lambda alm: sphere.synthesise(alm, survey.nside), alms)
    theirs = per_map(lambda alm: hp.alm2map(alm, survey.nside), alms)
    report("synthesis of a map", ours, "healpy.alm2map", theirs / ours)

    cleaned, ours = timed(PCA(n_sources=3).clean, seen.maps, freqs=seen.freqs)
    _, theirs = timed(SklearnPCA(n_components=3).fit_transform, seen.maps.T.astype(float))
    report("PCA", ours, "scikit-learn, fit_transform in float64", theirs / ours)

    _, ours = timed(spectra.angular_power, cleaned.residual)
    theirs = (
        per_map(lambda pixels: hp.anafast(pixels, iter=sphere.N_ITER), cleaned.residual) * survey.n_channels
    )
    report("angular power spectra", ours, f"healpy.anafast ({N_SAMPLES} maps, scaled)", theirs / ours)
    _, ours = timed(spectra.frequency_power, cleaned.residual, survey.channel_width)
    _, theirs = timed(plain_frequency_power, cleaned.residual, survey.channel_width)
    report("frequency power spectrum", ours, "numpy, whole cube at once", theirs / ours)


if __name__ == "__main__":
    main()
