"""Cubes of channel maps as they are on disk: HDF5, FITS, .npy. Nothing that is read can run code."""

import re
from pathlib import Path

import h5py
import numpy as np
from astropy import units as u

from himap.cubes import fits
from himap.cubes.raw import RawCube
from himap.errors import InputError
from himap.maps import sphere
from himap.maps.healpix_files import is_nested
from himap.reading import read_array, read_numbers

__all__ = ["read_freqs", "read_raw"]

_HDF5 = (".h5", ".hdf5", ".hdf")


def read_raw(path, *, maps_name=None, freqs_name=None):
    """The `RawCube` of an HDF5 or FITS file, of a folder of FITS files (one for each channel), or of .npy.

    Parameters
    ----------
    path
        File or folder.
    maps_name, freqs_name
        Datasets of an HDF5 file; found by their shapes and names unless given.

    Raises
    ------
    InputError
        No such file, another format, or a file that does not hold one cube of HEALPix maps.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"there is no file {path}.")
    if path.is_dir():
        return fits.maps_of_folder(path)
    readers = {
        _HDF5: lambda: _hdf5(path, maps_name, freqs_name),
        fits.ENDINGS: lambda: fits.maps_of_file(path),
    }
    readers[(".npy",)] = lambda: _npy(path)
    for suffixes, reader in readers.items():
        if path.name.lower().endswith(suffixes):
            if suffixes is not _HDF5 and (maps_name or freqs_name):
                raise InputError(f"names of datasets are for HDF5 files; {path} is none.")
            return reader()
    raise InputError(
        f"{path}: a cube is a .h5, .fits or .npy file, or a folder of .fits files, one for each channel."
    )


def read_freqs(path):
    """Frequencies of a .npy file or a text file with one number a line, (n,), in MHz."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"there is no file of frequencies {path}.")
    return read_numbers(path).ravel()


def _npy(path):
    maps = read_array(path)
    if maps.ndim != 2 or maps.dtype.kind not in "fiu" or not _sphere_sizes(maps.shape):
        raise InputError(
            f"{path} must hold numbers of shape (n_channels, n_pix) with n_pix = 12 nside^2, "
            f"got {maps.dtype} {maps.shape}."
        )
    return RawCube(maps=pixels_last(maps))


def _hdf5(path, maps_name, freqs_name):
    try:
        with h5py.File(path, "r") as file:
            arrays = {}
            file.visititems(lambda name, item: arrays.update({name: item} if _is_numeric(item) else {}))
            maps = arrays[_the_maps(path, arrays, maps_name)]
            values = pixels_last(maps[...])
            name = _the_freqs(path, arrays, freqs_name, len(values))
            return RawCube(
                maps=values,
                freqs=None if name is None else _in_mhz(arrays[name][...], _attribute(arrays[name], "unit")),
                unit=_attribute(maps, "unit") or _attribute(file, "unit"),
                nested=is_nested(_attribute(maps, "order") or _attribute(file, "order")),
            )
    except OSError as error:
        raise InputError(f"{path} cannot be read as HDF5 ({error}).") from None


def _is_numeric(item):
    return isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu"


def _sphere_sizes(shape):
    """The numbers among `shape` that are those of the pixels of a sphere."""
    return [n for n in shape if sphere.is_n_pix(n)]


def pixels_last(maps):
    """`maps` as (n_channels, n_pix): the larger of the two sizes that a sphere can have is the pixels."""
    sizes = _sphere_sizes(maps.shape)
    return maps if sizes and maps.shape[1] == max(sizes) else maps.T


def _the_maps(path, arrays, name):
    if name is not None:
        if name not in arrays:
            raise InputError(f"{path} has no dataset {name}; it has {_listing(arrays)}.")
        if arrays[name].ndim != 2 or not _sphere_sizes(arrays[name].shape):
            raise InputError(
                f"{name} in {path} must be (n_channels, n_pix) with n_pix = 12 nside^2, "
                f"got {arrays[name].shape}."
            )
        return name
    fitting = [dataset for dataset, item in arrays.items() if item.ndim == 2 and _sphere_sizes(item.shape)]
    if len(fitting) != 1:
        listing = f"{len(fitting)} are: {', '.join(fitting)}" if fitting else f"it has {_listing(arrays)}"
        raise InputError(
            f"{path}: one dataset must be (n_channels, n_pix) with n_pix = 12 nside^2, but {listing}. "
            "Name it with --maps."
        )
    return fitting[0]


def _the_freqs(path, arrays, name, n_channels):
    if name is not None:
        if name not in arrays or arrays[name].shape != (n_channels,):
            raise InputError(
                f"{path} must have a dataset {name} of {n_channels} frequencies; it has {_listing(arrays)}."
            )
        return name
    lines = [dataset for dataset, item in arrays.items() if item.shape == (n_channels,)]
    for tells in (_is_called_frequency, lambda dataset: _is_frequency(_attribute(arrays[dataset], "unit"))):
        matches = [dataset for dataset in lines if tells(dataset)]
        if len(matches) == 1:
            return matches[0]
    return None


def _is_called_frequency(name):
    return re.fullmatch(r"freq\w*|nus?|nu_\w+|\w*_mhz", name.rpartition("/")[2], re.IGNORECASE)


def _is_frequency(unit):
    try:
        return unit is not None and u.Unit(unit).is_equivalent(u.Hz)
    except ValueError:
        return False


def _listing(arrays):
    return "; ".join(f"{name} {item.shape}" for name, item in arrays.items()) or "no arrays of numbers"


def _attribute(item, start):
    """The text of the attribute whose name starts like `start`, or None."""
    for name, value in item.attrs.items():
        if name.lower().startswith(start):
            return value.decode() if isinstance(value, bytes) else str(value)
    return None


def _in_mhz(values, unit):
    """Frequencies of a file in MHz; without a unit they are taken to be that."""
    try:
        return np.asarray(values, dtype=float) * u.Unit(unit or "MHz").to(u.MHz)
    except (ValueError, u.UnitConversionError):
        raise InputError(f"frequencies must be in Hz, MHz or GHz, the file says {unit!r}.") from None
