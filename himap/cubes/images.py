"""Images in the plane with world coordinates (WCS): their pixels and their FITS representation."""

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from astropy.coordinates import angular_separation
from astropy.io import fits
from astropy.wcs import WCS, NoConvergence, WcsError

from himap.core.errors import InputError
from himap.cubes.layout import OURS
from himap.maps.frames import equinox_of, frame_of
from himap.maps.healpix_io import card_text

HEADERS = "headers"
"""HDF5 dataset with the header of each image."""

_STALE = ("BSCALE", "BZERO", "BLANK", "DATAMIN", "DATAMAX", "CHECKSUM", "DATASUM")
_FREQ = re.compile("^(FREQUENCY|FREQ-(BAR|CMB|GAL|GEO|HEL|LGR|LSD|LSR|OBS|REST|SOU|SYS|TOP))$")
_SAME = 1e-6  # of a pixel or step: tolerance for equal coordinates


@dataclass(frozen=True, kw_only=True, eq=False)
class ImagePart:
    """An image cube as an HDU of a file.

    Attributes
    ----------
    path, index, header
        The file, the HDU and its header.
    shape
        Of its array in the order of its world coordinates, including missing axes of length one.
    turn
        Position of these axes in the array of the file.
    order
        Axes of `shape`: frequency, the two sky axes in their order, and those of length one.
    freqs
        MHz, (n_channels,); None if its header does not state them.
    celestial
        World coordinates of the two sky axes.
    tables
        HDUs that its header refers to.
    """

    path: Path
    index: int
    header: fits.Header
    shape: tuple[int, ...]
    turn: tuple[int, ...]
    order: tuple[int, ...]
    freqs: np.ndarray | None
    celestial: WCS
    tables: tuple = ()

    def __str__(self):
        return image_name(self.path, self.index, self.header)

    @property
    def n_channels(self):
        return self.shape[self.order[0]]

    def read(self, file):
        """The data in an open file as (n_channels, n_pix)."""
        stored = [self.shape[place] for place in np.argsort(self.turn)]
        data = file[self.index].data.reshape(stored).transpose(self.turn)
        return data.transpose(self.order).reshape(self.n_channels, -1)

    def hdu(self, maps, kind, *, freqs, unit, cards, history):
        """An HDU of type `kind` with other maps (n_channels, n_y, n_x), in the order of its header.

        The header is unchanged, except for `freqs` if it did not state them.
        """
        data = maps.reshape([self.shape[axis] for axis in self.order]).transpose(np.argsort(self.order))
        header = self.header.copy(strip=True)
        n_axes = self.header["NAXIS"]
        if self.freqs is None or self.turn != tuple(range(len(self.shape))):
            n_axes = len(self.shape)
            if "WCSAXES" in header:
                header["WCSAXES"] = max(n_axes, header["WCSAXES"])
        if self.freqs is None:
            steps, axis = np.diff(freqs) if len(freqs) > 1 else np.ones(1), n_axes - self.order[0]
            if np.allclose(steps, steps[0], rtol=_SAME, atol=0):  # an axis cannot state others
                values = ("FREQ", 1e6 * freqs[0], 1.0, 1e6 * steps[0], "Hz")
                names = ("CTYPE", "CRVAL", "CRPIX", "CDELT", "CUNIT")
                header.update({f"{name}{axis}": value for name, value in zip(names, values, strict=True)})
        for key in (*_STALE, *OURS):
            header.remove(key, ignore_missing=True)
        if card_text(header, "BUNIT") is None:
            header["BUNIT"] = unit
        header.update(cards)
        if history:
            header.add_history(history)
        return kind(data=data.reshape(self.shape[len(self.shape) - n_axes :]), header=header)


