"""Cubes that are a few spectra times maps: to be added, taken away and measured without being made."""

from dataclasses import dataclass

import numpy as np

from himap.maps.blocked import blocks, mixture


@dataclass(frozen=True, kw_only=True)
class HarmonicModes:
    """A cube as `spectra` (n_channels, n_modes) @ maps with coefficients `alms` (n_modes, n_alm), mK."""

    spectra: np.ndarray
    alms: np.ndarray


@dataclass(frozen=True, kw_only=True)
class MapModes:
    """A cube as `spectra` (n_channels, n_modes) @ `maps` (n_modes, n_pix), mK, both float64.

    A foreground is 1e5 times brighter than HI, so that its difference from another one needs more digits than
    a float32 cube has; these have them.
    """

    spectra: np.ndarray
    maps: np.ndarray

    def __add__(self, other):
        return MapModes(
            spectra=np.hstack([self.spectra, other.spectra]), maps=np.concatenate([self.maps, other.maps])
        )

    def __neg__(self):
        return MapModes(spectra=-self.spectra, maps=self.maps)

    def lines(self, pixels):
        """The lines of sight of some pixels (a slice, numbers or a mask), (n_channels, n) float64."""
        return self.spectra @ self.maps[:, pixels]

    def of_channels(self, channels):
        """The same of some channels, a slice."""
        return MapModes(spectra=self.spectra[channels], maps=self.maps)

    def cube(self):
        """(n_channels, n_pix) float32."""
        return mixture(self.spectra, self.maps)

    def subtract_from(self, cube, means=None):
        """`cube` (n_channels, n_pix) less this and less one number per channel, float32."""
        left = np.empty(cube.shape, dtype=np.float32)
        means = 0 if means is None else means[:, None]
        for block in blocks(cube.shape[1]):
            left[:, block] = cube[:, block] - self.lines(block) - means
        return left

    def truncate(self, faint):
        """The same less its channel means, in as few orthonormal spectra as it needs.

        Parameters
        ----------
        faint
            Variance, mK^2, summed over channels, of terms that are left out.
        """
        axes, triangle = np.linalg.qr(self.spectra)
        maps = triangle @ (self.maps - self.maps.mean(axis=1, keepdims=True))
        values, turn = np.linalg.eigh(maps @ maps.T / maps.shape[1])
        turn = turn[:, values > faint][:, ::-1]
        return MapModes(spectra=axes @ turn, maps=turn.T @ maps)
