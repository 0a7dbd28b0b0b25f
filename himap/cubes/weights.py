"""Weights, flags and masks of a cube, from arrays and files, in the layout of the cube's own file."""

import os

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import format_of, mapped_array, read_array, regular_file
from himap.cubes import fits, hdf5
from himap.cubes.layout import by_channel, check_cube_room, is_seen, same_freqs
from himap.maps.healpix_io import to_ring

_HELD = 2  # cubes in float32 beside the one in the file: weights are float64
_RIGHT = {  # what is right in them, and how that is said
    "weights": (lambda v: (v >= 0) & np.isfinite(v), "finite and 0 or more; 0 means not seen"),
    "flags": (
        lambda v: (v == 0) | (v == 1),
        "True (or 1) where a voxel is bad and False (or 0) where it is good",
    ),
    "mask": (lambda v: (v == 0) | (v == 1), "1 where kept and 0 elsewhere, such as mask > 0.5"),
}


def is_path(given):
    """Whether it is the name of a file, and no array."""
    return isinstance(given, str) or hasattr(given, "__fspath__")


def weight_datasets(path, weights, flags):
    """Which datasets of the cube's own HDF5 file are its weights and flags, and no maps: a set of names."""

    def same_file(other):
        try:
            return is_path(other) and os.path.samefile(path, other)
        except (OSError, ValueError):
            return False

    return {name for name, file in {"weights": weights, "flags": flags}.items() if same_file(file)}


def voxel_weights(maps, layout, *, weights=None, flags=None, rotate=False):
    """Weights of the voxels of a cube, (n_in_file, n_pix) float64, in its order, and its `Layout`.

    Weights are 0 where a voxel is missing. The layout has the frame of the weights where it had none, and
    says so.

    Parameters
    ----------
    maps, layout
        As of `himap.cubes.files.read_file`, complete; voxels that are not finite, or UNSEEN, are missing.
    weights, flags
        Each an array of the pixels, (n_pix,), or of the voxels, (n_channels, n_pix), in the order of those in
        the file of the cube; of images (n_y, n_x) or (n_channels, n_y, n_x); or the path of one. Of flags
        True (or 1) is bad, and missing.
    rotate
        Whether those of another frame of coordinates are rotated; each pixel takes the value where it lies.

    Raises
    ------
    InputError
        A file that cannot be read, is of another nside, of other channels or of something else than weights
        or flags.
    """
    out = np.ones(maps.shape)
    for word, given in {"weights": weights, "flags": flags}.items():
        if given is None:
            continue
        values, layout = _values(given, word, layout, maps.shape, rotate)
        out *= values if word == "weights" else values == 0
    for row, pixels in zip(out, maps, strict=True):
        row[~is_seen(pixels)] = 0
    return out, layout


def read_mask(path, layout, *, rotate=False):
    """The mask in a file, (n_pix,) bool in the order of a `Cube`, True where kept, and its `Layout`.

    A FITS file has a HEALPix map, or an image, of 1 (kept) and 0, or of logical values; UNSEEN, NaN and
    pixels that a partial file leaves out are not kept. A .npy file has them in the order of the cube's own
    file. The layout has the frame of the mask where it had none, and says so.

    Raises
    ------
    InputError
        No such file, no order of pixels, others than those of the cube, values between 0 and 1, or another
        frame without `rotate`.
    """
    values, layout = _values(path, "mask", layout, (1, int(np.prod(layout.pixels.shape))), rotate)
    return layout.pixels.sorted(values[0] > 0), layout


def _values(given, word, layout, shape, rotate):
    """Checked numbers (n_channels or 1, n_pix) in the order of the cube, of an array or path; the layout."""
    label, frame, spectral_frame = f"the {word}", layout.pixels.frame, None
    if is_path(given):
        label = f"the {word} {given}"
        values, freqs, nested, frame, spectral_frame = _read(given, word, layout.pixels)
    else:
        values, freqs, nested = by_channel(label, given, layout.pixels), None, None
    if values.shape not in ((1, shape[1]), shape):
        voxels = f", or of its voxels, {shape}, all channels in its file included"
        raise InputError(
            f"{label} must be{' one map' * (word == 'mask')} of the pixels of the cube, ({shape[1]},)"
            f"{voxels * (word != 'mask')}; got {values.shape}. healpy.ud_grade changes nside."
        )
    is_right, right = _RIGHT[word]
    n_bad = sum(np.count_nonzero(~is_right(row)) for row in values)
    if n_bad:
        raise InputError(f"{label} must be {right}; {n_bad} are not.")
    if len(values) > 1 and freqs is not None and not same_freqs(freqs, layout.freqs).all():
        raise InputError(f"{label} must have the channels of the cube in the order of its own file.")
    layout = layout.joined(label, frame, spectral_frame, rotate=rotate)
    if (nested is None or nested == layout.pixels.nested) and frame in (None, layout.pixels.frame):
        return values, layout
    pixels = layout.pixels
    in_ring = (to_ring(row) if nested or (nested is None and pixels.nested) else row for row in values)
    return np.array([pixels.as_given(pixels.rotated(row, frame)) for row in in_ring]), layout


def _read(path, word, pixels):
    """Numbers (n_channels or 1, n_pix) of a file, and what it states: frequencies, NESTED, both frames."""
    file, label, on_sphere = regular_file(path, f"file of {word}"), f"the {word} {path}", pixels.whole_sky
    form, freqs, nested, frame, spectral_frame = format_of(file), None, None, pixels.frame, None
    if form == "npy":
        mapped = mapped_array(path)
        check_cube_room(path, mapped.size, mapped.dtype.itemsize, _HELD)
        values = by_channel(label, read_array(path), pixels)
        values = np.nan_to_num(values) if word == "mask" else values
        return values, freqs, nested, frame, spectral_frame
    in_hdf5 = on_sphere and word != "mask"  # whose meaning, kept or bad, is not known there
    if in_hdf5 and form == "HDF5":
        values, *stated = hdf5.read_dataset(path, word, held=_HELD)
        return by_channel(f"{word} in {path}", values, pixels), *stated
    if form != "FITS":
        whose = "" if on_sphere else " of a cube of images"
        raise InputError(f"{label}{whose} must be a {'.h5, ' * in_hdf5}.fits or .npy file.")
    if on_sphere:
        maps, layout = fits.read_fits(file, held=_HELD, logical=True)
        freqs, nested, frame = layout.freqs, layout.pixels.nested, layout.pixels.frame
        spectral_frame = layout.spectral_frame
        if nested is None:
            raise InputError(f"{label} must say ORDERING = RING or NESTED; write it with healpy.write_map.")
    else:
        maps, layout = fits.read_image_fits([file], held=_HELD)
        freqs, spectral_frame = layout.freqs, layout.spectral_frame
        if not pixels.same(layout.pixels):
            raise InputError(
                f"{label} must have the axes of the sky of the cube, {pixels}, got {layout.pixels}, or other "
                "coordinates; reproject them to the header of the cube."
            )
    unseen = 1.0 if word == "flags" else 0.0  # what FITS marks as not seen is bad, and has no weight
    return np.nan_to_num(maps, nan=unseen), freqs, nested, frame, spectral_frame
