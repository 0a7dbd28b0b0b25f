"""Error bars from a parametric bootstrap of a cleaning.

A member is an estimated foreground plus a mock in place of the HI and noise of the data (Efron 1979;
`himap.removal.cleaning.Cleaning.resampled`). Cleaned like the data, it has the same signal loss, foreground
residual and chance correlation of HI with the foreground.
"""

import numpy as np
from scipy import stats

KINDS = "angular", "frequency"
"""Kinds of power spectra."""

LEVEL = 0.01
"""Significance level of tests for data unlike the mocks."""


def sigma(errors):
    """68 % error bars, (...), from errors of mocks, each corrected by the others, (n_mocks, ...).

    The root mean square times Student's factor, as a few draws underestimate the width of a Gaussian.
    """
    return _student(len(errors)) * np.sqrt(np.mean(np.square(errors), axis=0))


def chance_of(n_sigma, n_mocks):
    """Probability of a difference of `n_sigma` error bars or more, if these are the `sigma` of `n_mocks`."""
    return 2 * stats.t.sf(n_sigma * _student(n_mocks), n_mocks - 1)


def of_others(values):
    """The mean of the other mocks for each one, (n_mocks, ...); a single mock itself."""
    return (values.sum(axis=0) - values) / (len(values) - 1) if len(values) > 1 else values


def significance(difference, errors, *more):
    """Error bar of a difference and the probability of one at least as large, {"error", "chance"}.

    The bar is the `sigma` of errors of mocks, (n_mocks,), and `more` errors in quadrature. Both are NaN for a
    single mock.
    """
    error = np.linalg.norm([sigma(errors), *more])
    return {"error": error, "chance": chance_of(abs(difference) / error, len(errors))}


def squared_pull(n_mocks):
    """Expected mean of (error / `sigma` of `n_mocks`)^2 for correct error bars; infinite for three or fewer.

    A Gaussian variable over an estimate of its width: 1 for many mocks, more for few.
    """
    if n_mocks <= 3:
        return np.inf
    variance = (n_mocks + 1) / n_mocks  # data are corrected by all mocks; a mock (next line) by the others
    of_bars = n_mocks / (n_mocks - 1) * _student(n_mocks) ** 2
    return variance / of_bars * (n_mocks - 1) / (n_mocks - 3)


def covariance(errors):
    """Covariance (n, n) of errors of mocks, (n_mocks, n); its diagonal is `sigma` squared.

    Its rank is n_mocks at most, so it is invertible only for fewer bins than mocks.
    """
    return _student(len(errors)) ** 2 * np.transpose(errors) @ errors / len(errors)


def _student(n_mocks):
    return stats.t.ppf(stats.norm.cdf(1), n_mocks - 1)
