"""Weights, flags and masks of a cube, from arrays and files, in the layout of the cube's file."""

import os
from contextlib import suppress
from pathlib import Path

import numpy as np

from himap.core.checks import real_array
from himap.core.errors import InputError
from himap.core.reading import format_of, read_array, regular_file
from himap.cubes import fits, hdf5
from himap.cubes.axes import pixel_axis
from himap.cubes.layout import Layout, same_freqs
from himap.maps import sphere
from himap.maps.healpix_io import to_ring
from himap.maps.sphere import sphere_sizes

_RIGHT = {
    "weights": "finite and 0 or more; 0 means not observed",
    "flags": "True (or 1) where a voxel is bad and False (or 0) where it is good",
    "mask": "1 where kept and 0 elsewhere, such as mask > 0.5",
}
_UNSEEN = {"weights": 0.0, "flags": 1.0, "mask": 0.0}  # value of NaN or UNSEEN in FITS: bad, or no weight


def weight_datasets(path, weights, flags):
    """Datasets of the cube's HDF5 file that are its weights and flags, not maps: a set of names."""
    names = set()
    for name, given in {"weights": weights, "flags": flags}.items():
        with suppress(OSError, ValueError):
            if isinstance(given, str | os.PathLike) and os.path.samefile(path, given):
                names.add(name)
    return names


def voxel_weights(shape, layout, *, weights=None, flags=None, rotate=False):
    """Weights of the voxels of a cube, (n_in_file, n_pix) float64, RING, 0 where flagged, and its `Layout`.

    `shape` and `layout` are those of the maps from `himap.cubes.files.read_file`, complete; a missing frame
    of the layout is replaced by that of the weights, with a remark. Other parameters as in
    `himap.cubes.read_cube`; those of images are (n_y, n_x) or (n_channels, n_y, n_x). InputError for
    unreadable files, another nside or other channels, or invalid values.
    """
    out = np.ones(shape)
    for word, given in {"weights": weights, "flags": flags}.items():
        if given is not None:
            values, layout = _values(given, word, layout, shape, rotate)
            out *= values if word == "weights" else values == 0
    return out, layout


def read_mask(path, layout, *, rotate=False):
    """The mask in a file, (n_pix,) bool, RING, True for kept pixels, and the `Layout` of the cube.

    A FITS file has a HEALPix map, or an image, of 1 (kept) and 0, or of logical values; UNSEEN, NaN and
    pixels missing in a partial file are not kept. A .npy file has the pixel order of the cube's file. A
    missing frame of the layout is replaced by that of the mask, with a remark.

    Raises
    ------
    InputError
        No such file, no pixel order, other pixels than the cube, values other than 0 and 1, or another frame
        without `rotate`.
    """
    values, layout = _values(path, "mask", layout, (1, int(np.prod(layout.pixels.shape))), rotate)
    return values[0] > 0, layout


def _values(given, word, layout, shape, rotate):
    """Checked numbers (n_channels or 1, n_pix), RING, from an array or path; and the layout of the cube."""
    label, own = f"the {word}", layout.pixels
    if isinstance(given, str | os.PathLike):
        label = f"the {word} {given}"
        values, theirs = _read(given, word, layout)
    else:
        values, theirs = _by_channel(label, given, own), Layout(pixels=own)
    if values.shape not in ((1, shape[1]), shape):
        voxels = f", or of its voxels, {shape}, including all channels of its file"
        raise InputError(
            f"{label} must be{' one map' * (word == 'mask')} of the pixels of the cube, ({shape[1]},)"
            f"{voxels * (word != 'mask')}; got {values.shape}."
            f"{' healpy.ud_grade changes nside.' * own.whole_sky}"
        )
    is_right = (values >= 0) & np.isfinite(values) if word == "weights" else np.isin(values, (0, 1))
    if not is_right.all():
        raise InputError(f"{label} must be {_RIGHT[word]}; {np.count_nonzero(~is_right)} are not.")
    if len(values) > 1 and theirs.freqs is not None and not same_freqs(theirs.freqs, layout.freqs).all():
        raise InputError(f"{label} must have the channels of the cube in the order of its file.")
    frame = theirs.pixels.frame
    layout = layout.joined(label, frame, theirs.spectral_frame, rotate=rotate)
    if theirs.pixels.nested:
        values = np.array([*map(to_ring, values)])
    if frame not in (None, layout.pixels.frame):  # nearest values
        values = values[:, sphere.pixels_in_frame(own.nside, layout.pixels.frame, frame)]
    return values, layout


def _by_channel(label, values, pixels):
    """Real numbers, or True as 1, in these pixels, (n_channels or 1, n_pix); called `label` in errors."""
    is_bool = isinstance(values, np.ndarray) and values.dtype == bool
    values = real_array(label, values.astype(np.uint8) if is_bool else values)
    shape, on_sphere = pixels.shape, pixels.whole_sky
    fits_in = sphere_sizes(values.shape) if on_sphere else values.shape[-2:] == shape
    if values.ndim - len(shape) not in (0, 1) or not fits_in:
        one = "one map, n_pix = 12 nside^2" if on_sphere else f"an image of the cube, {shape}"
        raise InputError(f"{label} must have the shape of {one}, or one per channel, got {values.shape}.")
    if not on_sphere:
        return values.reshape(-1, shape[0] * shape[1])
    maps = np.atleast_2d(values)
    return maps if pixel_axis(maps.shape)[0] == 1 else maps.T


def _read(path, word, layout):
    """Numbers (n_channels or 1, n_pix) of a file, and its `Layout`."""
    label, own, form = f"the {word} {path}", layout.pixels, format_of(regular_file(path, f"file of {word}"))
    in_hdf5 = own.whole_sky and word != "mask"  # the meaning of a mask is unknown there
    if form == "npy":
        values, theirs = _by_channel(label, read_array(path), own), Layout(pixels=own)
        return np.nan_to_num(values) if word == "mask" else values, theirs
    if in_hdf5 and form == "HDF5":
        values, stated = hdf5.read_dataset(path, word)
        values = _by_channel(f"{word} in {path}", values, own)
        nested = own.nested if stated["nested"] is None else stated["nested"]
        return values, Layout.of_sphere(values, **stated | {"nested": nested})
    if form != "FITS":
        whose = "" if own.whole_sky else " of a cube of images"
        raise InputError(f"{label}{whose} must be a {'.h5, ' * in_hdf5}.fits or .npy file.")
    maps, theirs = fits.read_fits(Path(path), logical=True)
    if own.whole_sky and theirs.pixels.whole_sky and theirs.pixels.nested is None:
        raise InputError(f"{label} must state ORDERING = RING or NESTED; write it with healpy.write_map.")
    if not (own.whole_sky and theirs.pixels.whole_sky) and not own.same(theirs.pixels):
        got = f"{theirs.pixels.grid} {theirs.pixels}"
        raise InputError(
            f"{label} must have the {own.grid} of the cube, {own}, got {got}, or other coordinates; "
            "reproject them to the header of the cube."
        )
    if len(maps) > 1 and not own.whole_sky and any(np.diff(own.parts[0].turn) != 1):
        raise InputError(
            f"{label}: the array of the cube is transposed (--axes), but a FITS file of channels would not "
            f"be; give it as .npy of the shape (n_channels, {own.shape[0]}, {own.shape[1]})."
        )
    return np.where(np.isnan(maps), _UNSEEN[word], maps), theirs
