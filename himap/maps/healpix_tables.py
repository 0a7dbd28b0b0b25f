"""The maps in a table of FITS as its header describes them: their scale, missing pixels, parts of the sky.

Read without healpy's own reader, which takes the first table of several, scales before it looks for the
markers of missing pixels, and counts negative pixel numbers from the end.
"""

import healpy as hp
import numpy as np
from astropy.io import fits

from himap.core.errors import InputError
from himap.core.memory import check_room
from himap.maps import sphere

_NUMBERS = "BIJKED"  # letters of TFORM: integers and floats
_UNSEEN = 1e-5  # relative: how close to healpy's UNSEEN a missing pixel is


def only_table(file, *, first):
    """The table of maps of an open FITS file; the `first` of several, where that is enough.

    Raises
    ------
    InputError
        There is none, or another one that holds maps too.
    """
    tables = [hdu for hdu in file if isinstance(hdu, fits.BinTableHDU)]
    if not tables:
        raise InputError("there is no table of maps; images in the plane are none.")
    more = [hdu for hdu in tables[1:] if _lengths(hdu) & _lengths(tables[0])]
    if more and not first:
        raise InputError(
            f"there are maps in {1 + len(more)} tables; write them as columns of one, as "
            "healpy.write_map(path, maps) does."
        )
    return tables[0]


def _lengths(hdu):
    """How many numbers the columns of a table hold, a set."""
    repeats = {column.format[:-1] for column in hdu.columns if column.format[-1:] in _NUMBERS}
    return {int(repeat or 1) * hdu.header["NAXIS2"] for repeat in repeats if not repeat or repeat.isdecimal()}


def maps_of_table(hdu, *, n_maps=None, partial=False, held=1):
    """The first `n_maps` maps of a table, or all, (n, n_pix) float32 or float64, and their columns.

    NaN where a pixel is UNSEEN, the TNULL of its column or BAD_DATA, or has no value.

    Parameters
    ----------
    hdu
        The table.
    n_maps
        How many maps are wanted.
    partial
        Whether the first column has the numbers of the pixels.
    held
        How many such arrays the caller will hold: they must fit into memory.

    Returns
    -------
    (ndarray, list of int)
        The maps, and the number of the column of each, as FITS counts them, from 1.

    Raises
    ------
    InputError
        What the header says cannot be, or does not fit.
    """
    header = hdu.header
    numbers = range(1 + partial, 1 + len(hdu.columns))[:n_maps]
    if not numbers:
        raise InputError("there is no column with a map.")
    for number in range(1, numbers[-1] + 1):
        _check_column(hdu.columns[number - 1])
    n_pix = _n_pix(hdu, numbers, partial)
    check_room("it", hdu.size + 8 * held * len(numbers) * n_pix)
    rows = hdu.data.view(np.ndarray)  # as they are stored: markers of missing pixels are not scaled
    pixels = _pixel_numbers(rows, hdu.header, n_pix) if partial else slice(None)
    dtype = np.result_type(*(_kind(hdu, rows, number) for number in numbers))
    maps = np.full((len(numbers), n_pix), np.nan, dtype=dtype)
    for out, number in zip(maps, numbers, strict=True):
        out[pixels] = _values(rows[rows.dtype.names[number - 1]].ravel(), header, number, dtype)
    return maps, list(numbers)


def _check_column(column):
    if column.format.lstrip("0123456789") not in tuple(_NUMBERS):
        raise InputError(f"maps are real numbers, and the column {column.name} has TFORM {column.format}.")


def _n_pix(hdu, numbers, partial):
    """Pixels of the sphere, by what the header says."""
    header = hdu.header
    lengths = {int(hdu.columns[n - 1].format[:-1] or 1) * header["NAXIS2"] for n in numbers}
    if len(lengths) > 1:
        raise InputError(f"its columns must have one length, got {sorted(lengths)}.")
    nside = header.get("NSIDE")
    if partial and not isinstance(nside, int):
        raise InputError(f"with the pixels of a part of the sky it must say NSIDE, got {nside!r}.")
    n_pix = 12 * nside**2 if partial else lengths.pop()
    if not sphere.is_n_pix(n_pix):
        raise InputError(f"a HEALPix map has 12 nside^2 pixels, nside a power of two; got {n_pix} pixels.")
    if isinstance(nside, int) and nside > 0 and n_pix != 12 * nside**2:
        raise InputError(f"it says NSIDE = {nside}, but its columns have {n_pix} pixels.")
    return n_pix


def _pixel_numbers(rows, header, n_pix):
    """The first column, checked: each pixel of the sphere once at most."""
    pixels = rows[rows.dtype.names[0]].ravel()
    if pixels.dtype.kind not in "iu":
        raise InputError(f"its first column must be the pixel numbers, got {pixels.dtype}.")
    pixels = pixels.astype(np.int64) + int(header.get("TZERO1", 0))
    if pixels.size and not (pixels.min() >= 0 and pixels.max() < n_pix):
        raise InputError(
            f"pixel numbers go from {pixels.min()} to {pixels.max()}, those of the sphere to {n_pix - 1}."
        )
    if len(np.unique(pixels)) < len(pixels):
        raise InputError("some pixel numbers stand there twice; each pixel has one value.")
    return pixels


def _kind(hdu, rows, number):
    """The floats that hold a column, exactly where it is not scaled."""
    kind = np.result_type(rows.dtype[number - 1].base.newbyteorder("="), np.float32)
    scaled = any(f"{key}{number}" in hdu.header for key in ("TSCAL", "TZERO"))
    return np.result_type(kind, np.float64) if scaled else kind


def _values(stored, header, number, dtype):
    values = stored.astype(dtype)
    values *= dtype.type(header.get(f"TSCAL{number}", 1))
    values += dtype.type(header.get(f"TZERO{number}", 0))
    null, bad = header.get(f"TNULL{number}"), header.get("BAD_DATA")
    missing = np.abs(values - hp.UNSEEN) <= _UNSEEN * abs(hp.UNSEEN)
    if null is not None:
        missing |= stored == null
    if bad is not None:
        missing |= stored == stored.dtype.type(bad) if stored.dtype.kind == "f" else values == bad
    values[missing] = np.nan
    return values
