"""Identify the axes of arrays and the files of a folder.

Axes follow from names given by the caller, from sizes, or from a header; files are ordered by the numbers in
their names, which are checked against the frequencies of the channels.
"""

import re

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import format_of
from himap.core.survey import FREQ_21CM
from himap.cubes.layout import is_seen, listed
from himap.maps.healpix_io import agreed, freq_in_header, freqs_in
from himap.maps.sphere import sphere_sizes

_N_FITTED = 3  # coefficients of a parabola
_SMOOTH = 1e-3  # largest residual share of the power along an axis that looks like frequency
_LESS = 0.01  # the same, relative to the residual share along the stated frequency axis
_AXES = {
    **dict.fromkeys(("ra", "lon", "glon", "l", "x"), "lon"),
    **dict.fromkeys(("dec", "lat", "glat", "b", "y"), "lat"),
    **dict.fromkeys(("freq", "freqs", "frequency", "nu", "channel"), "freq"),
    **dict.fromkeys(("pixel", "pixels", "pix"), "pixel"),
}

_DIGITS = re.compile(r"([0-9]+)")
_DECIMALS = re.compile(r"([0-9]+(?:[.,p][0-9]+)?)")
_IN_NAMES = (1.0, 1e3, 1e-3, 1e-6)  # MHz in possible units of names: MHz, GHz, kHz, Hz
_SHARE = 0.6  # of a channel: largest distance of a number from its centre, since names may state edges


def named_axes(axes, names):
    """Parse `axes` in numpy order, such as "ra,dec,freq", into a list with each of `names` once."""
    words = [_AXES.get(word.strip().lower()) for word in str(axes).split(",")]
    if sorted(map(str, words)) != sorted(names):
        like = "freq,pixel" if "pixel" in names else "ra,dec,freq"
        raise InputError(
            f"axes= (--axes) lists the axes of the array in numpy order, such as {like}; got {axes!r}."
        )
    return words


def pixel_axis(shape, axes=None):
    """Index of the pixel axis of HEALPix maps, by `axes` or by sizes, and remarks."""
    if axes is not None:
        return named_axes(axes, ("freq", "pixel")).index("pixel"), ()
    sizes = sphere_sizes(shape)
    if len(sizes) < 2:
        return int(shape[1] in sizes), ()
    which = "last" if shape[0] == shape[1] else "longer"
    return int(shape[1] == max(sizes)), (
        f"both axes, {shape[0]} and {shape[1]}, could be pixels of a sphere: assumed to be the {which} one "
        "(--axes freq,pixel or pixel,freq states it).",
    )


