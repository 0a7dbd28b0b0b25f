"""Which axis of an array is which: by names that the caller gives, by sizes, or as a header says."""

import numpy as np

from himap.core.errors import InputError
from himap.cubes.layout import is_seen
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


def named_axes(axes, names):
    """`axes` in the words of `names`, as a list.

    Parameters
    ----------
    axes
        Of an array, in the order of numpy, in one text: "ra,dec,freq".
    names
        Those that there must be, once each: of "freq", "lat", "lon" and "pixel".

    Raises
    ------
    InputError
        Others.
    """
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
    """A sentence on channels, (n_channels, n_pix) of images, that look like a line of the sky.

    Foregrounds change smoothly with frequency, but for a gain that all lines of sight have: what a parabola
    times their mean leaves is larger along the axes of the sky. Of 48 places along each axis. Which of the
    axes of the sky is which then is not known.
    """
    cube = maps.reshape(-1, *pixels.shape)
    cube = cube[tuple(slice(None, None, -(-n // 48)) for n in cube.shape)]
    seen = is_seen(cube)
    cube = np.where(seen, cube, 0).astype(float)
    turned = ([np.moveaxis(one, axis, 0) for one in (cube, seen)] for axis in range(3))
    along_freq, *along_sky = (_roughness(*(one.reshape(len(one), -1) for one in both)) for both in turned)
    least = min(along_sky)
    if not (least < _SMOOTH and least < _LESS * along_freq):
        return ()
    places = pixels.parts[0].order[:3]  # in the array, of what was read as frequency and as the sky
    place = sorted(places).index(places[1 + along_sky.index(least)])
    orders = [[*sky[:place], "freq", *sky[place:]] for sky in (["ra", "dec"], ["dec", "ra"])]
    return (
        f"The channels are less alike than the lines along the {('first', 'second', 'last')[place]} axis of "
        "the array in numpy, as of an array that is not turned round for its header: if frequencies are "
        f"there, give --axes {' or '.join(map(','.join, orders))}.",
    )


def _roughness(lines, seen):
    """Share of the power of lines (n, n_lines), 0 where not seen, that their mean times a parabola leaves.

    1 where there are too few places to say.
    """
    enough = seen.sum(axis=0) > 2 * _N_FITTED
    lines, seen = lines[:, enough], seen[:, enough].astype(float)
    power = np.sum(lines**2)
    if not power:
        return 1.0
    both = seen @ seen.T
    mean = np.linalg.eigh(lines @ lines.T / np.maximum(both, 1))[1][:, -1]
    basis = mean[:, None] * np.vander(np.linspace(-1, 1, len(lines)), _N_FITTED)
    normal = np.einsum("ki,kj,kn->nij", basis, basis, seen)
    fitted = np.linalg.pinv(normal, hermitian=True) @ (basis.T @ lines).T[..., None]
    return float(np.sum((lines - seen * (basis @ fitted[..., 0].T)) ** 2) / power)


def check_world_axes(header, shape, name):
    """Refuse a header that has fewer axes than its array, of this shape."""
    n_world, lengths = header.get("WCSAXES"), tuple(shape)[::-1]
    n_long = max((n for n, length in enumerate(lengths, 1) if length > 1), default=0)
    if isinstance(n_world, int) and n_world < n_long:
        raise InputError(
            f"{name}: its header is of {n_world} axes (WCSAXES) and its array of {len(lengths)}, "
            f"{' x '.join(map(str, lengths))} as FITS counts: which axis is which is not known. Write it "
            "with a header of three axes, transposed to (channel, Dec, RA) in numpy, or give its axes in the "
            "order of numpy: --axes ra,dec,freq or dec,ra,freq where channels are last, freq,dec,ra or "
            "freq,ra,dec where they are first."
        )


def turn_of(stored, axes, world, name):
    """Axes of an array of shape `stored` in the order of its header: as they are, or as `axes` says.

    `world` has the place of each of "lon", "lat" and "freq" in the header, from 0.
    """
    n_axes, turn = len(stored), [*range(len(stored))]
    if axes is None:
        return tuple(turn)
    words = named_axes(axes, tuple(world))
    long = [axis for axis in turn if stored[axis] > 1]
    if len(long) > len(words):
        raise InputError(f"{name} has {len(long)} axes longer than one, and --axes names {len(words)}.")
    short = [axis for axis in turn if axis not in long]
    while len(long) < len(words):  # an axis of length one that is named, the last ones first
        long.append(short.pop())
    places = {n_axes - 1 - world[word]: axis for word, axis in zip(words, sorted(long), strict=True)}
    return tuple(places[place] if place in places else short.pop() for place in range(n_axes))
