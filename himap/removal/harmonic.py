"""Channel maps seen through beams, multipole by multipole: X_l = diag(H_l) A S_l.

A field on the sphere is stored as its real modes, (..., (lmax + 1)^2): for each l its 2 l + 1 numbers
in sequence, m = 0 first, then sqrt(2) times the real and the imaginary parts. The modes of one l are
a slice, sums over m are plain dot products, and work that depends on l only is done once per l.
"""

from functools import lru_cache

import numpy as np

from himap.maps import sphere

_RANK = 1e-13  # singular values below this share of the largest are rounding errors


@lru_cache(maxsize=4)
def _order(lmax):
    """For every mode the index of its number in coefficients viewed as floats, and its factor; read-only."""
    index = np.empty((lmax + 1) ** 2, dtype=np.int64)
    for degree in range(lmax + 1):
        real = 2 * sphere.alm_index(lmax, degree, np.arange(degree + 1))
        index[degree**2 : (degree + 1) ** 2] = np.concatenate([real, real[1:] + 1])
    factor = np.full(len(index), np.sqrt(2))
    factor[np.arange(lmax + 1) ** 2] = 1
    index.flags.writeable = factor.flags.writeable = False
    return index, factor


def degrees(lmax):
    """The degree l of every mode, ((lmax + 1)^2,)."""
    return np.repeat(np.arange(lmax + 1), 2 * np.arange(lmax + 1) + 1)


def to_modes(alms, first=0, last=None):
    """Convert healpy's coefficients to real modes, (..., n_alm) to (..., (lmax + 1)^2) float64.

    With `first` and `last`, only those of l from `first` to `last`, both included.
    """
    alms, block = np.asarray(alms), slice(first**2, None if last is None else (last + 1) ** 2)
    index, factor = _order(sphere.lmax_of_size(alms.shape[-1]))
    numbers = np.ascontiguousarray(alms).view(alms.real.dtype)
    return numbers[..., index[block]] * factor[block]


def from_modes(modes):
    """Convert real modes to healpy's coefficients, complex128; the inverse of `to_modes`."""
    lmax = round(np.sqrt(modes.shape[-1])) - 1
    index, factor = _order(lmax)
    numbers = np.zeros((*modes.shape[:-1], 2 * sphere.alm_size(lmax)))
    numbers[..., index] = modes * (1 / factor)
    return numbers.view(np.complex128)


def synthesise(modes, nside):
    """Maps of real modes, (..., (lmax + 1)^2) to (..., n_pix) float64."""
    return sphere.synthesise(from_modes(modes), nside)


def blocks(modes):
    """Yield the modes of each l in turn, views (..., 2 l + 1)."""
    lmax = round(np.sqrt(modes.shape[-1])) - 1
    return [modes[..., degree**2 : (degree + 1) ** 2] for degree in range(lmax + 1)]


def safe_inverse(matrices):
    """Least-squares inverses of tall matrices, by QR instead of the normal equations.

    The matrices are W_l = diag(H_l) A, (n_l, n_channels, n_sources), the inverses (n_l, n_sources,
    n_channels). Directions below rounding are dropped, so none is singular.
    """
    q, square = np.linalg.qr(matrices)
    return np.linalg.pinv(square, rcond=_RANK) @ np.swapaxes(q, -1, -2)
