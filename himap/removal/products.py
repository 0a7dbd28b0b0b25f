"""Products of float32 with float64 arrays that an iteration does again and again, without a copy."""

from numba import njit


# Sums in any order, as in BLAS: their last bits depend on the processor, but not on the number of threads.
@njit(cache=True, fastmath={"reassoc", "contract"})
def add_products(rows, others, out):
    """Add ``rows @ others.T`` of (n, m) float32 and a few others, (k, m): BLAS would copy the rows first."""
    for i in range(rows.shape[0]):
        row = rows[i]
        for j in range(others.shape[0]):
            other, total = others[j], 0.0
            for k in range(row.size):
                total += row[k] * other[k]
            out[i, j] += total
