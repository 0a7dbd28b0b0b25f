"""Image cubes in FITS with world coordinates: two axes of the sky in any projection, and one of frequency.

Axes may come in any order, frequencies may descend, and axes of length one (Stokes) are kept for the way
back. Several images, in one file or in a folder, are the channels of one cube if they share the axes of the
sky and no range of frequencies.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from astropy import units as u
from astropy.io import fits
from astropy.utils.exceptions import AstropyWarning
from astropy.wcs import WCS

from himap.cubes.image_pixels import IMAGES, ImagePart, ImagePixels, world_of
from himap.cubes.raw import RawCube, as_input_error, check_cube_room
from himap.errors import InputError

__all__ = ["has_frequencies", "holds_image", "images_of_files"]

_LOWEST = 1.0  # MHz: a FREQ in MHz or GHz that says nothing is taken as Hz, and lies far below
_COUPLED = 1e-9  # of the largest step along an axis: rounding in a header


@dataclass(frozen=True, kw_only=True)
class _Found:
    """An image cube that a file holds: which HDU, and what its header says."""

    path: Path
    index: int
    part: ImagePart
    freqs: np.ndarray
    celestial: WCS
    stored: str

    @property
    def name(self):
        return f"{self.path}, HDU {self.index}"


def holds_image(path):
    """Whether what comes first in a FITS file is an image, and no table; False for what cannot be read."""
    try:
        with _quiet(), fits.open(path, memmap=False) as file:
            return next((_is_image(hdu) for hdu in file if not _is_empty(hdu)), False)
    except Exception:  # astropy raises nearly anything; the reader of tables says it
        return False


def has_frequencies(path):
    """Whether the first image in a FITS file has an axis of frequency; False for what cannot be read."""
    try:
        with _quiet(), fits.open(path, memmap=False) as file:
            first = next(hdu for hdu in file if _is_image(hdu) and not _is_empty(hdu))
            return world_of(first, file).wcs.spec >= 0
    except Exception:  # astropy raises nearly anything for a file that is damaged
        return False


def _quiet():
    """Without astropy's warnings: of what is mended, or an error a line below."""
    return warnings.catch_warnings(action="ignore", category=AstropyWarning)


def _is_image(hdu):
    return isinstance(hdu, IMAGES)


def _is_empty(hdu):
    return _is_image(hdu) and not hdu.shape


def images_of_files(paths, *, held=1):
    """The `RawCube` of all image cubes in some files.

    Parameters
    ----------
    paths
        The files.
    held
        Cubes in float32 that the caller will hold at once: they must fit into memory.

    Raises
    ------
    InputError
        A file without such an image, axes of the sky that differ, frequencies that overlap, other units than
        of temperature, or too large a cube.
    """
    remarks, found = [], []
    for path in paths:
        found += _read(path, lambda file, path=path: _images(path, file, remarks))
    _check_alike(found)
    n_pix = int(np.prod(found[0].part.sky_shape))
    starts = np.cumsum([0, *(one.part.n_channels for one in found)])
    dtype = np.result_type(np.float32, *(one.stored for one in found))
    check_cube_room(paths[0].parent if len(paths) > 1 else paths[0], starts[-1] * n_pix, dtype.itemsize, held)
    maps = np.empty((starts[-1], n_pix), dtype=dtype)
    for one, start in zip(found, starts[:-1], strict=True):
        out = maps[start : start + one.part.n_channels]
        out[:] = _read(one.path, lambda file, one=one: one.part.channels_first(file[one.index].data))
    pixels = ImagePixels(
        parts=tuple(one.part for one in found), celestial=found[0].celestial, shape=found[0].part.sky_shape
    )
    return RawCube(
        maps=maps,
        freqs=np.concatenate([one.freqs for one in found]),
        freqs_from="the axis FREQ" + (" of each image" if len(found) > 1 else ""),
        unit=_one_unit(found),
        image=pixels,
        remarks=tuple(remarks),
    )


def _read(path, read):
    """``read(file)`` of an open FITS file; what astropy raises as an error of the input."""
    kind = "an image cube in FITS"
    with as_input_error(path, kind), _quiet(), fits.open(path, memmap=False) as file:
        return read(file)


