"""Cubes in FITS: a file with a column for each channel, or a folder with a file for each."""

import re

import healpy as hp
import numpy as np

from himap.cubes.raw import RawCube, is_nested
from himap.errors import InputError

__all__ = ["ENDINGS", "maps_of_file", "maps_of_folder"]

ENDINGS = (".fits", ".fit", ".fits.gz")
_DIGITS = re.compile(r"(\d+)")
_FREQUENCY = re.compile(r"(\d+(?:\.\d+)?)\s*MHz", re.IGNORECASE)


def _maps(path):
    """Maps (n, n_pix) of the table of a FITS file, NaN or UNSEEN where there are none, and its header."""
    try:
        maps, header = hp.read_map(path, field=None, dtype=None, nest=None, h=True)
    except Exception as error:  # healpy and astropy raise all kinds for a file that is something else
        raise InputError(f"{path} cannot be read as HEALPix maps in FITS ({error}).") from None
    maps, header = np.atleast_2d(maps), dict(header)
    missing = [*_of_columns(header, "TNULL", len(maps)), header.get("BAD_DATA")]
    if any(value is not None for value in missing):
        maps = np.array(maps, dtype=np.float64)
        for pixels, value in zip(maps, missing, strict=False):
            pixels[np.isin(pixels, [one for one in (value, missing[-1]) if one is not None])] = np.nan
    return maps, header


def _of_columns(header, key, n_maps):
    """The keyword `key` of the column of each map; of partial maps the first column tells the pixels."""
    first = 2 if header.get("INDXSCHM") == "EXPLICIT" else 1
    return [header.get(f"{key}{first + n}") for n in range(n_maps)]


def _one_unit(path, units):
    """The unit that all maps have, None where none is told."""
    if len(set(units)) > 1:
        told = ", ".join(str(unit) for unit in dict.fromkeys(units))
        raise InputError(f"the maps in {path} must have one unit, got {told}.")
    return units[0] or None


def maps_of_file(path):
    """One file with a column for each channel, as healpy writes a list of maps."""
    maps, header = _maps(path)
    return RawCube(
        maps=maps,
        freqs=_from_texts([str(name) for name in _of_columns(header, "TTYPE", len(maps))]),
        unit=_one_unit(path, _of_columns(header, "TUNIT", len(maps))),
        nested=is_nested(header.get("ORDERING")),
    )


def maps_of_folder(folder):
    """A folder with a file for each channel, in the order of their names, numbers in them as numbers."""
    paths = [path for path in folder.iterdir() if path.name.lower().endswith(ENDINGS)]
    paths.sort(key=lambda path: [int(part) if part.isdigit() else part for part in _DIGITS.split(path.name)])
    if not paths:
        raise InputError(f"the folder {folder} holds no .fits file.")
    maps, headers = [], []
    for path in paths:
        found, header = _maps(path)
        if len(found) != 1 or (maps and found[0].shape != maps[0].shape):
            raise InputError(
                f"{path} must hold one map of the size of the others, "
                f"got {len(found)} of {found.shape[1]} pixels."
            )
        maps.append(found[0])
        headers.append(header)
    units = [unit for header in headers for unit in _of_columns(header, "TUNIT", 1)]
    orders = {header.get("ORDERING") for header in headers}
    if len(orders) > 1:
        raise InputError(
            f"the files in {folder} must have one order of pixels, got {', '.join(map(str, orders))}."
        )
    return RawCube(
        maps=np.array(maps),
        freqs=_from_headers(paths, headers),
        unit=_one_unit(folder, units),
        nested=is_nested(orders.pop()),
    )


def _from_headers(paths, headers):
    """Frequencies that all headers tell as FREQ, or all names of files."""
    if not all("FREQ" in header for header in headers):
        return _from_texts([path.name for path in paths])
    try:
        return np.array([float(header["FREQ"]) for header in headers])
    except (TypeError, ValueError):
        bad = next(header["FREQ"] for header in headers if not isinstance(header["FREQ"], float | int))
        raise InputError(f"FREQ in a header must be a number of MHz, got {bad!r}.") from None


def _from_texts(texts):
    """The frequencies that texts such as "map_950.5MHz.fits" tell, if all do."""
    found = [_FREQUENCY.search(text) for text in texts]
    return np.array([float(match[1]) for match in found]) if all(found) else None
