"""Time and memory of every method of foreground removal, and of its alternatives in the same run.

    python -m benchmarks.methods --preset laptop --beam oscillating

Methods get the paper's number of components and find the foreground in the peak-masked maps. A ratio above 1
means that the alternative takes longer. Times depend on the machine, ratios less so.
"""

import click

from benchmarks.__main__ import case_options
from benchmarks.measure import Benchmark, measured
from benchmarks.steps import STEPS, prepare, step_of
from himap import removal


@click.command(cls=Benchmark)
@case_options
def main(preset, case):
    """Time all methods on one observation."""
    survey = case.survey
    click.echo(
        f"{preset}: {survey.n_channels} channels, nside {survey.nside}, {case.galaxy.source} Galaxy, "
        f"{case.beam} beam. N x: the alternative takes N times as long."
    )
    prepare(case)
    for step in [
        *(step for step in STEPS if step.name == "peak masking"),
        *map(step_of, removal.available()),
    ]:
        found = measured(step, case)
        click.echo(f"{step.name:20}  {found.seconds:9.3g} s  {found.memory / 1e9:7.2f} GB")
        for name, seconds, share in found.alternatives:
            sampled = f" (from {share:.2g} of it)" if share < 1 else ""
            click.echo(f"    {seconds / found.seconds:10.2f} x  {name}{sampled}")


if __name__ == "__main__":
    main()
