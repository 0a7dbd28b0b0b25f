"""The `himap` command. Invalid input ends with a one-paragraph message and exit code 2, without a traceback.

Computing modules are imported when needed, so that `himap --help` is fast.
"""

import math
import time
from collections import defaultdict
from datetime import datetime
from functools import partial

import click
from tqdm import tqdm

from himap import __version__
from himap.app import reproduce
from himap.app.cli.cubes import clean, sensitivity, suggest, transfer
from himap.app.cli.measure import measure
from himap.app.cli.shared import (
    METHOD,
    NOTEBOOK,
    PRESET,
    Commands,
    debug,
    named_values,
    overwrite_option,
    workers,
)
from himap.app.notebooks import find, notebooks
from himap.app.parameters import all_parameters, check_parameters, describe_parameters, parse_texts
from himap.core.errors import InputError
from himap.core.survey import PRESETS
from himap.figures.tables import Table
from himap.store import cache

_OTHER = "other"  # than a preset
_size_text = partial(tqdm.format_sizeof, suffix="B")


@click.group(
    cls=Commands,
    commands=[clean, measure, sensitivity, suggest, transfer],
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, message="himap %(version)s")
@debug
def main():
    """Foreground removal in HI intensity mapping: notebooks, and users' cubes.

    \b
    himap run 04_pca --preset laptop -p n_sources=4 -o pca.ipynb
    """


@main.command("list")
@click.argument("name", required=False, **NOTEBOOK)
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
@click.argument("name", required=False, **METHOD)
@debug
def methods(name):
    """List the methods of foreground removal, or the parameters of method NAME.

    \b
    himap methods pca
    """
    from himap import removal

    if name is not None:
        click.echo(removal.describe(name))
        return
    rows = [(method, removal.describe(method).splitlines()[0]) for method in removal.available()]
    click.echo(Table(["method", "what it does"], rows))


@main.command()
@click.argument("names", metavar="[NAME]...", nargs=-1, **NOTEBOOK)
@click.option("--preset", help="ci, quick, laptop or paper; default: the notebook's, quick.", **PRESET)
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter; the value may be JSON.")
@click.option(
    "-o", "--output", metavar="FILE", help="Where to write; default results/NAME_PRESET_PARAMETERS.ipynb."
)
@click.option("--stale", is_flag=True, help="Execute outdated notebooks in place (all, or the named).")
@click.option("--all", "every", is_flag=True, help="All notebooks, except those already executed.")
@overwrite_option
@workers
@debug
def run(names, preset, pairs, output, stale, every, overwrite):
    """Execute notebooks, optionally with other parameters.

    `himap list NAME` shows the parameters. The fields of a preset (nside, n_channels, seed, ...)
    are parameters too. Interrupted runs are resumed when run again.

    \b
    himap run 10_results --preset ci -p seed=7 -p reading=code
    himap run 04_pca -p galaxy=templates -p template_dir=maps -o pca.ipynb
    himap run --all --preset laptop --jobs 2
    """
    if stale:
        if preset or pairs or output is not None or every or overwrite:
            raise InputError("--stale runs notebooks as they are committed; omit all other options.")
        if not reproduce.refresh(names or None, report=lambda name, why: click.echo(f"{name}: {why}")):
            click.echo("every notebook is fresh")
        return
    if every and names:
        raise InputError(f"--all runs every notebook; omit it to run only {', '.join(names)}.")
    if not (names or every):
        raise InputError("name the notebooks to run, or give --all; `himap list` shows them.")
    names = [notebook.name for notebook in notebooks()] if every else names
    if output is not None and len(names) > 1:
        raise InputError(f"-o names the output of one notebook, but there are {len(names)}; omit it.")
    texts, declared = named_values(pairs, preset), {name: find(name).parameters for name in names}
    known = {name: all_parameters(parameters) for name, parameters in declared.items()}
    if every and (unused := set(texts).difference(*known.values())):
        raise InputError(f"no notebook has the parameter {min(unused)}; `himap list NAME` shows them.")
    calls = {}
    for name, parameters in declared.items():  # with --all each gets its parameters
        accepted = {key: text for key, text in texts.items() if not every or key in known[name]}
        calls[name] = parse_texts(parameters, accepted)
        check_parameters(parameters, calls[name])  # before any run
    stopped = []
    for name, values in calls.items():
        started, options = time.monotonic(), {"output": output, "again": not every, "overwrite": overwrite}
        try:
            path, done = reproduce.run(name, parameters=values, **options)
        except (InputError, reproduce.NotebookError) as error:
            if not every:
                raise
            stopped.append(name)  # others may accept the parameters
            click.echo(f"{name}: {error}", err=True)
            continue
        click.echo(f"{path}  ({f'{time.monotonic() - started:.0f} s' if done else 'done before'})")
    if stopped:
        raise reproduce.NotebookError(
            f"{len(stopped)} of {len(calls)} notebooks stopped: {', '.join(stopped)}."
        )


