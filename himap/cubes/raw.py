"""What a file says of a cube, before it is made to what himap works with."""

from dataclasses import dataclass

import numpy as np

__all__ = ["RawCube"]


@dataclass(frozen=True, kw_only=True)
class RawCube:
    """What a file says; None for what it does not.

    Attributes
    ----------
    maps
        (n_channels, n_pix), in the order, unit and pixelisation of the file.
    freqs
        Channel centres, MHz, (n_channels,).
    unit
        Of the maps, as text.
    nested
        Whether pixels are in NESTED order.
    """

    maps: np.ndarray
    freqs: np.ndarray | None = None
    unit: str | None = None
    nested: bool | None = None
