"""Statistics of ensembles, for methods of which one run is one draw."""

import numpy as np
from scipy.stats import permutation_test

from himap.core.errors import InputError

_BLOCK = 1000  # permutations at a time
_ROUNDING = 1e-9  # relative, of sums in another order


def compare_samples(one, two, *, n_permutations=9999, seed=0):
    """Two-sample Kolmogorov-Smirnov tests of several quantities of the same members, by permutations.

    All quantities of a member are permuted together, so that the last p, of the mean distance, allows for
    every quantity, however they depend on each other. p is valid for any number of permutations, and at least
    1 / (n_permutations + 1).

    Parameters
    ----------
    one, two
        (n_members, n_quantities); numbers of members may differ.
    n_permutations, seed
        How many permutations, and their seed.

    Returns
    -------
    distances, p, p_all
        The largest difference of the distribution functions of each quantity and its p, (n_quantities,); and
        the p of the mean of these distances.

    Raises
    ------
    InputError
        Other shapes, or a value that is not finite.
    """
    one, two = np.asarray(one, dtype=float), np.asarray(two, dtype=float)
    if one.ndim != 2 or two.ndim != 2 or one.shape[1] != two.shape[1] or not min(len(one), len(two)):
        raise InputError(f"expected (n_members, n_quantities) twice, got {one.shape} and {two.shape}.")
    pooled = np.concatenate([one, two])
    if not np.isfinite(pooled).all():
        raise InputError("every value must be finite; leave out quantities that some members do not have.")
    result = permutation_test(
        (one.T, two.T),
        _largest_differences,
        vectorized=True,
        axis=-1,
        n_resamples=n_permutations,
        batch=_BLOCK,
        alternative="greater",
        rng=np.random.default_rng(seed),
    )
    means, found = result.null_distribution.mean(axis=1), result.statistic.mean()
    p_all = (1 + np.sum(means >= found * (1 - _ROUNDING))) / (1 + len(means))
    return result.statistic, result.pvalue, float(p_all)


def _largest_differences(one, two, axis=-1):
    """Of the distribution functions of two samples, the largest difference, (..., n_members) to (...)."""
    pooled = np.concatenate([one, two], axis=-1)
    order = np.argsort(pooled, axis=-1, kind="stable")
    ordered = np.take_along_axis(pooled, order, axis=-1)
    last = np.diff(ordered, axis=-1, append=np.inf) > 0  # of equal values
    steps = np.where(order < one.shape[-1], 1 / one.shape[-1], -1 / two.shape[-1])
    return np.max(np.abs(np.cumsum(steps, axis=-1)) * last, axis=-1)
