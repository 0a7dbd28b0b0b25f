"""How the cost of every step grows with nside and with the number of channels, and a figure of it.

    python -m benchmarks.scaling -o book/results/scaling.json --figure book/_static/scaling.png

An exponent is p of cost = a x^p between the two largest sizes, for the smallest is ruled by fixed costs.
A shared machine changes its pace within minutes, so a probe of it is timed before and after every
measurement, and costs are those at the quickest pace that was seen. `--draw` draws the figure of a file
again.
"""

import json
from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter

import click
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.measure import measured
from benchmarks.steps import STEPS
from himap.instrument.beams.oscillating import Oscillating
from himap.maps import sphere
from himap.paper import pipeline, plan
from himap.products.provenance import Provenance
from himap.survey import PRESETS

SIZES = {
    "nside": [{"nside": n, "box_cells": 4 * n} for n in (32, 64, 128)],
    "n_channels": [{"n_channels": n} for n in (62, 125, 250)],
}
LABELS = {"nside": r"$N_\mathrm{side}$ (100 channels)", "n_channels": r"channels ($N_\mathrm{side} = 64$)"}
BASES = {"nside": replace(PRESETS["ci"], nside=64), "n_channels": PRESETS["quick"]}
_MARKERS = "osv^D<>pP*"


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
        surveys = [replace(BASES[name], **changed) for changed in variants]
        sizes = [getattr(survey, name) for survey in surveys]
        runs = {step.name: [] for step in steps}
        for survey in surveys:
            case = pipeline.Case(survey=survey, beam=Oscillating())
            plan.make_observations([case])
            for step in steps:
                probe_before = probe()
                measurement = measured(step, case, beside=False)
                runs[step.name].append((measurement, (probe_before + probe()) / 2))
        costs[name] = {}
        for step, measurements in runs.items():
            probes = [paced for _, paced in measurements]
            seconds = at_one_pace([(measurement.seconds, paced) for measurement, paced in measurements])
            costs[name][step] = {
                "sizes": sizes,
                "seconds": seconds,
                "probe": probes,
                "memory_gb": [measurement.memory / 1e9 for measurement, _ in measurements],
                "exponent": exponents(sizes, seconds),
            }
            click.echo(f"{name:11s} {step:26s} {costs[name][step]['exponent']:.2f}  {seconds}")
    return costs


def draw(costs, path):
    """Two panels, cost against what grows, a line for each step with its exponent in the legend."""
    figure, axes = plt.subplots(1, 2, figsize=(10.4, 7), sharey=True, layout="constrained")
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.9, len(STEPS)))
    for axis, (name, steps) in zip(axes, costs.items(), strict=True):
        for (step, run), marker, shade in zip(steps.items(), _MARKERS, shades, strict=False):
            label = f"{step}, {run['exponent']:.1f}"
            axis.plot(run["sizes"], run["seconds"], marker=marker, color=shade, label=label)
        axis.set(xscale="log", yscale="log", xlabel=LABELS[name])
        axis.set_xticks(run["sizes"], [str(size) for size in run["sizes"]], minor=False)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
        axis.legend(
            title="step, exponent", fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.12)
        )
    axes[0].set_ylabel("time [s]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


@click.command()
@click.option("-o", "--output", type=click.Path(dir_okay=False), help="JSON file to write.")
@click.option("--figure", type=click.Path(dir_okay=False), help="Picture to write.")
@click.option("--draw", "recorded", type=click.Path(exists=True), help="Draw this file.")
@click.option("--only", multiple=True, type=click.Choice([step.name for step in STEPS]), help="These steps.")
def main(output, figure, recorded, only):
    """Measure the steps at several sizes."""
    if recorded:
        costs = json.loads(Path(recorded).read_text())["found"]
    else:
        costs = measure([step for step in STEPS if not only or step.name in only])
    if output:
        about = asdict(Provenance.of(BASES["nside"], galaxy="synthetic", preset="ci", parameters={}))
        Path(output).write_text(json.dumps({"about": about, "found": costs}, indent=1) + "\n")
    if figure:
        draw(costs, figure)


if __name__ == "__main__":
    main()
