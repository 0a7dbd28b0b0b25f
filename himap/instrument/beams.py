"""Beam models of the paper (Sect. 2.2.1): degraded, evolving, oscillating, and the user's own.

All are Gaussian and symmetric, so a beam is its transfer function b_l, one row per channel.
"""

from dataclasses import dataclass

import numpy as np
from astropy import constants as const
from astropy import units as u

from himap.checks import real_array
from himap.errors import InputError
from himap.maps import sphere

__all__ = [
    "BEAM_MODELS",
    "RIPPLES",
    "Beam",
    "beam_from_array",
    "beam_model",
    "diffraction_fwhm",
    "oscillating_fwhm",
]

BEAM_MODELS = ("degraded", "evolving", "oscillating")
RIPPLES = {
    "bracket": "P(nu) + (0.1/60) sin, times lambda/D: 0.14 % of the FWHM",
    "additive": "lambda/D + 0.1 arcmin sin",
    "additive_strong": "lambda/D + 0.5 arcmin sin: 0.7 % of the FWHM",
}
"""Readings of the ripple in the paper's Eq. 10, where arcmin inside a plain number are ambiguous."""

_RIPPLE_PERIOD = 20.0  # MHz
_LARGEST_TRANSFER = 1.01  # b_0 = 1, but for rounding
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
class Beam:
    """What the telescope does to the sky, and what the analyst does to the maps afterwards.

    Attributes
    ----------
    name
        "degraded", "evolving", "oscillating" or the user's.
    native
        b_l of the telescope, (n_channels, lmax + 1).
    after
        b_l of a later smoothing of signal and noise, of the same shape; None for no smoothing.
    """

    name: str
    native: np.ndarray
    after: np.ndarray | None = None

    @property
    def transfer(self):
        """b_l from the sky to the final maps, (n_channels, lmax + 1)."""
        return self.native if self.after is None else self.native * self.after


def diffraction_fwhm(freqs, dish_diameter):
    """FWHM = lambda / D, rad (paper, Eq. 8); `freqs` in MHz, `dish_diameter` in m."""
    wavelength = (const.c / (np.asarray(freqs, dtype=float) * u.MHz)).to_value(u.m)
    return wavelength / dish_diameter


def oscillating_fwhm(freqs, dish_diameter, ripple="bracket"):
    """FWHM of the oscillating beam, rad (paper, Eq. 10; Matshawule et al. 2021).

    Parameters
    ----------
    freqs
        MHz, (n_channels,).
    dish_diameter
        m.
    ripple
        One of `RIPPLES`: how the 0.1 arcmin of the paper are read.

    Raises
    ------
    InputError
        Unknown ripple, or frequencies outside the range of the polynomial, 850 to 1420 MHz.
    """
    freqs = np.asarray(freqs, dtype=float)
    if not isinstance(ripple, str) or ripple not in RIPPLES:
        readings = "; ".join(f"{name} ({text})" for name, text in RIPPLES.items())
        raise InputError(f"unknown ripple {ripple!r}; there are: {readings}.")
    wave = np.sin(2 * np.pi * freqs / _RIPPLE_PERIOD)
    diffraction = diffraction_fwhm(freqs, dish_diameter)
    if ripple != "bracket":
        amplitude = {"additive": 0.1, "additive_strong": 0.5}[ripple]
        return diffraction + np.deg2rad(amplitude / 60) * wave
    low, high = _MATSHAWULE_RANGE
    if freqs.min() < low or freqs.max() > high:
        raise InputError(
            f"the oscillating beam is measured from {low:.0f} to {high:.0f} MHz and diverges beyond; "
            f"got channels from {freqs.min():g} to {freqs.max():g} MHz. Narrow the band, or use "
            "ripple='additive'."
        )
    bracket = np.polynomial.polynomial.polyval(freqs, _MATSHAWULE) + 0.1 / 60 * wave
    return diffraction * bracket


def beam_model(name, survey, *, ripple="bracket"):
    """One of the paper's three beams for a `Survey`, up to its lmax.

    "degraded" is the evolving beam followed by smoothing every channel, signal and noise, to the
    resolution of the worst, sigma_new^2 = sigma_worst^2 - sigma^2 (Eq. 9).

    Raises
    ------
    InputError
        Unknown name, or what `oscillating_fwhm` raises.
    """
    freqs, diameter, lmax = survey.freqs, survey.dish_diameter, survey.lmax
    if name == "oscillating":
        fwhm = oscillating_fwhm(freqs, diameter, ripple)
        return Beam(name=name, native=sphere.gaussian_beam(fwhm, lmax))
    fwhm = diffraction_fwhm(freqs, diameter)
    if name == "evolving":
        return Beam(name=name, native=sphere.gaussian_beam(fwhm, lmax))
    if name == "degraded":
        extra = np.sqrt(fwhm.max() ** 2 - fwhm**2)
        native, after = (sphere.gaussian_beam(width, lmax) for width in (fwhm, extra))
        return Beam(name=name, native=native, after=after)
    raise InputError(
        f"unknown beam {name!r}; there are {', '.join(BEAM_MODELS)}. For a beam of your own give "
        "its b_l to beam_from_array."
    )


def beam_from_array(transfer, survey, *, name="custom"):
    """A beam from the user's b_l, (n_channels, at least lmax + 1), in the order of the channels.

    Raises
    ------
    InputError
        Wrong shape, values that are not finite or above 1, or a b_0 that is not positive.
    """
    transfer = np.array(real_array("beams", transfer), dtype=float)
    n_channels, n_degrees = survey.n_channels, survey.lmax + 1
    if transfer.ndim != 2 or transfer.shape[0] != n_channels or transfer.shape[1] < n_degrees:
        raise InputError(
            f"beams must be b_l of shape (n_channels, lmax + 1) = ({n_channels}, {n_degrees}), "
            f"or longer in l, got {transfer.shape}."
        )
    transfer = transfer[:, :n_degrees]
    bad = ~(np.abs(transfer) < _LARGEST_TRANSFER)
    bad[:, 0] |= ~(transfer[:, 0] > 0)
    if bad.any():
        channel, degree = np.argwhere(bad)[0]
        raise InputError(
            "beams must be finite and at most 1 at every l, and above 0 at l = 0; got "
            f"{transfer[channel, degree]} at channel {channel}, l = {degree}. Divide each b_l by its b_0."
        )
    return Beam(name=name, native=transfer)
