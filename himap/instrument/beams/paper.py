"""The beams of the paper (Sect. 2.2.1): evolving, degraded, and oscillating with frequency."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.core.checks import parameter
from himap.core.errors import InputError
from himap.instrument.beams.base import GaussianBeam, Windows, diffraction_fwhm
from himap.maps import sphere

NOISE = {
    "smoothed": "smoothed with the maps, as what is observed and degraded later has it",
    "white": "added to the degraded maps, and not smoothed",
}
"""Readings of the noise of degraded maps: the paper adds white noise after the beam, which includes degrading
(Sects. 2 and 2.2.1), but an analyst degrades observed maps together with their noise."""

RIPPLES = {
    "bracket": "P(nu) + (0.1/60) sin, times lambda/D: 0.14 % of the FWHM",
    "additive": "lambda/D + 0.1 arcmin sin",
    "additive_strong": "lambda/D + 0.5 arcmin sin: 0.7 % of the FWHM",
}
"""Readings of the ripple in the paper's Eq. 10, where arcmin inside a dimensionless factor are ambiguous."""

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
_MATSHAWULE_RANGE = (850.0, 1420.0)  # MHz; beyond, the polynomial diverges: 1.5 at 1500 and 13 at 1650


@dataclass(frozen=True, kw_only=True)
class Evolving(GaussianBeam):
    """Gaussian with the width of diffraction: FWHM = lambda / D (paper, Eq. 8)."""

    name: ClassVar[str] = "evolving"
    follows_dish: ClassVar[bool] = True

    def _fwhm(self, freqs, dish_diameter):
        return diffraction_fwhm(freqs, dish_diameter)


@dataclass(frozen=True, kw_only=True)
class Degraded(GaussianBeam):
    """The evolving beam, followed by smoothing every channel to the resolution of the worst.

    sigma_new^2 = sigma_worst^2 - sigma^2 (paper, Eq. 9). The treatment of the noise is in `NOISE`; the b_l of
    the sky are the same for both.

    Raises
    ------
    InputError
        For an unknown reading of the noise.
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


@dataclass(frozen=True, kw_only=True)
class Oscillating(GaussianBeam):
    """Gaussian, FWHM = lambda / D [sum_d a_d nu^d + A sin(2 pi nu / 20 MHz)] (paper, Eq. 10).

    Readings of the paper's A = 0.1 arcmin are in `RIPPLES`; the a_d are from Matshawule et al. (2021).

    Raises
    ------
    InputError
        For an unknown ripple; in use, for frequencies outside the polynomial's range, 850 to 1420 MHz.
    """

    name: ClassVar[str] = "oscillating"
    follows_dish: ClassVar[bool] = True
    ripple: str = parameter("bracket", f"reading of the ripple: {', '.join(RIPPLES)}", choices=tuple(RIPPLES))

    def _fwhm(self, freqs, dish_diameter):
        if self.ripple in _ARCMIN:
            wave = np.sin(2 * np.pi * freqs / _PERIOD)
            return diffraction_fwhm(freqs, dish_diameter) + np.deg2rad(_ARCMIN[self.ripple] / 60) * wave
        return Rippled().fwhm(freqs, dish_diameter=dish_diameter)


@dataclass(frozen=True, kw_only=True)
class Rippled(GaussianBeam):
    """Gaussian, FWHM = lambda / D [sum_d a_d nu^d + A sin(2 pi nu / period + phase)] (paper, Eq. 10).

    With default parameters it is `Oscillating()`, A = 0.1 / 60.

    Raises
    ------
    InputError
        For a field outside its range; in use, for frequencies as in `Oscillating`.
    """

    name: ClassVar[str] = "rippled"
    follows_dish: ClassVar[bool] = True
    amplitude: float = parameter(0.1, "60 A", minimum=-10, maximum=10)
    period: float = parameter(_PERIOD, "MHz", minimum=0, above=True)
    phase: float = parameter(0.0, "at 0 MHz, rad")

    def _fwhm(self, freqs, dish_diameter):
        low, high = _MATSHAWULE_RANGE
        if freqs.min() < low or freqs.max() > high:
            raise InputError(
                f"the oscillating beam is measured from {low:.0f} to {high:.0f} MHz and diverges beyond; got "
                f"channels from {freqs.min():g} to {freqs.max():g} MHz. Narrow the band, or use "
                "the beam oscillating:ripple=additive."
            )
        wave = np.sin(2 * np.pi * freqs / self.period + self.phase)
        factor = np.polynomial.polynomial.polyval(freqs, _MATSHAWULE) + self.amplitude / 60 * wave
        return diffraction_fwhm(freqs, dish_diameter) * factor
