"""Time and memory of every step of the chain, its floor on this machine, and the usual alternative.

    python -m benchmarks --preset laptop -o steps.json

Each step has a process of its own and starts from what the cache holds of the steps before it; its own
result is computed, whatever the cache holds. The floor is what the transforms, bytes and operations that a
step cannot do without take on this machine, measured just before. A ratio above 1 means that the
alternative takes longer.
"""

import time
from dataclasses import asdict
from functools import wraps

import click

from benchmarks.floors import Machine
from benchmarks.measure import Benchmark, measured, write_result
from benchmarks.steps import STEPS, prepare
from himap.app.parameters import parse_texts
from himap.app.stored_tables import steps_table
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


@click.command(cls=Benchmark)
@case_options
@click.option("--only", multiple=True, type=click.Choice([step.name for step in STEPS]), help="These steps.")
@click.option("--alone", is_flag=True, help="Without the alternatives.")
@click.option("-o", "--output", metavar="FILE", type=click.Path(dir_okay=False), help="JSON file to write.")
def main(preset, case, only, alone, output):
    """Measure the steps at one preset."""
    survey, started, rows = case.survey, time.monotonic(), []
    size = {name: getattr(survey, name) for name in ("nside", "n_channels", "box_cells")}
    machine = Machine.measured(survey.nside)
    prepare(case)
    for step in STEPS:
        if only and step.name not in only:
            continue
        found = measured(step, case, alternatives=not alone)
        click.echo(f"{step.name}: {found.seconds:.3g} s, {found.memory / 1e9:.2f} GB")
        row = {
            "step": step.name,
            "seconds": found.seconds,
            "memory_gb": found.memory / 1e9,
            "goal_seconds": step.target[0],
            "goal_gb": step.target[1],
            "floor_seconds": found.needs.floor(machine),
            "channels_per_second": survey.n_channels / found.seconds,
        }
        if found.alternatives:
            name, seconds, share = found.alternatives[0]
            row["alternative"] = {"name": name, "seconds": seconds, "measured_share": share}
        rows.append(row)
        given = {"galaxy": case.galaxy, "preset": preset, "parameters": {"beam": str(case.beam)}}
        about = {"size": size} | asdict(Provenance.of(survey, **given, started=started))
        stored = {"about": about, "machine": asdict(machine), "steps": rows}
        write_result(output, stored)  # after each, for the next may run out of memory
    click.echo(f"\n{steps_table(stored)}")


if __name__ == "__main__":
    main()
