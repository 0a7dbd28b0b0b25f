"""Time and memory of every step of the chain, its floor on this machine, and the usual alternative.

    python -m benchmarks --preset laptop -o steps.json

Each step has a process of its own and starts from what the cache holds of the steps before it; its own
result is computed, whatever the cache holds. The floor is what the transforms, bytes and operations that a
step cannot do without take on this machine, measured just before. A ratio above 1 means that the
alternative takes longer.
"""

import json
import time
from dataclasses import asdict
from functools import wraps

import click

from benchmarks.machine import Machine
from benchmarks.measure import measured
from benchmarks.steps import STEPS, prepare
from himap.app.parameters import parse_texts
from himap.core.files import atomic_files
from himap.core.survey import PRESETS, Survey
from himap.instrument.beams import named
from himap.paper import pipeline
from himap.sky.galaxy import SOURCES, Galaxy
from himap.store.provenance import Provenance

_OPTIONS = [
    click.option("--preset", type=click.Choice(list(PRESETS)), default="quick", show_default=True),
    click.option("--survey", "pairs", type=(str, str), multiple=True, help="Survey field and its value."),
    click.option("--galaxy", type=click.Choice(SOURCES), default="synthetic", show_default=True),
    click.option("--template-dir", help="Folder of the templates."),
    click.option("--beam", default="oscillating", show_default=True, help="Name of a beam, or a file."),
]


def case_options(command):
    """A command that takes the name of a preset and a `Case` gets the options that make them."""

    @wraps(command)
    def with_case(preset, pairs, galaxy, template_dir, beam, **others):
        survey = Survey.preset(preset, **parse_texts([], dict(pairs)))
        sky = Galaxy(source=galaxy, template_dir=template_dir)
        return command(preset, pipeline.Case(survey=survey, galaxy=sky, beam=named(beam)), **others)

    for option in reversed(_OPTIONS):
        with_case = option(with_case)
    return with_case


@click.command()
@case_options
@click.option("--only", multiple=True, type=click.Choice([step.name for step in STEPS]), help="These steps.")
@click.option("--alone", is_flag=True, help="Without the alternatives.")
@click.option("-o", "--output", metavar="FILE", type=click.Path(dir_okay=False), help="JSON file to write.")
def main(preset, case, only, alone, output):
    """Measure the steps at one preset."""
    survey, galaxy, started = case.survey, case.galaxy.source, time.monotonic()
    machine = Machine.measured(survey.nside)
    click.echo(
        f"{preset}: nside {survey.nside}, {survey.n_channels} channels, {survey.box_cells}^3 cells, {galaxy} "
        f"Galaxy, {case.beam} beam.\nThis machine: {machine.bandwidth / 1e9:.3g} GB/s, "
        f"{machine.operations / 1e9:.3g} GFlop/s (float32 {machine.operations_single / 1e9:.3g}), "
        f"a transform {1e3 * machine.transform:.3g} ms (float32 {1e3 * machine.transform_single:.3g})."
    )
    header = ("step", "time", "goal", "memory", "goal", "floor", "over it", "channels/s", "alternative")
    click.echo(line_of(header))
    prepare(case)
    rows = []
    for step in STEPS:
        if only and step.name not in only:
            continue
        measurement = measured(step, case, beside=not alone)
        rows.append(_row(step, measurement, machine, survey))
        click.echo(line_of(_texts(rows[-1], preset)))
        if output:  # after each, for the next may run out of memory
            about = _about(preset, case, started)
            text = json.dumps({"about": about, "machine": asdict(machine), "steps": rows}, indent=1)
            with atomic_files(output) as (temporary,):
                temporary.write_text(text + "\n")


def _about(preset, case, started):
    size = {name: getattr(case.survey, name) for name in ("nside", "n_channels", "box_cells")}
    provenance = Provenance.of(
        case.survey,
        galaxy=case.galaxy,
        preset=preset,
        parameters={"beam": str(case.beam)},
        started=started,
    )
    return {"size": size} | asdict(provenance)


def _row(step, measurement, machine, survey):
    row = {
        "step": step.name,
        "seconds": measurement.seconds,
        "memory_gb": measurement.memory / 1e9,
        "goal_seconds": step.target[0],
        "goal_gb": step.target[1],
        "floor_seconds": measurement.needs.floor(machine),
        "channels_per_second": survey.n_channels / measurement.seconds,
    }
    if measurement.alternatives:
        name, seconds, share = measurement.alternatives[0]
        row["alternative"] = {"name": name, "seconds": seconds, "measured_share": share}
    return row


def _texts(row, preset):
    goals = (f"{row['goal_seconds']} s", f"{row['goal_gb']} GB") if preset == "paper" else ("", "")
    beside = row.get("alternative")
    return (
        row["step"],
        f"{row['seconds']:.3g} s",
        goals[0],
        f"{row['memory_gb']:.2f} GB",
        goals[1],
        f"{row['floor_seconds']:.2g} s",
        f"{row['seconds'] / row['floor_seconds']:.2g} x",
        f"{row['channels_per_second']:.3g}",
        f"{beside['seconds'] / row['seconds']:.2g} x  {beside['name']}" if beside else "",
    )


def line_of(cells, widths=(26, 9, 6, 9, 6, 8, 8, 11)):
    """A line of a table, with its last cell as long as it is."""
    padded = [cell.rjust(width) for cell, width in zip(cells[1:], widths[1:], strict=False)]
    return "  ".join([cells[0].ljust(widths[0]), *padded, cells[-1]]).rstrip()


if __name__ == "__main__":
    main()
