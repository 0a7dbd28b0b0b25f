"""Cubes in FITS: HEALPix maps with a column or a file per channel, and images with world coordinates.

Images have two sky axes in any projection and a frequency axis. Axes may be in any order, frequencies may
descend, and axes of length one (Stokes) are restored in the output. Images, in one file or in a folder,
are channels of one cube if they share the sky axes and have different frequencies.
"""

import warnings
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial

import numpy as np
from astropy import units as u
from astropy.io import fits
from astropy.utils.exceptions import AstropyWarning

from himap.core.errors import InputError
from himap.core.reading import reading
from himap.cubes.axes import fits_in, stated_freqs, turn_of
from himap.cubes.images import ImagePart, ImagePixels, image_name, world_of
from himap.cubes.layout import HELD, STRUCTURE, Layout, check_cube_room, only_value, plain_pairs
from himap.maps.frames import spectral_frame_of
from himap.maps.healpix_io import card_text, read_maps

_STOKES = {  # column names of a single polarised map: healpy (and PySM); CRIME
    ("TEMPERATURE", "Q_POLARISATION", "U_POLARISATION"),
    ("I_STOKES", "Q_STOKES", "U_STOKES"),
    ("I", "Q", "U"),
    ("T", "Q", "U"),
}
_IMAGES = fits.PrimaryHDU, fits.ImageHDU, fits.CompImageHDU  # as astropy opens them
_NO_TYPE = ("", "LINEAR", "CHANNEL", "CHAN")  # CTYPE without information
_LOWEST = 1.0  # MHz: a FREQ in MHz or GHz without a unit is read as Hz, and is far below
_BEAMS = "BEAMS"  # CASA's table, referred to by CASAMBM in a header
_AS_STORED = {"memmap": False, "uint": False}  # astropy's unsigned integers lose BLANK
_COUPLED = 1e-9  # relative to the largest step along an axis: rounding in a header


def read_fits(path, axes=None, *, logical=False):
    """Maps and `Layout` of a file or folder; `axes` as in `read_cube`, `logical` as in `read_maps`.

    HEALPix maps have a column per channel, as written by healpy, or in a folder a file per channel, in the
    order of their names with numbers sorted as numbers; of three Stokes parameters the first is read.
    """
    paths, left_out = fits_in(path) if path.is_dir() else ([path], [])
    first = None
    with suppress(InputError), _opened(paths[0]) as file:  # its reader reports errors
        first = next(hdu for hdu in file if not isinstance(hdu, _IMAGES) or hdu.shape)
    if isinstance(first, _IMAGES):
        maps, layout = _read_images(paths, axes)
    elif axes is not None:
        raise InputError(f"axes (--axes) apply to arrays, and {path} is a table of maps; omit them.")
    elif path.is_dir():
        maps, layout = _read_tables(path, paths)
    else:
        file = read_maps(path, held=HELD, logical=logical)
        if file.names in _STOKES:
            raise InputError(
                f"{path} has the Stokes parameters of one map ({', '.join(file.names)}), not a channel per "
                "column: give a folder with a file per channel, or rename the columns."
            )
        stated = stated_freqs(file.names, "the names of its columns")
        maps, layout = file.maps, _layout(path, file.maps, [file], file.names, **stated)
    return maps, layout.noted(*left_out)


def _layout(path, maps, files, labels, **stated):
    """The `Layout` of the maps (n_channels, n_pix) of each `HealpixFile`, called `labels` in errors."""
    same = partial(only_value, path, names=labels)
    first, *others = (file.header for file in files)
    about = plain_pairs({key: value for key, value in first.items() if not STRUCTURE.fullmatch(key)})
    same("spectral frame", [spectral_frame_of(file.header.get("SPECSYS")) for file in files])
    same("order of pixels", [{True: "NESTED", False: "RING"}.get(file.nested) for file in files])
    return Layout.of_sphere(
        maps,
        nested=files[0].nested,
        partial=all(file.partial for file in files),
        frame=same("frame of coordinates", [file.frame for file in files]),
        unit=same("unit", [unit for file in files for unit in file.units[: len(file.maps)]]),
        about={key: value for key, value in about.items() if all(one.get(key) == value for one in others)},
        **stated,
    )


