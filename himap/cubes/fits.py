"""Cubes in FITS: a file with a column for each channel, or a folder with a file for each."""

import re

import numpy as np

from himap.cubes.raw import RawCube
from himap.errors import InputError
from himap.maps.healpix_files import read_maps

__all__ = ["ENDINGS", "maps_of_file", "maps_of_folder"]

ENDINGS = (".fits", ".fit", ".fits.gz")
_DIGITS = re.compile(r"(\d+)")
_FREQUENCY = re.compile(r"(\d+(?:\.\d+)?)\s*MHz", re.IGNORECASE)


def _one_unit(path, units):
    """The unit that all maps have, None where none is told."""
    if len(set(units)) > 1:
        listing = ", ".join(str(unit) for unit in dict.fromkeys(units))
        raise InputError(f"the maps in {path} must have one unit, got {listing}.")
    return units[0]


def maps_of_file(path):
    """One file with a column for each channel, as healpy writes a list of maps."""
    file = read_maps(path)
    return RawCube(
        maps=file.maps,
        freqs=_from_texts(file.names),
        unit=_one_unit(path, file.units),
        nested=file.nested,
    )


def maps_of_folder(folder):
    """A folder with a file for each channel, in the order of their names, numbers in them as numbers."""
    paths = [path for path in folder.iterdir() if path.name.lower().endswith(ENDINGS)]
    paths.sort(key=lambda path: [int(part) if part.isdigit() else part for part in _DIGITS.split(path.name)])
    if not paths:
        raise InputError(f"the folder {folder} holds no .fits file.")
    files = []
    for path in paths:
        files.append(read_maps(path))
        n_maps, n_pix = files[-1].maps.shape
        if n_maps != 1 or n_pix != files[0].maps.shape[1]:
            raise InputError(
                f"{path} must hold one map of the size of the others, got {n_maps} of {n_pix} pixels."
            )
    if len({file.nested for file in files}) > 1:
        orders = ", ".join(dict.fromkeys(str(file.header.get("ORDERING")) for file in files))
        raise InputError(f"the files in {folder} must have one order of pixels, got {orders}.")
    return RawCube(
        maps=np.concatenate([file.maps for file in files]),
        freqs=_from_headers(paths, [file.header for file in files]),
        unit=_one_unit(folder, [file.units[0] for file in files]),
        nested=files[0].nested,
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
    matches = [_FREQUENCY.search(text) for text in texts]
    return np.array([float(match[1]) for match in matches]) if all(matches) else None
