"""Shared by the commands of `himap` for cubes: options, input and output files, remarks."""

import functools
import time
import warnings
from types import SimpleNamespace

import click
from click import option

from himap.app.cli.shared import NamesOption, debug, named_values, overwrite_option, with_options
from himap.app.parameters import parse_texts
from himap.core.errors import InputError, plain_text
from himap.core.files import atomic_files
from himap.core.reading import is_file, regular_file

_READING = ("freqs", "unit", "order", "frame", "rotate", "maps_name", "freqs_name", "axes")
_FILES = ("path", "truth", "beam", "freqs", "mask", "weights", "flags")
METHOD = option("--method", cls=NamesOption, required=True, metavar="NAME")
WEIGHTS = (
    option("--weights", metavar="FILE", help="Hits or inverse variances, 0 where not observed."),
    option("--flags", metavar="FILE", help="1 where a voxel is bad."),
)
MOCKS = (
    option("--mocks", metavar="N|FILE", multiple=True, help="Mocks to correct spectra: a number, or a file."),
    option("--mock-noise", type=float, metavar="MK", help="Noise per pixel of N mocks."),
    *WEIGHTS,
)
_FOR_FILES = {
    ("--frame",): "Of the coordinates, G, C or E, if not in a file.",
    ("--axes",): "Those of the array in numpy order, if not as in the header: ra,dec,freq of images; "
    "freq,pixel or pixel,freq of maps.",
    ("--maps", "maps_name"): "Dataset of the maps in HDF5, if ambiguous.",
    ("--freqs-name",): "Dataset of the frequencies in HDF5.",
}


def _show_for_files(context, parameter, asked):
    """Print the help of the options `_FOR_FILES`, which the main help omits, if asked, and exit."""
    if asked:
        formatter = context.make_formatter()
        formatter.write_dl([(f"{name} NAME", text) for (name, *_), text in _FOR_FILES.items()])
        click.echo(formatter.getvalue(), nl=False)
        context.exit()


def _named_beams():
    from himap.instrument.beams import available

    return [name for name in available() if name != "file"]  # given by the path itself


COMMON = (
    option(
        "--beam",
        cls=NamesOption,
        names=_named_beams,
        more="; NAME:PARAMETER=VALUE; a FILE",
        metavar="NAME",
    ),
    option("--dish", metavar="M", type=float, help="Diameter behind a named beam; default 13.5 m."),
    option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter of the method."),
    option("--mask", metavar="FILE", help="Map of 1 where kept, .fits or .npy; the rest is unused."),
    option("--keep-peaks", is_flag=True, help="Do not mask peaks first."),
    overwrite_option,
    option("--freqs", metavar="FILE", help="Channel centres, MHz, if not in the file."),
    option("--unit", metavar="NAME", help="K, mK or uK, if not in the file."),
    option("--order", metavar="NAME", help="RING or NESTED, if not in the file."),
    option("--rotate", is_flag=True, help="Rotate masks etc. from other frames to CUBE's."),
    *(option(*names, metavar="NAME", hidden=True) for names in _FOR_FILES),
    option(
        "--help-files",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_show_for_files,
        help="More options, for incomplete files.",
    ),
    debug,
)


def cube_command(*options, short_help=None):
    """Decorator: a command for CUBE with these options and the common ones.

    It receives them in a namespace, with `reading` for `read_cube`, `weighed` for weights and flags,
    `parameters` of the method, `peaks` whether to mask peaks, `inputs` all potential input files, the time
    `started`, the remarks `said`, and the `tables` to print at the end.
    """

    def decorate(function):
        @functools.wraps(function)
        def command(**given):
            from himap.removal.base import SeparationWarning

            asked = SimpleNamespace(**given, said=[], tables=[], started=time.monotonic())
            asked.peaks = not given["keep_peaks"]
            asked.reading = {name: given[name] for name in _READING}
            names = ("weights", "flags")
            asked.weighed = {name: given[name] for name in names if given.get(name) is not None}
            asked.parameters = parse_texts([], named_values(given["pairs"]))
            if "name" in asked.parameters:
                raise InputError("no method has a parameter called name; give the method with --method.")
            values = [value for value in asked.parameters.values() if isinstance(value, str)]
            files = [*map(given.get, _FILES), *given.get("mocks", ())]
            files += [regular_file(value) for value in values if is_file(value)]
            asked.inputs = [file for file in files if file is not None]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SeparationWarning)  # included in the report and in remarks
                function(asked)

        path = click.argument("path", metavar="CUBE")
        return click.command(short_help=short_help)(with_options(path, *options, *COMMON)(command))

    return decorate


def tell(asked, *sentences):
    """Print sentences on standard error, and store them for the output files."""
    for sentence in sentences:
        click.echo(plain_text(sentence), err=True)
        asked.said.append(sentence)


def outputs_of(asked, endings=(), page=True):
    """The checked paths of the output, none if there is no output."""
    from himap.cubes.writing import check_output

    more = {"overwrite": asked.overwrite, "inputs": asked.inputs, "endings": endings, "page": page}
    return [] if asked.output is None else check_output(asked.output, **more)


def write_and_say(asked, files, write, *, remarks=()):
    """Write all `files` or none, ``write(*temporary names)``; then print tables, remarks and their names.

    In this order, so that results are written even if printing fails.
    """
    if files:
        with atomic_files(*files) as temporary:
            write(*temporary)
    for table in asked.tables:
        click.echo(table)
    tell(asked, *remarks)
    if files:
        took = time.monotonic() - asked.started
        click.echo(f"{plain_text('  '.join(map(str, files)))}  ({took:.0f} s)")
