"""Channel maps seen through beams, multipole by multipole: X_l = diag(H_l) A S_l.

A field on the sphere is held as its real modes, (..., (lmax + 1)^2): for each l its 2 l + 1 numbers
side by side, m = 0 first, then sqrt(2) times the real and the imaginary parts. The modes of one l are
a slice, sums over m are plain dot products, and what depends on l alone is done once per l.
"""

from functools import lru_cache

import numpy as np

from himap.maps import sphere

_RANK = 1e-13  # singular values below this share of the largest are rounding


@lru_cache(maxsize=4)
def _order(lmax):
    """For every mode the index of its real number in the coefficients, and its factor; read-only."""
    n_alm = sphere.alm_size(lmax)
    index = np.empty((lmax + 1) ** 2, dtype=np.int64)
    for degree in range(lmax + 1):
        alm = sphere.alm_index(lmax, degree, np.arange(degree + 1))
        index[degree**2 : (degree + 1) ** 2] = np.concatenate([alm, alm[1:] + n_alm])
    factor = np.full(len(index), np.sqrt(2))
    factor[np.arange(lmax + 1) ** 2] = 1
    index.flags.writeable = factor.flags.writeable = False
    return index, factor


def degrees(lmax):
    """The degree l of every mode, ((lmax + 1)^2,)."""
    return np.repeat(np.arange(lmax + 1), 2 * np.arange(lmax + 1) + 1)


def to_modes(alms):
    """Real modes of healpy's coefficients, (..., n_alm) to (..., (lmax + 1)^2) float64."""
    alms = np.asarray(alms)
    index, factor = _order(sphere.lmax_of_size(alms.shape[-1]))
    return np.concatenate([alms.real, alms.imag], axis=-1, dtype=np.float64)[..., index] * factor


def from_modes(modes):
    """healpy's coefficients of real modes, the inverse of `to_modes`; complex128."""
    lmax = round(np.sqrt(modes.shape[-1])) - 1
    n_alm, (index, factor) = sphere.alm_size(lmax), _order(lmax)
    numbers = np.zeros((*modes.shape[:-1], 2 * n_alm))
    numbers[..., index] = modes * (1 / factor)
    return numbers[..., :n_alm] + 1j * numbers[..., n_alm:]


def blocks(modes):
    """The modes of each l in turn, views (..., 2 l + 1)."""
    lmax = round(np.sqrt(modes.shape[-1])) - 1
    return [modes[..., degree**2 : (degree + 1) ** 2] for degree in range(lmax + 1)]


def safe_inverse(matrices):
    """Least-squares inverses of tall matrices, through QR and never through the normal equations.

    Of W_l = diag(H_l) A, (n_l, n_channels, n_sources), to (n_l, n_sources, n_channels). Directions below
    rounding are dropped, so nothing is singular.
    """
    q, square = np.linalg.qr(matrices)
    return np.linalg.pinv(square, rcond=_RANK) @ np.swapaxes(q, -1, -2)
