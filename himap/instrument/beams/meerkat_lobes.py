"""The beams of MeerKAT with their side lobes (package katbeam)."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy import special

from himap.instrument.beams.base import Beam, Windows
from himap.instrument.beams.meerkat import model_of, stokes_i

_RADIUS = np.linspace(0, 20, 4001)  # deg; the first side lobe is at 1e-2, and 1e-6 is reached before the end
_N_ANGLES = 12
_LEAST = 1e-4


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
        model = model_of(freqs)
        return Windows(telescope=np.array([_window(model, float(freq), lmax) for freq in freqs]))


@lru_cache(maxsize=4096)  # of a survey it is asked for again and again
def _window(model, freq, lmax):
    """b_l = int P(r) P_l(cos r) sin r dr over that of l = 0."""
    profile = stokes_i(model, freq, _RADIUS, _N_ANGLES)
    window = _legendre(lmax) @ (profile * np.sin(np.deg2rad(_RADIUS)))
    return np.maximum(window / window[0], _LEAST)


@lru_cache(maxsize=2)
def _legendre(lmax):
    """P_l(cos r) at all radii, (lmax + 1, n_radii)."""
    return special.eval_legendre(np.arange(lmax + 1)[:, None], np.cos(np.deg2rad(_RADIUS)))
