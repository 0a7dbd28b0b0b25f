"""The commands of `himap` for cubes of one's own."""

import time
import warnings

import click

from himap.cli_shared import debug, named_values, print_table
from himap.cubes import suggestion
from himap.cubes.beams import BEAM_NAMES, beams_of
from himap.cubes.cleaning import clean_cube, method_for
from himap.cubes.cube import read_cube
from himap.cubes.report import write_report
from himap.cubes.writing import check_cube_output, check_page, save_cleaned, whole_file
from himap.errors import InputError
from himap.parameters import parse_texts
from himap.removal import available
from himap.removal.base import REGISTRY, SeparationWarning

__all__ = ["clean", "suggest"]

_READING = [
    click.option("--freqs", help="File of the channel centres in MHz, one a line, in the file's order."),
    click.option("--unit", help="K or mK, if the file does not say."),
    click.option("--order", help="RING or NESTED, if the file does not say."),
    click.option("--maps", "maps_name", help="Dataset of the maps in an HDF5 file."),
    click.option("--freqs-name", help="Dataset of the frequencies in an HDF5 file."),
]


def _reading(command):
    for option in reversed(_READING):
        command = option(command)
    return command


@click.command()
@click.argument("path", metavar="CUBE")
@click.option("--method", required=True, help=f"{', '.join(available())}.")
@click.option("--beam", help=f"{', '.join(BEAM_NAMES)}, or a file of FWHM (deg) or b_l.")
@click.option("--dish", type=float, help="Diameter in m behind the named beams; default 13.5.")
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter of the method.")
@click.option("--truth", help="Cube of what a perfect cleaning would leave, for the report.")
@click.option("--keep-peaks", is_flag=True, help="Look for the foreground without masking peaks.")
@click.option("-o", "--output", required=True, help="Cleaned cube: .h5, .fits or .npy.")
@click.option("--overwrite", is_flag=True, help="Write over what is there.")
@_reading
@debug
def clean(path, method, beam, dish, pairs, truth, keep_peaks, output, overwrite, **reading):
    """Remove the foregrounds of the cube of maps in CUBE.

    CUBE is HDF5, FITS (one file with a column for each channel, or a folder with a file for each) or .npy.
    The page OUTPUT.html says what to look at.

    \b
    himap clean cube.h5 --method pca -p n_sources=4 -o cleaned.h5
    himap clean cube.h5 --method sdecgmca --beam oscillating -p n_sources=5 -o cleaned.h5
    """
    started = time.monotonic()
    output = check_cube_output(output, overwrite=overwrite)
    cube, beams = _cube_and_beams(path, method, beam, dish, reading)
    remover = method_for(cube, method, **parse_texts([], named_values(pairs)))
    true = None if truth is None else read_cube(truth, **reading)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeparationWarning)  # the report says it, and the line below
        cleaned = clean_cube(cube, remover, beams=beams, peaks=not keep_peaks)
    page = output.with_suffix(".html")
    with whole_file(page) as temporary:
        write_report(cleaned, temporary, truth=true)
        written = save_cleaned(cleaned, output)
    if not cleaned.separation.converged:
        click.echo(f"{method} stopped before it converged.", err=True)
    click.echo("  ".join(str(one) for one in [*written, page]) + f"  ({time.monotonic() - started:.0f} s)")


@click.command()
@click.argument("path", metavar="CUBE")
@click.option("--method", default="pca", show_default=True, help="A method with a number of sources.")
@click.option("--beam", help=f"{', '.join(BEAM_NAMES)}, or a file of FWHM (deg) or b_l.")
@click.option("--dish", type=float, help="Diameter in m behind the named beams; default 13.5.")
@click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="Another parameter of the method.")
@click.option("--from", "least", type=int, default=1, show_default=True, help="Least number of sources.")
@click.option("--to", "most", type=int, default=10, show_default=True, help="Largest number of sources.")
@click.option("-o", "--output", help="Page with the figures, .html.")
@click.option("--overwrite", is_flag=True, help="Write over what is there.")
@_reading
@debug
def suggest(path, method, beam, dish, pairs, least, most, output, overwrite, **reading):
    """Suggest how many sources to remove from the cube in CUBE, without the truth.

    \b
    himap suggest cube.h5 --method pca -o how_many.html
    """
    page = None if output is None else check_page(output, overwrite=overwrite)
    cube, remover_beams = _cube_and_beams(path, method, beam, dish, reading)
    parameters = parse_texts([], named_values(pairs))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeparationWarning)
        found = suggestion.suggest(
            cube, method, n_sources=range(least, most + 1), beams=remover_beams, **parameters
        )
    rows = [
        (str(n), f"{value:.4f}", f"{change:.1%}" if change is not None else "")
        for n, value, change in zip(found.n_sources, found.criterion, [*found.change, None], strict=True)
    ]
    print_table(("n_sources", "criterion", "change with one more"), rows)
    click.echo(f"{found.n_bright} eigenvalues stand above HI and noise. {suggestion.advice(found)}")
    if page is not None:
        with whole_file(page) as temporary:
            suggestion.write_suggestion(found, temporary)
        click.echo(page)


def _cube_and_beams(path, method, beam, dish, reading):
    """The cube, with its remarks told, and its beams, None where none are named."""
    if dish is not None and beam is None:
        raise InputError("--dish belongs to a beam; give --beam too.")
    cube = read_cube(path, **reading)
    for remark in cube.remarks:
        click.echo(remark, err=True)
    if beam is None and method in available() and REGISTRY[method].needs_beams:
        raise InputError(f"{method} needs the beam of the cube; give --beam.")
    return cube, None if beam is None else beams_of(cube, beam, dish=dish)
