"""Beams of MeerKAT as measured by holography (package katbeam): with the width only, or with side lobes."""

from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import ClassVar

import numpy as np
from scipy import special

from himap.core.checks import parameter
from himap.core.errors import InputError
from himap.instrument.beams.base import Beam, GaussianBeam, Windows

_ANY, _BANDS = "any", ("UHF", "L")
_RADIUS = np.linspace(0, 20, 4001)  # deg; the first side lobe is 1e-2, the power at the end 1e-5 or less
_LEAST = 1e-4


@dataclass(frozen=True, kw_only=True)
class _OfBand(Beam):
    """katbeam's models of one receiver; each band extends from its first node in frequency to its last."""

    band: str = parameter(
        _ANY, "UHF or L; required if both contain the frequencies", choices=(_ANY, *_BANDS), off=_ANY
    )

    def chosen_for(self, freqs):
        """The same beam with the band that contains `freqs`, MHz; InputError if there is not exactly one."""
        limits = {band: _model(band).freqMHzlist[[0, -1]] for band in _BANDS}
        wanted = _BANDS if self.band == _ANY else [self.band]
        fit = [band for band in wanted if limits[band][0] <= min(freqs) and max(freqs) <= limits[band][1]]
        if len(fit) != 1:
            known = ", ".join(f"{name} from {low:g} to {high:g} MHz" for name, (low, high) in limits.items())
            raise InputError(
                f"the channels must lie in one band alone, of {' and '.join(wanted)}, got {min(freqs):g} to "
                f"{max(freqs):g} MHz, and katbeam has nodes for {known}. Where both hold them, name one: "
                f"{self.name}:band=UHF. Else leave out the channels beyond, or give a file of widths."
            )
        return replace(self, band=fit[0])


@dataclass(frozen=True, kw_only=True)
class MeerKAT(_OfBand, GaussianBeam):
    """Gaussian, with the FWHM of the models of MeerKAT's primary beam: Stokes I averaged over angles.

    Raises
    ------
    InputError
        For an unknown band. In use: if katbeam is not installed, or frequencies do not determine the band.
    """

    name: ClassVar[str] = "meerkat"

    def _fwhm(self, freqs, dish_diameter):
        model, radius, widths = _model(self.chosen_for(freqs).band), np.linspace(0, 3, 601), []  # deg
        for freq in freqs:
            power = _stokes_i(model, freq, radius, 36)
            below = int(np.argmax(power < power[0] / 2))
            inside = slice(below, below - 2, -1)
            widths.append(2 * np.deg2rad(np.interp(power[0] / 2, power[inside], radius[inside])))
        return np.array(widths)


@dataclass(frozen=True, kw_only=True)
class MeerKATLobes(_OfBand):
    """The models of MeerKAT's primary beam with side lobes: Stokes I averaged over angles.

    A dish of diameter D does not measure l above 2 pi D / lambda. There b_l is 1e-4: too small to be visible
    in maps, but methods can divide by it.

    Raises
    ------
    InputError
        See `MeerKAT`.
    """

    name: ClassVar[str] = "meerkat_lobes"

    def _windows(self, freqs, lmax, dish_diameter):
        band = self.chosen_for(freqs).band
        return Windows(telescope=_lobes(band, tuple(freqs.tolist()), lmax).copy())


@cache
def _model(band):
    try:
        from katbeam import JimBeam
    except ImportError:
        raise InputError("the beams of MeerKAT are in the package katbeam: pip install katbeam.") from None
    return JimBeam(f"MKAT-AA-{band}-JIM-2020")


def _stokes_i(model, freq, radius, n_angles):
    """Power of a model of katbeam at `freq` in MHz, averaged over angles, at `radius` in degrees, (n,)."""
    angle = np.linspace(0, 2 * np.pi, n_angles, endpoint=False)[:, None]
    return model.I(radius * np.cos(angle), radius * np.sin(angle), freq).mean(axis=0)


@lru_cache(maxsize=16)  # a survey calls it repeatedly
def _lobes(band, freqs, lmax):
    """b_l = int P(r) P_l(cos r) sin r dr, over its value at l = 0, (n_channels, lmax + 1)."""
    profiles = np.array([_stokes_i(_model(band), freq, _RADIUS, 12) for freq in freqs])
    legendre = special.eval_legendre(np.arange(lmax + 1)[:, None], np.cos(np.deg2rad(_RADIUS)))
    windows = profiles * np.sin(np.deg2rad(_RADIUS)) @ legendre.T
    return np.maximum(windows / windows[:, :1], _LEAST)
