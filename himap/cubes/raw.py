"""What a file says of a cube, before it is made to what himap works with."""

from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from himap.cubes.pixels import Pixels
from himap.errors import InputError
from himap.memory import PROCESS, check_room

__all__ = ["HELD", "LARGEST", "RawCube", "as_input_error", "check_cube_room", "same_freqs"]

HELD = 4
"""Cubes in float32 that cleaning holds at once beside the one in the file; measured with one of 0.1 GB."""

LARGEST = 1e15
"""What is as large as this is no number: healpy marks missing pixels with -1.6e30."""

_ROUNDING = 1e-6  # relative: frequencies that are told twice are the same


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


def same_freqs(first, second):
    """Which frequencies are the same but for their rounding, of two arrays that fit each other."""
    return np.isclose(first, second, rtol=_ROUNDING, atol=0)


def check_cube_room(path, n_values, itemsize, held):
    """Refuse a cube of `n_values` voxels of `itemsize` bytes before it is read, if work on it cannot fit.

    `held` is how many cubes in float32 will be held at once, beside the one as it is in the file.

    Raises
    ------
    InputError
        It needs more memory than may be used.
    """
    check_room(f"work on {path}", PROCESS + n_values * (itemsize + 4 * held))
