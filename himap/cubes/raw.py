"""What a file says of a cube, before it is made to what himap works with."""

from dataclasses import dataclass

import numpy as np

from himap.cubes.pixels import Pixels
from himap.memory import PROCESS, check_room

__all__ = ["HELD", "RawCube", "check_cube_room"]

HELD = 4
"""Cubes in float32 that cleaning holds at once beside the one in the file; measured with one of 0.1 GB."""


@dataclass(frozen=True, kw_only=True)
class RawCube:
    """What a file says; None for what it does not.

    Attributes
    ----------
    maps
        (n_channels, n_pix), in the order, unit and pixelisation of the file; NaN where it marks them missing.
    freqs
        Channel centres, MHz, (n_channels,).
    freqs_from
        What in the file tells them, in words.
    nearly
        Where nothing does, a sentence on what nearly does.
    unit
        Of the maps, as text.
    nested
        Whether HEALPix pixels are in NESTED order.
    partial
        Whether the file names the HEALPix pixels that it has.
    image
        The `ImagePixels` of an image in the plane; None for HEALPix.
    remarks
        What was taken for granted or left out, for the user to read.
    """

    maps: np.ndarray
    freqs: np.ndarray | None = None
    freqs_from: str | None = None
    nearly: str = ""
    unit: str | None = None
    nested: bool | None = None
    partial: bool = False
    image: Pixels | None = None
    remarks: tuple[str, ...] = ()


def check_cube_room(path, n_values, itemsize, held):
    """Refuse a cube of `n_values` voxels of `itemsize` bytes before it is read, if work on it cannot fit.

    `held` is how many cubes in float32 will be held at once, beside the one as it is in the file.

    Raises
    ------
    InputError
        It needs more memory than may be used.
    """
    check_room(f"work on {path}", PROCESS + n_values * (itemsize + 4 * held))
