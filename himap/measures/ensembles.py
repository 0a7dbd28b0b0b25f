"""Statistics of ensembles, for methods of which one run is one draw."""

import numpy as np

from himap.core.errors import InputError

_BLOCK = 1000  # permutations at a time


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
    order = np.argsort(pooled, axis=0)
    last = np.diff(np.take_along_axis(pooled, order, axis=0), axis=0, append=np.inf) > 0  # of equal values
    steps = np.repeat([1 / len(one), -1 / len(two)], [len(one), len(two)])
    rng = np.random.default_rng(seed)

    def distances(labels):
        return np.max(np.abs(np.cumsum(labels[:, order], axis=1)) * last, axis=1)

    (found,) = distances(steps[None])
    count, count_mean = np.zeros(len(found)), 0
    for start in range(0, n_permutations, _BLOCK):
        several = np.tile(steps, (min(_BLOCK, n_permutations - start), 1))
        permuted = distances(rng.permuted(several, axis=1)) + 1e-9  # sums differ in their rounding
        count += np.sum(permuted >= found, axis=0)
        count_mean += np.sum(permuted.mean(axis=1) >= found.mean())
    return found, (1 + count) / (1 + n_permutations), float((1 + count_mean) / (1 + n_permutations))
