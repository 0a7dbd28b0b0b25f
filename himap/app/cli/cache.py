"""`himap cache`: what is kept of computed products, and how to be rid of it."""

import math
from collections import defaultdict
from datetime import datetime

import click

from himap.app.cli.shared import size_text
from himap.core.errors import InputError
from himap.core.survey import PRESETS
from himap.figures.tables import Table
from himap.store import cache

_OTHER = "other"  # than a preset


@click.group("cache")
def cache_commands():
    """Look at, or empty, the folder of computed products.

    \b
    himap cache info
    himap cache clear --preset laptop
    """


@cache_commands.command()
@click.option("--all", "every", is_flag=True, help="Every entry with its arguments.")
def info(every):
    """Show where the cache is and what it holds."""
    entries = cache.cache_info()
    click.echo(f"{cache.cache_folder()}: {size_text(sum(entry.n_bytes for entry in entries))}")
    if every:
        for entry in entries:
            created = entry.created.strftime("%Y-%m-%d %H:%M")
            click.echo(f"{entry.product}  {size_text(entry.n_bytes)}  {created}  {entry.seconds:.1f} s")
            click.echo(f"    {entry.arguments}")
        return
    groups = defaultdict(list)
    for entry in entries:
        groups[entry.product, _preset_of(entry)].append(entry.n_bytes)
    rows = [(*key, len(sizes), size_text(sum(sizes))) for key, sizes in sorted(groups.items())]
    if rows:
        click.echo(Table(["product", "preset", "results", "size"], rows))


def _finite(context, parameter, days):
    if days is not None and not math.isfinite(days):
        raise InputError(f"an age is a number of days, got --older-than {days}.")
    return days


@cache_commands.command()
@click.argument("products", nargs=-1)
@click.option("--preset", type=click.Choice([*PRESETS, _OTHER]), help="Only what was made at this preset.")
@click.option(
    "--older-than",
    "days",
    type=click.FloatRange(min=0),
    callback=_finite,
    help="Only what is older, in days.",
)
@click.option("--yes", is_flag=True, help="Do not ask.")
def clear(products, preset, days, yes):
    """Delete the results of PRODUCTS, or all.

    \b
    himap cache clear --preset laptop --older-than 7
    """

    def wanted(entry):
        age = (datetime.now() - entry.created).total_seconds() / 86_400
        return preset in (None, _preset_of(entry)) and (days is None or age >= days)

    if not (products or yes or preset or days is not None):
        click.confirm(f"Delete everything in {cache.cache_folder()}?", abort=True)
    click.echo(f"freed {size_text(cache.clear_cache(products, wanted=wanted))}")


def _preset_of(entry):
    """The preset whose size the survey of a cached result has; "other" where there is none."""
    for name, survey in PRESETS.items():
        size = (f"{item}={getattr(survey, item)}," for item in ("nside", "n_channels", "box_cells"))
        if all(text in entry.arguments for text in size):
            return name
    return _OTHER
