"""`himap templates`: the files of the real Galaxy, from PySM."""

import time

import click

from himap.app.cli.shared import debug


@click.command()
@click.argument("folder", metavar="FOLDER", type=click.Path(file_okay=False))
@click.option("--nside", type=int, default=64, show_default=True, help="Resolution, up to PySM's own, 512.")
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
    from himap.sky.pysm import write_templates  # here: it takes seconds that `himap --help` need not wait

    started = time.monotonic()
    for path in write_templates(folder, nside):
        click.echo(path)
    click.echo(f"for -p galaxy=templates -p template_dir={folder}  ({time.monotonic() - started:.0f} s)")
