"""The beams of a cube of one's own: b_l of its channels, from a beam by name, or from a file."""

from himap.core.checks import checked_beams
from himap.core.errors import InputError
from himap.instrument.beams import available, named
from himap.instrument.beams.base import DISH, REGISTRY, Beam


def beams_of(cube, beam, *, dish=None):
    """b_l of every channel of a `Cube`, (n_channels, 3 nside), or as far as a file tells them.

    Parameters
    ----------
    cube
        The `Cube`.
    beam
        A `Beam`, or what `himap.instrument.beams.named` takes: a name, such as "meerkat", or the path of a
        file with one line for each channel in the order of the cube's own file, the FWHM in degrees or b_l.
    dish
        Diameter in m, 13.5 unless given; for beams whose width follows from it.

    Raises
    ------
    InputError
        An unknown name, a file that does not fit, or frequencies that a beam is not known at.
    """
    beam = beam if isinstance(beam, Beam) else _named(beam)
    if dish is not None and not beam.follows_dish:
        able = [name for name in available() if REGISTRY[name].follows_dish]
        raise InputError(f"dish= is for the beams that follow from it: {', '.join(able)}.")
    layout, lmax = cube.layout, 3 * cube.nside - 1
    options = {"lmax": lmax, "dish_diameter": DISH if dish is None else dish}
    if beam.by_line:
        beams = beam.windows(layout.freqs, **options).total[layout.channels]
    else:
        beams = beam.windows(cube.freqs, **options).total
    if beams.shape[1] <= 2 * cube.nside:
        raise InputError(
            f"{beam} must hold b_l from l = 0 to 2 nside = {2 * cube.nside} at least, got {beams.shape[1]} "
            "numbers a line; for widths give one FWHM (deg) a line."
        )
    return checked_beams(str(beam), beams, len(cube.freqs))


def _named(text):
    """The beam that a text means, which must tell what the beam cannot do without."""
    try:
        return named(text)
    except TypeError as error:
        raise InputError(
            f"the beam {text!r} says too little ({error}): give NAME:PARAMETER=VALUE, or in the place of "
            "`file` the path of the file itself."
        ) from None
