"""Sparse sources: starlet coefficients below a threshold are noise, and are removed."""

import numpy as np

from himap.maps import sphere
from himap.maps.starlets import noise_of_scales, starlet_bands, starlet_filters
from himap.removal.harmonic import from_modes, to_modes

NORMAL = 1.4826
"""Standard deviation of normal numbers over the median of their absolute values."""


class SparseSources:
    """Soft thresholds on the starlet detail scales of sources given as real modes.

    The scales are made on a grid that is exact for the multipoles to `lmax`, so that what is not thresholded
    comes back unchanged. The lowest threshold is `n_sigma` times the noise of a source in a scale: propagated
    from that of the source where `analytic`, otherwise 1.48 times the median absolute coefficient. For a part
    of the sky there are `weights` of the grid, 0 to 1, (n_grid,): coefficients are multiplied by them, and
    medians are of those above zero.
    """

    def __init__(self, lmax, n_scales, *, n_sigma, analytic, weights=None):
        self.lmax = lmax
        self.n_sigma = n_sigma
        self.analytic = analytic
        self.weights = weights
        self.filters = starlet_filters(n_scales, lmax)
        self._bands = starlet_bands(n_scales, lmax)[:-1]

    def __call__(self, sources, noise, share):
        """Detail scales of `sources`, real modes (n_sources, (lmax + 1)^2), after soft thresholds, added up.

        `noise` is its variance in each source per mode, (n_l, n_sources). Of the coefficients above the
        noise, the largest `share` stay.
        """
        levels = noise_of_scales(self.filters[:-1], noise)
        kept = np.empty_like(sources)
        for alm, level_of_scale, out in zip(from_modes(sources), levels.T, kept, strict=True):
            scales = [sphere.synthesise_grid(alm[keep] * band, self.lmax) for keep, band in self._bands]
            for scale, level in zip(scales, level_of_scale, strict=True):
                if self.weights is not None:
                    scale *= self.weights
                sizes = np.abs(scale)
                if not self.analytic:
                    level = NORMAL * np.median(sizes if self.weights is None else sizes[self.weights > 0])
                limit = share_threshold(sizes, self.n_sigma * level, share)
                scale -= np.clip(scale, -limit, limit)
            out[:] = to_modes(sphere.analyse_grid(sum(scales), self.lmax))
        return kept


def share_threshold(sizes, floor, share):
    """Threshold that keeps the largest `share` (0 to 1) of the absolute values `sizes` above `floor`."""
    above = sizes[sizes > floor]
    n_dropped = len(above) - int(np.ceil(share * len(above)))
    return np.partition(above, n_dropped - 1)[n_dropped - 1] if n_dropped else floor
