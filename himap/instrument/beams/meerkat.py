"""The width of MeerKAT's beams as holography measured it (package katbeam)."""

from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.instrument.beams.base import GaussianBeam

_BANDS = {"MKAT-AA-UHF-JIM-2020": (544, 1088), "MKAT-AA-L-JIM-2020": (856, 1712)}  # MHz


@dataclass(frozen=True, kw_only=True)
class MeerKAT(GaussianBeam):
    """Gaussian, with the FWHM of the models of MeerKAT's primary beam: Stokes I averaged over angles.

    Raises
    ------
    InputError
        In use: katbeam is not installed, or has no band that holds the frequencies.
    """

    name: ClassVar[str] = "meerkat"

    def _fwhm(self, freqs, dish_diameter):
        model = model_of(freqs)
        return np.array([_half_power(model, freq) for freq in freqs])


def model_of(freqs):
    """katbeam's model of the band that holds `freqs`, MHz; the same object for the same band.

    Raises
    ------
    InputError
        katbeam is not installed, or no band holds them.
    """
    for name, (low, high) in _BANDS.items():
        if low <= min(freqs) and max(freqs) <= high:
            return _model(name)
    bands = " or ".join(f"{low} to {high}" for low, high in _BANDS.values())
    raise InputError(f"katbeam knows {bands} MHz, the channels go from {min(freqs):g} to {max(freqs):g}.")


@cache
def _model(name):
    try:
        from katbeam import JimBeam
    except ImportError:
        raise InputError("the beams of MeerKAT are in the package katbeam: pip install katbeam.") from None
    return JimBeam(name)


def stokes_i(model, freq, radius, n_angles):
    """Power of a model of katbeam at `freq` in MHz, averaged over angles, at `radius` in degrees, (n,)."""
    angle = np.linspace(0, 2 * np.pi, n_angles, endpoint=False)[:, None]
    return model.I(radius * np.cos(angle), radius * np.sin(angle), freq).mean(axis=0)


def _half_power(model, freq):
    """Full width at half maximum of a model of katbeam, rad."""
    radius = np.linspace(0, 3, 601)  # deg
    power = stokes_i(model, freq, radius, 36)
    below = int(np.argmax(power < power[0] / 2))
    inside = slice(below, below - 2, -1)
    return 2 * np.deg2rad(np.interp(power[0] / 2, power[inside], radius[inside]))
