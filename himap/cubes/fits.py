"""Cubes in FITS: HEALPix maps with a column, or a file, for each channel; images with world coordinates.

Images have two axes of the sky in any projection, and one of frequency. Axes may come in any order,
frequencies may descend, and axes of length one (Stokes) are kept for the way back. Several images, in one
file or in a folder, are the channels of one cube if they share the axes of the sky and no range of
frequencies.
"""

import warnings
from dataclasses import replace

import numpy as np
from astropy import units as u
from astropy.io import fits
from astropy.utils.exceptions import AstropyWarning

from himap.core.errors import InputError
from himap.cubes.axes import check_world_axes, turn_of
from himap.cubes.images import IMAGES, ImagePart, ImagePixels, has_image, world_of
from himap.cubes.layout import Layout, as_input_error, check_cube_room, one_unit
from himap.cubes.names import LISTED, fits_in
from himap.maps.healpix_io import agreed, freq_in_header, freqs_in, read_maps

_LOWEST = 1.0  # MHz: a FREQ in MHz or GHz that says nothing is taken as Hz, and lies far below
_COUPLED = 1e-9  # of the largest step along an axis: rounding in a header
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
    stated = _freqs_of(file.names, "the names of its columns")
    stated["unit"] = one_unit(path, file.units)
    return file.maps, Layout.of_sphere(file.maps, file.nested, partial=file.partial, **stated)


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
        return maps, replace(layout, remarks=(*left_out, *layout.remarks))
    _check_no_axes(folder, axes)
    files, n_polarised = [], 0
    for path in paths:
        file = read_maps(path)
        if file.names in _STOKES:
            file, n_polarised = replace(file, maps=file.maps[:1].copy()), n_polarised + 1
        files.append(file)
        n_maps, n_pix = file.maps.shape
        if n_maps != 1 or n_pix != files[0].maps.shape[1]:
            raise InputError(
                f"{path} must hold one map of the size of the others, got {n_maps} of {n_pix} pixels."
            )
        if len(files) == 1:
            check_cube_room(folder, len(paths) * n_pix, file.maps.dtype.itemsize, held)
    orders = dict.fromkeys(str(file.header.get("ORDERING")) for file in files)
    if len({file.nested for file in files}) > 1:
        raise InputError(f"the files in {folder} must have one order of pixels, got {', '.join(orders)}.")
    in_headers = [freq_in_header(file.header, path) for file, path in zip(files, paths, strict=True)]
    stated = _freqs_of([path.name for path in paths], "the names of its files", in_headers, paths)
    stated["unit"] = one_unit(folder, [file.units[0] for file in files])
    stated["names"] = tuple(path.name for path in paths)
    if n_polarised:
        left_out.append(f"Stokes Q and U in {n_polarised} of its files are left out.")
    stated["remarks"] = tuple(left_out)
    maps, partial = np.concatenate([file.maps for file in files]), all(file.partial for file in files)
    return maps, Layout.of_sphere(maps, files[0].nested, partial=partial, **stated)


def _freqs_of(names, called, in_headers=(), paths=()):
    """What a `Layout` has of frequencies, a dict: those in all names, or in all headers; if both, they agree.

    Where there are none, a sentence on a name that seems to state one.
    """
    stated = [freqs_in(name) for name in names]
    if all(len(found) == 1 for found in stated):
        if not in_headers:
            return {"freqs": np.array([name.freq for (name,) in stated]), "freqs_from": called}
        both = zip(stated, in_headers, paths, strict=True)
        return {
            "freqs": np.array([agreed(*name, freq, path) for name, freq, path in both]),
            "freqs_from": called,
        }
    if in_headers and None not in in_headers:
        return {"freqs": np.array(in_headers), "freqs_from": "FREQ in the headers"}
    without = [name for name, found in zip(names, stated, strict=True) if not found]
    if 0 < len(without) < len(names) / 2:
        listing = ", ".join(without[:LISTED])
        return {"nearly": f"Most of {called} state one, but not {listing}: rename these, or move them away."}
    for name, found in zip(names, stated, strict=True):
        if "hz" in name.lower() and len(found) != 1:
            return {
                "nearly": f"The name {name!r} is not taken for one: it must have one number in MHz or GHz "
                "that stands by itself, such as map_950.5MHz.fits."
            }
    return {}


def holds_image(path, *, frequencies=False):
    """Whether what comes first in a FITS file is an image, and no table; False for what cannot be read.

    With `frequencies` whether the first image has an axis of these.
    """
    try:
        with _quiet(), fits.open(path, memmap=False) as file:
            if frequencies:
                first = next(hdu for hdu in file if has_image(hdu))
                return world_of(first, file).wcs.spec >= 0
            return has_image(next(hdu for hdu in file if not isinstance(hdu, IMAGES) or hdu.shape))
    except Exception:  # astropy raises nearly anything for a file that is damaged; its reader says it
        return False