def _read_tables(folder, paths):
    """Maps and `Layout` of a folder with a file of HEALPix maps per channel."""
    files, names, n_polarised = [], [path.name for path in paths], 0
    for path in paths:
        file = read_maps(path)
        if file.names in _STOKES:
            file, n_polarised = replace(file, maps=file.maps[:1]), n_polarised + 1
        n_pix = (files or [file])[0].maps.shape[1]
        if file.maps.shape != (1, n_pix):
            raise InputError(
                f"{path} must hold one map of the size of the others, got {len(file.maps)} of "
                f"{file.maps.shape[1]} pixels."
            )
        if not files:
            check_cube_room(folder, len(paths) * n_pix, file.maps.itemsize)
        files.append(replace(file, maps=file.maps.copy()))
    headers = [file.header for file in files]
    stated = {"names": tuple(names), **stated_freqs(names, "the names of its files", headers)}
    if n_polarised:
        stated["remarks"] = (f"Stokes Q and U in {n_polarised} of its files are ignored.",)
    maps = np.concatenate([file.maps for file in files])
    return maps, _layout(folder, maps, files, names, **stated)


def _quiet():
    """Suppress astropy's warnings: the issues are corrected, or raise an error later."""
    return warnings.catch_warnings(action="ignore", category=AstropyWarning)


def _read_images(paths, axes):
    """Maps, NaN where blank, and `Layout` of the channels of all image cubes in some files."""
    remarks, parts = [], []
    for path in paths:
        with _opened(path) as file:
            parts += _parts(path, file, axes=axes, remarks=remarks, alone=len(paths) == 1)
    channels = {}
    for part in parts:
        for freq in () if part.freqs is None else part.freqs:
            if (other := channels.setdefault(freq, part)) is not part:
                raise InputError(
                    f"{other} and {part} have the same channel, {freq:g} MHz: write the one to be cleaned to "
                    "a separate file, or correct the frequencies (CRVAL, CDELT)."
                )
    pixels, where = _pixels_of(parts), paths[0].parent if len(paths) > 1 else paths[0]
    same = partial(only_value, where, names=[*map(str, parts)])
    unit = same("unit", [card_text(part.header, "BUNIT") for part in parts])
    frame = same("spectral frame", [spectral_frame_of(part.header.get("SPECSYS")) for part in parts])
    ends = np.cumsum([part.n_channels for part in parts])
    dtype = np.result_type(np.float32, *(fits.BITPIX2DTYPE[part.header["BITPIX"]] for part in parts))
    n_pix = int(np.prod(pixels.shape))
    check_cube_room(where, ends[-1] * n_pix, dtype.itemsize)
    maps = np.empty((ends[-1], n_pix), dtype=dtype)
    for part, out in zip(parts, np.split(maps, ends[:-1]), strict=True):
        with _opened(part.path) as file:
            out[:] = part.read(file)
    stated = {"unit": unit, "remarks": tuple(remarks), "about": {"SPECSYS": frame} if frame else {}}
    if parts[0].freqs is not None:
        stated["freqs"] = np.concatenate([part.freqs for part in parts])
        stated["freqs_from"] = "the axis FREQ" + " of each image" * (len(parts) > 1)
    elif len(parts) > 1 and len({part.path for part in parts}) == ends[-1]:  # a file per channel
        files, headers = [part.path.name for part in parts], [part.header for part in parts]
        stated |= {"names": tuple(files), **stated_freqs(files, "the names of its files", headers)}
    return maps, Layout(pixels=pixels, **stated)