@dataclass(frozen=True, kw_only=True, eq=False)
class ImagePixels:
    """The pixels of an image, row by row in the order of the file; methods as in `SpherePixels`.

    Attributes
    ----------
    parts
        The `ImagePart` of each image cube of the channels; all share the sky axes.
    """

    area: ClassVar[str] = "the image"
    grid: ClassVar[str] = "sky axes"
    whole_sky: ClassVar[bool] = False
    nested: ClassVar[None] = None
    parts: tuple[ImagePart, ...]

    @property
    def celestial(self):
        """World coordinates of the two sky axes."""
        return self.parts[0].celestial

    @property
    def shape(self):
        """(n_y, n_x)."""
        return tuple(self.parts[0].shape[axis] for axis in self.parts[0].order[1:3])

    @property
    def frame(self):
        """Of the coordinates, as in `himap.maps.frames.frame_of`; Galactic has no RADESYS."""
        types, wcs = "".join(self.celestial.wcs.ctype), self.celestial.wcs
        if "RA" in types:
            return frame_of(wcs.radesys, wcs.equinox, "RADESYS")
        return frame_of(types[:1], name="CTYPE")

    def __str__(self):
        (x, y), (n_y, n_x) = self.celestial.wcs.ctype, self.shape
        frame = f" ({self.celestial.wcs.radesys})" if "RA" in x + y else ""
        return f"{x} and {y}{frame}, {n_x} x {n_y} pixels"

    @property
    def nside(self):
        """Raises an InputError: multipoles, beams and mocks need it."""
        raise InputError(
            "the cube is an image in the plane, and beams, mocks and multipoles need the sphere: omit them, "
            "or convert the cube to HEALPix, for example with reproject_to_healpix of the package reproject."
        )

    def described(self, unit):
        rows, columns = np.rad2deg(self.pixel_angles())
        return f"images in {unit}, {self} of {columns:.3g} x {rows:.3g} deg"

    def same(self, other):
        """Whether other pixels have the same positions, at the corners, edges and centre of the image."""
        if not isinstance(other, ImagePixels) or self.shape != other.shape:
            return False
        names, others = ([*map(str, one.celestial.wcs.ctype), one.frame] for one in (self, other))
        x, y = (axis.ravel() for axis in np.meshgrid(*(np.linspace(0, n - 1, 3) for n in self.shape[::-1])))
        places = other.celestial.all_pix2world(x, y, 0)
        with suppress(NoConvergence):
            again = self.celestial.all_world2pix(*places, 0)
            return names == others and np.allclose(again, [x, y], rtol=0, atol=_SAME, equal_nan=True)
        return False

    def in_hdf5(self, layout):
        """As in `SpherePixels`; the datasets contain the header of each image, as in FITS."""
        empty = np.broadcast_to(np.float32(0), (len(layout.freqs), *self.shape))
        headers = [hdu.header.tostring() for hdu in self._hdus(empty, layout, fits.PrimaryHDU)]
        axes = "frequency, then those of the sky as in numpy"
        return {"axes": axes, "wcs": self.celestial.to_header_string()}, {HEADERS: headers}

    def write(self, path, maps, layout, *, name, cards):
        first = [fits.PrimaryHDU()] if len(self.parts) > 1 else []
        history = f"{name} of foreground removal, " + ", ".join(
            f"{key} = {value}" for key, value in cards if key != "HISTORY"
        )
        kind = fits.ImageHDU if first else fits.PrimaryHDU
        tables = [table for part in self.parts for table in part.tables]
        images = self._hdus(maps, layout, kind, cards=cards, history=history)
        fits.HDUList([*first, *images, *tables]).writeto(path, output_verify="silentfix+ignore")

    def _hdus(self, maps, layout, kind, *, cards=(), history=None):
        """An HDU of type `kind` for each part, from maps (n_in_file, n_y, n_x)."""
        ends = np.cumsum([part.n_channels for part in self.parts])
        split = (np.split(values, ends[:-1]) for values in (maps, layout.freqs))
        for part, images, freqs in zip(self.parts, *split, strict=True):
            yield part.hdu(images, kind, freqs=freqs, unit=layout.unit, cards=cards, history=history)

    def pixel_angles(self):
        """Height and width of the central pixel of the image, rad."""
        middle = (np.array(self.shape[::-1]) - 1) / 2
        steps = np.array([[0, -0.5], [-0.5, 0], [0, 0.5], [0.5, 0]])
        world = self.celestial.all_pix2world(middle + steps, 0)
        lon, lat = np.deg2rad(world[:, [self.celestial.wcs.lng, self.celestial.wcs.lat]].T)
        return angular_separation(lon[:2], lat[:2], lon[2:], lat[2:])


def image_name(path, index, header):
    """Name of an image in messages."""
    name = str(header.get("EXTNAME") or "").strip()
    return f"{path}, HDU {index}" + (f" ({name})" if name else "")


def world_of(header):
    """The `WCS` of a header, which may have more axes than the array, and other names for FREQ (`_FREQ`)."""
    header = header.copy()
    frame_of(header.get("RADESYS"), name="RADESYS")  # astropy ignores non-text values and accepts any text
    if "EQUINOX" in header:
        header["EQUINOX"] = equinox_of(header["EQUINOX"])
    for key in [key for key in header if key.startswith("CTYPE")]:
        name = str(header[key]).strip().upper()
        if name.endswith("-TAB"):
            raise InputError(
                f"{key} of an image is {name}, coordinates in a table: leave it blank, and give --freqs."
            )
        header[key] = _FREQ.sub("FREQ", name)
    try:
        world = WCS(header)
    except WcsError as error:
        why = " ".join(str(error).split())
        raise InputError(
            f"the world coordinates of an image are invalid ({why}): correct CTYPE, CUNIT and so on."
        ) from None
    world.pixel_shape = None  # astropy cannot slice one that is shorter than its axes
    return world
