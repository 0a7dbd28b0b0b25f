"""How a file has a cube: what it states of channels, units and pixels; and what all readers share."""

from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.core.checks import real_array
from himap.core.errors import InputError, plain_text
from himap.core.memory import PROCESS, check_room
from himap.core.reading import format_of, read_array, regular_file
from himap.maps import sphere
from himap.maps.healpix_io import MILLIKELVIN, read_maps, to_ring, write_maps
from himap.maps.sphere import pixels_last, sphere_sizes

LARGEST = 1e15
"""What is as large as this is no number: healpy marks missing pixels with -1.6e30."""

_ROUNDING = 1e-6  # relative: frequencies that are stated twice are the same


@dataclass(frozen=True, kw_only=True)
class SpherePixels:
    """HEALPix pixels: in a `Cube` RING, in its file NESTED or RING.

    Attributes
    ----------
    nside
        Of the maps.
    nested
        Whether the file has them in NESTED order; None where it does not say.
    partial
        Whether the file names the pixels that it has (explicit indexing).
    """

    area: ClassVar[str] = "the sky"
    grid: ClassVar[str] = "nside"
    whole_sky: ClassVar[bool] = True
    nside: int
    nested: bool | None = None
    partial: bool = False

    def __str__(self):
        return f"{self.nside}"

    @property
    def shape(self):
        """Of a map."""
        return (12 * self.nside**2,)

    @property
    def order(self):
        """Of the file: "RING" or "NESTED"."""
        return "NESTED" if self.nested else "RING"

    def sorted(self, pixels):
        """A map as in the file, (n_pix,), in the order of the cube."""
        return to_ring(pixels) if self.nested else pixels

    def as_given(self, pixels):
        """A map of the cube, (n_pix,), in the order of the file."""
        return pixels[sphere.nest_to_ring(self.nside)] if self.nested else pixels

    def by_channel(self, label, values):
        """Numbers of pixels, or of voxels in any order of these two axes, as (n_channels or 1, n_pix)."""
        if values.ndim not in (1, 2) or not sphere_sizes(values.shape):
            raise InputError(
                f"{label} must have shape (n_pix,) or (n_channels, n_pix) with n_pix = 12 nside^2, got "
                f"{values.shape}."
            )
        return pixels_last(np.atleast_2d(values))

    def described(self, unit):
        """What they are, for a sentence."""
        return f"maps of nside {self} in {unit}, {self.order}"

    def same(self, other):
        """Whether other pixels are the same ones, in whatever order."""
        return isinstance(other, SpherePixels) and self.nside == other.nside

    def read_mask(self, path):
        """The mask in a file, (n_pix,) bool, RING, True where kept.

        A FITS file has a HEALPix map of 1 (kept) and 0, or of logical values; UNSEEN, NaN and pixels that a
        partial file leaves out are not kept. A .npy file has them in the order of the cube's own file.

        Raises
        ------
        InputError
            No such file, no order of pixels, another nside, values between 0 and 1, or nothing kept.
        """
        kind = format_of(regular_file(path, "mask"))
        if kind not in ("FITS", "npy"):
            raise InputError(
                f"the mask {path} must be a FITS file, as healpy.write_map writes it, or a .npy file."
            )
        nested = self.nested
        if kind == "FITS":
            file = read_maps(path, n_maps=1, logical=True)
            nested = file.nested
            check_order(f"the mask {path}", nested)
        values = file.maps[0] if kind == "FITS" else array_of_mask(path, self)
        values = np.nan_to_num(values, nan=0.0)
        if sphere.nside_of(values) != self.nside:
            raise InputError(
                f"the mask {path} has nside {sphere.nside_of(values)}, and the cube {self}; write it again "
                "at that nside, as healpy.ud_grade(mask, nside) > 0.5 does."
            )
        if not np.isin(values, (0, 1)).all():
            raise InputError(
                f"the mask {path} must be 1 where kept and 0 elsewhere, got values from {values.min():g} to "
                f"{values.max():g}; write mask > 0.5, or the like."
            )
        if not values.any():
            raise InputError(f"the mask {path} keeps no pixel; 1 means kept.")
        return to_ring(values > 0) if nested else values > 0

    def attributes(self):
        """What HDF5 keeps of them, {name: text}."""
        return {"ordering": self.order}

    def write(self, path, maps, layout, *, name, cards):
        """Write maps of `Layout.as_given` as FITS; `name` says what they are, `cards` go into the header."""
        names = [f"{name} {freq:.10g} MHz" for freq in layout.freqs]
        order = {"nested": self.nested, "partial": self.partial}
        write_maps(path, maps, names=names, unit=layout.unit, cards=cards, **order)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a file has a cube; None for what it does not state, until `read_cube` completes it.

    Attributes
    ----------
    pixels
        The `SpherePixels` or `himap.cubes.images.ImagePixels`.
    freqs
        MHz, of all channels in the file, those without a seen pixel included, (n_in_file,).
    freqs_from
        What states the frequencies, in words.
    nearly
        Where nothing does, a sentence on what nearly does.
    unit
        Of the file, as text; "K", "mK" or "uK" once it is complete.
    remarks
        What was assumed or left out, for the user to read.
    names
        Of a folder the names of its files, one for each channel.
    channels
        For each channel of a `Cube` its place in the file, (n_channels,).
    """

    pixels: object
    freqs: np.ndarray | None = None
    freqs_from: str | None = None
    nearly: str = ""
    unit: str | None = None
    remarks: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    channels: np.ndarray | None = None

    @classmethod
    def of_sphere(cls, maps, nested=None, *, partial=False, **stated):
        """That of HEALPix maps (n_channels, n_pix); InputError for a number of pixels that no sphere has."""
        pixels = SpherePixels(nside=sphere.nside_of(maps), nested=nested, partial=partial)
        return cls(pixels=pixels, **stated)

    def as_given(self, maps, mask):
        """Maps (n_channels, n_seen) of the pixels in `mask`, laid out as in the file; NaN elsewhere."""
        out = np.full((len(self.freqs), len(mask)), np.nan, dtype=maps.dtype)
        full_map = np.full(len(mask), np.nan, dtype=maps.dtype)
        for place, pixels in zip(self.channels, maps, strict=True):
            full_map[mask] = pixels / MILLIKELVIN[self.unit]
            out[place] = self.pixels.as_given(full_map)
        return out.reshape(-1, *self.pixels.shape)


@contextmanager
def as_input_error(path, kind):
    """While `path` is read as `kind`: what a library raises for a damaged file is an InputError."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"{path} cannot be read as {kind} ({type(error).__name__}: {error}). Is it whole?"
        ) from None