@contextmanager
def _opened(path):
    """An open FITS file; errors raised by astropy are reported as InputError."""
    with reading(path, "an image cube in FITS"), _quiet(), fits.open(path, **_AS_STORED) as file:
        yield file


def _parts(path, file, *, axes, remarks, alone):
    """The `ImagePart` of every image cube in an open file; the rest is ignored, with a remark."""
    images = [n for n, hdu in enumerate(file) if isinstance(hdu, _IMAGES) and len(hdu.shape) > 1]
    if not images:
        raise InputError(f"{path} contains no image cube.")
    worlds = {n: world_of(file[n].header) for n in images}
    cubes = [n for n in images if worlds[n].wcs.spec >= 0]
    cubes = cubes or [n for n in images if len(file[n].shape) > 2] or images[:1]
    # Remarks of several files share one name.
    tables = [hdu for hdu in file if alone and type(hdu) is fits.BinTableHDU and hdu.name == _BEAMS]
    parts = [_part(path, n, file[n].header, file[n].shape, worlds[n], axes) for n in cubes]
    parts[0] = replace(parts[0], tables=tuple(hdu.copy() for hdu in tables))
    rest = [(n, hdu) for n, hdu in enumerate(file) if n not in cubes and hdu not in tables]
    others = [hdu.name or f"HDU {n}" for n, hdu in rest if not isinstance(hdu, _IMAGES) or hdu.shape]
    if others:
        remarks.append(f"{path} also contains {', '.join(others)}, which is ignored.")
    if tables:
        remarks.append(f"{path} also contains {_BEAMS}, which is copied but not used.")
    for wcs in (worlds[n].wcs for n in cubes):
        for axis in (n for n, kind in enumerate(wcs.ctype) if kind.strip() == "STOKES"):
            value = wcs.crval[axis] + (1 - wcs.crpix[axis]) * wcs.cdelt[axis]
            if round(value) != 1:
                remarks.append(f"{path} has STOKES = {value:g}; the intensity I is 1.")
    for part in () if alone else parts:
        part.header.remove("CASAMBM", ignore_missing=True)  # refers to such a table
    return parts


def pixels_of_headers(path, headers):
    """The `ImagePixels` of images stored in HDF5 as one array, from their headers, texts."""
    parts = []
    with _quiet():
        for index, text in enumerate(headers):
            header = fits.Header.fromstring(text)
            shape = [header[f"NAXIS{axis}"] for axis in range(header["NAXIS"], 0, -1)]
            parts.append(_part(path, index, header, shape, world_of(header)))
    return _pixels_of(parts)


def _part(path, index, header, shape, wcs, axes=None):
    name = image_name(path, index, header)
    n_axes, n_world = max(wcs.naxis, 3), header.get("WCSAXES")
    stored = (1,) * (n_axes - len(shape)) + tuple(shape)
    if axes is None and isinstance(n_world, int) and max(stored[: n_axes - n_world], default=1) > 1:
        raise InputError(
            f"{name}: its header has {n_world} axes (WCSAXES) and its array {len(shape)}, "
            f"{' x '.join(map(str, shape[::-1]))} in FITS order, so the axes cannot be identified. Write it "
            "with a header of three axes, transposed to (channel, Dec, RA) in numpy, or name its axes in "
            "numpy order (--axes ra,dec,freq or freq,dec,ra and so on)."
        )
    spectral, has_freqs = _spectral_axis(wcs, header, stored, axes, name)
    turn = turn_of(stored, axes, {"lon": wcs.wcs.lng, "lat": wcs.wcs.lat, "freq": spectral})
    shape = tuple(stored[axis] for axis in turn)
    _check_axes(wcs, shape, spectral, name)
    sky = sorted(n_axes - 1 - axis for axis in (wcs.wcs.lng, wcs.wcs.lat))
    first = n_axes - 1 - spectral
    rest = [axis for axis in range(n_axes) if axis not in (first, *sky)]
    freqs = None
    if has_freqs:
        line = wcs.sub([spectral + 1])
        (values,) = line.wcs_pix2world(np.arange(shape[first]), 0)
        freqs = np.asarray((values * u.Unit(line.wcs.cunit[0] or u.Hz)).to_value(u.MHz))
        if not freqs.min() > _LOWEST:
            raise InputError(
                f"{name} has frequencies from {freqs.min():.4g} to {freqs.max():.4g} MHz, probably in "
                f"another unit: write it as CUNIT{spectral + 1} into the header; without it, Hz is assumed."
            )
    where = {"path": path, "index": index, "header": header.copy(), "celestial": wcs.celestial}
    return ImagePart(**where, shape=shape, turn=turn, order=(first, *sky, *rest), freqs=freqs)


