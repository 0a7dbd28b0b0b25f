"""The `himap` command. Bad input ends in one paragraph and exit code 2, without a traceback."""

import time
from dataclasses import asdict

import click

from himap import __version__
from himap.cli.cache import cache_commands
from himap.cli.cubes import clean, suggest, transfer
from himap.cli.readings import readings
from himap.cli.records import record
from himap.cli.sensitivity import sensitivity
from himap.cli.shared import (
    SETTINGS,
    Commands,
    check_alone,
    debug,
    json_output,
    judging_parameters,
    named_values,
    overwrite_option,
    provenance_parameters,
    workers,
)
from himap.cli.templates import templates
from himap.cli.verify import verify
from himap.companion import reproduce
from himap.companion.notebook_files import copy_name
from himap.companion.notebooks import find, notebooks
from himap.companion.parameters import accepts, check_parameters, describe_parameters, parse_texts
from himap.errors import InputError
from himap.figures.tables import Table
from himap.products.fingerprint import CodeTree
from himap.products.provenance import Provenance

__all__ = ["main"]

# Of `himap claims`, where 15_claims does less: some verdicts depend on realisation and noise level.
_CLAIMS = {"n_realisations": 5, "nudged": True}


@click.group(cls=Commands, context_settings=SETTINGS)
@click.version_option(__version__, message="himap %(version)s")
@debug
def main():
    """Foreground removal in HI intensity mapping: notebooks, and cubes of your own.

    \b
    himap run 04_pca --preset laptop -p n_sources=4 -o pca.ipynb
    """


main.add_command(cache_commands)
main.add_command(clean)
main.add_command(readings)
main.add_command(record)
main.add_command(sensitivity)
main.add_command(suggest)
main.add_command(templates)
main.add_command(transfer)
main.add_command(verify)


@main.command("list")
@click.argument("name", required=False)
@debug
def list_(name):
    """List the notebooks, or the parameters of notebook NAME.

    \b
    himap list 04_pca
    """
    if name is None:
        rows = [(n.name, f"Sect. {n.section}" if n.section else "", n.title) for n in notebooks()]
        click.echo(Table(["notebook", "paper", "title"], rows))
        return
    notebook = find(name)
    click.echo(notebook.title)
    if notebook.section:
        click.echo(f"Paper: Sect. {notebook.section}; figures: {', '.join(notebook.figures) or 'none'}")
    click.echo(f"Parameters:\n{describe_parameters(notebook.parameters) or '  none'}")


@main.command()
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option("--preset", help="ci, quick, laptop or paper; default: the notebook's, quick.")
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter; the value may be JSON.")
@click.option("-o", "--output", help="Where to write; default results/NAME_PRESET_PARAMETERS.ipynb.")
@click.option("--stale", is_flag=True, help="Execute in place what is out of date (all, or the named).")
@click.option("--all", "every", is_flag=True, help="All notebooks, but for those that are done already.")
@overwrite_option
@workers
@debug
def run(names, preset, pairs, output, stale, every, overwrite):
    """Execute notebooks, with other parameters if you like.

    `himap list NAME` shows the parameters. The fields of a preset (nside, n_channels, seed, ...)
    are parameters too. What was interrupted goes on where it stopped when it is run again.

    \b
    himap run 10_results --preset ci -p seed=7 -p reading=letter
    himap run 04_pca -p galaxy=templates -p template_dir=maps -o pca.ipynb
    himap run --all --preset laptop --jobs 2
    """
    if stale:
        if preset or pairs or output is not None or every or overwrite:
            raise InputError("--stale runs notebooks as they are committed; leave out all but their names.")
        _refresh(names)
        return
    if every and names:
        raise InputError(f"--all runs every notebook; leave it out to run only {', '.join(names)}.")
    if not (names or every):
        raise InputError("name the notebooks to run, or give --all; `himap list` shows what there is.")
    names = [notebook.name for notebook in notebooks()] if every else names
    if output is not None and len(names) > 1:
        raise InputError(f"-o names the output of one notebook, but there are {len(names)}; leave it out.")
    values = _values(names, preset, named_values(pairs), some_accept=every)
    for name in names:
        started = time.monotonic()
        own = preset if not every or accepts(find(name).parameters, "preset") else None
        path, done = reproduce.run(
            name,
            preset=own,
            parameters=values[name],
            output=output,
            again=not every,
            overwrite=overwrite,
        )
        click.echo(f"{path}  ({f'{time.monotonic() - started:.0f} s' if done else 'done before'})")


