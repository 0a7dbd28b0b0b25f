"""Cubes in FITS: a file with a column for each channel, or a folder with a file for each; or images."""

import re
from dataclasses import replace

import numpy as np

from himap.cubes.images import holds_image, images_of_files
from himap.cubes.raw import RawCube, check_cube_room
from himap.errors import InputError
from himap.maps.frequency_names import agreed, freq_in_header, freqs_in
from himap.maps.healpix_files import ENDINGS, read_maps

__all__ = ["maps_of_file", "maps_of_folder"]

_DIGITS = re.compile(r"(\d+)")
_STOKES = {  # names of the three columns of one polarised map: of healpy, and so of PySM; of CRIME
    ("TEMPERATURE", "Q_POLARISATION", "U_POLARISATION"),
    ("I_STOKES", "Q_STOKES", "U_STOKES"),
    ("I", "Q", "U"),
    ("T", "Q", "U"),
}


def _one_unit(path, units):
    """The unit that all maps have, None where none is told."""
    if len(set(units)) > 1:
        listing = ", ".join(str(unit) for unit in dict.fromkeys(units))
        raise InputError(f"the maps in {path} must have one unit, got {listing}.")
    return units[0]


def maps_of_file(path, *, held=1):
    """One file with a column for each channel, as healpy writes a list of maps; or with an image cube."""
    if holds_image(path):
        return images_of_files([path], held=held)
    file = read_maps(path, held=held)
    if _is_polarised(file):
        raise InputError(
            f"{path} has the Stokes parameters of one map ({', '.join(file.names)}), and not a channel in "
            "each column: give a folder with a file for each channel, or name the columns as channels are."
        )
    freqs = _in_names(file.names)
    return RawCube(
        maps=file.maps,
        freqs=freqs,
        freqs_from=None if freqs is None else "the names of its columns",
        nearly=_nearly(file.names),
        unit=_one_unit(path, file.units),
        nested=file.nested,
        partial=file.partial,
    )


def maps_of_folder(folder, *, held=1):
    """A folder with a file for each channel, in the order of their names, numbers in them as numbers.

    Of image cubes each may have a range of channels.
    """
    try:
        paths = [path for path in folder.iterdir() if path.name.lower().endswith(ENDINGS)]
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be read ({error.strerror}).") from None
    paths.sort(
        key=lambda path: [int(part) if part.isdecimal() else part for part in _DIGITS.split(path.name)]
    )
    if not paths:
        raise InputError(f"the folder {folder} holds no .fits file.")
    if holds_image(paths[0]):
        return images_of_files(paths, held=held)
    files, polarised = [], 0
    for path in paths:
        file = read_maps(path)
        if _is_polarised(file):
            polarised += 1
            file = replace(file, maps=file.maps[:1].copy(), units=file.units[:1])
        files.append(file)
        n_maps, n_pix = files[-1].maps.shape
        if n_maps != 1 or n_pix != files[0].maps.shape[1]:
            raise InputError(
                f"{path} must hold one map of the size of the others, got {n_maps} of {n_pix} pixels."
            )
        if len(files) == 1:
            check_cube_room(folder, len(paths) * n_pix, files[0].maps.dtype.itemsize, held)
    if len({file.nested for file in files}) > 1:
        orders = ", ".join(dict.fromkeys(str(file.header.get("ORDERING")) for file in files))
        raise InputError(f"the files in {folder} must have one order of pixels, got {orders}.")
    freqs, freqs_from = _of_files(paths, [file.header for file in files])
    return RawCube(
        maps=np.concatenate([file.maps for file in files]),
        freqs=freqs,
        freqs_from=freqs_from,
        nearly=_nearly([path.name for path in paths]),
        unit=_one_unit(folder, [file.units[0] for file in files]),
        nested=files[0].nested,
        partial=all(file.partial for file in files),
        remarks=(f"Stokes Q and U in {polarised} of its files are left out.",) if polarised else (),
    )


def _is_polarised(file):
    """Whether the columns of a `HealpixFile` are the Stokes parameters I, Q and U, by their exact names."""
    return file.names in _STOKES


def _of_files(paths, headers):
    """(frequencies, what tells them): all names of files, or all headers as FREQ; if both, they agree."""
    in_headers = [freq_in_header(header, path) for header, path in zip(headers, paths, strict=True)]
    stated = [freqs_in(path.name) for path in paths]
    if all(len(found) == 1 for found in stated):
        told = zip(stated, in_headers, paths, strict=True)
        return np.array([agreed(name, freq, path) for (name,), freq, path in told]), "the names of its files"
    if all(freq is not None for freq in in_headers):
        return np.array(in_headers), "FREQ in the headers"
    return None, None


def _nearly(names):
    """A sentence on a name that seems to tell a frequency, if there is one."""
    for name in names:
        if "hz" in name.lower() and len(freqs_in(name)) != 1:
            return (
                f"The name {name!r} is not taken for one: it must have one number in MHz or GHz that stands "
                "by itself, such as map_950.5MHz.fits."
            )
    return ""


def _in_names(names):
    """The frequencies that names such as "residual 950.5 MHz" tell, if all do."""
    stated = [freqs_in(name) for name in names]
    return np.array([name.freq for (name,) in stated]) if all(len(found) == 1 for found in stated) else None
