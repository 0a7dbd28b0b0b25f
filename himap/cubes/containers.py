"""Cubes in the containers of cora, draco and caput (radiocosmology), which are HDF5 of one exact structure.

`map` has the axes (freq, pol, pixel), of the whole sphere. `index_map/freq` says what the channels are, a
table with a column `centre`, or plain numbers, both in MHz; `index_map/pol` the names of the polarisations.
"""

import h5py
import numpy as np

from himap.core.errors import InputError
from himap.maps import sphere

MAPS = "map"
FREQS = "index_map/freq"
_POLS = "index_map/pol"
_AXES = ["freq", "pol", "pixel"]
_INTENSITY = "I"


def is_one(file):
    """Whether the datasets of a file are a container of maps: `map` of three axes beside an `index_map`."""
    has_index = any(name.startswith("index_map/") for name in {*file.items, *file.elsewhere})
    return has_index and MAPS in file.arrays and file.arrays[MAPS].ndim == 3


def axes(file):
    """What the axes of the maps stand for.

    Returns
    -------
    (ndarray, int, tuple of str)
        Channel centres, MHz, (n_channels,); the place of Stokes I among the polarisations; and remarks.

    Raises
    ------
    InputError
        Another order of axes, no whole spheres, no frequencies or no Stokes I.
    """
    maps, path = file[MAPS], file.path
    n_channels, n_pols, n_pix = maps.shape
    stated = [_word(name) for name in np.atleast_1d(maps.attrs.get("axis", _AXES))]
    if stated != _AXES or not sphere.is_n_pix(n_pix):
        raise InputError(
            f"{MAPS} in {path} must have the axes (freq, pol, pixel) and 12 nside^2 pixels, got {stated} and "
            f"{maps.shape}."
        )
    pols = _column(file, _POLS, n_pols)
    if not h5py.check_string_dtype(pols.dtype):
        raise InputError(f"{_POLS} in {path} must be names of polarisations, got {pols.dtype}.")
    names = [_word(name) for name in pols[...]]
    if names.count(_INTENSITY) != 1:
        raise InputError(
            f"{_POLS} in {path} must have {_INTENSITY} once, got {', '.join(names)}; write the intensity of "
            "each channel to a dataset of (channels, pixels)."
        )
    table = _column(file, FREQS, n_channels)
    freqs = table.fields("centre")[...] if "centre" in (table.dtype.names or ()) else table[...]
    if freqs.dtype.kind not in "fiu":
        raise InputError(
            f"{FREQS} in {path} must be numbers, or a table with a column centre, in MHz; got {table.dtype}."
        )
    others = ", ".join(name for name in names if name != _INTENSITY)
    remarks = (f"Of the polarisations {others} are left out.",) if others else ()
    return freqs.astype(float), names.index(_INTENSITY), remarks


def _column(file, name, length):
    """The dataset of that name, of that length."""
    if name not in file.items:
        raise InputError(f"{file.path} has {MAPS} (freq, pol, pixel), but no {name} in its own file.")
    item = file[name]
    if item.shape != (length,):
        raise InputError(f"{name} in {file.path} must have {length} entries, got {item.shape}.")
    return item


def _word(value):
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
