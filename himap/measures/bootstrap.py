"""Error bars from a parametric bootstrap of a cleaning.

A member is an estimated foreground, with a mock in place of the HI and noise of the data (Efron 1979;
`himap.removal.cleaning.Cleaning.resampled`). Cleaned like the data it has the signal loss, the foreground
residual, and the chance correlation of HI with the foreground.
"""

import numpy as np
from scipy import stats

KINDS = "angular", "frequency"
"""Of power spectra."""

LEVEL = 0.01
"""Of tests for data unlike the mocks."""


def sigma(errors):
    """68 % error bars, (...), from errors of mocks that are corrected by each other, (n_mocks, ...).

    Their root mean square times Student's factor: a Gaussian is wider than few of its draws suggest.
    """
    return _student(len(errors)) * np.sqrt(np.mean(np.square(errors), axis=0))


def chance_of(n_sigma, n_mocks):
    """The probability of a difference of so many error bars, or more, that are a `sigma` of `n_mocks`."""
    return 2 * stats.t.sf(n_sigma * _student(n_mocks), n_mocks - 1)


def squared_pull(n_mocks):
    """The mean of (error / `sigma` of `n_mocks`)^2 that true error bars have; infinite for three or fewer.

    A Gaussian over a Student: 1 for many, more for few.
    """
    if n_mocks <= 3:
        return np.inf
    variance = (n_mocks + 1) / n_mocks  # of data corrected by all mocks; the next of mocks, by the others
    of_bars = n_mocks / (n_mocks - 1) * _student(n_mocks) ** 2
    return variance / of_bars * (n_mocks - 1) / (n_mocks - 3)


def covariance(errors):
    """Covariance (n, n) of the errors of mocks, (n_mocks, n), whose diagonal is `sigma` squared.

    Its rank is n_mocks at most, so that it is invertible for fewer bins than mocks only.
    """
    return _student(len(errors)) ** 2 * np.transpose(errors) @ errors / len(errors)


def _student(n_mocks):
    return stats.t.ppf(stats.norm.cdf(1), n_mocks - 1)
