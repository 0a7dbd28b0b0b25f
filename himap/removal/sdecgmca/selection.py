"""Medians and thresholds of a scale, in one pass over its pixels each: half of the work of SDecGMCA.

A number is found by its rank through a histogram of the leading bits of all, and a search among the few that
share these: the same as numpy's partition, and quicker, since it passes over all of them only twice.
"""

import numpy as np
from numba import njit

_NORMAL = 1 / 0.6735  # standard deviation over median absolute deviation, to the digits of C21's code
_SMALLEST = 1e-20
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
def _median(values):
    n = len(values)
    upper = ranked(values, n // 2)
    return upper if n % 2 else 0.5 * (ranked(values, n // 2 - 1) + upper)


@njit(cache=True)
def deviation(scale):
    """Standard deviation of a scale (n_pix,) by the median absolute deviation from its median."""
    return _NORMAL * _median(np.abs(scale - _median(scale)))


@njit(cache=True)
def shrink(scale, cut, share, least_kept, last, reweighted):
    """Soft threshold of one scale (n_pix,) in place; a coefficient equal to the threshold stays.

    Parameters
    ----------
    scale
        Coefficients.
    cut
        k times the noise: a coefficient below is noise.
    share, least_kept
        Of the others the largest `share` stay, and at least `least_kept` of all; a share of 1 keeps them all.
    last, reweighted
        Coefficients of the last iteration, (n_pix,), which divide the threshold by 1 + |last| / cut; without
        `reweighted` they are not looked at.
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
