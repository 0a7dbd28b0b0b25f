"""Cubes in FITS: HEALPix maps with a column, or a file, for each channel; images by `image_files`."""

import re
from dataclasses import replace

import numpy as np

from himap.core.errors import InputError
from himap.cubes.axes import fits_in, stated_freqs
from himap.cubes.image_files import holds_image, read_image_fits
from himap.cubes.layout import Layout, check_cube_room, only_value, plain_pairs
from himap.maps.frames import spectral_frame_of
from himap.maps.healpix_io import freq_in_header, read_maps

_STRUCTURE = re.compile(  # cards of a table of maps that are written anew, by what was read, or not at all
    r"SIMPLE|XTENSION|EXTEND|BITPIX|NAXIS\d*|[PG]COUNT|TFIELDS|THEAP|T[A-Z]{3,4}\d+|EXT(NAME|VER|LEVEL)"
    r"|CHECKSUM|DATASUM|DATE|PIXTYPE|ORDERING|NSIDE|(FIRST|LAST)PIX|INDXSCHM|OBJECT|OBS_NPIX|GRAIN|BAD_DATA"
    r"|COORDSYS|EQUINOX|RADE(C)?SYS|B?UNIT|FREQ|COMMENT|HISTORY|"
)
_STOKES = {  # names of the three columns of one polarised map: of healpy, and so of PySM; of CRIME
    ("TEMPERATURE", "Q_POLARISATION", "U_POLARISATION"),
    ("I_STOKES", "Q_STOKES", "U_STOKES"),
    ("I", "Q", "U"),
    ("T", "Q", "U"),
}


def read_fits(path, *, axes=None, held=1, logical=False):
    """Maps and `Layout` of a file with a column for each channel, as healpy writes it, or an image cube.

    `axes` are those of an image, `logical` as of `himap.maps.healpix_io.read_maps`.
    """
    if holds_image(path):
        return read_image_fits([path], axes=axes, held=held)
    _check_no_axes(path, axes)
    file = read_maps(path, held=held, logical=logical)
    if file.names in _STOKES:
        raise InputError(
            f"{path} has the Stokes parameters of one map ({', '.join(file.names)}), and not a channel in "
            "each column: give a folder with a file for each channel, or name the columns as channels are."
        )
    return file.maps, Layout.of_sphere(
        file.maps,
        nested=file.nested,
        partial=file.partial,
        frame=file.frame,
        unit=only_value(path, "unit", file.units, file.names),
        about=_about([file.header]),
        **stated_freqs(file.names, "the names of its columns"),
    )


def _about(headers):
    """What all headers of tables say alike but for their structure, a dict, for `Layout.about`."""
    first, *others = headers
    pairs = plain_pairs({key: value for key, value in first.items() if not _STRUCTURE.fullmatch(key)})
    return {key: value for key, value in pairs.items() if all(each.get(key) == value for each in others)}


def _check_no_axes(path, axes):
    if axes is not None:
        raise InputError(f"axes (--axes) are those of arrays, and {path} is a table of maps; leave them out.")


def read_folder(folder, *, axes=None, held=1):
    """Those of a folder with a file for each channel, by their names, numbers in them as numbers.

    Of image cubes each may have a range of channels. Of three Stokes parameters the first is read.
    """
    paths, left_out = fits_in(folder)
    if holds_image(paths[0]):
        maps, layout = read_image_fits(paths, axes=axes, held=held)
        return maps, layout.noted(*left_out)
    _check_no_axes(folder, axes)
    files, names, n_polarised = [], [path.name for path in paths], 0
    for path in paths:
        file = read_maps(path)
        polarised = file.names in _STOKES
        file, n_polarised = replace(file, maps=file.maps[: 1 if polarised else None]), n_polarised + polarised
        n_pix = (files or [file])[0].maps.shape[1]
        if file.maps.shape != (1, n_pix):
            raise InputError(
                f"{path} must hold one map of the size of the others, got {len(file.maps)} of "
                f"{file.maps.shape[1]} pixels."
            )
        if not files:
            check_cube_room(folder, len(paths) * n_pix, file.maps.dtype.itemsize, held)
        files.append(replace(file, maps=file.maps.copy()))

    def same(what, values):
        return only_value(folder, what, values, names)

    in_headers = [freq_in_header(file.header, path) for file, path in zip(files, paths, strict=True)]
    same("spectral frame", [spectral_frame_of(file.header.get("SPECSYS")) for file in files])
    same("order of pixels", [{True: "NESTED", False: "RING"}.get(file.nested) for file in files])
    polarised = [f"Stokes Q and U in {n_polarised} of its files are left out."] if n_polarised else []
    maps = np.concatenate([file.maps for file in files])
    return maps, Layout.of_sphere(
        maps,
        nested=files[0].nested,
        partial=all(file.partial for file in files),
        frame=same("frame of coordinates", [file.frame for file in files]),
        unit=same("unit", [file.units[0] for file in files]),
        about=_about([file.header for file in files]),
        names=tuple(names),
        remarks=(*left_out, *polarised),
        **stated_freqs(names, "the names of its files", in_headers),
    )
