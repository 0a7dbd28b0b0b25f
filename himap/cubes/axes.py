"""Which axis of an array, and which file of a folder, is which.

Axes are known by names that the caller gives, by sizes, or as a header says; files by the numbers in their
names, and whether these fit the frequencies of channels.
"""

import re

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import format_of
from himap.core.survey import FREQ_21CM
from himap.cubes.layout import is_seen, listed
from himap.maps.healpix_io import agreed, freq_in_header, freqs_in
from himap.maps.sphere import sphere_sizes

_N_FITTED = 3  # numbers of a parabola
_SMOOTH = 1e-3  # of the power, that it leaves along an axis that looks like frequency
_LESS = 0.01  # of what it leaves along the axis that is said to be
_AXES = {
    **dict.fromkeys(("ra", "lon", "glon", "l", "x"), "lon"),
    **dict.fromkeys(("dec", "lat", "glat", "b", "y"), "lat"),
    **dict.fromkeys(("freq", "freqs", "frequency", "nu", "channel"), "freq"),
    **dict.fromkeys(("pixel", "pixels", "pix"), "pixel"),
}

_DIGITS = re.compile(r"([0-9]+)")
_DECIMALS = re.compile(r"([0-9]+(?:[.,p][0-9]+)?)")
_IN_NAMES = (1.0, 1e3, 1e-3, 1e-6)  # MHz in what names may be in: MHz, GHz, kHz, Hz
_SHARE = 0.6  # of a channel, that a number in a name may be from its centre: names may have its edge


def named_axes(axes, names):
    """`axes` of an array in the order of numpy, such as "ra,dec,freq", as a list of `names`, once each."""
    words = [_AXES.get(word.strip().lower()) for word in str(axes).split(",")]
    if sorted(map(str, words)) != sorted(names):
        like = "freq,pixel" if "pixel" in names else "ra,dec,freq"
        raise InputError(
            f"axes= (--axes) names those of the array in the order of numpy, such as {like}; got {axes!r}."
        )
    return words


def pixel_axis(shape, axes=None):
    """Which of the two axes of maps of the sphere is that of pixels, and remarks: by `axes`, or by sizes."""
    if axes is not None:
        return named_axes(axes, ("freq", "pixel")).index("pixel"), ()
    sizes = sphere_sizes(shape)
    if len(sizes) < 2:
        return int(shape[1] in sizes), ()
    which = "last" if shape[0] == shape[1] else "longer"
    return int(shape[1] == max(sizes)), (
        f"both axes, {shape[0]} and {shape[1]}, could be pixels of a sphere: the {which} one was assumed to "
        "be (--axes freq,pixel or pixel,freq says it).",
    )


