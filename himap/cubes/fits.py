"""Cubes of HEALPix maps in FITS: a file with a column for each channel, or a folder with a file for each."""

import re
from dataclasses import replace

import numpy as np

from himap.core.errors import InputError
from himap.cubes.images import holds_image, read_image_fits
from himap.cubes.layout import Layout, check_cube_room, one_unit
from himap.maps.healpix_io import ENDINGS, agreed, freq_in_header, freqs_in, read_maps

_DIGITS = re.compile(r"(\d+)")
_STOKES = {  # names of the three columns of one polarised map: of healpy, and so of PySM; of CRIME
    ("TEMPERATURE", "Q_POLARISATION", "U_POLARISATION"),
    ("I_STOKES", "Q_STOKES", "U_STOKES"),
    ("I", "Q", "U"),
    ("T", "Q", "U"),
}


def read_fits(path, *, held=1):
    """Maps and `Layout` of a file with a column for each channel, as healpy writes it, or an image cube."""
    if holds_image(path):
        return read_image_fits([path], held=held)
    file = read_maps(path, held=held)
    if file.names in _STOKES:
        raise InputError(
            f"{path} has the Stokes parameters of one map ({', '.join(file.names)}), and not a channel in "
            "each column: give a folder with a file for each channel, or name the columns as channels are."
        )
    stated = [freqs_in(name) for name in file.names]
    freqs = np.array([name.freq for (name,) in stated]) if all(len(one) == 1 for one in stated) else None
    layout = Layout.of_sphere(
        file.maps,
        file.nested,
        partial=file.partial,
        freqs=freqs,
        freqs_from=None if freqs is None else "the names of its columns",
        nearly=_nearly(file.names),
        unit=one_unit(path, file.units),
    )
    return file.maps, layout


def read_folder(folder, *, held=1):
    """Those of a folder with a file for each channel, by their names, numbers in them as numbers.

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
        return read_image_fits(paths, held=held)
    files = _files(folder, paths, held)
    if len({file.nested for file in files}) > 1:
        orders = ", ".join(dict.fromkeys(str(file.header.get("ORDERING")) for file in files))
        raise InputError(f"the files in {folder} must have one order of pixels, got {orders}.")
    freqs, freqs_from = _freqs_of(paths, [file.header for file in files])
    maps = np.concatenate([file.maps for file in files])
    n_polarised = sum(file.names in _STOKES for file in files)
    layout = Layout.of_sphere(
        maps,
        files[0].nested,
        partial=all(file.partial for file in files),
        freqs=freqs,
        freqs_from=freqs_from,
        nearly=_nearly([path.name for path in paths]),
        unit=one_unit(folder, [file.units[0] for file in files]),
        remarks=(f"Stokes Q and U in {n_polarised} of its files are left out.",) if n_polarised else (),
    )
    return maps, layout


def _files(folder, paths, held):
    """The `HealpixFile` of each path, with one map, the first of three Stokes parameters."""
    files = []
    for path in paths:
        file = read_maps(path)
        if file.names in _STOKES:
            file = replace(file, maps=file.maps[:1].copy(), units=file.units[:1])
        files.append(file)
        n_maps, n_pix = file.maps.shape
        if n_maps != 1 or n_pix != files[0].maps.shape[1]:
            raise InputError(
                f"{path} must hold one map of the size of the others, got {n_maps} of {n_pix} pixels."
            )
        if len(files) == 1:
            check_cube_room(folder, len(paths) * n_pix, file.maps.dtype.itemsize, held)
    return files


def _freqs_of(paths, headers):
    """(frequencies, what states them): all names of files, or all headers as FREQ; if both, they agree."""
    in_headers = [freq_in_header(header, path) for header, path in zip(headers, paths, strict=True)]
    stated = [freqs_in(path.name) for path in paths]
    if all(len(found) == 1 for found in stated):
        both = zip(stated, in_headers, paths, strict=True)
        return np.array([agreed(name, freq, path) for (name,), freq, path in both]), "the names of its files"
    if all(freq is not None for freq in in_headers):
        return np.array(in_headers), "FREQ in the headers"
    return None, None


def _nearly(names):
    """A sentence on a name that seems to state a frequency, if there is one."""
    for name in names:
        if "hz" in name.lower() and len(freqs_in(name)) != 1:
            return (
                f"The name {name!r} is not taken for one: it must have one number in MHz or GHz that stands "
                "by itself, such as map_950.5MHz.fits."
            )
    return ""