def remark_on_axes(maps, pixels):
    """A remark if the frequency axis of images, maps (n_channels, n_pix), may be an axis of the sky.

    Foregrounds are smooth in frequency except for a common gain, so the residual of a fit of a parabola times
    the mean line is larger along the axes of the sky. Uses 48 positions along each axis.
    """
    cube = maps.reshape(-1, *pixels.shape)
    cube = cube[tuple(slice(None, None, -(-n // 48)) for n in cube.shape)].astype(float)
    turned = (np.moveaxis(cube, axis, 0) for axis in range(3))
    along_freq, *along_sky = (_roughness(lines.reshape(len(lines), -1)) for lines in turned)
    least = min(along_sky)
    if not (least < _SMOOTH and least < _LESS * along_freq):
        return ()
    places = pixels.parts[0].order[:3]  # in the array: the axes read as frequency and as the sky
    place = sorted(places).index(places[1 + along_sky.index(least)])
    orders = [[*sky[:place], "freq", *sky[place:]] for sky in (["ra", "dec"], ["dec", "ra"])]
    return (
        f"The channels vary more than the pixels along the {('first', 'second', 'last')[place]} axis of "
        f"the array in numpy: if that is frequency, give --axes {' or '.join(map(','.join, orders))}.",
    )


def _roughness(lines):
    """Residual share of the power of lines (n, n_lines) after a fit of their mean times a parabola.

    It is 1 for few positions. Those without data, or with one value everywhere (dead channels), are ignored.
    """
    seen = is_seen(lines)
    some = np.where(seen, lines, -np.inf).max(axis=1) > np.where(seen, lines, np.inf).min(axis=1)
    lines = lines[some][:, seen[some].all(axis=0)]  # complete lines
    if len(lines) <= 2 * _N_FITTED or not lines.any():
        return 1.0
    mean = np.linalg.eigh(lines @ lines.T)[1][:, -1]
    basis, _ = np.linalg.qr(mean[:, None] * np.vander(np.linspace(-1, 1, len(lines)), _N_FITTED))
    return float(np.sum((lines - basis @ (basis.T @ lines)) ** 2) / np.sum(lines**2))


def turn_of(stored, axes, world):
    """Axes of an array of shape `stored` in the order of its header: unchanged, or as stated by `axes`.

    `world` has the index in the header of each of "lon", "lat" and "freq", from 0.
    """
    n_axes = len(stored)
    if axes is None:
        return tuple(range(n_axes))
    words = named_axes(axes, tuple(world))
    # Names refer to the axes longer than one and, if these are too few, to the last ones of length one.
    *rest, one, two, three = sorted(range(n_axes), key=lambda axis: (stored[axis] > 1, axis))
    named = sorted((one, two, three))
    places = {n_axes - 1 - world[word]: axis for word, axis in zip(words, named, strict=True)}
    return tuple(places[place] if place in places else rest.pop() for place in range(n_axes))


def fits_in(folder):
    """FITS files in a folder, ordered by name, and a list with a remark on other files, if any."""
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be read ({error.strerror}).") from None
    paths = [path for path in entries if format_of(path) == "FITS" and not path.name.startswith(".")]
    if not paths:
        raise InputError(f"the folder {folder} contains no FITS file.")
    paths.sort(key=lambda path: (_numbers_in(path.name), _numbers_in(path.name, _DIGITS)))
    others = [path.name for path in entries if path not in paths]
    return paths, [f"{len(others)} other files in the folder are ignored: {listed(others)}."] * bool(others)


def _numbers_in(name, pattern=_DECIMALS):
    """Split a name into [text, number, text, ...]; numbers as decimals or (`_DIGITS`) as digits alone."""
    parts = pattern.split(name)
    return [float(re.sub("[p,]", ".", part)) if n % 2 else part for n, part in enumerate(parts)]


def check_names(names, freqs):
    """Refuse frequencies (n,), MHz, that are assigned to files in another order than their names state.

    Numbers in names close to the frequencies, in any unit or as redshifts, must agree with those assigned to
    the files. Without such numbers, the order of names must depend neither on how decimals are written nor on
    which of several numbers is used.
    """
    split = [_numbers_in(name) for name in names]
    alike = len({tuple(parts[::2]) for parts in split}) == 1
    step = np.median(np.abs(np.diff(np.sort(freqs)))) if len(freqs) > 1 else 0.0
    columns = np.array([parts[1::2] for parts in split]).T if alike else ()
    columns = [column for column in columns if len({*column}) == len(names)]
    near = False
    for column in columns:
        may_be = [(factor * column, _SHARE * step) for factor in _IN_NAMES]
        for numbers, reach in (*may_be, (FREQ_21CM / (1 + column), np.inf)):  # redshifts have fewer digits
            if np.median(np.abs(np.sort(numbers) - np.sort(freqs))) > step:
                continue
            near = True
            other = (np.argsort(numbers) != np.argsort(freqs)) | (np.abs(numbers - freqs) > reach)
            if other.any():
                n = int(other.argmax())
                raise InputError(
                    f"--freqs are assigned to the files in the order of names, and {names[n]} would have "
                    f"{freqs[n]:.10g} MHz: sort --freqs by the numbers in the names, or rename the files."
                )
    by_digits = sorted(names, key=lambda name: _numbers_in(name, _DIGITS))
    for order in (by_digits, *([names[n] for n in np.argsort(column)] for column in columns)):
        if not near and list(names) != order:
            raise InputError(
                f"the order of the files is {', '.join(names[:3])}, ... by the first number in their names "
                f"but {', '.join(order[:3])}, ... by another, or if it is not a decimal: rename the files so "
                "that only one number differs, with the same number of digits in all names."
            )


def stated_freqs(names, called, headers=None):
    """Frequencies for a `Layout`, a dict, from names or headers of files, which must agree."""
    in_headers = [freq_in_header(*pair) for pair in zip(headers or [{}] * len(names), names, strict=True)]
    stated = [freqs_in(name) for name in names]
    if all(len(freqs) == 1 for freqs in stated):
        several = zip(stated, in_headers, names, strict=True)
        freqs = [agreed(*in_name, in_header, name) for in_name, in_header, name in several]
        return {"freqs": np.array(freqs), "freqs_from": called}
    if None not in in_headers:
        return {"freqs": np.array(in_headers), "freqs_from": "FREQ in the headers"}
    return {}
