"""`himap corrections`: how well transfer functions correct what the methods lose."""

import time
from dataclasses import asdict
from pathlib import Path

import click

from himap.checks import whole_number
from himap.cli.shared import debug, judging_parameters, provenance_parameters, workers
from himap.companion.notebook_files import check_output, copy_name
from himap.companion.parameters import Parameter
from himap.figures.tables import Table
from himap.products.fingerprint import CodeTree
from himap.products.provenance import Provenance

__all__ = ["corrections"]

_CHAPTER = "20_transfer_function"  # the notebook whose parameters it has
_MORE = [Parameter("n_realisations", "int", 20, "skies, each with a seed of its own")]
_OWN = {
    "n_mocks": 10,
    "methods": [["beam_subspace", 3], ["pca", 5], ["pca", 8], ["gmca", 5], ["sdecgmca", 5]],
}
_WITHOUT = ("results",)  # what the notebook shows


@click.command()
@click.option("--preset", help="ci, quick, laptop or paper; default: quick.")
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help=f"A parameter, as of {_CHAPTER}.")
@click.option(
    "-o", "--output", help="Where to write the JSON; default results/corrections_PRESET_PARAMETERS.json."
)
@workers
@debug
def corrections(preset, pairs, output):
    """Measure how well transfer functions correct what methods lose.

    Mocks are put into the observation of every sky and cleaned with it; the power of what comes back of them
    corrects the power of what is left, which is held against the truth. On 20 skies with 10 mocks unless told
    otherwise. What was interrupted goes on where it stopped.

    The table tells of each band of C_l and P(k) the mean over skies of the ratio to the truth, as it is left,
    corrected, and corrected by the other definition; the scatter of what is corrected, that which the mocks
    foretell, and on how many skies the truth lies within the last.

    \b
    himap corrections --preset laptop -p galaxy=templates -p template_dir=maps --jobs 2
    """
    # Imported here: other commands need not wait seconds for what does the work.
    from himap.companion.staleness import corrections_code
    from himap.paper import corrections as measured
    from himap.paper.corrections_file import write_corrections
    from himap.paper.mocks import first_mocks

    chosen, given = judging_parameters(
        pairs, preset, own=_OWN, without=_WITHOUT, more=_MORE, notebook=_CHAPTER
    )
    preset = chosen["preset"]
    name = copy_name("corrections", preset, given, suffix=".json")
    path = check_output(Path(output) if output else Path("results") / name, suffix=".json")
    started = time.monotonic()
    n_mocks = whole_number("n_mocks", chosen.pop("n_mocks"), 2, 1000)  # one has no scatter
    cases, removers = measured.cases_and_methods(**chosen)
    rows = measured.evaluate(cases, removers, first_mocks(n_mocks, cases))
    about = Provenance.of(
        cases[0].survey,
        galaxy=cases[0].galaxy,
        preset=preset,
        parameters={"n_realisations": len(cases), "n_mocks": n_mocks} | provenance_parameters(given),
        started=started,
    )
    code = corrections_code(CodeTree(loaded=True))  # that ran, whatever was edited in the hours since
    write_corrections(rows, path, asdict(about) | {"code": code})
    click.echo(Table(measured.HEADER, measured.summary(rows), align="llr" + "r" * len(measured.HEADER)))
    click.echo(f"{path}  ({time.monotonic() - started:.0f} s)")