@main.command()
@click.argument("folder", metavar="FOLDER", type=click.Path(file_okay=False))
@click.option("--nside", type=int, default=64, show_default=True, help="Resolution, up to that of PySM, 512.")
@debug
def templates(folder, nside):
    """Write the real Galaxy, PySM's models s1 and f1, as FITS templates in FOLDER.

    Synchrotron emission at 408 MHz with its index map, and free-free emission at 30 GHz. PySM downloads
    them on first use. Results with `galaxy=templates` in the book are of nside 64; small scales are added
    beyond.

    \b
    himap templates maps --nside 64
    himap run 04_pca -p galaxy=templates -p template_dir=maps
    """
    from himap.sky.templates import digest_of, write_templates

    started = time.monotonic()
    paths = write_templates(folder, nside)
    for path in paths:
        click.echo(path)
    click.echo(f"checksum {digest_of(paths[0].parent)}")
    click.echo(f"for -p galaxy=templates -p template_dir={folder}  ({time.monotonic() - started:.0f} s)")


@main.command()
@click.option("--renew", is_flag=True, help="Store the numbers of the current code if they differ.")
@debug
def verify(renew):
    """Accept changed code that gives the numbers of former code.

    Small calls of every product, method and beam with changed code are compared with the numbers in
    book/results/probes.json. If they agree, stamps of notebooks, stored results and the cache stay valid,
    as recorded in book/results/accepted.json, which is committed. If they differ, results of former code are
    stale; with --renew the current numbers become the reference. Code in cells of chapters is not
    called: `himap run --stale` executes those, and changes only the stamp if nothing else differs.

    \b
    himap verify && himap run --stale
    """
    from himap.paper import canonical
    from himap.store.verify import verify as accept

    others = accept(canonical, renew=renew, report=click.echo)
    if others and not renew:
        raise click.ClickException(
            f"other numbers than those stored: {', '.join(others)}. If this is intended, `himap verify "
            "--renew` stores the current numbers, and results of former code become stale; otherwise undo "
            "the change. The others were accepted."
        )


@main.group("cache")
def cache_commands():
    """Show, or empty, the folder of computed products.

    \b
    himap cache info
    himap cache clear --preset laptop
    """


@cache_commands.command()
@click.option("--all", "every", is_flag=True, help="Every entry with its arguments.")
def info(every):
    """Show the location and content of the cache."""
    entries = cache.cache_info()
    click.echo(f"{cache.cache_folder()}: {_size_text(sum(entry.n_bytes for entry in entries))}")
    if every:
        for entry in entries:
            created = entry.created.strftime("%Y-%m-%d %H:%M")
            click.echo(f"{entry.product}  {_size_text(entry.n_bytes)}  {created}  {entry.seconds:.1f} s")
            click.echo(f"    {entry.arguments}")
        return
    groups = defaultdict(list)
    for entry in entries:
        groups[entry.product, _preset_of(entry)].append(entry.n_bytes)
    rows = [(*key, len(sizes), _size_text(sum(sizes))) for key, sizes in sorted(groups.items())]
    if rows:
        click.echo(Table(["product", "preset", "results", "size"], rows))


@cache_commands.command()
@click.argument("products", nargs=-1)
@click.option(
    "--preset",
    type=click.Choice([*PRESETS, _OTHER], case_sensitive=False),
    help="Only results of this preset.",
)
@click.option("--older-than", "days", type=click.FloatRange(min=0), help="Only older results, in days.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def clear(products, preset, days, yes):
    """Delete the results of PRODUCTS, or all.

    \b
    himap cache clear --preset laptop --older-than 7
    """
    if days is not None and not math.isfinite(days):
        raise InputError(f"an age must be a number of days, got --older-than {days}.")

    entries, now = cache.cache_info(), datetime.now()
    known = {entry.product for entry in entries}
    if unknown := set(products) - known:
        names = ", ".join(sorted(known)) or "nothing"
        raise InputError(f"the cache contains no {', '.join(sorted(unknown))}, but {names}.")
    if not (products or yes or preset or days is not None):
        click.confirm(f"Delete everything in {cache.cache_folder()}?", abort=True)
    entries = [entry for entry in entries if entry.product in (products or known)]
    entries = [entry for entry in entries if (now - entry.created).total_seconds() >= 86_400 * (days or 0)]
    entries = [entry for entry in entries if preset in (None, _preset_of(entry))]
    click.echo(f"freed {_size_text(cache.clear_cache(entries))}")


def _preset_of(entry):
    """The preset whose size matches the survey of a cached result; "other" if none."""
    size = ("nside", "n_channels", "box_cells")
    texts = {name: [f"{item}={getattr(one, item)}," for item in size] for name, one in PRESETS.items()}
    return next((name for name in texts if all(text in entry.arguments for text in texts[name])), _OTHER)
