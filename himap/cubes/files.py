"""Cubes of channel maps as they are on disk: HDF5, FITS, .npy. Nothing that is read can run code."""

from pathlib import Path

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import mapped_array, read_array, read_numbers, regular_file
from himap.cubes import fits, hdf5
from himap.cubes.layout import Layout, SpherePixels, check_cube_room, same_freqs
from himap.maps.healpix_files import ENDINGS
from himap.maps.shapes import pixels_last, sphere_sizes
from himap.sky.cosmology import FREQ_21CM

_REDSHIFT = 1e-5  # the same of redshifts, which have six digits


def read_file(path, *, maps_name=None, freqs_name=None, aside=(), held=1):
    """What an HDF5 or FITS file states, a folder of FITS files (one for each channel), or .npy.

    FITS holds HEALPix maps in a table, or an image cube with world coordinates; of these each file of a
    folder may have a range of channels.

    Parameters
    ----------
    path
        File or folder.
    maps_name, freqs_name
        Datasets of an HDF5 file; found by their shapes and names unless given.
    aside
        Datasets of an HDF5 file that are no maps and no masks, by the last part of their names.
    held
        Cubes in float32 that the caller will hold at once: they must fit into memory.

    Returns
    -------
    (ndarray, Layout)
        Maps (n_channels, n_pix) in the order, unit and pixelisation of the file, NaN where it marks them
        missing; and what it states of them.

    Raises
    ------
    InputError
        No such file, another format, a file that does not hold one cube, or too large a one.
    """
    is_folder = _is_folder(path)
    path = Path(path) if is_folder else regular_file(path)
    name = path.name.lower()
    if not is_folder and name.endswith(hdf5.ENDINGS):
        names = {"maps_name": maps_name, "freqs_name": freqs_name, "aside": aside}
        return hdf5.read_hdf5(path, **names, held=held)
    readers = {ENDINGS: fits.read_fits, (".npy",): read_npy}
    read = fits.read_folder if is_folder else None
    read = read or next((reader for endings, reader in readers.items() if name.endswith(endings)), None)
    if read is None:
        raise InputError(
            f"{path}: a cube is a .h5, .fits or .npy file, or a folder of .fits files, one for each channel."
        )
    if maps_name is not None or freqs_name is not None:
        raise InputError(f"names of datasets (--maps, --freqs-name) are for HDF5 files; {path} is none.")
    return read(path, held=held)


def _is_folder(path):
    try:
        return bool(str(path)) and Path(path).is_dir()
    except (OSError, ValueError, RuntimeError):  # no name that a file can have
        return False


def read_npy(path, *, held=1):
    """Maps and `Layout` of an array of HEALPix maps, which states nothing else."""
    maps = mapped_array(path)
    if maps.ndim != 2 or maps.dtype.kind not in "fiu" or not sphere_sizes(maps.shape):
        raise InputError(
            f"{path} must hold numbers of shape (n_channels, n_pix) with n_pix = 12 nside^2, "
            f"got {maps.dtype} {maps.shape}."
        )
    check_cube_room(path, maps.size, maps.dtype.itemsize, held)
    maps = pixels_last(read_array(path))
    return maps, Layout(pixels=SpherePixels.of(maps))


def read_freqs(path):
    """Frequencies that a file states, (n,), in MHz, and what it states, in words.

    Parameters
    ----------
    path
        A .npy file or a text file with one number a line, the centre of a channel. Or a table of the edges of
        channels that adjoin each other, as those of CRIME and CoLoRe, of which the means are taken: lower and
        upper; before them the number of the channel, from 1, or nothing; behind them the redshifts of the
        upper and the lower edge, or nothing.

    Raises
    ------
    InputError
        Another table: which of its columns is meant cannot be known.
    """
    numbers = read_numbers(regular_file(path, "file of frequencies"))
    if numbers.ndim == 1 or 1 in numbers.shape:
        return numbers.ravel(), "what was given"
    edges = _edges(numbers) if numbers.ndim == 2 else None
    if edges is None:
        raise InputError(
            f"{path} must have one frequency a line, the centre of a channel in MHz, or the edges of "
            "channels that adjoin (lower upper, or number lower upper, or that and redshifts, as of CRIME); "
            f"got a table of shape {numbers.shape}. Write the centres to a file, one a line."
        )
    return edges.mean(axis=1), f"the edges of channels in {path}"


def _edges(table):
    """Lower and upper edges, (n, 2), of a table that is exactly one of those of `read_freqs`, or None."""
    n_rows, n_columns = table.shape
    first = 0 if n_columns == 2 else 1
    edges = table[:, first : first + 2]
    if n_columns not in (2, 3, 5) or (first and not np.array_equal(table[:, 0], np.arange(1, n_rows + 1))):
        return None
    lower, upper = edges.T
    adjoin = any(
        same_freqs(end[:-1], start[1:]).all()  # edges that two channels share
        for start, end in ((lower, upper), (upper, lower))
    )
    if not (adjoin and (lower > 0).all() and (lower < upper).all()):
        return None
    redshifts = FREQ_21CM / edges[:, ::-1] - 1
    if n_columns == 5 and not np.allclose(table[:, 3:], redshifts, rtol=0, atol=_REDSHIFT):
        return None
    return edges