def _quiet():
    """Without astropy's warnings: of what is mended, or an error a line below."""
    return warnings.catch_warnings(action="ignore", category=AstropyWarning)


def read_image_fits(paths, *, axes=None, held=1):
    """The channels of all image cubes in some files.

    Parameters
    ----------
    paths
        The files.
    axes
        Those of the arrays, in the order of numpy, where they are not those of the headers turned round: such
        as "ra,dec,freq".
    held
        Cubes in float32 that the caller will hold at once: they must fit into memory.

    Returns
    -------
    (ndarray, Layout)
        Maps (n_channels, n_pix) as they are in the files, NaN where blank.

    Raises
    ------
    InputError
        A file without such an image, axes of the sky that differ, frequencies that overlap, other units than
        of temperature, or too large a cube.
    """
    remarks, parts = [], []
    for path in paths:
        parts += _read(path, lambda file, path=path: _parts(path, file, axes, remarks))
    _check_alike(parts)
    where = paths[0].parent if len(paths) > 1 else paths[0]
    unit = one_unit(where, [str(part.header.get("BUNIT") or "").strip() or None for part in parts])
    pixels = ImagePixels(parts=tuple(parts))
    ends = np.cumsum([part.n_channels for part in parts])
    dtype = np.result_type(np.float32, *(fits.BITPIX2DTYPE[part.header["BITPIX"]] for part in parts))
    n_pix = int(np.prod(pixels.shape))
    check_cube_room(where, ends[-1] * n_pix, dtype.itemsize, held)
    maps = np.empty((ends[-1], n_pix), dtype=dtype)
    for part, out in zip(parts, np.split(maps, ends[:-1]), strict=True):
        out[:] = _read(part.path, part.read)
    return maps, Layout(pixels=pixels, unit=unit, remarks=tuple(remarks), **_freqs_of_images(parts))


def _freqs_of_images(parts):
    """What a `Layout` has of frequencies, a dict: those of the axes, or in the names of files of one each."""
    several = len(parts) > 1
    if parts[0].freqs is not None:
        stated_by = "the axis FREQ" + (" of each image" if several else "")
        return {"freqs": np.concatenate([part.freqs for part in parts]), "freqs_from": stated_by}
    paths, stated, nearly = [part.path for part in parts], {}, "Its images have no axis FREQ."
    if several and len(set(paths)) == sum(part.n_channels for part in parts):
        in_headers = [freq_in_header(part.header, part.path) for part in parts]
        names = [path.name for path in paths]
        stated = _freqs_of(names, "the names of its files", in_headers, paths) | {"names": tuple(names)}
    return stated if "freqs" in stated else stated | {"nearly": f"{nearly} {stated.get('nearly', '')}"}


def _read(path, read):
    """``read(file)`` of an open FITS file; what astropy raises as an error of the input."""
    kind = "an image cube in FITS"
    with as_input_error(path, kind), _quiet(), fits.open(path, memmap=False) as file:
        return read(file)


def _parts(path, file, axes, remarks):
    """The `ImagePart` of every image cube in an open file; what else is there is left out, and said."""
    parts, others = [], []
    for index, hdu in enumerate(file):
        if has_image(hdu) and (len(hdu.shape) > 2 or (len(hdu.shape) == 2 and not parts)):
            parts.append(_part(path, index, hdu, file, axes))
        elif not isinstance(hdu, IMAGES) or hdu.shape:
            others.append(hdu.name or str(index))
    if not parts:
        raise InputError(f"{path} holds no image cube.")
    if others:
        remarks.append(f"{path} holds {', '.join(others)} beside the cube, which is left out.")
    return parts


def _part(path, index, hdu, file, axes):
    wcs, name = world_of(hdu, file), f"{path}, HDU {index}"
    if axes is None:
        check_world_axes(hdu, name)
    spectral = _spectral_axis(wcs, name)
    n_axes = max(wcs.naxis, len(hdu.shape), 3)
    stored = (1,) * (n_axes - len(hdu.shape)) + tuple(hdu.shape)
    typed = {axis for axis in range(wcs.naxis) if not _has_no_type(wcs, axis)}
    free = [axis for axis in range(n_axes) if axis not in typed]
    if spectral is None:  # the first axis without type, of those that are longer than one if it can be
        long = [axis for axis in free if stored[n_axes - 1 - axis] > 1]
        spectral, given_freqs = (long if long and axes is None else free)[0], False
    else:
        given_freqs = True
    turn = turn_of(stored, axes, {"lon": wcs.wcs.lng, "lat": wcs.wcs.lat, "freq": spectral}, name)
    shape = tuple(stored[axis] for axis in turn)
    _check_axes(wcs, shape, spectral, name)
    unit = str(hdu.header.get("BUNIT") or "")
    if "jy" in unit.lower():
        raise InputError(
            f"{name} is in {unit}, and a cube must be in K, mK or uK: convert every channel with the area of "
            "its beam, (values * u.Jy / u.beam).to(u.K, u.brightness_temperature(freq, beam_area=...)) in "
            "astropy, and write BUNIT = 'K'."
        )
    sky = sorted(n_axes - 1 - axis for axis in (wcs.wcs.lng, wcs.wcs.lat))
    first = n_axes - 1 - spectral
    rest = [axis for axis in range(n_axes) if axis not in (first, *sky)]
    freqs = _freqs_along(wcs, spectral, shape[first], name) if given_freqs else None
    order = {"stored": stored, "turn": turn, "order": (first, *sky, *rest)}
    where = {"path": path, "index": index, "header": hdu.header.copy()}
    return ImagePart(**where, **order, freqs=freqs, celestial=wcs.celestial)


