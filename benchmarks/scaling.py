"""How the cost of every step grows with nside and with the number of channels.

    python -m benchmarks.scaling -o book/results/scaling.json

An exponent is p of cost = a x^p between the two largest sizes, for the smallest is ruled by fixed costs.
A shared machine changes its pace within minutes, so a probe of it is timed before and after every
measurement, and the costs of a step are those at the quickest pace among its sizes. The book's chapter on
scale draws them.
"""

from dataclasses import asdict, replace
from time import perf_counter

import click
import numpy as np

from benchmarks.measure import Benchmark, measured, write_result
from benchmarks.steps import STEPS, prepare
from himap.core.survey import PRESETS
from himap.instrument.beams.paper import Oscillating
from himap.maps import sphere
from himap.paper import pipeline
from himap.store.provenance import Provenance

SIZES = {
    "nside": [{"nside": n, "box_cells": 4 * n} for n in (32, 64, 128)],
    "n_channels": [{"n_channels": n} for n in (125, 250, 500)],
}
BASES = {"nside": "ci", "n_channels": "laptop"}


def exponents(sizes, seconds):
    """p of seconds = a size^p between the two largest sizes."""
    return float(np.log(seconds[-1] / seconds[-2]) / np.log(sizes[-1] / sizes[-2]))


def at_one_pace(runs):
    """What each of [(seconds, seconds of the probe)] would be at the quickest pace among them."""
    quickest = min(probe for _, probe in runs)
    return [seconds * quickest / probe for seconds, probe in runs]


def probe():
    """Seconds of a fixed piece of work, half of it transforms, half products of matrices."""
    rng = np.random.default_rng(0)
    alm, matrix = sphere.gaussian_alm(np.ones(384), rng), rng.standard_normal((1000, 1000))
    started = perf_counter()
    for _ in range(20):
        sphere.synthesise(alm, 128)
        matrix @ matrix
    return perf_counter() - started


def measure(steps):
    """{what grows: {step: {"sizes", "seconds", "probe", "memory_gb", "exponent"}}}."""
    costs = {}
    for name, variants in SIZES.items():
        surveys = [replace(PRESETS[BASES[name]], **changed) for changed in variants]
        sizes = [getattr(survey, name) for survey in surveys]
        runs = {step.name: [] for step in steps}
        for survey in surveys:
            case = pipeline.Case(survey=survey, beam=Oscillating())
            prepare(case)
            for step in steps:
                probe_before = probe()
                measurement = measured(step, case, alternatives=False)
                runs[step.name].append((measurement, (probe_before + probe()) / 2))
        costs[name] = {}
        for step, pairs in runs.items():
            seconds = at_one_pace([(measurement.seconds, paced) for measurement, paced in pairs])
            costs[name][step] = {
                "sizes": sizes,
                "seconds": seconds,
                "probe": [paced for _, paced in pairs],
                "memory_gb": [measurement.memory / 1e9 for measurement, _ in pairs],
                "exponent": exponents(sizes, seconds),
            }
            click.echo(f"{name:11s} {step:26s} {costs[name][step]['exponent']:.2f}  {seconds}")
    return costs


@click.command(cls=Benchmark)
@click.option("-o", "--output", metavar="FILE", type=click.Path(dir_okay=False), help="JSON file to write.")
@click.option("--only", multiple=True, type=click.Choice([step.name for step in STEPS]), help="These steps.")
def main(output, only):
    """Measure the steps at several sizes."""
    costs = measure([step for step in STEPS if not only or step.name in only])
    about = asdict(Provenance.of(PRESETS["ci"], galaxy="synthetic", preset="ci"))
    about["preset"] = ", ".join(f"{name} at {preset}" for name, preset in BASES.items())
    write_result(output, {"about": about, "found": costs})


if __name__ == "__main__":
    main()