def _images(path, file, remarks):
    """`_Found` of every image cube in an open file; what else is there is left out, and said."""
    found, others = [], []
    for index, hdu in enumerate(file):
        if _is_image(hdu) and (len(hdu.shape) > 2 or (len(hdu.shape) == 2 and not found)):
            found.append(_found(path, index, hdu, file))
        elif not _is_empty(hdu):
            others.append(hdu.name or str(index))
    if not found:
        raise InputError(f"{path} holds no image cube.")
    if others:
        remarks.append(f"{path} holds {', '.join(others)} beside the cube, which is left out.")
    return found


def _found(path, index, hdu, file):
    wcs = world_of(hdu, file)
    name = f"{path}, HDU {index}"
    spectral = _spectral_axis(wcs, name)
    full_shape = (1,) * (wcs.naxis - len(hdu.shape)) + tuple(hdu.shape)
    _check_axes(wcs, full_shape, spectral, name)
    sky = sorted(wcs.wcs.naxis - 1 - axis for axis in (wcs.wcs.lng, wcs.wcs.lat))
    first = wcs.naxis - 1 - spectral
    rest = [axis for axis in range(wcs.naxis) if axis not in (first, *sky)]
    part = ImagePart(
        header=hdu.header.copy(), shape=tuple(hdu.shape), full_shape=full_shape, order=(first, *sky, *rest)
    )
    _check_unit(hdu.header, name)
    line = wcs.sub([spectral + 1])
    (values,) = line.wcs_pix2world(np.arange(part.n_channels), 0)
    unit = u.Unit(line.wcs.cunit[0] or u.Hz)
    freqs = np.asarray((values * unit).to_value(u.MHz))
    if not freqs.min() > _LOWEST:
        raise InputError(
            f"{name} has frequencies from {freqs.min():.4g} to {freqs.max():.4g} MHz, which looks like "
            f"another unit: write the right one as CUNIT{spectral + 1} into the header, where none means Hz."
        )
    stored = fits.BITPIX2DTYPE[hdu.header["BITPIX"]]
    return _Found(path=path, index=index, part=part, freqs=freqs, celestial=wcs.celestial, stored=stored)


def _spectral_axis(wcs, name):
    """Which axis of the world is that of frequency."""
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
    if axis < 0:
        raise InputError(
            f"{name} has no axis FREQ, which tells the channels, but {listing}; write CTYPE, CRVAL, CRPIX, "
            "CDELT and CUNIT of the frequencies into its header."
        )
    return axis


def _check_axes(wcs, full_shape, spectral, name):
    """Refuse more axes than three that are longer than one, and axes that are not those of the array."""
    celestial = {wcs.wcs.lng, wcs.wcs.lat}
    for axis in set(range(wcs.naxis)) - celestial - {spectral}:
        length = full_shape[wcs.naxis - 1 - axis]
        if length > 1:
            text = wcs.wcs.ctype[axis] or f"axis {axis + 1}"
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


def _check_unit(header, name):
    unit = str(header.get("BUNIT") or "")
    if "jy" in unit.lower():
        raise InputError(
            f"{name} is in {unit}, and a cube must be in K, mK or uK: convert every channel with the area of "
            "its beam, (values * u.Jy / u.beam).to(u.K, u.brightness_temperature(freq, beam_area=...)) in "
            "astropy, and write BUNIT = 'K'."
        )


def _check_alike(found):
    """Refuse images that do not share the axes of the sky, or do share a range of frequencies."""
    first = found[0]
    for one in found[1:]:
        pixels = ImagePixels(parts=(), celestial=first.celestial, shape=first.part.sky_shape)
        other = ImagePixels(parts=(), celestial=one.celestial, shape=one.part.sky_shape)
        if not pixels.same(None, other, None):
            raise InputError(
                f"all images must have the same axes of the sky: {first.name} has {pixels.size(None)}, and "
                f"{one.name} has {other.size(None)}, or other coordinates; reproject them to one header."
            )
    ordered = sorted(found, key=lambda one: one.freqs.min())
    for low, high in zip(ordered, ordered[1:], strict=False):
        if high.freqs.min() <= low.freqs.max():
            raise InputError(
                f"the frequencies of {low.name} and {high.name} overlap, from {high.freqs.min():.10g} to "
                f"{low.freqs.max():.10g} MHz; cut one of them, or write what is to be cleaned alone."
            )


def _one_unit(found):
    """The unit that all images have, None where none is told."""
    units = [str(one.part.header.get("BUNIT") or "").strip() or None for one in found]
    if len(set(units)) > 1:
        listing = ", ".join(str(unit) for unit in dict.fromkeys(units))
        raise InputError(f"all images must have one unit (BUNIT), got {listing}.")
    return units[0]
