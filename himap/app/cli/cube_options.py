"""What the commands for cubes of one's own share: options, and the cube, beams and parameters of these."""

from importlib import import_module

import click

from himap.app.cli.shared import named_values
from himap.app.parameters import parse_texts
from himap.core.errors import InputError, plain_text
from himap.core.reading import is_file, regular_file


class _Registered(click.Option):
    """An option whose help lists what there is, found when it is asked for."""

    package, more, less = "", "", ()

    def get_help_record(self, context):
        names = [name for name in import_module(self.package).available() if name not in self.less]
        self.help = f"{', '.join(names)}{self.more}."
        option, text = super().get_help_record(context)
        return option, text.replace("  [required]", "")  # whoever forgets it is told, and a line is one


class Methods(_Registered):
    package = "himap.removal"


class Beams(_Registered):
    package = "himap.instrument.beams"
    more = "; NAME:PARAMETER=VALUE; a FILE"
    less = ("file",)


_OPTIONS = [
    click.option("--beam", cls=Beams, metavar="NAME"),
    click.option("--dish", metavar="M", type=float, help="Diameter behind a named beam; default 13.5 m."),
    click.option("-p", "pairs", metavar="NAME=VALUE", multiple=True, help="A parameter of the method."),
    click.option("--mask", metavar="FILE", help="Map of 1 where kept, .fits: nothing else is looked at."),
    click.option("--keep-peaks", is_flag=True, help="Do not mask peaks first."),
    click.option("--overwrite", is_flag=True, help="Write over what is there."),
    click.option("--freqs", metavar="FILE", help="Channel centres in MHz, one a line."),
    click.option("--unit", metavar="NAME", help="K, mK or uK, if the file does not say."),
    click.option("--order", metavar="NAME", help="RING or NESTED, if the file does not say."),
    click.option("--maps", "maps_name", metavar="NAME", help="Dataset of the maps in HDF5."),
    click.option("--freqs-name", metavar="NAME", help="Dataset of the frequencies in HDF5."),
]


_MOCKS = [
    click.option(
        "--mocks",
        metavar="N|FILE",
        multiple=True,
        help="Mocks that correct spectra: how many, or a file.",
    ),
    click.option("--mock-noise", type=float, metavar="MK", help="Noise of a pixel of N mocks."),
]


_WEIGHTS = [
    click.option("--weights", metavar="FILE", help="Hits or inverse variances, 0 where not seen."),
    click.option("--flags", metavar="FILE", help="1 where a voxel is bad."),
]


def _with_options(options):
    def with_all(command):
        for option in reversed(options):
            command = option(command)
        return command

    return with_all


cube_options, mock_options = _with_options(_OPTIONS), _with_options(_MOCKS)
weight_options = _with_options(_WEIGHTS)


def method_parameters(pairs):
    """Parameters of a method from texts NAME=VALUE."""
    parameters = parse_texts([], named_values(pairs))
    if "name" in parameters:
        raise InputError("no method has a parameter called name; --method says which method.")
    return parameters


def inputs_of(names, pairs):
    """The names of all files that a command reads, or of what may be such, for outputs to spare.

    Of `names` those that are given, and values of parameters (NAME=VALUE) where there is a file of that name.

    Raises
    ------
    InputError
        One of those is there, but cannot be read, such as a pipe.
    """
    values = method_parameters(pairs).values()
    named = [regular_file(value) for value in values if isinstance(value, str) and is_file(value)]
    return [name for name in (*names, *named) if name is not None]


def tell(sentence):
    """Say a sentence beside the output, whatever the names in it."""
    click.echo(plain_text(sentence), err=True)


def cube_and_beams(path, remover, beam, dish, mask, reading, *, weighed=None, peaks=True):
    """The cube, with its remarks told, and its beams, None where none are named.

    `weighed` are weights and flags as of `read_cube`; with these, pixels are left out of which too many
    channels are missing for the method, and with `peaks` for the masking of peaks.
    """
    import numpy as np

    from himap.cubes.cleaning import beams_of, check_pixels, with_enough_channels
    from himap.cubes.files import read_cube
    from himap.instrument.beams.base import gaussian_widths

    if dish is not None and beam is None:
        raise InputError("--dish belongs to a beam; give --beam too.")
    if beam is None and "beams" in remover.uses:
        raise InputError(f"{remover.name} needs the beam of the cube; give --beam.")
    weighed = {name: file for name, file in (weighed or {}).items() if file is not None}
    if weighed:
        remover.check_weights()
    cube = read_cube(path, **reading, **weighed)
    check_pixels(cube, remover)
    if mask is not None:
        cube = cube.within(cube.layout.pixels.read_mask(mask))
    if weighed:
        cube = with_enough_channels(cube, remover, peaks=peaks)
    for sentence in (cube.summary, *cube.remarks):
        tell(sentence)
    beams = None if beam is None else beams_of(cube, beam, dish=dish)
    if beams is not None:
        widths = np.rad2deg(gaussian_widths(beams))
        tell(f"The beams have a FWHM of {min(widths):.3g} to {max(widths):.3g} deg.")
    return cube, beams
