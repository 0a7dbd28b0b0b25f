"""`himap measure`: experiments on many skies, written as records, checked and extended."""

import shutil
import textwrap
import time
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import click
import numpy as np

from himap.app.cli.shared import EXPERIMENT, PRESET, debug, named_values, overwrite_option, workers
from himap.app.notebook_files import check_output, copy_name
from himap.app.notebooks import find
from himap.app.parameters import Parameter, check_parameters, parse_texts
from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.figures.tables import Table
from himap.store.fingerprint import CodeTree
from himap.store.provenance import Provenance
from himap.store.sources import LOADED, digest_of
from himap.store.store import describe

_MOST_SOURCES = 10_000
_USUAL_WIDTH = 120  # columns if the output is not a terminal
_NARROWEST = 16  # columns of a text
_OF_HEAD = 8  # least columns of a number, to which its head is wrapped
_SKIES = Parameter("n_realisations", "int", 20, "skies, each with its own seed")
_AMOUNTS = ("n_realisations", "n_restarts", "n_mocks")  # always stored
_GROW = _AMOUNTS[:2]  # of a record
_OF_PROVENANCE = ("preset", "survey", "galaxy", "template_dir")  # parameters in a provenance


@click.command()
@click.argument("name", **EXPERIMENT)
@click.option("--preset", help="ci, quick, laptop or paper.", **PRESET)
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter of the chapter.")
@click.option("-o", "--output", metavar="FILE", help="The JSON to write; default in results/.")
@overwrite_option
@click.option("--check", metavar="FILE", help="Measure a sky of this record again, and mark it.")
@click.option("--grow", metavar="FILE", help="Add skies and restarts missing in this record.")
@workers
@debug
def measure(name, *, pairs, preset, output, overwrite, check, grow):
    """Measure the experiment NAME on many skies, and write its record. `himap list CHAPTER` shows parameters.

    \b
    authors      SDecGMCA as its authors' code was measured          (27_restarts)
    beam_errors  what it costs a method to assume a wrong beam      (21_beam_errors)
    boxes        HI in boxes of fewer and of more cells              (01_simulations)
    claims       every claim of the paper, with a verdict           (15_claims)
    flags        how often a failure shows without the truth         (15_claims)
    methods      all methods side by side, through each beam        (25_side_by_side)
    n_sources    how often a criterion finds the number of sources  (22_how_many)
    readings     every claim under every reading of SDecGMCA        (15_claims)
    restarts     SDecGMCA from several starts, in each reading       (15_claims)
    transfer     how well spectra are corrected, and their errors   (20_transfer_function)

    \b
    himap measure claims --preset laptop -p galaxy=templates -p template_dir=maps
    """
    # Imported here, so that other commands start fast.
    from himap.paper.experiments import find_experiment, measuring_code
    from himap.paper.record import Record

    experiment = find_experiment(name)
    path = grow if check is None else check
    if path is not None and (None not in (check, grow) or output is not None or overwrite):
        raise InputError(
            "--check and --grow write into the given file: give one of them, without -o and "
            "--overwrite; a record is checked before it grows."
        )
    record = None if path is None else Record.load(experiment, path)
    chosen, given = _parameters(experiment, pairs, preset, record.parameters if record else {})
    if record is None:
        default = Path("results", copy_name(name, chosen["preset"], given, suffix=".json"))
        path = check_output(default if output is None else Path(output), suffix=".json", overwrite=overwrite)
    started = time.monotonic()
    skies = experiment.skies(**chosen)
    # With one realisation and restart, since a record may grow. Includes defaults and input files.
    first = describe(experiment.skies(**chosen | {one: 1 for one in _GROW if one in chosen})[0])
    first = first.replace(repr(chosen.get("template_dir")), "")  # the content of its files counts
    stated = {one: chosen[one] for one in (*_AMOUNTS, *experiment.stated) if one in chosen}
    stated |= {one: value for one, value in given.items() if one not in _OF_PROVENANCE}

    def about(since):
        options = {"galaxy": skies[0].galaxy, "preset": chosen["preset"], "parameters": stated}
        made = Provenance.of(skies[0].survey, **options, started=since)
        # The code that ran, even if it was edited meanwhile.
        code = measuring_code(name, CodeTree(texts=LOADED))
        files = {"galaxy_files": skies[0].galaxy.digest(), "first_sky": digest_of([first])}
        return asdict(made) | files | {"code": code}

    if check is not None:
        click.echo(_checked(record, path, skies[0], chosen, partial(about, started)))
        return
    if record is None:
        rows = experiment.table(skies)
        stated |= experiment.restarts_of(rows)
        record = Record(experiment=experiment, rows=rows, about=about(started))
        record.save(path)
    else:
        for sky in record.missing(skies, about(started)):
            since = time.monotonic()
            rows = experiment.table([sky])
            record = Record.load(experiment, path)  # may have grown meanwhile
            if record.missing([sky], about(since)) != [sky]:
                raise InputError(f"{path} was grown by another command meanwhile: run this one again.")
            record = record.grow(rows, about(since))
            record.save(path)  # immediately: no sky is lost
    click.echo(_table(experiment.summary(record.rows), experiment.remark(skies[0])))
    click.echo(f"{path}  ({time.monotonic() - started:.0f} s)")


