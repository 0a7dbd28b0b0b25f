"""The beam of maps that were smoothed to one resolution (paper, Sect. 2.2.1)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.instrument.beams.base import GaussianBeam, Windows, diffraction_fwhm
from himap.maps import sphere

__all__ = ["Degraded"]


@dataclass(frozen=True, kw_only=True)
class Degraded(GaussianBeam):
    """The evolving beam, followed by smoothing every channel to the resolution of the worst.

    sigma_new^2 = sigma_worst^2 - sigma^2 (paper, Eq. 9), for signal and noise alike.
    """

    name: ClassVar[str] = "degraded"
    follows_dish: ClassVar[bool] = True

    def _fwhm(self, freqs, dish_diameter):
        width = diffraction_fwhm(freqs, dish_diameter)
        return np.full_like(width, width.max())

    def _windows(self, freqs, lmax, dish_diameter):
        width = diffraction_fwhm(freqs, dish_diameter)
        extra = np.sqrt(width.max() ** 2 - width**2)
        telescope, resmoothing = (sphere.gaussian_beam(fwhm, lmax) for fwhm in (width, extra))
        return Windows(telescope=telescope, resmoothing=resmoothing)
