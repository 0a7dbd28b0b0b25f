"""The beams of MeerKAT as holography measured them (package katbeam): their width, and with side lobes."""

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import ClassVar

import numpy as np
from scipy import special

from himap.core.errors import InputError
from himap.instrument.beams.base import Beam, GaussianBeam, Windows

_BANDS = {"MKAT-AA-UHF-JIM-2020": (544, 1088), "MKAT-AA-L-JIM-2020": (856, 1712)}  # MHz
_RADIUS = np.linspace(0, 20, 4001)  # deg; the first side lobe is at 1e-2, and 1e-6 is reached before the end
_LEAST = 1e-4


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
        model, radius, widths = _model_of(freqs), np.linspace(0, 3, 601), []  # deg
        for freq in freqs:
            power = _stokes_i(model, freq, radius, 36)
            below = int(np.argmax(power < power[0] / 2))
            inside = slice(below, below - 2, -1)
            widths.append(2 * np.deg2rad(np.interp(power[0] / 2, power[inside], radius[inside])))
        return np.array(widths)


@dataclass(frozen=True, kw_only=True)
class MeerKATLobes(Beam):
    """The models of MeerKAT's primary beam with their side lobes: Stokes I averaged over angles.

    A dish of diameter D sees nothing beyond l = 2 pi D / lambda. There b_l is 1e-4: no map shows it, and
    methods may divide by it.

    Raises
    ------
    InputError
        As `MeerKAT`.
    """

    name: ClassVar[str] = "meerkat_lobes"

    def _windows(self, freqs, lmax, dish_diameter):
        model = _model_of(freqs)
        return Windows(telescope=np.array([_window(model, float(freq), lmax) for freq in freqs]))


def _model_of(freqs):
    """katbeam's model of the band that holds `freqs`, MHz; the same object for the same band."""
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


def _stokes_i(model, freq, radius, n_angles):
    """Power of a model of katbeam at `freq` in MHz, averaged over angles, at `radius` in degrees, (n,)."""
    angle = np.linspace(0, 2 * np.pi, n_angles, endpoint=False)[:, None]
    return model.I(radius * np.cos(angle), radius * np.sin(angle), freq).mean(axis=0)


@lru_cache(maxsize=4096)  # a survey asks again and again
def _window(model, freq, lmax):
    """b_l = int P(r) P_l(cos r) sin r dr over that of l = 0."""
    profile = _stokes_i(model, freq, _RADIUS, 12)
    window = _legendre(lmax) @ (profile * np.sin(np.deg2rad(_RADIUS)))
    return np.maximum(window / window[0], _LEAST)


@lru_cache(maxsize=2)
def _legendre(lmax):
    """P_l(cos r) at all radii, (lmax + 1, n_radii)."""
    return special.eval_legendre(np.arange(lmax + 1)[:, None], np.cos(np.deg2rad(_RADIUS)))