def _checked(record, path, sky, chosen, about):
    """Measure a sky of a record again, mark the record in its file as checked, and return what to print.

    `about()` is the provenance of what is measured now, with the parameters `chosen`.
    """
    experiment = record.experiment
    record.check_parameters(about())
    if _single_draws(record.rows, chosen).all():  # before the work
        raise InputError(f"{path} has only single runs of chaotic methods: measure all of it again.")
    known = record.rows[record.rows["seed"] == sky.survey.seed]
    if experiment.other_restarts and experiment.other_restarts(sky, {*known["restart"]}):
        n = known["restart"].nunique()
        raise InputError(f"{path} has {n} restarts of that sky: give n_restarts={n} or fewer.")
    rows = experiment.table([sky])
    drawn = _single_draws(rows, chosen)
    record = type(record).load(experiment, path)  # may have grown meanwhile
    record.check(rows, about(), drawn=drawn).save(path)
    n, more = drawn.sum(), "of single runs of a chaotic method are not compared"
    said = f"{len(rows) - n} rows of one sky are the same with today's code"
    return f"{path}: {said}{f'; {n} {more}' if n else ''}."


def _table(summary, note):
    """The `Table` of a summary, numbers right-aligned and long texts wrapped to fit the terminal."""
    align = "".join("r" if summary[name].str.match(r"[-+–.\d]|$").all() else "l" for name in summary)
    width = shutil.get_terminal_size((_USUAL_WIDTH, 0)).columns - 2 * (len(align) - 1)
    longest = [max(map(len, (name[:_OF_HEAD], *summary[name]))) for name in summary]

    def capped(cap):
        return [min(one, cap) if side == "l" else one for one, side in zip(longest, align, strict=True)]

    caps = range(max(longest), _NARROWEST, -1)
    widths = capped(next((cap for cap in caps if sum(capped(cap)) <= width), _NARROWEST))
    header, *rows = (
        [textwrap.fill(cell, cap) for cell, cap in zip(row, widths, strict=True)]
        for row in (summary.columns, *summary.itertuples(index=False))
    )
    return Table(header, rows, align=align, note=note)


def _single_draws(rows, chosen):
    """Which rows are of single runs of chaotic methods, an array, given the parameters `chosen`.

    These have such a method in the column "method"; for restarts of the judged method, all rows except those
    only about others.
    """
    from himap import removal
    from himap.paper.claims.base import METHODS
    from himap.removal.restarts import has_restarts

    chaotic = [name for name in removal.available() if has_restarts(removal.create(name))]
    of_restarts = "restart" in rows and chosen.get("method", "sdecgmca") in chaotic
    if "method" not in rows:
        return np.full(len(rows), of_restarts)
    names = ["", METHODS["sdecgmca"]] if of_restarts else chaotic
    return rows["method"].fillna("").isin(names).to_numpy()


def _parameters(experiment, pairs, preset, recorded):
    """{name: value} of all parameters of an experiment, and of those given or `recorded`."""
    declared = {one.name: one for one in (_SKIES, *find(experiment.chapter).parameters)}
    declared = [
        replace(one, default=experiment.defaults.get(one.name, one.default))
        for one in declared.values()
        if one.name not in experiment.without
    ]
    given = check_parameters(declared, recorded | parse_texts(declared, named_values(pairs, preset)))
    usual = {one.name: one.default for one in declared}
    given = {name: value for name, value in given.items() if name in recorded or value != usual[name]}
    for one in given.keys() & {"n_sources_min", "n_sources_max"}:
        whole_number(one, given[one], 1, _MOST_SOURCES)  # before counting them
    return usual | given, given
