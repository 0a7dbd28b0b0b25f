"""Thresholds with the reweighting and the smooth scale of C21."""

import numpy as np

from himap.maps import sphere
from himap.removal import sparse_sources
from himap.removal.harmonic import degrees, from_modes, to_modes

__all__ = ["SparseSources"]


class SparseSources(sparse_sources.SparseSources):
    """`himap.removal.sparse_sources.SparseSources` that remembers the last coefficients."""

    def __init__(self, lmax, n_scales, *, n_sigma, analytic):
        super().__init__(lmax, n_scales, n_sigma=n_sigma, analytic=analytic)
        self.detail = 1 - self.filters[-1]
        self._modes = degrees(lmax)
        self._last = None

    def __call__(self, sources, noise, share, *, reweighted=False):
        """As of the base class; `reweighted` spares what was large.

        The threshold of a coefficient is lowered by 1 + |its last value| / noise (Candes et al. 2008), so
        that large ones, which are no noise, lose less.
        """
        levels = self._levels(noise)
        kept, memory = np.empty_like(sources), []
        for n, alm in enumerate(from_modes(sources)):
            scales = self._scales(alm)
            for place, (scale, level) in enumerate(zip(scales, levels[:, n], strict=True)):
                limit, level = self._limit(scale, level, share)
                if reweighted and self._last is not None and level > 0:
                    limit = limit / (1 + np.abs(self._last[n][place]) / level)
                scale -= np.clip(scale, -limit, limit)
            memory.append(np.array(scales, dtype=np.float32))
            kept[n] = to_modes(sphere.analyse_grid(sum(scales), self.lmax))
        self._last = memory
        return kept

    def coarse(self, sources):
        """The smooth rest of `sources`, which has no threshold; real modes."""
        return sources * self.filters[-1, self._modes]
