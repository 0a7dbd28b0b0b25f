"""Thresholds on the starlet scales of the sources (paper, Sect. 3.3, iii; C21, Sect. 3)."""

import numpy as np

from himap.maps import sphere
from himap.maps.starlets import cubic_b_spline, noise_of_scales, starlet_low_passes
from himap.removal import harmonic
from himap.removal.sdecgmca.selection import deviation, shrink


def low_passes(n_scales, lmax, kind):
    """Low passes of the starlet scales, fine to coarse, (n_scales, lmax + 1).

    "cascade" are those of the starlet transform, phi_j(l) = (3/2) b(2^(j + 1) l / lmax) for j = 1, 2, ...
    with b the cubic B-spline. "ratio" are phi_j / phi_(j - 1), which the transform applies to the last smooth
    map and C21's code to the map itself, so that its scales are wider.
    """
    if kind == "cascade":
        return starlet_low_passes(n_scales, lmax)
    degrees = np.arange(lmax + 1)
    filters = np.empty((n_scales, lmax + 1))
    for scale, low_pass in zip(2 ** np.arange(n_scales), filters, strict=True):
        smooth, last = (1.5 * cubic_b_spline(factor * scale * degrees / lmax) for factor in (4, 2))
        low_pass[:] = smooth / (last + 1e-6)
        low_pass[lmax // (2 * scale) :] = 0
    return filters


class Scales:
    """Soft thresholds on the detail scales of sources given as real modes.

    Parameters
    ----------
    lmax, n_scales
        Largest multipole, and number of detail scales.
    pixels
        A `Grid` or `HEALPix`.
    wavelets
        As `low_passes` has it.
    n_sigma
        k: a coefficient below k times the noise of its scale is noise.
    least_kept
        Of the others a share is kept, but at least so many.
    analytic
        Whether the noise is that of the instrument; else the median absolute deviation of the scale.
    """

    def __init__(self, lmax, n_scales, *, pixels, wavelets, n_sigma, least_kept, analytic):
        self.pixels, self.n_sigma, self.least_kept, self.analytic = pixels, n_sigma, least_kept, analytic
        self.low_passes = low_passes(n_scales, lmax, wavelets)
        self.detail = 1 - self.low_passes[-1]
        self.bands = -np.diff(np.vstack([np.ones(lmax + 1), self.low_passes]), axis=0)
        degree = sphere.alm_degree(lmax)
        self._kept = [degree <= np.flatnonzero(low_pass).max(initial=0) for low_pass in self.low_passes]
        self._filters = [
            low_pass[degree[kept]] for low_pass, kept in zip(self.low_passes, self._kept, strict=True)
        ]

    def __call__(self, sources, noise, share, memory=None):
        """Sources after the thresholds, with their smooth scale, and what is remembered of them.

        Parameters
        ----------
        sources
            Real modes, (n_sources, (lmax + 1)^2).
        noise
            Variance of the noise of each source per mode, (n_l, n_sources); None without `analytic`.
        share
            Of the coefficients above the noise, the largest `share` stay; 1 keeps them all.
        memory
            Thresholded coefficients of the last iteration, (n_sources, n_scales, n_pix): the threshold of a
            coefficient is divided by 1 + |its last value| / (k noise) (Candes et al. 2008), so that large
            ones lose less. None for plain thresholds; zeros at the start.

        Returns
        -------
        sources, memory
            In the shapes of those given; the memory is None without one.
        """
        kept = np.empty_like(sources)
        remembered = None if memory is None else np.empty_like(memory)
        levels = noise_of_scales(self.bands, noise).T if self.analytic else [None] * len(sources)
        for n, (alm, level) in enumerate(zip(harmonic.from_modes(sources), levels, strict=True)):
            last = None if memory is None else memory[n]
            scales, smooth = self._thresholded(alm, level, share, last)
            kept[n] = self.pixels.analyse(scales.sum(axis=0) + smooth)
            if remembered is not None:
                remembered[n] = scales
        return kept, remembered

    def empty_memory(self, n_sources):
        """A memory of nothing, (n_sources, n_scales, n_pix)."""
        n_pix = len(self.pixels.synthesise(np.zeros(1)))
        return np.zeros((n_sources, len(self.low_passes), n_pix))

    def _thresholded(self, alm, level, share, last):
        """Detail scales of one source after the thresholds, (n_scales, n_pix), and the smooth rest."""
        scales = []
        finer = self.pixels.synthesise(alm)
        for j, (kept, low_pass) in enumerate(zip(self._kept, self._filters, strict=True)):
            smooth = self.pixels.synthesise(alm[kept] * low_pass)
            scale = finer - smooth
            cut = self.n_sigma * (deviation(scale) if level is None else level[j])
            shrink(scale, cut, share, self.least_kept, smooth if last is None else last[j], last is not None)
            scales.append(scale)
            finer = smooth
        return np.array(scales), finer
