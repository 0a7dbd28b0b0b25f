"""Parametric bootstrap of a cleaning: error bars, and a test for foreground residual, from known skies.

A member is the estimated foreground of a cleaning, with a mock in place of the HI and noise of the data
(Efron 1979; `himap.removal.cleaning.Cleaning.resampled`). Cleaned like the data it has the signal loss, the
foreground residual, and the chance correlation of HI with the foreground.
"""

from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from scipy import stats

from himap.measures.transfer import TransferFunction, quotient

KINDS = "angular", "frequency"
"""Of power spectra."""

LEVEL = 0.01
"""Of the test for foreground residual (`Bootstrap.explains`), and of that for data unlike the mocks."""


@dataclass(frozen=True, kw_only=True)
class Bootstrap:
    """Members with the estimated foreground, cleaned like the data and with one source more.

    Attributes
    ----------
    own, more
        The `TransferFunction` with the number of sources of the estimated foreground, and with one more; the
        same of a method without such a number.
    """

    own: TransferFunction
    more: TransferFunction

    def explains(self, residual, residual_more):
        """Whether the estimated foreground is complete, by the next source of the data.

        The power that one source more removes from the data, in bands, is compared with what it removes from
        the members, where it is HI. There is foreground residual if it is more by more than an error bar, and
        at `LEVEL`, by Student's distribution and Bonferroni's correction for many bands; or the data have HI
        that is smoother in frequency than that of the members.

        Parameters
        ----------
        residual, residual_more
            `HarmonicPower` of the residual of the data, with and without one source more.
        """
        n_mocks = len(self.own.mocks)
        if self.more is self.own or n_mocks < 2:
            return True
        pairs = [(one.output, more.output) for one, more in zip(self.own.mocks, self.more.mocks, strict=True)]
        pairs.append((residual, residual_more))
        total, removed = reduce(add, self.own.mocks).input, {}
        for kind in KINDS:
            rows = np.array([getattr(one, kind) - getattr(more, kind) for one, more in pairs])
            removed[kind] = quotient(rows, np.broadcast_to(getattr(total, kind) / n_mocks, rows.shape))
        removed = self.own.mocks[0].band_means(removed)
        errors = self.own.mocks[0].band_means({kind: self.own.errors(kind) for kind in KINDS})
        for band, (*members, data) in removed.items():
            excess = data - np.mean(members)
            scatter = np.std(members, ddof=1) * np.sqrt(1 + 1 / n_mocks)
            chance = stats.t.sf(excess / max(scatter, np.finfo(float).tiny), n_mocks - 1)
            if excess > sigma(errors[band]) and chance * len(removed) < LEVEL:
                return False
        return True


def bootstrap_of(members):
    """The `Bootstrap` of members, each (`MockPower`,) or (`MockPower`, the same with one source more).

    Raises
    ------
    InputError
        No member.
    """
    own = TransferFunction(mocks=tuple(first for first, *_ in members))
    more = own if len(members[0]) == 1 else TransferFunction(mocks=tuple(second for _, second in members))
    return Bootstrap(own=own, more=more)


def sigma(errors):
    """68 % error bars, (...), from errors of mocks that are corrected by each other, (n_mocks, ...).

    Their root mean square times Student's factor: a Gaussian is wider than few of its draws suggest.
    """
    return _student(len(errors)) * np.sqrt(np.mean(np.square(errors), axis=0))


def chance_of(n_sigma, n_mocks):
    """The probability of a difference of so many error bars, or more, that are a `sigma` of `n_mocks`."""
    return 2 * stats.t.sf(n_sigma * _student(n_mocks), n_mocks - 1)


def covariance(errors):
    """Covariance (n, n) of the errors of mocks, (n_mocks, n), whose diagonal is `sigma` squared.

    Its rank is n_mocks at most, so that it is invertible for fewer bins than mocks only.
    """
    return _student(len(errors)) ** 2 * np.transpose(errors) @ errors / len(errors)


def _student(n_mocks):
    return stats.t.ppf(stats.norm.cdf(1), n_mocks - 1)
