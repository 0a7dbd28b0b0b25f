"""`himap readings`: what every reading of the paper's SDecGMCA leads to."""

import time
from dataclasses import asdict
from pathlib import Path

import click

from himap.cli.shared import debug, judging_parameters, provenance_parameters, workers
from himap.companion.notebook_files import check_output, copy_name
from himap.figures.tables import Table
from himap.products.fingerprint import CodeTree
from himap.products.provenance import Provenance

__all__ = ["readings"]

_OWN = {"preset": "quick", "n_realisations": 2, "n_sources_max": 12}
_WITHOUT = ("reading", "method", "nudged")  # they are what is varied, or always so


@click.command()
@click.option("--preset", help="ci, quick, laptop or paper; default: quick.")
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter, as of `himap claims`.")
@click.option(
    "-o", "--output", help="Where to write the JSON; default results/readings_PRESET_PARAMETERS.json."
)
@workers
@debug
def readings(preset, pairs, output):
    """Judge every claim under every reading of what the paper leaves open about SDecGMCA.

    The readings with a name (default, letter, code, follow-up), and the default with one choice changed at a
    time; each on two seeds unless told otherwise, and through the oscillating beam with the noise level that
    SDecGMCA is told 0.1 % lower and higher too. All share skies, observations and the other methods, and what
    was interrupted goes on where it stopped.

    The table has one row for each reading: how many choices are not as the paper's text has them, in how many
    runs it fails (mean |C/C0 - 1| above 10 % at 10 < l < 200), how many claims are reproduced (✓), in part
    (≈), not (✗) or do not apply (–), and of bands of C/C0 and P/P0 and of the bump near k = 0.31 what is
    furthest from 1.

    \b
    himap readings --preset ci --jobs 2
    himap readings --preset quick -p galaxy=templates -p template_dir=maps -p n_realisations=2 --jobs 2
    """
    # Imported here: other commands need not wait seconds for what does the work.
    from himap.companion.staleness import readings_code
    from himap.instrument.beams.oscillating import Oscillating
    from himap.paper import ledger, readings_file, readings_table
    from himap.paper.readings import evaluate

    chosen, given = judging_parameters(pairs, preset, own=_OWN, without=_WITHOUT)
    preset = chosen["preset"]
    name = copy_name("readings", preset, given, suffix=".json")
    path = check_output(Path(output) if output else Path("results") / name, suffix=".json")
    started = time.monotonic()
    oscillating = Oscillating(ripple=chosen.pop("ripple"))
    skies = ledger.realisations(**chosen, oscillating=oscillating)
    outcomes = evaluate(skies)
    about = Provenance.of(
        skies[0].survey,
        galaxy=skies[0].galaxy,
        preset=preset,
        parameters={"n_realisations": len(skies), "n_sources_max": chosen["n_sources_max"]}
        | provenance_parameters(given),
        started=started,
    )
    code = readings_code(CodeTree(loaded=True))  # that ran, whatever was edited in the hours since
    readings_file.write_readings(outcomes, path, asdict(about) | {"code": code})
    click.echo(Table(readings_table.HEADER, readings_table.plain_rows(outcomes)))
    click.echo(f"{path}  ({time.monotonic() - started:.0f} s)")
