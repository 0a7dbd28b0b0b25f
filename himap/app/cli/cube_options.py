"""The options that the commands of `himap` for cubes share."""

import click
from click import option

from himap.app.cli.shared import NamesOption, debug, overwrite_option

METHOD = option("--method", cls=NamesOption, required=True, metavar="NAME")
WEIGHTS = (
    option("--weights", metavar="FILE", help="Hits or inverse variances, 0 where not seen."),
    option("--flags", metavar="FILE", help="1 where a voxel is bad."),
)
MOCKS = (
    option(
        "--mocks", metavar="N|FILE", multiple=True, help="Mocks that correct spectra: how many, or a file."
    ),
    option("--mock-noise", type=float, metavar="MK", help="Noise of a pixel of N mocks."),
    *WEIGHTS,
)
_FOR_FILES = {
    ("--frame",): "Of the coordinates, G, C or E, if no file says.",
    ("--axes",): "Those of the array as in numpy, where the header does not fit: ra,dec,freq of images; "
    "freq,pixel or pixel,freq of maps.",
    ("--maps", "maps_name"): "Dataset of the maps in HDF5, if several could be.",
    ("--freqs-name",): "Dataset of the frequencies in HDF5.",
}


def _show_for_files(context, parameter, asked):
    """Print the help of the options `_FOR_FILES`, for which the other has no lines, if asked, and end."""
    if asked:
        formatter = context.make_formatter()
        formatter.write_dl([(f"{name} NAME", text) for (name, *_), text in _FOR_FILES.items()])
        click.echo(formatter.getvalue(), nl=False)
        context.exit()


COMMON = (
    option(
        "--beam",
        cls=NamesOption,
        package="himap.instrument.beams",
        more="; NAME:PARAMETER=VALUE; a FILE",
        less=("file",),
        metavar="NAME",
    ),
    option("--dish", metavar="M", type=float, help="Diameter behind a named beam; default 13.5 m."),
    option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter of the method."),
    option("--mask", metavar="FILE", help="Map of 1 where kept, .fits or .npy: the rest is not used."),
    option("--keep-peaks", is_flag=True, help="Do not mask peaks first."),
    overwrite_option,
    option("--freqs", metavar="FILE", help="Channel centres, MHz, if the file does not say."),
    option("--unit", metavar="NAME", help="K, mK or uK, if the file does not say."),
    option("--order", metavar="NAME", help="RING or NESTED, if the file does not say."),
    option("--rotate", is_flag=True, help="Rotate masks and the like of another frame to CUBE's."),
    *(option(*names, metavar="NAME", hidden=True) for names in _FOR_FILES),
    option(
        "--help-files",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_show_for_files,
        help="More options, for files that say too little.",
    ),
    debug,
)
