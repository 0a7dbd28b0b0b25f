"""The pixels that thresholds work on: a grid without quadrature errors, or HEALPix as in C21's code."""

import numpy as np

from himap.maps import sphere
from himap.removal import harmonic

_N_ITER = 3  # refinements of the quadrature in C21's code


class Grid:
    """Rings of nearly equal areas with an exact quadrature, as few as hold `lmax`."""

    def __init__(self, lmax, nside):
        self.lmax = lmax

    def synthesise(self, alm):
        """Field of coefficients of any smaller lmax, (n_alm,) to (n_pix,)."""
        return sphere.synthesise_grid(alm, self.lmax)

    def analyse(self, field):
        """Real modes of a field, (n_pix,) to ((lmax + 1)^2,)."""
        return harmonic.to_modes(sphere.analyse_grid(field, self.lmax))


class HEALPix:
    """Pixels of the maps; their quadrature is refined as in healpy's map2alm."""

    def __init__(self, lmax, nside):
        self.lmax, self.nside = lmax, nside

    def synthesise(self, alm):
        """As `Grid.synthesise`."""
        return sphere.synthesise(np.asarray(alm, dtype=complex), self.nside)

    def analyse(self, field):
        """As `Grid.analyse`."""
        return harmonic.to_modes(sphere.analyse(field, self.lmax, n_iter=_N_ITER))
