"""The base class of beams, which give b_l of every channel, from a width or directly; and the registry.

A beam is a frozen dataclass of its parameters with one hook. To add one, write one file with one class in
`himap/instrument/beams/`; it is registered under its name, and the contract test covers it automatically.
"""

import numbers
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from astropy import constants as const
from astropy import units as u

from himap.core.checks import checked_fields, checked_freqs, whole_number
from himap.core.errors import InputError
from himap.maps import sphere

REGISTRY = {}

DISH = 13.5
"""Diameter of a MeerKAT dish, m, as in the paper."""

_LARGEST_DISH = 1000.0  # m: larger values are probably in cm or mm
_LARGEST_LMAX = 100_000
_FELT = 0.1  # value of b_l at which its width is measured


@dataclass(frozen=True, kw_only=True)
class Windows:
    """Window functions b_l of every channel: of the telescope, and of the later analysis.

    Attributes
    ----------
    telescope
        b_l of the beam, (n_channels, lmax + 1).
    resmoothing
        b_l of a later smoothing of signal and noise, of the same shape; None for no smoothing.
    """

    telescope: np.ndarray
    resmoothing: np.ndarray | None = None

    @property
    def total(self):
        """b_l from the sky to the final maps, (n_channels, lmax + 1)."""
        return self.telescope if self.resmoothing is None else self.telescope * self.resmoothing


@dataclass(frozen=True, kw_only=True)
class Beam(ABC):
    """A beam that is symmetric about its axis; its fields are its parameters.

    Attributes
    ----------
    name
        Name of the beam in `named`, on the command line and in figures.
    follows_dish
        Whether its width depends on the diameter of the dish.
    by_line
        Whether it is given channel by channel, in the user's order of channels.
    """

    name: ClassVar[str]
    follows_dish: ClassVar[bool] = False
    by_line: ClassVar[bool] = False

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        if "name" in vars(cls):
            REGISTRY[cls.name] = cls

    def __post_init__(self):
        checked_fields(self)

    def __str__(self):
        """The text from which `named` makes this beam, without parameters at their defaults."""
        values = {item: getattr(self, item.name) for item in fields(self)}
        changed = [f"{item.name}={value}" for item, value in values.items() if value != item.default]
        return f"{self.name}:{','.join(changed)}" if changed else self.name

    def chosen_for(self, freqs):
        """The same beam with parameters that depend on `freqs`, MHz, such as the band of a receiver."""
        return self

    def windows(self, freqs, *, lmax, dish_diameter=DISH):
        """The `Windows` of channels, up to `lmax` or the largest l at which the beam is known.

        Parameters
        ----------
        freqs
            Channel centres, MHz, (n_channels,); ascending unless the beam is `by_line`.
        lmax
            Largest multipole.
        dish_diameter
            m, for beams whose width depends on it.

        Raises
        ------
        InputError
            If the beam is not known at the frequencies, or `lmax` or the dish diameter is invalid.
        """
        lmax = whole_number("lmax", lmax, 0, _LARGEST_LMAX)
        freqs = np.asarray(freqs, dtype=float) if self.by_line else checked_freqs(freqs, np.size(freqs))
        if not (isinstance(dish_diameter, numbers.Real) and 0 < dish_diameter <= _LARGEST_DISH):
            raise InputError(
                f"dish must be a diameter in m, at most {_LARGEST_DISH:g}, got {dish_diameter!r}."
            )
        return self._windows(freqs, lmax, dish_diameter)

    def of_survey(self, survey):
        """The `Windows` of a `Survey`, up to its lmax.

        Raises
        ------
        InputError
            As for `windows`; also for a beam that ends before lmax.
        """
        windows = self.windows(survey.freqs, lmax=survey.lmax, dish_diameter=survey.dish_diameter)
        n_degrees = windows.telescope.shape[1]
        if n_degrees <= survey.lmax:
            raise InputError(
                f"the beam {self} must reach l = {survey.lmax} for nside {survey.nside}, got b_l to "
                f"{n_degrees - 1}; give a longer b_l."
            )
        return windows

    @abstractmethod
    def _windows(self, freqs, lmax, dish_diameter):
        """The `Windows` at `freqs` (MHz), b_l to `lmax`."""


@dataclass(frozen=True, kw_only=True)
class GaussianBeam(Beam):
    """A Gaussian beam, b_l = exp(-l (l + 1) sigma^2 / 2), sigma = FWHM / sqrt(8 ln 2) (paper, Eqs. 6, 7)."""

    def fwhm(self, freqs, *, dish_diameter=DISH):
        """Full width at half maximum, rad, (n_channels,); `freqs` in MHz, `dish_diameter` in m."""
        return self._fwhm(np.asarray(freqs, dtype=float), dish_diameter)

    def _windows(self, freqs, lmax, dish_diameter):
        return Windows(telescope=sphere.gaussian_beam(self._fwhm(freqs, dish_diameter), lmax))

    @abstractmethod
    def _fwhm(self, freqs, dish_diameter):
        """FWHM, rad, (n_channels,), at `freqs` in MHz with a dish of `dish_diameter` in m."""


def diffraction_fwhm(freqs, dish_diameter):
    """FWHM = lambda / D, rad (paper, Eq. 8); `freqs` in MHz, `dish_diameter` in m."""
    wavelength = (const.c / (np.asarray(freqs, dtype=float) * u.MHz)).to_value(u.m)
    return wavelength / dish_diameter


def gaussian_widths(beams):
    """FWHM, rad, (n_channels,), of the Gaussians that fall off as `beams` do, b_l (n_channels, lmax + 1).

    Measured at the last l where b_l is above a tenth of its value at l = 0.
    """
    widths = []
    for beam in beams:
        degree = max(np.flatnonzero(beam > _FELT * beam[0])[-1], 1)
        sigma = np.sqrt(-2 * np.log(min(beam[degree] / beam[0], 1)) / (degree * (degree + 1)))
        widths.append(np.sqrt(8 * np.log(2)) * sigma)
    return np.array(widths)
