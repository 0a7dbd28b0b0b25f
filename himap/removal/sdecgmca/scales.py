"""Thresholds on the starlet scales of the sources (paper, Sect. 3.3, iii; C21, Sect. 3)."""

import numpy as np

from himap.maps import sphere
from himap.maps.starlets import bands_of, cubic_b_spline, noise_of_scales, starlet_low_passes
from himap.removal import harmonic
from himap.removal.compiled import deviation, shrink

_N_ITER = 3  # refinements of the quadrature in C21's code


class Scales:
    """Soft thresholds on the detail scales of sources represented as real modes.

    Parameters
    ----------
    method
        The `SDecGMCA`, whose parameters define the scales, their noise and their pixels. "grid" means
        rings of nearly equal areas with an exact quadrature; the quadrature of "healpix" is refined as in
        healpy's map2alm, which C21's code uses.
    lmax, nside
        Largest multipole, and resolution of the HEALPix pixels.
    """

    def __init__(self, method, lmax, nside):
        self.lmax, self.nside = lmax, nside if method.pixels == "healpix" else None
        self.n_sigma, self.least_kept = method.n_sigma, method.least_kept
        self.analytic = method.thresholds == "analytic"
        self.low_passes = low_passes(method.n_scales, lmax, method.wavelets)
        self.detail = 1 - self.low_passes[-1]
        self.bands = -np.diff(np.vstack([np.ones(lmax + 1), self.low_passes]), axis=0)
        self._filters = bands_of(self.low_passes)

    def threshold(self, mixture, inverses, share, memory=None):
        """Sources after the thresholds, smooth scale included, and their coefficients.

        The input sources are those that `inverses`, P_l, give for a `BlurredMixture`. Returns real modes,
        (n_sources, (lmax + 1)^2), and for each source an array (n_scales, n_pix). Of the coefficients above
        the noise the largest `share` are kept; 1 keeps all. With a `memory`, the coefficients of the last
        iteration, a threshold is divided by 1 + |last value| / (k noise) (Candes et al. 2008), so large
        ones lose less.
        """
        sources, coefficients = [], []
        for n, (*scales, smooth, cuts) in enumerate(self._with_cuts(mixture, inverses)):
            for j, (scale, cut) in enumerate(zip(scales, cuts, strict=True)):
                last = scale if memory is None else memory[n][j]
                shrink(scale, cut, share, self.least_kept, last, memory is not None)
            coefficients.append(np.array(scales))
            field = coefficients[-1].sum(axis=0) + smooth
            if self.nside is None:
                after = sphere.analyse_grid(field, self.lmax)
            else:
                after = sphere.analyse(field, self.lmax, n_iter=_N_ITER)
            sources.append(harmonic.to_modes(after))
        return np.array(sources), coefficients

    def penalty(self, mixture, inverses, kept):
        """Sum of |coefficients| of thresholded sources times their lowest thresholds, mK^2.

        `kept` are these sources, real modes; the thresholds are those of the sources that `inverses` give.
        """
        total = 0.0
        pairs = zip(self._with_cuts(mixture, inverses), harmonic.from_modes(kept), strict=True)
        for (*_, cuts), alm in pairs:
            for scale, cut in zip(self._decompose(alm), cuts, strict=False):
                total += cut * np.abs(scale).mean()
        return 4 * np.pi * total

    def _with_cuts(self, mixture, inverses):
        """For each source, its detail scales, smooth scale, and k times the noise of each detail scale."""
        known = noise_of_scales(self.bands, mixture.source_noise(inverses)).T if self.analytic else None
        for n, alm in enumerate(harmonic.from_modes(mixture.sources(inverses))):
            scales = list(self._decompose(alm))
            noise = map(deviation, scales[:-1]) if known is None else known[n]
            yield *scales, [self.n_sigma * level for level in noise]

    def _decompose(self, alm):
        """Detail scales of a source, fine to coarse, and its smooth scale, each (n_pix,)."""
        finer = self._synthesise(alm)
        for band, low_pass in self._filters:
            smooth = self._synthesise(alm[band] * low_pass)
            yield finer - smooth
            finer = smooth
        yield finer

    def _synthesise(self, alm):
        if self.nside is None:
            return sphere.synthesise_grid(alm, self.lmax)
        return sphere.synthesise(alm, self.nside)


def low_passes(n_scales, lmax, kind):
    """Low passes of the starlet scales, fine to coarse, (n_scales, lmax + 1).

    "cascade": those of the starlet transform, phi_j(l) = (3/2) b(2^(j + 1) l / lmax) for j = 1, 2, ...
    with b the cubic B-spline. "ratio": phi_j / phi_(j - 1), which the transform applies to the last smooth
    map, but C21's code to the map itself, so its scales are wider.
    """
    passes, degrees = starlet_low_passes(n_scales, lmax), np.arange(lmax + 1)
    if kind == "cascade":
        return passes
    before = np.vstack([1.5 * cubic_b_spline(2 * degrees / lmax), passes[:-1]])
    ends = lmax // 2 ** np.arange(1, n_scales + 1)[:, None]
    return np.where(degrees < ends, passes / (before + 1e-6), 0)
