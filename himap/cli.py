"""The `himap` command. Bad input ends in one paragraph and exit code 2, without a traceback."""

import os
import time
from collections import defaultdict
from dataclasses import asdict
from pathlib import Path

import click

from himap import __version__, ledger, ledger_table, reproduce, store
from himap.claims import DIFFERENT, FAILED, REPRODUCED, UNDECIDED
from himap.errors import InputError
from himap.notebook_files import check_output, copy_name
from himap.parallel import JOBS_VARIABLE
from himap.parameters import check_parameters, describe_parameters, parse_texts
from himap.provenance import Provenance

__all__ = ["main"]

_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


class _BadInput(click.ClickException):
    exit_code = 2


class _Commands(click.Group):
    """Commands whose errors of the user's making are told in one paragraph."""

    def invoke(self, context):
        try:
            return super().invoke(context)
        except (InputError, reproduce.NotebookError) as error:
            if context.meta.get("debug"):
                raise
            if isinstance(error, InputError):
                raise _BadInput(str(error)) from None
            raise click.ClickException(f"{error}\nAdd --debug for the traceback.") from None


def _remember_debug(context, parameter, value):
    context.meta["debug"] = value or context.meta.get("debug", False)


_debug = click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    callback=_remember_debug,
    help="Show the traceback of an error.",
)


def _set_jobs(context, parameter, value):
    if value:
        os.environ[JOBS_VARIABLE] = str(value)  # kernels and worker processes read it


_jobs = click.option(
    "--jobs",
    type=click.IntRange(min=1),
    expose_value=False,
    callback=_set_jobs,
    help="Processes that work at once on what is independent; default 1.",
)
_SEEDS = 5  # of `himap claims`: fewer say little where a verdict depends on the realisation
_COLOURS = {REPRODUCED: "green", DIFFERENT: "yellow", FAILED: "red", UNDECIDED: "bright_black"}


@click.group(cls=_Commands, context_settings=_SETTINGS)
@click.version_option(__version__, message="himap %(version)s")
@_debug
def main():
    """Foreground removal in HI intensity mapping: the notebooks of the companion, from the shell.

    \b
    himap list                     what there is
    himap list 04_pca              the parameters of one notebook
    himap run 04_pca --preset laptop -p n_sources=4 -o pca.ipynb
    himap claims --preset laptop   what of the paper is reproduced
    """


@main.command("list")
@click.argument("name", required=False)
@_debug
def list_(name):
    """List the notebooks, or the parameters of notebook NAME."""
    if name is None:
        rows = [(n.name, f"Sect. {n.section}" if n.section else "", n.title) for n in reproduce.notebooks()]
        _print_table(("notebook", "paper", "title"), rows)
        return
    notebook = reproduce.find(name)
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
@_jobs
@_debug
def run(names, preset, pairs, output, stale):
    """Execute notebooks, with other parameters if you like.

    `himap list NAME` shows the parameters. The fields of a preset (nside, n_channels, seed, ...)
    are parameters too.

    \b
    himap run 02_beams_and_noise --preset ci -p seed=7
    himap run 04_pca -p galaxy=templates -p template_dir=maps -o pca.ipynb
    """
    if stale:
        if preset or pairs or output:
            raise InputError("--stale runs notebooks as they are committed; leave out --preset, -p and -o.")
        _refresh(names)
        return
    if not names:
        raise InputError("name the notebooks to run, or give --stale; `himap list` shows what there is.")
    if output and len(names) > 1:
        raise InputError(f"-o names the output of one notebook, but there are {len(names)}; leave it out.")
    texts = _split(pairs)
    values = {}
    for name in names:  # all of them, before any runs
        declared = reproduce.find(name).parameters
        values[name] = parse_texts(declared, texts)
        check_parameters(declared, values[name], preset)
    for name in names:
        started = time.monotonic()
        path = reproduce.run(name, preset=preset, parameters=values[name], output=output)
        click.echo(f"{path}  ({time.monotonic() - started:.0f} s)")


