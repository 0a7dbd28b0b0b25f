"""The beam of maps that were smoothed to one resolution (paper, Sect. 2.2.1)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.instrument.beams.base import GaussianBeam, Windows, diffraction_fwhm, parameter
from himap.maps import sphere

NOISE = {
    "smoothed": "smoothed with the maps, as what is observed and degraded later has it",
    "white": "added to the degraded maps, and not smoothed",
}
"""Readings of the noise of degraded maps: the paper adds white noise after the beam, of which it is a part
(Sects. 2 and 2.2.1), yet it is maps that were observed, with their noise, that an analyst degrades."""


@dataclass(frozen=True, kw_only=True)
class Degraded(GaussianBeam):
    """The evolving beam, followed by smoothing every channel to the resolution of the worst.

    sigma_new^2 = sigma_worst^2 - sigma^2 (paper, Eq. 9). What becomes of the noise is in `NOISE`; the b_l of
    the sky are the same for both.

    Raises
    ------
    InputError
        An unknown reading of the noise.
    """

    name: ClassVar[str] = "degraded"
    follows_dish: ClassVar[bool] = True
    noise: str = parameter("smoothed", f"reading of the noise: {', '.join(NOISE)}", choices=tuple(NOISE))

    def _fwhm(self, freqs, dish_diameter):
        width = diffraction_fwhm(freqs, dish_diameter)
        return np.full_like(width, width.max())

    def _windows(self, freqs, lmax, dish_diameter):
        if self.noise == "white":  # one window, and nothing after the noise
            return super()._windows(freqs, lmax, dish_diameter)
        width = diffraction_fwhm(freqs, dish_diameter)
        extra = np.sqrt(width.max() ** 2 - width**2)
        telescope, resmoothing = (sphere.gaussian_beam(fwhm, lmax) for fwhm in (width, extra))
        return Windows(telescope=telescope, resmoothing=resmoothing)