def _freqs_along(wcs, spectral, n_channels, name):
    """MHz of the channels, by the axis FREQ."""
    line = wcs.sub([spectral + 1])
    (values,) = line.wcs_pix2world(np.arange(n_channels), 0)
    freqs = np.asarray((values * u.Unit(line.wcs.cunit[0] or u.Hz)).to_value(u.MHz))
    if not freqs.min() > _LOWEST:
        raise InputError(
            f"{name} has frequencies from {freqs.min():.4g} to {freqs.max():.4g} MHz, which looks like "
            f"another unit: write the right one as CUNIT{spectral + 1} into the header, where none means Hz."
        )
    return freqs


def _has_no_type(wcs, axis):
    """Whether an axis of the world says nothing of what it is."""
    return wcs.wcs.ctype[axis].strip() in ("", "LINEAR", "CHANNEL", "CHAN")


def _spectral_axis(wcs, name):
    """Which axis of the world is that of frequency, None where it may be one that has no type."""
    types = [text.strip() for text in wcs.wcs.ctype]
    listing = ", ".join(text or "one without CTYPE" for text in types)
    if not wcs.has_celestial:
        raise InputError(
            f"{name} must have two axes of the sky (CTYPE such as RA---SIN and DEC--SIN), got {listing}. For "
            "HEALPix maps write a table, as healpy.write_map does."
        )
    axis = wcs.wcs.spec
    if axis >= 0 and not types[axis].startswith("FREQ"):
        raise InputError(
            f"{name} has the spectral axis {types[axis]}, and FREQ is needed: convert it with the rest "
            "frequency, as SpectralCube.read(path).with_spectral_unit('Hz') of the package spectral-cube "
            "does."
        )
    if axis < 0 and len(types) > 2 and not any(_has_no_type(wcs, n) for n in range(len(types))):
        raise InputError(
            f"{name} has no axis FREQ, which tells the channels, but {listing}; write CTYPE, CRVAL, CRPIX, "
            "CDELT and CUNIT of the frequencies into its header, or make the CTYPE of channels that are "
            "numbered blank and give --freqs."
        )
    return axis if axis >= 0 else None


def _check_axes(wcs, shape, spectral, name):
    """Refuse more axes than three that are longer than one, and axes that are not those of the array."""
    celestial = {wcs.wcs.lng, wcs.wcs.lat}
    for axis in set(range(len(shape))) - celestial - {spectral}:
        length = shape[len(shape) - 1 - axis]
        if length > 1:
            text = (axis < wcs.naxis and wcs.wcs.ctype[axis]) or f"axis {axis + 1}"
            raise InputError(
                f"{name} has {length} values along {text}, and a cube is of one: take one out, for Stokes I "
                "the first, and write it to a file of its own."
            )
    matrix = np.abs(wcs.pixel_scale_matrix)
    for world, pixel in np.argwhere(matrix > 0):
        both_on_sky = {world, pixel} <= celestial
        if world != pixel and not both_on_sky and matrix[world, pixel] > _COUPLED * matrix[world].max():
            raise InputError(
                f"{name}: {wcs.wcs.ctype[world]} changes along axis {pixel + 1} too (PC or CD in the "
                "header): such a rotated or sheared cube must be regridded to one whose channels are images."
            )


def _check_alike(parts):
    """Refuse images that do not share the axes of the sky, or do share a range of frequencies."""
    first, *others = (ImagePixels(parts=(part,)) for part in parts)
    for part, pixels in zip(parts[1:], others, strict=True):
        if not first.same(pixels):
            raise InputError(
                f"all images must have the same axes of the sky: {parts[0]} has {first}, and {part} has "
                f"{pixels}, or other coordinates; reproject them to one header."
            )
    unstated = [part for part in parts if part.freqs is None]
    if unstated and len(unstated) < len(parts):
        raise InputError(f"{unstated[0]} has no axis FREQ, and other images have; write it into its header.")
    ordered = [] if unstated else sorted(parts, key=lambda part: part.freqs.min())
    for low, high in zip(ordered, ordered[1:], strict=False):
        if high.freqs.min() <= low.freqs.max():
            raise InputError(
                f"the frequencies of {low} and {high} overlap, from {high.freqs.min():.10g} to "
                f"{low.freqs.max():.10g} MHz; cut one of them, or write what is to be cleaned alone."
            )
