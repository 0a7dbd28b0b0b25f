"""`himap sensitivity`: how far the cleaning of a cube of one's own hangs on its beam."""

import time
import warnings

import click

from himap.app.cli.cube_options import Methods, cube_and_beams, cube_options, inputs_of, method_parameters
from himap.app.cli.shared import debug
from himap.core.errors import InputError, plain_text
from himap.core.files import whole_file


@click.command(short_help="Tell how far what is left of CUBE hangs on its beam.")
@click.argument("path", metavar="CUBE")
@click.option("--method", cls=Methods, required=True, metavar="NAME")
@click.option(
    "--width", "widths", type=float, multiple=True, help="Relative error of the FWHM; ±0.1 and 1 %."
)
@click.option(
    "--ripple", "ripples", type=float, multiple=True, help="Of an error that oscillates; 1e-5 to 1e-3."
)
@click.option("--period", type=float, default=20.0, show_default=True, help="Of that, MHz.")
@click.option("-o", "--output", metavar="FILE", help="Page with the figure, .html.")
@cube_options
@debug
def sensitivity(
    path, method, widths, ripples, period, beam, dish, pairs, mask, keep_peaks, output, overwrite, **reading
):
    """Clean CUBE with beams that differ a little from --beam, and tell how far the power that is left moves.

    \b
    himap sensitivity cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 -o beam.html
    """
    from himap.cubes import sensitivity as measured
    from himap.cubes.cleaning import clean_cube
    from himap.cubes.writing import check_output
    from himap.removal import create
    from himap.removal.base import SeparationWarning

    started = time.monotonic()
    inputs = inputs_of([path, beam, reading["freqs"], mask], pairs)
    checked = {"overwrite": overwrite, "inputs": inputs, "page": True}
    page = None if output is None else check_output(output, **checked)
    remover = create(method, **method_parameters(pairs))
    if "beams" not in remover.uses:
        raise InputError(f"{remover.name} does not use the beam: no error of it changes what is left.")
    chosen = {"widths": widths, "ripples": ripples} if widths or ripples else {}
    if beam is not None:
        measured.perturbed_beams(beam, **chosen, period=period)  # before the work
    cube, beams = cube_and_beams(path, remover, beam, dish, mask, reading)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeparationWarning)  # of cleaning it says the report
        cleaned = clean_cube(cube, remover, beams=beams, peaks=not keep_peaks)
        found = measured.beam_sensitivity(cleaned, beam, **chosen, period=period, dish=dish)
    click.echo(measured.sensitivity_table(found))
    if page is not None:
        with whole_file(page) as temporary:
            measured.write_sensitivity(found, temporary)
        click.echo(f"{plain_text(str(page))}  ({time.monotonic() - started:.0f} s)")
