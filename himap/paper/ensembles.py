"""SDecGMCA as an ensemble: growth of a change of its start, its distribution, and how often it fails.

Tables are those of the experiments `authors` and `restarts`.
"""

import itertools

import numpy as np
import pandas as pd
from scipy.stats import permutation_test

from himap.core.errors import InputError
from himap.measures.diagnostics import FAILING
from himap.paper import cleaned
from himap.paper.claims.entries import wilson
from himap.paper.experiments.authors import first_mixings, growth, of_code, rows_of

_BLOCK = 1000  # permutations at a time
_ROUNDING = 1e-9  # relative rounding of sums in another order
_NO_K = {"share": 1.0, "n_warmup": 1}

VARIANTS = {
    "as in the code": {},
    "no $K$": _NO_K,
    "instrument's noise": {"thresholds": "analytic"},
    r"no $K$, instrument's noise, $\mathbf{A} \geq 0$": {
        "thresholds": "analytic",
        "sign": "nonnegative",
        **_NO_K,
    },
    "no $K$, instrument's noise": {"thresholds": "analytic", **_NO_K},
    "no thresholds": {"n_sigma": 0.0, **_NO_K},
}
"""{variant of the iteration: options of `SDecGMCA` in addition to the reading "code"}: without K all
coefficients above the noise are kept, from the first iteration."""

MEASURES = ("C/C0, 2 to 9", "C/C0, 10 to 64", "P/P0, k < 0.03", "P/P0, 0.03 to 0.1", "bump", "flagged")
"""Quantities of the last S that are compared between two ensembles."""

_RUN = ["reading", "case", "n_sources"]


def variant_growth(case, options, n_restarts, **common):
    """Angles and condition numbers of a variant on a `pipeline.Case`, rows as in the experiment `authors`.

    `options` are as in `VARIANTS`, and `common` those of all variants; the plain start, relative to which
    angles are measured, is one of the `n_restarts`.
    """
    plain, *others = (
        first_mixings(case, of_code(case.beam, restart=k, **common | options, tolerance=0.0))
        for k in range(n_restarts)
    )
    rows = (rows_of(k, growth(mixings, plain)) for k, mixings in enumerate(others, 1))
    return pd.DataFrame(itertools.chain(*rows))


def first_kept(case, options):
    """Share of the starlet coefficients of each source kept by the first thresholds of a variant."""
    method = of_code(case.beam, **options)
    mixture, scales, start = method.problem(cleaned.cleaning(case, method).basis)
    inverses = mixture.inverses(start, mixture.epsilon_of_matrices(start, method.regularisation))
    _, kept = scales.threshold(mixture, inverses, method.share / method.n_warmup)
    return np.mean(np.array(kept) != 0, axis=(1, 2))


def curves(rows, quantity):
    """Values of a quantity, a DataFrame with a row for each seed and restart and a column for each x."""
    chosen = rows[rows["quantity"] == quantity]
    member = [name for name in ("seed", "restart") if name in rows]  # runs of one sky may have no seed
    return chosen.pivot_table(index=member, columns="x", values="value")


def samples(rows, floor):
    """Values for one floor of the last S, and the last condition number of A, (n_members, n)."""
    columns = [curves(rows, name)[floor] for name in MEASURES]
    return np.column_stack([*columns, curves(rows, "condition").iloc[:, -1]])


def compare_samples(one, two, *, n_permutations=9999):
    """Two-sample Kolmogorov-Smirnov tests of several quantities of the same members, by permutation.

    All quantities of a member are permuted together, so the last p, of the mean distance, accounts for all
    quantities and any dependence between them. p is valid for any number of permutations, and at least 1 /
    (n_permutations + 1). Samples are (n_members, n_quantities); their n_members may differ. InputError for
    other shapes, or a value that is not finite.

    Returns
    -------
    distances, p, p_all
        The largest difference of the distribution functions of each quantity and its p, (n_quantities,); and
        the p of the mean of these distances.
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
        rng=np.random.default_rng(0),
    )
    means, mean = result.null_distribution.mean(axis=1), result.statistic.mean()
    p_all = (1 + np.sum(means >= mean * (1 - _ROUNDING))) / (1 + len(means))
    return result.statistic, result.pvalue, float(p_all)


def _largest_differences(one, two, axis=-1):
    """Largest difference of the distribution functions of two samples, (..., n_members) to (...)."""
    pooled = np.concatenate([one, two], axis=-1)
    order = np.argsort(pooled, axis=-1, kind="stable")
    ordered = np.take_along_axis(pooled, order, axis=-1)
    last = np.diff(ordered, axis=-1, append=np.inf) > 0  # the last of equal values
    steps = np.where(order < one.shape[-1], 1 / one.shape[-1], -1 / two.shape[-1])
    return np.max(np.abs(np.cumsum(steps, axis=-1)) * last, axis=-1)


def failures(rows):
    """Failure rates of SDecGMCA, a DataFrame with a row for each reading, case and number of sources.

    `rows` are from the experiment `restarts`. Further columns: "failed", "members", and "low" and "high", the
    two-sigma Wilson interval of the probability.
    """
    errors = rows[rows["quantity"] == "mean error"]
    runs = errors.assign(failed=~(errors["value"] <= FAILING)).groupby(_RUN, sort=False)
    table = runs["failed"].agg(failed="sum", members="size").reset_index()
    table[["low", "high"]] = [wilson(*pair, z=2) for pair in table[["failed", "members"]].to_numpy()]
    return table


def any_within(values, stored):
    """Whether any value is in the range of the stored ones, widened by half of it, in logarithms."""
    low, high = np.log([np.min(stored), np.max(stored)])
    return bool(np.any(np.abs(np.log(values) - (low + high) / 2) <= 0.75 * (high - low)))