@main.command()
@click.option("--preset", help="ci, quick, laptop or paper; default: that of 15_claims.")
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter of 15_claims.")
@click.option(
    "-o", "--output", help="Where to write the JSON; default results/claims_PRESET_PARAMETERS.json."
)
@_jobs
@_debug
def claims(preset, pairs, output):
    """Evaluate every claim of the paper on five seeds, print the ledger, and write it as JSON.

    \b
    himap claims --preset quick --jobs 2
    himap claims --preset laptop -p galaxy=templates -p template_dir=maps -p n_realisations=7
    """
    declared = reproduce.find("15_claims").parameters
    values = check_parameters(declared, parse_texts(declared, _split(pairs)), preset)
    defaults = {parameter.name: parameter.default for parameter in declared}
    preset = values.get("preset", defaults["preset"])
    name = copy_name("claims", preset, values, suffix=".json")
    path = check_output(Path(output) if output else Path("results") / name, suffix=".json")
    started = time.monotonic()
    skies = ledger.realisations(**defaults | {"n_realisations": _SEEDS} | values)
    entries = ledger.evaluate(skies)
    about = Provenance.of(
        skies[0].survey,
        galaxy=skies[0].galaxy,
        preset=preset,
        parameters={"n_realisations": len(skies)},
        started=started,
    )
    ledger.write_ledger(entries, path, asdict(about))
    header = ("claim", "beam", "verdict", "in", "measured", "paper", "what is measured")
    _print_table(header, ledger_table.plain_rows(entries), colours=(2, _COLOURS))
    count = ledger_table.summary(entries)
    click.echo(", ".join(f"{n} {verdict}" for verdict, n in count.items() if n))
    click.echo(f"{path}  ({time.monotonic() - started:.0f} s)")


@main.group()
def cache():
    """Look at, or empty, the folder of computed products."""


@cache.command()
@click.option("--all", "every", is_flag=True, help="Every entry with its arguments.")
def info(every):
    """Show where the cache is and what it holds."""
    entries = store.cache_info()
    click.echo(f"{store.cache_folder()}: {_size(sum(entry.n_bytes for entry in entries))}")
    if every:
        for entry in entries:
            when = entry.created.strftime("%Y-%m-%d %H:%M")
            click.echo(f"{entry.product}  {_size(entry.n_bytes)}  {when}  {entry.seconds:.1f} s")
            click.echo(f"    {entry.arguments}")
        return
    groups = defaultdict(list)
    for entry in entries:
        groups[entry.product].append(entry.n_bytes)
    rows = [(name, str(len(sizes)), _size(sum(sizes))) for name, sizes in sorted(groups.items())]
    if rows:
        _print_table(("product", "results", "size"), rows)


@cache.command()
@click.argument("products", nargs=-1)
@click.option("--yes", is_flag=True, help="Do not ask.")
def clear(products, yes):
    """Delete the results of PRODUCTS, or all."""
    if not (products or yes):
        click.confirm(f"Delete everything in {store.cache_folder()}?", abort=True)
    click.echo(f"freed {_size(store.clear_cache(products))}")


def _refresh(names):
    done = reproduce.refresh(names or None, report=lambda name, why: click.echo(f"{name}: {why}"))
    if not done:
        click.echo("every notebook is fresh")


def _split(pairs):
    """{name: text} from NAME=VALUE."""
    texts = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not (equals and name.isidentifier()):
            raise InputError(f"a parameter is given as -p name=value; got -p {pair}.")
        if name in texts:
            raise InputError(
                f"the parameter {name} is given twice, as {texts[name]} and as {text}; give one."
            )
        texts[name] = text
    return texts


def _print_table(header, rows, colours=(None, {})):
    """Aligned columns; `colours` are a column and the colour of each of its texts."""
    column, colour_of = colours
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    for row in [header, *rows]:
        cells = [text.ljust(width) for text, width in zip(row, widths, strict=True)]
        if column is not None:
            cells[column] = click.style(cells[column], fg=colour_of.get(row[column]))
        click.echo("  ".join(cells).rstrip())


def _size(n_bytes):
    for unit in ("B", "kB", "MB"):
        if n_bytes < 1000:
            return f"{n_bytes:.0f} {unit}" if unit == "B" else f"{n_bytes:.1f} {unit}"
        n_bytes /= 1000
    return f"{n_bytes:.1f} GB"