def remark_on_axes(maps, pixels):
    """A sentence on channels (n_channels, n_pix) of images that look like a line of the sky, if they do.

    Foregrounds change smoothly with frequency but for a gain that all lines of sight have: what a parabola
    times their mean leaves is larger along the axes of the sky. Of 48 places along each axis.
    """
    cube = maps.reshape(-1, *pixels.shape)
    cube = cube[tuple(slice(None, None, -(-n // 48)) for n in cube.shape)].astype(float)
    turned = (np.moveaxis(cube, axis, 0) for axis in range(3))
    along_freq, *along_sky = (_roughness(lines.reshape(len(lines), -1)) for lines in turned)
    least = min(along_sky)
    if not (least < _SMOOTH and least < _LESS * along_freq):
        return ()
    places = pixels.parts[0].order[:3]  # in the array, of what was read as frequency and as the sky
    place = sorted(places).index(places[1 + along_sky.index(least)])
    orders = [[*sky[:place], "freq", *sky[place:]] for sky in (["ra", "dec"], ["dec", "ra"])]
    return (
        f"The channels are less alike than the lines along the {('first', 'second', 'last')[place]} axis of "
        f"the array in numpy: if frequencies are there, give --axes {' or '.join(map(','.join, orders))}.",
    )


def _roughness(lines):
    """Share of the power of lines (n, n_lines) that their mean times a parabola leaves; 1 of few places.

    Places without any value, or with one everywhere, as a dead channel, do not count.
    """
    seen = is_seen(lines)
    some = np.where(seen, lines, -np.inf).max(axis=1) > np.where(seen, lines, np.inf).min(axis=1)
    lines = lines[some][:, seen[some].all(axis=0)]  # those that are seen wherever any is
    if len(lines) <= 2 * _N_FITTED or not lines.any():
        return 1.0
    mean = np.linalg.eigh(lines @ lines.T)[1][:, -1]
    basis, _ = np.linalg.qr(mean[:, None] * np.vander(np.linspace(-1, 1, len(lines)), _N_FITTED))
    return float(np.sum((lines - basis @ (basis.T @ lines)) ** 2) / np.sum(lines**2))


def turn_of(stored, axes, world):
    """Axes of an array of shape `stored` in the order of its header: as they are, or as `axes` says.

    `world` has the place of each of "lon", "lat" and "freq" in the header, from 0.
    """
    n_axes = len(stored)
    if axes is None:
        return tuple(range(n_axes))
    words = named_axes(axes, tuple(world))
    # Those that are longer than one have names, and of the others the last ones.
    *rest, one, two, three = sorted(range(n_axes), key=lambda axis: (stored[axis] > 1, axis))
    named = sorted((one, two, three))
    places = {n_axes - 1 - world[word]: axis for word, axis in zip(words, named, strict=True)}
    return tuple(places[place] if place in places else rest.pop() for place in range(n_axes))


def fits_in(folder):
    """The FITS files in a folder in the order of their names, and a sentence on others, if any, in a list."""
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be read ({error.strerror}).") from None
    paths = [path for path in entries if format_of(path) == "FITS" and not path.name.startswith(".")]
    if not paths:
        raise InputError(f"the folder {folder} holds no FITS file.")
    paths.sort(key=lambda path: (_numbers_in(path.name), _numbers_in(path.name, _DIGITS)))
    others = [path.name for path in entries if path not in paths]
    return paths, [f"{len(others)} more in the folder, no maps, left out: {listed(others)}."] * bool(others)


def _numbers_in(name, pattern=_DECIMALS):
    """A name as [text, number, text, ...]; numbers as decimals or, with `_DIGITS`, as digits alone."""
    parts = pattern.split(name)
    return [float(re.sub("[p,]", ".", part)) if n % 2 else part for n, part in enumerate(parts)]


def check_names(names, freqs):
    """Refuse frequencies (n,), MHz, that are given to files in another order than their names have.

    Numbers in names that are near the frequencies, in any unit or as redshifts, must be those of their own
    files. Without such numbers the order of names must not depend on how decimals are written, or on which of
    several numbers counts.
    """
    split = [_numbers_in(name) for name in names]
    alike = len({tuple(parts[::2]) for parts in split}) == 1
    step = np.median(np.abs(np.diff(np.sort(freqs)))) if len(freqs) > 1 else 0.0
    columns = np.array([parts[1::2] for parts in split]).T if alike else ()
    columns = [column for column in columns if len({*column}) == len(names)]
    near = False
    for column in columns:
        may_be = [(factor * column, _SHARE * step) for factor in _IN_NAMES]
        for numbers, reach in (*may_be, (FREQ_21CM / (1 + column), np.inf)):  # redshifts are rounded more
            if np.median(np.abs(np.sort(numbers) - np.sort(freqs))) > step:
                continue
            near = True
            other = (np.argsort(numbers) != np.argsort(freqs)) | (np.abs(numbers - freqs) > reach)
            if other.any():
                n = int(other.argmax())
                raise InputError(
                    f"--freqs are given to the files in the order of their names, and {names[n]} would have "
                    f"{freqs[n]:.10g} MHz: sort --freqs as the numbers in the names are, or rename the files."
                )
    by_digits = sorted(names, key=lambda name: _numbers_in(name, _DIGITS))
    for order in (by_digits, *([names[n] for n in np.argsort(column)] for column in columns)):
        if not near and list(names) != order:
            raise InputError(
                f"the order of the files is {', '.join(names[:3])}, ... by the first number in their names "
                f"and {', '.join(order[:3])}, ... by another, or if it is no decimal: rename the files so "
                "that only one number differs, and has as many digits in all names."
            )


def stated_freqs(names, called, headers=None):
    """What a `Layout` has of frequencies, a dict: in all names, or in headers of files; both must agree."""
    in_headers = [freq_in_header(*pair) for pair in zip(headers or [{}] * len(names), names, strict=True)]
    stated = [freqs_in(name) for name in names]
    if all(len(freqs) == 1 for freqs in stated):
        several = zip(stated, in_headers, names, strict=True)
        freqs = [agreed(*in_name, in_header, name) for in_name, in_header, name in several]
        return {"freqs": np.array(freqs), "freqs_from": called}
    if None not in in_headers:
        return {"freqs": np.array(in_headers), "freqs_from": "FREQ in the headers"}
    return {}
