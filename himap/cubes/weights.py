"""Weights and flags of a cube of one's own, from arrays and files, in the layout of the cube's own file."""

import os
from dataclasses import replace
from functools import partial

import numpy as np

from himap.checks import real_array
from himap.cubes import fits, hdf5, images
from himap.cubes.raw import LARGEST, RawCube, check_cube_room, same_freqs
from himap.errors import InputError
from himap.maps import sphere
from himap.maps.healpix_files import ENDINGS, to_ring
from himap.maps.shapes import pixels_last, sphere_sizes
from himap.reading import mapped_array, read_array, regular_file

__all__ = ["missing_told", "names_beside", "seen_weights"]

_HELD = 2  # cubes in float32 beside the one in the file: weights are float64


def names_beside(path, weights, flags):
    """Which datasets of the cube's own HDF5 file are its weights and flags, and no maps: a set of names."""
    given = {"weights": weights, "flags": flags}
    return {name for name, file in given.items() if _is_path(file) and _same_file(path, file)}


def seen_weights(raw, *, weights=None, flags=None, nested=False):
    """Weights of the voxels of a `RawCube`, (n_in_file, n_pix) float64, in its order; 0 where missing.

    Parameters
    ----------
    raw
        The `RawCube`, with its frequencies; voxels that are not finite, or UNSEEN, are missing.
    weights, flags
        Each an array of the pixels, (n_pix,), or of the voxels, (n_channels, n_pix), in the order of those in
        the file of the cube; of images (n_y, n_x) or (n_channels, n_y, n_x); or the path of one. Of flags
        True (or 1) is bad, and missing.
    nested
        The order of the pixels of the cube.

    Raises
    ------
    InputError
        A file that cannot be read, is of another nside, of other channels or of something else than weights
        or flags.
    """
    out = np.ones(raw.maps.shape)
    if weights is not None:
        out *= _checked("the weights", _values(weights, "weights", raw, nested), _is_weight, _WEIGHTS)
    if flags is not None:
        bad = _checked("the flags", _values(flags, "flags", raw, nested), _is_flag, _FLAGS)
        out[np.broadcast_to(bad > 0, out.shape)] = 0
    for row, pixels in zip(out, raw.maps, strict=True):
        row[~(np.abs(pixels) < LARGEST)] = 0  # NaN too
    return out


def missing_told(weights):
    """Sentences on the voxels without weight of pixels that have some, (n_channels, n_seen): one or none."""
    share = np.mean(weights == 0)
    if not share:
        return []
    return [
        f"{share:.2%} of the voxels in these pixels are missing (flagged, not seen or of no weight): they "
        "count nothing, what is left of them is not told, and the spectra have 0 in their place."
    ]


_WEIGHTS = "finite and 0 or more; 0 means not seen"
_FLAGS = "True (or 1) where a voxel is bad and False (or 0) where it is good"


def _is_weight(values):
    return (values >= 0) & np.isfinite(values)


def _is_flag(values):
    return (values == 0) | (values == 1)


def _checked(label, values, right, words):
    n_bad = sum(np.count_nonzero(~right(row)) for row in values)
    if n_bad:
        raise InputError(f"{label} must be {words}; {n_bad} are not.")
    return values


def _is_path(given):
    return isinstance(given, str) or hasattr(given, "__fspath__")


def _same_file(one, other):
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


def _values(given, word, raw, nested):
    """Numbers (n_channels or 1, n_pix) in the order of the cube, of an array or a path."""
    label = f"the {word} {given}" if _is_path(given) else f"the {word}"
    read = _read if raw.image is None else partial(_read_image, image=raw.image)
    flat = _by_channel if raw.image is None else partial(_images_by_channel, image=raw.image)
    beside = read(given, word) if _is_path(given) else RawCube(maps=flat(label, given))
    n_channels, n_pix = raw.maps.shape
    if beside.maps.shape not in ((1, n_pix), (n_channels, n_pix)):
        raise InputError(
            f"{label} must be of the pixels of the cube, ({n_pix},), or of its voxels, "
            f"{(n_channels, n_pix)}, all channels in its file included; got {beside.maps.shape}."
        )
    told = beside.freqs if len(beside.maps) > 1 else None
    if told is not None and not same_freqs(told, raw.freqs).all():
        raise InputError(f"{label} must have the channels of the cube in the order of its own file.")
    if beside.nested is None or beside.nested == nested:
        return beside.maps
    ring = sphere.nest_to_ring(sphere.nside_of(beside.maps))
    return np.array([to_ring(row) if beside.nested else row[ring] for row in beside.maps])


