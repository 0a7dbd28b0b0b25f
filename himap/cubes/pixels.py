"""The pixels that a cube has: how they lie in its file, what they can be compared with, how they are written.

A cube works with maps (n_channels, n_pix) whatever its pixels are. What is of the sphere alone (multipoles,
beams, mocks) asks for `nside`, which pixels of another kind refuse.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from himap.cubes.masks import read_mask
from himap.maps import sphere
from himap.maps.healpix_files import to_ring, write_maps

__all__ = ["Pixels", "SpherePixels"]


class Pixels(ABC):
    """What a `Layout` knows of the pixels of a cube; `mask` (n_pix,) tells how many there are.

    Attributes
    ----------
    area
        What they cover, in words.
    grid
        What two cubes must share to have the same pixels, in words.
    """

    area: ClassVar[str]
    grid: ClassVar[str]
    whole_sky: ClassVar[bool]

    @abstractmethod
    def check(self, maps):
        """Refuse maps (n_channels, n_pix) that cannot have such pixels."""

    @abstractmethod
    def sorted(self, pixels):
        """A map as in the file, (n_pix,), in the order that the cube has."""

    @abstractmethod
    def as_given(self, pixels):
        """A map of the cube, (n_pix,), in the order of the file."""

    @abstractmethod
    def shaped(self, maps):
        """Maps (n_channels, n_pix) in the order of the file, in the shape that an array of them has."""

    @abstractmethod
    def described(self, mask, unit):
        """What they are, for a sentence."""

    @abstractmethod
    def size(self, mask):
        """How fine they are and how many, in words."""

    @abstractmethod
    def same(self, mask, other, other_mask):
        """Whether other `Pixels` are the same ones, in whatever order."""

    @abstractmethod
    def nside(self, mask):
        """Of the HEALPix sphere; InputError where it is none."""

    @abstractmethod
    def read_mask(self, path, mask):
        """The mask in a file, (n_pix,) bool, True where kept; InputError where it does not fit."""

    @abstractmethod
    def attributes(self):
        """What HDF5 keeps of them, {name: text}."""

    @abstractmethod
    def write(self, path, maps, layout, *, name, cards):
        """Write maps of `Layout.as_given` as FITS; `name` tells what they are, `cards` go into the header."""


@dataclass(frozen=True, kw_only=True)
class SpherePixels(Pixels):
    """HEALPix: in the cube RING, in the file NESTED or RING.

    Attributes
    ----------
    nested
        Whether the file has them in NESTED order.
    partial
        Whether the file names the pixels that it has (explicit indexing).
    """

    area: ClassVar[str] = "the sky"
    grid: ClassVar[str] = "nside"
    whole_sky: ClassVar[bool] = True
    nested: bool
    partial: bool = False

    def check(self, maps):
        sphere.nside_of(maps)

    def sorted(self, pixels):
        return to_ring(pixels) if self.nested else pixels

    def as_given(self, pixels):
        return pixels[sphere.nest_to_ring(sphere.nside_of(pixels))] if self.nested else pixels

    def shaped(self, maps):
        return maps

    def described(self, mask, unit):
        return f"maps of nside {self.nside(mask)} in {unit}, {self._order}"

    def size(self, mask):
        return f"{self.nside(mask)}"

    def same(self, mask, other, other_mask):
        return isinstance(other, SpherePixels) and len(mask) == len(other_mask)

    def nside(self, mask):
        return sphere.nside_of(mask)

    def read_mask(self, path, mask):
        return read_mask(path, self.nside(mask))

    def attributes(self):
        return {"ordering": self._order}

    @property
    def _order(self):
        return "NESTED" if self.nested else "RING"

    def write(self, path, maps, layout, *, name, cards):
        write_maps(
            path,
            maps,
            names=[f"{name} {freq:.10g} MHz" for freq in layout.freqs],
            unit=layout.unit,
            nested=self.nested,
            partial=self.partial,
            cards=cards,
        )