def _spectral_axis(wcs, header, stored, axes, name):
    """Index of the frequency axis of the world coordinates, and whether its header states frequencies.

    If not, it is the first axis without a type among those that may be longer than one in shape `stored`.
    """
    types, n_axes, axis = [text.strip() for text in wcs.wcs.ctype], len(stored), wcs.wcs.spec
    spelled = (str(header.get(f"CTYPE{n}", "")).strip() for n in range(1, len(types) + 1))
    listing = ", ".join(text or "no CTYPE" for text in spelled)
    if not wcs.has_celestial:
        raise InputError(
            f"{name} must have two sky axes (CTYPE such as RA---SIN and DEC--SIN), got {listing}. For "
            "HEALPix maps write a table, as healpy.write_map does."
        )
    if axis >= 0 and types[axis].startswith("FREQ"):
        return axis, True
    free = [n for n in range(n_axes) if n >= len(types) or types[n] in _NO_TYPE]
    if axis >= 0 or not free:
        raise InputError(
            f"{name} has no frequency axis FREQ, but {listing}: write CTYPE, CRVAL, CRPIX, CDELT and "
            "CUNIT of the frequencies into its header (the package spectral-cube converts velocities, "
            "SpectralCube.read(path).with_spectral_unit('Hz')), or a blank CTYPE, and give --freqs."
        )
    long = [n for n in free if stored[n_axes - 1 - n] > 1]
    return (long if long and axes is None else free)[0], False


def _check_axes(wcs, shape, spectral, name):
    """Refuse more than three axes longer than one, and coupled world axes."""
    celestial = {wcs.wcs.lng, wcs.wcs.lat}
    for axis in set(range(len(shape))) - celestial - {spectral}:
        length = shape[len(shape) - 1 - axis]
        if length > 1:
            text = wcs.wcs.ctype[axis] or f"axis {axis + 1}"
            raise InputError(
                f"{name} has {length} values along {text}, but a cube has one: write that one, for Stokes "
                "parameters the first, to a separate file."
            )
    matrix = np.abs(wcs.pixel_scale_matrix)
    for world, pixel in np.argwhere(matrix > 0):
        both_on_sky = {world, pixel} <= celestial
        if world != pixel and not both_on_sky and matrix[world, pixel] > _COUPLED * matrix[world].max():
            raise InputError(
                f"{name}: {wcs.wcs.ctype[world]} also changes along axis {pixel + 1} (PC or CD in the "
                "header): regrid such a rotated or sheared cube to one whose channels are images."
            )


def _pixels_of(parts):
    """The `ImagePixels` of parts with the same sky axes, if all or none of them state frequencies."""
    first = ImagePixels(parts=tuple(parts[:1]))
    for part in parts[1:]:
        pixels = ImagePixels(parts=(part,))
        if not first.same(pixels):
            raise InputError(
                f"all images must have the same sky axes: {parts[0]} has {first}, and {part} has "
                f"{pixels}, or other coordinates; reproject them to one header."
            )
        if (part.freqs is None) != (parts[0].freqs is None):
            raise InputError(
                f"only one of {parts[0]} and {part} has an axis FREQ; write it into the other header."
            )
    return replace(first, parts=tuple(parts))