def _numbers(label, values):
    values = np.asarray(values)
    return real_array(label, values.astype(np.uint8) if values.dtype == bool else values)


def _by_channel(label, values):
    """Numbers as (n_channels or 1, n_pix)."""
    values = _numbers(label, values)
    if values.ndim not in (1, 2) or not sphere_sizes(values.shape):
        raise InputError(
            f"{label} must have shape (n_pix,) or (n_channels, n_pix) with n_pix = 12 nside^2, got "
            f"{values.shape}."
        )
    return pixels_last(np.atleast_2d(values))


def _images_by_channel(label, values, image):
    """Numbers of an image (n_y, n_x), or of all channels of a cube of them, as (n_channels or 1, n_pix)."""
    values = _numbers(label, values)
    if values.ndim not in (2, 3) or values.shape[-2:] != image.shape:
        raise InputError(
            f"{label} must have the shape of an image of the cube, {image.shape}, or of one for each "
            f"channel, got {values.shape}."
        )
    return values.reshape(-1, values.shape[-2] * values.shape[-1])


def _read_image(path, word, image):
    """The `RawCube` of a file of weights or flags for a cube of images: of one image, or by channel."""
    name = regular_file(path, f"file of {word}").name.lower()
    if name.endswith(".npy"):
        return RawCube(maps=_images_by_channel(*_read_array(path, word), image))
    if not name.endswith(ENDINGS):
        raise InputError(f"the {word} {path} of a cube of images must be a .fits or .npy file.")
    if images.has_frequencies(path):
        beside = images.images_of_files([regular_file(path)], held=_HELD)
        if not image.same(None, beside.image, None):
            raise InputError(
                f"the {word} {path} must have the axes of the sky of the cube, {image.size(None)}, got "
                f"{beside.image.size(None)}, or other coordinates; reproject them to the header of the cube."
            )
    else:
        beside = RawCube(maps=image.one_image(path, f"file of {word}")[None])
    return replace(beside, maps=_filled(beside.maps, word))


def _filled(maps, word):
    """What a FITS file marks as not seen has no weight, and is bad."""
    return np.nan_to_num(maps, nan=0.0 if word == "weights" else 1.0)


def _read(path, word):
    """The `RawCube` of a file of weights or flags."""
    name = regular_file(path, f"file of {word}").name.lower()
    if name.endswith(hdf5.ENDINGS):
        beside = hdf5.dataset_of_file(path, word, held=_HELD)
        return replace(beside, maps=_by_channel(f"{word} in {path}", beside.maps))
    if name.endswith(ENDINGS):
        beside = fits.maps_of_file(regular_file(path), held=_HELD)
        if beside.nested is None:
            raise InputError(
                f"the {word} {path} must say ORDERING = RING or NESTED in the header; write them again with "
                "healpy.write_map."
            )
        return replace(beside, maps=_filled(beside.maps, word))
    if not name.endswith(".npy"):
        raise InputError(f"the {word} {path} must be a .h5, .fits or .npy file.")
    return RawCube(maps=_by_channel(*_read_array(path, word)))


def _read_array(path, word):
    """What a .npy file of weights or flags is called in errors, and its array, if there is room for it."""
    mapped = mapped_array(path)
    check_cube_room(path, mapped.size, mapped.dtype.itemsize, _HELD)
    return f"the {word} {path}", read_array(path)