@contextmanager
def naming(path):
    """While a cube is read from `path`: every error of the input names it."""
    try:
        yield
    except InputError as error:
        if plain_text(str(path)) in str(error):
            raise
        raise InputError(f"{path}: {error}") from None


def is_seen(pixels):
    """Which pixels have a number: neither NaN nor infinite nor UNSEEN."""
    return np.abs(pixels.astype(np.result_type(pixels.dtype, np.float32), copy=False)) < LARGEST


def same_freqs(first, second):
    """Which frequencies are the same but for their rounding, of two arrays that fit each other."""
    return np.isclose(first, second, rtol=_ROUNDING, atol=0)


def check_order(label, nested):
    """Refuse HEALPix maps of which it is not known whether they are NESTED, with an InputError."""
    if nested is None:
        raise InputError(
            f"{label} must say ORDERING = RING or NESTED in its header; write it again with healpy.write_map."
        )


def by_channel(label, values, pixels):
    """Real numbers, or True as 1, of these pixels, (n_channels or 1, n_pix); errors call them `label`."""
    values = np.asarray(values)
    values = real_array(label, values.astype(np.uint8) if values.dtype == bool else values)
    return pixels.by_channel(label, values)


def array_of_mask(path, pixels):
    """The mask (n_pix,) of these pixels in a .npy file, in the order of the cube's own file."""
    values = by_channel(f"the mask {path}", read_array(path), pixels)
    if len(values) > 1:
        raise InputError(f"the mask {path} must be one map for all channels, got {len(values)}; see --flags.")
    return values[0]


def one_unit(path, units):
    """The unit that all maps in `path` have, None where none is stated; InputError where they differ."""
    if len(set(units)) > 1:
        listing = ", ".join(str(unit) for unit in dict.fromkeys(units))
        raise InputError(f"the maps in {path} must have one unit, got {listing}.")
    return units[0]


def check_cube_room(path, n_values, itemsize, held):
    """Refuse a cube of `n_values` voxels of `itemsize` bytes before it is read, if work on it cannot fit.

    `held` is how many cubes in float32 will be held at once, beside the one as it is in the file. Raises an
    InputError.
    """
    check_room(f"work on {path}", PROCESS + n_values * (itemsize + 4 * held))
