"""Time and memory of every method of foreground removal, and of the usual alternative in the same run.

    python -m benchmarks.methods --preset laptop --beam oscillating

Each method runs in a process of its own, on memory-mapped cubes, so that peaks of memory do not mix. Methods
get the paper's number of components and find the foreground in the peak-masked maps. A ratio above 1 means
that the alternative takes longer. Times depend on the machine, ratios less so.
"""

import resource
import sys
import tempfile
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import click
import numpy as np

from benchmarks.alternatives import Run, alternatives, timed
from benchmarks.cases import case_options
from himap import removal
from himap.core.survey import Survey
from himap.instrument.noise import noise_sigma
from himap.paper import pipeline
from himap.paper.methods import sdecgmca_for, table_1
from himap.removal.base import SeparationWarning
from himap.removal.peaks import mask_peaks
from himap.removal.sdecgmca.method import SDecGMCA

PRELOADED = ["benchmarks.alternatives"]  # with all that it imports


@dataclass(frozen=True, kw_only=True)
class Data:
    """What every process gets: cubes in two files, and what goes with them."""

    folder: Path
    freqs: np.ndarray
    beams: np.ndarray
    survey: Survey

    def cube(self, name):
        """The cube "maps" or "masked", memory-mapped, with all its pages in memory."""
        cube = np.load(self.folder / f"{name}.npy", mmap_mode="r")
        for channel in cube:
            channel.sum()
        return cube


def peak_memory():
    """Peak memory of the process so far, GB."""
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB on Linux
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9


def alone(function, *args):
    """Result of a call in a process of its own, forked from one that has imported everything and no more."""
    context = get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(function, *args).result()


def prepare(case, folder):
    """The `Data` of a case, from the cache where it is there."""
    observation = pipeline.observation(case)
    np.save(folder / "maps.npy", observation.maps)
    np.save(folder / "masked.npy", pipeline.peak_masked(case).maps)
    freqs, beams = np.array(observation.freqs), np.array(observation.beams)
    return Data(folder=folder, freqs=freqs, beams=beams, survey=case.survey)


def methods(beam):
    """Every method with the paper's number of components, by its label; None for peak masking."""
    removers = {"peak masking": None}
    for name in removal.available():
        method = removal.create(name)
        if hasattr(method, "n_sources"):
            method = replace(method, n_sources=table_1(beam)["n_sources"])
        removers[name] = method
    removers[SDecGMCA.name] = sdecgmca_for(beam)
    return removers


def measure(label, remover, data):
    """The lines of the table on one method: ours, its warnings, its alternatives."""
    maps, masked = data.cube("maps"), data.cube("masked")
    if remover is None:
        work = partial(mask_peaks, maps, data.freqs)
    else:
        given = {"freqs": data.freqs, "beams": data.beams, "noise": noise_sigma(data.survey)}
        given["rng"] = data.survey.rng(f"removal {remover.name}")
        work = partial(remover.clean, maps, **given, separate_on=masked)
    memory_before, cpu = peak_memory(), time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SeparationWarning)
        result, seconds = timed(work)
    memory, cpu = peak_memory() - memory_before, time.process_time() - cpu
    separation = getattr(result, "separation", None)
    run = Run(
        label=label,
        remover=remover,
        maps=maps,
        masked=masked,
        freqs=data.freqs,
        beams=data.beams,
        mixing=getattr(separation, "mixing", None),
        n_iterations=getattr(separation, "n_iterations", 0),
        seconds=seconds,
    )
    del result, separation  # a cube that the alternatives do not need
    each = f"{run.n_iterations:10d} {seconds / run.n_iterations:10.3g} s" if run.n_iterations else ""
    n_sources = getattr(remover, "n_sources", "")
    lines = [f"{label:20s} {n_sources!s:>4} {seconds:9.3g} s {cpu:9.3g} s {memory:7.2f} GB {each}".rstrip()]
    lines += [f"{'':15s}warning: {warning.message}" for warning in caught]
    return "\n".join(lines + alternatives(run))


@click.command()
@case_options
def main(preset, case):
    """Time all methods on one observation."""
    survey, beam = case.survey, case.beam
    size = 4 * survey.n_channels * survey.n_pix / 1e9
    click.echo(
        f"{preset}: {survey.n_channels} channels, nside {survey.nside}, {case.galaxy.source} "
        f"Galaxy, {beam} beam.\nMemory is the peak above the two cubes given, of {size:.2g} GB each. The "
        "time of each iteration is all\ntime over their number. N x: the alternative takes N times as long, "
        "on the clock."
    )
    names = f"{'n_s':>4} {'time':>11s} {'CPU time':>11s} {'memory':>10s} {'iterations':>10s} {'each':>12s}"
    click.echo(f"{'method':20s} {names}")
    with tempfile.TemporaryDirectory() as folder:
        data = alone(prepare, case, Path(folder))
        for label, remover in methods(beam).items():
            click.echo(alone(measure, label, remover, data))


if __name__ == "__main__":
    main()
