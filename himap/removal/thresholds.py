"""Medians and thresholds of sparse coefficients, which are half of the work of methods that use wavelets.

A number is found by its rank through a histogram of the leading bits of all, and a search among the few that
share these: the same as numpy's partition, and quicker, since it passes over all of them only twice.
"""

import math

import numpy as np
from numba import njit

NORMAL = 1.4826
"""Standard deviation of normal numbers over the median of their absolute values."""

_BITS = 48  # of 64 that are left out: what stays is the sign, the exponent and 4 bits of the fraction
_BINS = 1 << (64 - _BITS)
_SIGN = np.int64(-(2**63))


@njit(cache=True)
def ranked(values, rank):
    """The number of this rank, 0 for the smallest, among float64 `values` (n,)."""
    keys = values.view(np.int64)
    counts = np.zeros(_BINS, dtype=np.int64)
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
    """Leading bits of a float64, in the order of the numbers: negative ones run backwards."""
    ordered = ~key if key < 0 else key ^ _SIGN
    return (ordered >> _BITS) & (_BINS - 1)


@njit(cache=True)
def median(values):
    """The median of float64 `values` (n,)."""
    n = len(values)
    upper = ranked(values, n // 2)
    return upper if n % 2 else 0.5 * (ranked(values, n // 2 - 1) + upper)


@njit(cache=True)
def sparse(values, n_sigma, share, level=-1.0, soft=True):
    """Drop in place what is at or below a threshold among coefficients (n,) float64; returns the threshold.

    It is the one that keeps the largest `share` of those whose absolute value is above `n_sigma` times their
    noise, `level`, by default 1.48 times the median absolute value. The `soft` one is taken off the others.
    """
    sizes = np.abs(values)
    limit = n_sigma * level if level >= 0 else n_sigma * NORMAL * median(sizes)
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