def _values(names, preset, texts, *, some_accept):
    """{notebook: parameters}, checked before any runs; with `some_accept`, those that the notebook has."""
    declared = {name: find(name).parameters for name in names}
    for parameter in texts if some_accept else ():
        if not any(accepts(parameters, parameter) for parameters in declared.values()):
            raise InputError(f"no notebook has the parameter {parameter}; `himap list NAME` shows them.")
    values = {}
    for name, parameters in declared.items():
        accepted = {key: text for key, text in texts.items() if not some_accept or accepts(parameters, key)}
        values[name] = parse_texts(parameters, accepted)
        asked = preset if not some_accept or accepts(parameters, "preset") else None
        check_parameters(parameters, values[name], asked)
    return values


@main.command()
@click.option("--preset", help="ci, quick, laptop or paper; default: that of 15_claims.")
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter of 15_claims.")
@click.option(
    "-o", "--output", help="Where to write the JSON; default results/claims_PRESET_PARAMETERS.json."
)
@overwrite_option
@click.option("--check", metavar="FILE", help="Judge one realisation of a ledger again, and mark it.")
@workers
@debug
def claims(preset, pairs, output, overwrite, check):
    """Evaluate every claim of the paper on five seeds, print the ledger, and write it as JSON.

    The first seed is also judged with the noise level that SDecGMCA is told 0.1 % lower and higher;
    -p nudged=false leaves that out. -p reading=NAME and -p method=NAME put another reading of SDecGMCA,
    or another method, in its place.

    \b
    himap claims --preset quick --jobs 2
    himap claims --preset laptop -p galaxy=templates -p template_dir=maps -p n_realisations=7
    """
    # Imported here: other commands need not wait seconds for what does the work.
    from himap.companion.staleness import ledger_code
    from himap.instrument.beams.oscillating import Oscillating
    from himap.paper import ledger, ledger_table
    from himap.paper.checking import check_ledger
    from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED

    chosen, given = judging_parameters(pairs, preset, own=_CLAIMS)
    preset = chosen["preset"]
    name = copy_name("claims", preset, given, suffix=".json")
    started = time.monotonic()
    oscillating = Oscillating(ripple=chosen.pop("ripple"))
    nudges = ledger.NUDGES if chosen.pop("nudged") and check is None else ()
    if check is None:
        path = json_output(output, name, overwrite=overwrite)
    else:
        check_alone("--check", output, overwrite)
        ledger.read_ledger(check)  # fails now
        chosen["n_realisations"] = 1
    skies = ledger.realisations(**chosen, oscillating=oscillating)
    entries = ledger.evaluate(skies, nudges=nudges)
    about = Provenance.of(
        skies[0].survey,
        galaxy=skies[0].galaxy,
        preset=preset,
        parameters={"n_realisations": len(skies)} | provenance_parameters(given),
        started=started,
    )
    # The code that ran, whatever was edited in the hours since.
    about = asdict(about) | {"code": ledger_code(CodeTree(loaded=True))}
    if check is not None:
        check_ledger(entries, check, about)
        click.echo(f"{check}: {len(entries)} claims on one realisation are the same with today's code.")
        return
    ledger.write_ledger(entries, path, about)
    colours = {REPRODUCED: "green", IN_PART: "yellow", FAILED: "red", INAPPLICABLE: "bright_black"}
    rows = [
        [id, beam, click.style(verdict, fg=colours[entry.verdict]), *others]
        for entry, (id, beam, verdict, *others) in zip(entries, ledger_table.plain_rows(entries), strict=True)
    ]
    click.echo(Table(ledger_table.HEADER, rows))
    count = ledger_table.summary(entries)
    click.echo(", ".join(f"{n} {verdict}" for verdict, n in count.items() if n))
    click.echo(f"{path}  ({time.monotonic() - started:.0f} s)")


def _refresh(names):
    refreshed = reproduce.refresh(names or None, report=lambda name, reason: click.echo(f"{name}: {reason}"))
    if not refreshed:
        click.echo("every notebook is fresh")
