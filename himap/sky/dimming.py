"""Foregrounds made fainter along the Galactic plane (paper, Sect. 5.2)."""

from dataclasses import dataclass

import numpy as np

from himap.core.checks import checked_fields, parameter
from himap.maps import sphere

_WIDTHS = 3  # standard deviations from the plane to the edge


@dataclass(frozen=True, kw_only=True)
class Dimming:
    """A weight by Galactic latitude that mimics a mask before cleaning.

    w(b) = 1 - (1 - w_0) (g(b) - g(edge)) / (1 - g(edge)) with the Gaussian g(b) = exp(-b^2 / (2 sigma^2)),
    sigma = edge / 3, and w = 1 beyond the edge. The paper gives the weight in the plane, 0.1, and the
    latitude from which the sky is as it was, 15 deg; the width of its Gaussian it does not say.

    Raises
    ------
    InputError
        A weight outside 0 to 1, or an edge outside 0 to 90 deg.
    """

    weight: float = parameter(0.1, "what is left of the foregrounds at b = 0", minimum=0, maximum=1)
    edge: float = parameter(
        15.0, "latitude beyond which nothing changes, deg", minimum=0, maximum=90, above=True
    )

    def __post_init__(self):
        checked_fields(self)

    def weights(self, nside):
        """The weight of every pixel, (n_pix,) float64, RING, Galactic."""
        x = np.minimum(np.abs(sphere.pixel_latitude(nside)) / self.edge, 1)
        end = np.exp(-0.5 * _WIDTHS**2)
        return 1 - (1 - self.weight) * (np.exp(-0.5 * (_WIDTHS * x) ** 2) - end) / (1 - end)
