"""The width of MeerKAT's beams as holography measured it (package katbeam)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.errors import InputError
from himap.instrument.beams.base import GaussianBeam

__all__ = ["MeerKAT"]

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
        try:
            from katbeam import JimBeam
        except ImportError:
            raise InputError(
                "the beams of MeerKAT are in the package katbeam: pip install katbeam."
            ) from None
        for name, (low, high) in _BANDS.items():
            if low <= min(freqs) and max(freqs) <= high:
                return np.array([_half_power(JimBeam(name), freq) for freq in freqs])
        bands = " or ".join(f"{low} to {high}" for low, high in _BANDS.values())
        raise InputError(f"katbeam knows {bands} MHz, the channels go from {min(freqs):g} to {max(freqs):g}.")


def _half_power(model, freq):
    """Full width at half maximum of a model of katbeam, rad."""
    radius = np.linspace(0, 3, 601)  # deg
    angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)[:, None]
    power = model.I(radius * np.cos(angle), radius * np.sin(angle), freq).mean(axis=0)
    below = int(np.argmax(power < power[0] / 2))
    inside = slice(below, below - 2, -1)
    return 2 * np.deg2rad(np.interp(power[0] / 2, power[inside], radius[inside]))
