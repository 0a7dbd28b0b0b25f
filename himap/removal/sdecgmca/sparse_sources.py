"""Sparse sources: starlet coefficients below a threshold are noise, and are taken out."""

import numpy as np

from himap.maps import sphere
from himap.maps.starlets import starlet_bands, starlet_filters
from himap.removal.harmonic import degrees, from_modes, to_modes
from himap.removal.thresholds import NORMAL, share_threshold

__all__ = ["SparseSources"]


class SparseSources:
    """Soft thresholds on the starlet detail scales of sources given as real modes.

    The scales are made on a grid that is exact for the multipoles at hand, so that what is not
    thresholded comes back unchanged.

    Parameters
    ----------
    lmax, n_scales
        Largest multipole, and number of detail scales.
    n_sigma
        Lowest threshold, in units of the noise of a source in a scale.
    analytic
        Noise propagated from that of the sources; otherwise 1.48 times the median absolute coefficient.
    """

    def __init__(self, lmax, n_scales, *, n_sigma, analytic):
        self.n_sigma = n_sigma
        self.analytic = analytic
        self.filters = starlet_filters(n_scales, lmax)
        self.detail = 1 - self.filters[-1]
        self._bands = starlet_bands(n_scales, lmax)[:-1]
        self._modes = degrees(lmax)
        self._last = None

    def __call__(self, sources, noise, share, *, reweighted=False):
        """Detail scales of `sources` after soft thresholds, added up: real modes of the same shape.

        Parameters
        ----------
        sources
            Real modes, (n_sources, (lmax + 1)^2).
        noise
            Variance of the noise of each source per mode, (n_l, n_sources).
        share
            Of the coefficients above the noise, the largest `share` stay.
        reweighted
            Lower the threshold of a coefficient by 1 + |its last value| / noise (Candes et al. 2008),
            so that large ones, which are no noise, lose less.
        """
        lmax = len(self.filters[0]) - 1
        levels = np.sqrt((self.filters[:-1] ** 2 * (2 * np.arange(lmax + 1) + 1)) @ noise / (4 * np.pi))
        kept = np.empty_like(sources)
        memory = []
        for n, alm in enumerate(from_modes(sources)):
            scales = [sphere.synthesise_grid(alm[keep] * band, lmax) for keep, band in self._bands]
            for scale, level, last in zip(scales, levels[:, n], self._of_source(n, len(scales)), strict=True):
                self._shrink(scale, level, share, last if reweighted else None)
            memory.append(np.array(scales, dtype=np.float32))
            kept[n] = to_modes(sphere.analyse_grid(sum(scales), lmax))
        self._last = memory
        return kept

    def coarse(self, sources):
        """The smooth rest of `sources`, which has no threshold; real modes."""
        return sources * self.filters[-1, self._modes]

    def _of_source(self, n, n_scales):
        return [None] * n_scales if self._last is None else self._last[n]

    def _shrink(self, scale, level, share, last):
        """Soft threshold of one scale (n_grid,) in place."""
        sizes = np.abs(scale)
        if not self.analytic:
            level = NORMAL * np.median(sizes)
        limit = share_threshold(sizes, self.n_sigma * level, share)
        if last is not None and level > 0:
            limit = limit / (1 + np.abs(last) / level)
        scale -= np.clip(scale, -limit, limit)
