"""`himap readings`: what every reading of the paper's SDecGMCA leads to."""

import time
from dataclasses import asdict

import click

from himap.cli.shared import (
    debug,
    json_output,
    judging_parameters,
    overwrite_option,
    provenance_parameters,
    workers,
)
from himap.companion.notebook_files import copy_name
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
@overwrite_option
@workers
@debug
def readings(preset, pairs, output, overwrite):
    """Judge every claim under every reading of the paper's SDecGMCA.

    Each reading is judged on two seeds unless told otherwise, and through the oscillating beam with the noise
    level that SDecGMCA is told 0.1 % lower and higher too. What was interrupted goes on where it stopped.

    The table tells of each in how many runs it fails (mean |C/C0 - 1| above 10 % at 10 < l < 200), how many
    claims are reproduced (✓), in part (≈), not (✗) or do not apply (–), and of bands of C/C0 and P/P0 what
    is furthest from 1.

    \b
    himap readings --preset quick -p galaxy=templates -p template_dir=maps --jobs 2
    """
    # Imported here: other commands need not wait seconds for what does the work.
    from himap.companion.staleness import readings_code
    from himap.instrument.beams.oscillating import Oscillating
    from himap.paper import ledger, readings_file, readings_table
    from himap.paper.readings import evaluate

    chosen, given = judging_parameters(pairs, preset, own=_OWN, without=_WITHOUT)
    preset = chosen["preset"]
    name = copy_name("readings", preset, given, suffix=".json")
    path = json_output(output, name, overwrite=overwrite)
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
