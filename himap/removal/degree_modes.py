"""The modes of one multipole, for products that an iteration does again and again."""

from dataclasses import dataclass

import numpy as np
from numba import njit


@dataclass(frozen=True, kw_only=True)
class DegreeModes:
    """The modes X_l of all channels at one l, mK, ``spectra @ bright + rest`` as in `CubeModes`.

    They know two products, ``rows @ modes`` and ``modes @ columns``, in float64 without the sum in memory;
    `numpy.asarray` makes the sum, (n_channels, 2 l + 1) float64.

    Attributes
    ----------
    spectra, bright, rest
        (n_channels, n_bright) and (n_bright, 2 l + 1), float64; (n_channels, 2 l + 1), float32, contiguous.
    """

    __array_ufunc__ = None  # so that numpy leaves products to this class

    spectra: np.ndarray
    bright: np.ndarray
    rest: np.ndarray

    def __rmatmul__(self, rows):
        return (rows @ self.spectra) @ self.bright + rows @ self.rest.astype(np.float64)

    def __matmul__(self, columns):
        product = self.spectra @ (self.bright @ columns)
        _add_products(self.rest, np.ascontiguousarray(columns.T, dtype=np.float64), product)
        return product

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.spectra @ self.bright + self.rest, dtype=dtype)


# Sums in any order, as in BLAS: their last bits depend on the processor, but not on the number of threads.
@njit(cache=True, fastmath={"reassoc", "contract"})
def _add_products(rows, others, out):
    """Add ``rows @ others.T`` of (n, m) float32 and a few others, (k, m): BLAS would copy the rows first."""
    for i in range(rows.shape[0]):
        row = rows[i]
        for j in range(others.shape[0]):
            other, total = others[j], 0.0
            for k in range(row.size):
                total += row[k] * other[k]
            out[i, j] += total
