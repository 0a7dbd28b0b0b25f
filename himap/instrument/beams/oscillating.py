"""The beam whose width ripples with frequency (paper, Sect. 2.2.1; Matshawule et al. 2021)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.instrument.beams.base import GaussianBeam, diffraction_fwhm, parameter

RIPPLES = {
    "bracket": "P(nu) + (0.1/60) sin, times lambda/D: 0.14 % of the FWHM",
    "additive": "lambda/D + 0.1 arcmin sin",
    "additive_strong": "lambda/D + 0.5 arcmin sin: 0.7 % of the FWHM",
}
"""Readings of the ripple in the paper's Eq. 10, where arcmin inside a plain number are ambiguous."""

_ARCMIN = {"additive": 0.1, "additive_strong": 0.5}
_PERIOD = 20.0  # MHz
# Matshawule et al. 2021, Table 1, for nu in MHz. Terms of 1e3 cancel to 1: every digit counts.
_MATSHAWULE = (
    6.70428133e03,
    -5.03702034e01,
    1.64488782e-01,
    -3.04953935e-04,
    3.51130410e-07,
    -2.57168633e-10,
    1.17019761e-13,
    -3.02516490e-17,
    3.40234907e-21,
)
_MATSHAWULE_RANGE = (850.0, 1420.0)  # MHz; the polynomial reaches 1.5 at 1500 and 13 at 1650


@dataclass(frozen=True, kw_only=True)
class Oscillating(GaussianBeam):
    """Gaussian, FWHM = lambda / D [sum_d a_d nu^d + A sin(2 pi nu / 20 MHz)] (paper, Eq. 10).

    How the A = 0.1 arcmin of the paper are read is in `RIPPLES`.

    Raises
    ------
    InputError
        Unknown ripple; in use, frequencies outside the range of the polynomial, 850 to 1420 MHz.
    """

    name: ClassVar[str] = "oscillating"
    follows_dish: ClassVar[bool] = True
    ripple: str = parameter("bracket", f"reading of the ripple: {', '.join(RIPPLES)}", choices=tuple(RIPPLES))

    def _fwhm(self, freqs, dish_diameter):
        wave = np.sin(2 * np.pi * freqs / _PERIOD)
        diffraction = diffraction_fwhm(freqs, dish_diameter)
        if self.ripple in _ARCMIN:
            return diffraction + np.deg2rad(_ARCMIN[self.ripple] / 60) * wave
        low, high = _MATSHAWULE_RANGE
        if freqs.min() < low or freqs.max() > high:
            raise InputError(
                f"the oscillating beam is measured from {low:.0f} to {high:.0f} MHz and diverges beyond; "
                f"got channels from {freqs.min():g} to {freqs.max():g} MHz. Narrow the band, or use "
                "ripple='additive'."
            )
        return diffraction * (np.polynomial.polynomial.polyval(freqs, _MATSHAWULE) + 0.1 / 60 * wave)
