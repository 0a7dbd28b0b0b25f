"""The `himap` command. Bad input ends in one paragraph and exit code 2, without a traceback."""

import time

import click

from himap import __version__
from himap.app import reproduce
from himap.app.cli.cache import cache_commands
from himap.app.cli.cubes import clean, suggest, transfer
from himap.app.cli.measure import claims, measure, readings, record
from himap.app.cli.sensitivity import sensitivity
from himap.app.cli.shared import (
    SETTINGS,
    Commands,
    debug,
    named_values,
    overwrite_option,
    workers,
)
from himap.app.cli.templates import templates
from himap.app.cli.verify import verify
from himap.app.notebooks import find, notebooks
from himap.app.parameters import accepts, check_parameters, describe_parameters, parse_texts
from himap.core.errors import InputError
from himap.figures.tables import Table


@click.group(cls=Commands, context_settings=SETTINGS)
@click.version_option(__version__, message="himap %(version)s")
@debug
def main():
    """Foreground removal in HI intensity mapping: notebooks, and cubes of your own.

    \b
    himap run 04_pca --preset laptop -p n_sources=4 -o pca.ipynb
    """


main.add_command(cache_commands)
main.add_command(claims)
main.add_command(clean)
main.add_command(measure)
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


def _refresh(names):
    refreshed = reproduce.refresh(names or None, report=lambda name, reason: click.echo(f"{name}: {reason}"))
    if not refreshed:
        click.echo("every notebook is fresh")
