"""Compiled loops: medians and thresholds of sparse coefficients, and products without a copy.

Medians and thresholds are half of the work of methods that use wavelets. A number of given rank is found
from a histogram of the leading bits of all, and a search among the few that share these. The result is the
same as from numpy's partition, and faster, as all numbers are read only twice. Numbers must be finite.

All compiled functions that call each other are here: numba recompiles only when their own file changes.
"""

import math

import numpy as np
from numba import njit

NORMAL = 1.4826
"""Standard deviation of normal numbers over the median of their absolute values."""

_C21_NORMAL = 1 / 0.6735  # standard deviation over median absolute deviation, with the digits of C21's code
_SMALLEST = 1e-20
_BITS = 50  # of 64 that are dropped: the sign, the exponent and 2 bits of the fraction remain
_BINS = 1 << (64 - _BITS)
_SIGN = np.int64(-(2**63))


@njit(cache=True)
def ranked(values, rank):
    """The number of given rank, 0 for the smallest, among float64 `values` (n,)."""
    if values.itemsize != 8 or not 0 <= rank < len(values):
        raise ValueError("a rank is one among float64 numbers")
    keys = values.view(np.int64)
    counts = np.zeros(_BINS, dtype=np.int32)
    for key in keys:
        counts[_bin(key)] += 1
    at, below = 0, 0
    while below + counts[at] <= rank:
        below += counts[at]
        at += 1
    same = np.empty(counts[at])
    n = 0
    for i in range(len(keys)):
        if _bin(keys[i]) == at:
            same[n] = values[i]
            n += 1
    return np.partition(same, rank - below)[rank - below]


@njit(cache=True)
def _bin(key):
    """Leading bits of a float64, in the order of the numbers: the bits of negative ones are inverted."""
    ordered = ~key if key < 0 else key ^ _SIGN
    return (ordered >> _BITS) & (_BINS - 1)


@njit(cache=True)
def median(values):
    """The median of float64 `values` (n,)."""
    n = len(values)
    upper = ranked(values, n // 2)
    if n % 2:
        return upper
    n_below, before = 0, -np.inf  # the number before `upper`, unless that is equal to `upper`
    for value in values:  # array expressions would allocate memory of the size of `values`
        if value < upper:
            n_below += 1
            before = max(before, value)
    return 0.5 * (before + upper) if n_below == n // 2 else upper


@njit(cache=True)
def sparse(values, n_sigma, share, level=-1.0, soft=True):
    """Set coefficients (n,) float64 at or below a threshold to zero in place; return the threshold.

    It keeps the largest `share` of the coefficients whose absolute value is above `n_sigma` times their
    noise, `level`, by default 1.48 times the median absolute value. If `soft`, the kept ones shrink by it.
    """
    sizes = np.abs(values)
    limit = n_sigma * NORMAL * median(sizes) if level < 0 else n_sigma * level
    n_above = np.sum(sizes > limit)
    n_kept = math.ceil(share * n_above)
    if n_kept < n_above:
        limit = ranked(sizes, len(sizes) - n_kept - 1)
    for i, size in enumerate(sizes):
        if size <= limit:
            values[i] = 0
        elif soft:
            values[i] -= np.copysign(limit, values[i])
    return limit


@njit(cache=True)
def deviation(scale):
    """Standard deviation of a scale (n_pix,), from the median absolute deviation from its median."""
    return _C21_NORMAL * median(np.abs(scale - median(scale)))


@njit(cache=True)
def shrink(scale, cut, share, least_kept, last, reweighted):
    """Soft-threshold one scale (n_pix,) in place; a coefficient equal to the threshold stays unchanged.

    Coefficients below `cut`, k times the noise, are noise; of the others the largest `share` are kept, and at
    least `least_kept` of all. If `reweighted`, the threshold is divided by 1 + |last| / cut.
    """
    sizes = np.abs(scale)
    threshold = cut
    if share < 1:
        n_kept = max(int(share * np.sum(sizes > cut)), least_kept)
        threshold = ranked(sizes, len(sizes) - n_kept) if n_kept > 0 else np.inf
    for i in range(len(scale)):
        limit = threshold
        if reweighted:
            limit = threshold / (1 + abs(last[i]) / max(cut, _SMALLEST))
        if sizes[i] < limit:
            scale[i] = 0
        elif sizes[i] > limit:
            scale[i] -= np.copysign(limit, scale[i])


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
