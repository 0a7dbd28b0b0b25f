"""A linear filter of few spectra at every multipole: what it takes of maps, and what it leaves of HI."""

from dataclasses import dataclass

import numpy as np

from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.blocked import projection
from himap.maps.modes import MapModes
from himap.removal import harmonic
from himap.removal.covariance import common_axes


@dataclass(frozen=True, kw_only=True)
class SpectralFilter:
    """At every l the foreground is W_l G_l X_l of the data X_l.

    Attributes
    ----------
    spectra
        W_l, (n_l, n_channels, n_sources), with zeros where fewer spectra do.
    estimators
        G_l, (n_l, n_sources, n_channels).
    faint
        Covariance of HI and noise per mode that they were made with, mK^2, (n_bands, n_channels, n_channels).
    first
        First l of each band, (n_bands,).
    """

    spectra: np.ndarray
    estimators: np.ndarray
    faint: np.ndarray
    first: np.ndarray

    @property
    def lmax(self):
        """Last l of its own; what a transform cannot hold is filtered like this one."""
        return len(self.spectra) - 1

    def foreground(self, maps, modes):
        """The foreground of maps, a `MapModes`.

        Parameters
        ----------
        maps
            (n_channels, n_pix) float32, mK, RING.
        modes
            Their `CubeModes`.
        """
        return filtered(self.spectra, self.estimators, maps, modes)

    def faint_at(self, degree):
        """The covariance of HI and noise at one l, (n_channels, n_channels)."""
        return self.faint[np.searchsorted(self.first, degree, side="right") - 1]


def filtered(spectra, estimators, maps, modes):
    """W_l G_l X_l of maps at every l, a `MapModes`; what the transform cannot hold is filtered as the last l.

    Parameters
    ----------
    spectra, estimators
        W_l, (n_l, n_channels, n), and G_l, (n_l, n, n_channels). All W_l lie in a space of a few dozen
        spectra, so few maps are transformed back.
    maps
        (n_channels, n_pix) float32, mK, RING.
    modes
        Their `CubeModes`.
    """
    axes = common_axes(spectra)
    within = axes.T @ spectra
    foreground = within[-1] @ projection(estimators[-1], maps)
    more = np.empty((axes.shape[1], len(spectra) ** 2))
    for degree, out in enumerate(harmonic.blocks(more)):
        data = block_of(modes, degree)
        out[:] = within[degree] @ (estimators[degree] @ data) - within[-1] @ (estimators[-1] @ data)
    nside = sphere.nside_of(maps)
    for pixels, mode in zip(progress(foreground, "foreground"), more, strict=True):
        pixels += sphere.synthesise(harmonic.from_modes(mode), nside)
    return MapModes(spectra=axes, maps=foreground)


def block_of(modes, degree):
    """The modes of one l of a `CubeModes`, (n_channels, 2 l + 1) float64."""
    block = slice(degree**2, (degree + 1) ** 2)
    return modes.spectra @ modes.bright[:, block] + modes.rest[:, block]
