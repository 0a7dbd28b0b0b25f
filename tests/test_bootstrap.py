"""The bootstrap of a cleaning: against closed forms of linear methods, and draws whose coverage is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from himap.maps import sphere
from himap.measures.bootstrap import chance_of, covariance, sigma, squared_pull
from himap.measures.transfer import TransferFunction, harmonic_power, mock_power
from himap.removal import PCA
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data

NSIDE, FREQS, WIDTH = 16, np.linspace(900, 1000, 20, endpoint=False), 5.0


@pytest.mark.parametrize("n_mocks", [3, 8, 50])
def test_error_bars_of_few_draws_cover_68_percent_and_squared_pulls_are_as_expected(rng, n_mocks):
    """Gaussian biases of some mocks, each corrected by the mean of the others, and data by that of all."""
    data, mocks = np.split(rng.standard_normal((n_mocks + 1, 40_000)), [1])
    errors = mocks - (mocks.sum(axis=0) - mocks) / (n_mocks - 1)
    pulls = (data - mocks.mean(axis=0)) / sigma(errors)
    assert 0.67 < np.mean(np.abs(pulls) < 1) < 0.683 + 0.06 / (n_mocks - 1)
    expected = squared_pull(n_mocks)
    assert expected == np.inf if n_mocks == 3 else np.mean(pulls**2) == pytest.approx(expected, rel=0.05)


def test_a_covariance_is_that_of_what_was_drawn(rng):
    """Its diagonal is error bars squared, also of means; its expectation is the true one times Student's."""
    true = np.array([[4.0, -1.0, 0.0], [-1.0, 1.0, 0.5], [0.0, 0.5, 2.0]])
    found = [covariance(rng.multivariate_normal(np.zeros(3), true, size=6)) for _ in range(20_000)]
    factor = stats.t.ppf(stats.norm.cdf(1), 5) ** 2
    assert np.mean(found, axis=0) == pytest.approx(factor * true, abs=0.1)
    errors = rng.multivariate_normal(np.zeros(3), true, size=6)
    weights = np.array([[0.2, 0.3, 0.5], [1.0, 0.0, 0.0]])
    expected = weights @ covariance(errors) @ weights.T
    assert covariance(errors @ weights.T) == pytest.approx(expected)
    assert sigma(errors @ weights.T) == pytest.approx(np.sqrt(np.diag(expected)))


def white(rng):
    """Noise of 1 mK in pixels and channels, less its means."""
    maps = rng.standard_normal((len(FREQS), 12 * NSIDE**2))
    maps -= maps.mean(axis=1, keepdims=True)
    return maps.astype(np.float32)


def foreground(rng, n=3, brightness=(1e4, 1e3, 1e2)):
    """Of known rank and smooth spectra, each with a Gaussian map."""
    spectra = np.linalg.qr(FREQS[:, None] ** -np.arange(1.0, n + 1))[0] * np.sqrt(len(FREQS))
    return spectra @ (np.array(brightness)[:n, None] * rng.standard_normal((n, 12 * NSIDE**2)))


def members(cleaned, mocks, separation=None):
    """The `TransferFunction` of members of a bootstrap, with the foreground of a `Separation`."""
    separation = cleaned.separation if separation is None else separation
    powers = (powers_of(separation, cleaned.resampled(mock, separation), mock) for mock in mocks)
    return TransferFunction(mocks=tuple(powers))


def powers_of(before, member, mock):
    wrong = (before.foreground + -member.separation.foreground).truncate(0)
    return mock_power(sphere.analyse(mock), wrong, WIDTH)


def power_of(cleaned):
    return harmonic_power(sphere.analyse(cleaned.residual), WIDTH)


class TestClosedForms:
    """PCA with as many components as a bright foreground has is a projection whose axes are known."""

    @pytest.fixture
    def cleaned(self, rng):
        maps = (foreground(rng) + white(rng)).astype(np.float32)
        return Cleaning.of(Data.of(maps, freqs=FREQS), PCA(n_sources=3), peaks=False)

    def test_the_loss_is_that_of_the_projection(self, cleaned, rng):
        """Of white noise n_s of n channels, in C_l; in P(k) the share of the axes at that k."""
        found = members(cleaned, [white(rng) for _ in range(4)])
        assert found.angular[4:].mean() == pytest.approx(1 - 3 / 20, rel=2e-3)
        waves = np.abs(np.fft.rfft(cleaned.separation.mixing, axis=0)) ** 2
        share = waves.sum(axis=1) / np.linalg.norm(cleaned.separation.mixing[:, 0]) ** 2 / 20
        assert found.frequency[2:] == pytest.approx(1 - share[2:], abs=0.01)

    def test_the_covariance_of_a_projection_is_the_sample_variance_of_the_lost(self, cleaned, rng):
        """It leaves no foreground: corrected power is off by what the lost modes have more than their share.

        Of a Gaussian this has the variance 2 n_s / ((2 l + 1) n (n - n_s)) in C_l over channels of the sum.
        """
        found = members(cleaned, [white(rng) for _ in range(30)])
        degrees = np.arange(10, 40)
        errors = found.errors("angular")[:, degrees]
        expected = np.sqrt(2 * 3 / ((2 * degrees + 1) * 20 * 17))
        assert np.sqrt(np.mean((errors / expected) ** 2)) == pytest.approx(1, abs=0.1)
        correlation = np.corrcoef(errors.T)
        assert np.abs(correlation[np.triu_indices(len(degrees), 1)]).mean() < 0.2


class TestAMissedSource:
    """Of a faint fourth source PCA of three leaves nearly all: its power is known, a share of white noise."""

    @staticmethod
    def cleaned(rng, faint, truth):
        """PCA of three sources, and the true foreground, a `Separation`."""
        true = foreground(rng, 4, (1e4, 1e3, 1e2, faint))
        true -= true.mean(axis=1, keepdims=True)
        maps = (true + truth).astype(np.float32)
        cleaned = Cleaning.of(Data.of(maps, freqs=FREQS), PCA(n_sources=3), peaks=False)
        spectra = np.linalg.svd(true, full_matrices=False)[0][:, :4]
        known = replace(cleaned.separation, mixing=spectra, sources=spectra.T @ true)
        return cleaned, known

    @pytest.mark.parametrize("faint", [0.1, 0.3, 1.0])
    def test_its_power_is_unlike_the_mocks(self, rng, faint):
        """In C_l averaged over channels it has faint^2 of the power of noise of 1 mK."""
        cleaned, known = self.cleaned(rng, faint, white(rng))
        found = members(cleaned, [white(rng) for _ in range(8)], known)
        true = np.mean([one.input.angular for one in found.mocks], axis=0)
        residual = np.mean([one.output.angular for one in found.mocks], axis=0)
        excess = np.mean(((residual - found.angular * true) / true)[5:40])
        assert excess == pytest.approx(faint**2, rel=0.1, abs=0.003)

    def test_error_bars_cover_where_members_have_it(self, rng):
        """And not where the estimated foreground lacks it: the residual is high by its power."""
        pulls = {True: [], False: []}
        for _ in range(6):
            truth = white(rng)
            cleaned, known = self.cleaned(rng, 0.2, truth)
            true, residual = harmonic_power(sphere.analyse(truth), WIDTH).angular, power_of(cleaned).angular
            mocks, bands = [white(rng) for _ in range(8)], np.array_split(np.arange(4, 40), 6)
            for knows, separation in ((True, known), (False, None)):
                found = members(cleaned, mocks, separation)
                excess, errors = found.corrected("angular", residual) / true - 1, found.errors("angular")
                pulls[knows] += [excess[band].mean() / sigma(errors[:, band].mean(axis=1)) for band in bands]
        assert 0.45 < np.mean(np.abs(pulls[True]) < 1) < 0.9
        assert np.sqrt(np.mean(np.square(pulls[True]))) < 1.6 and abs(np.mean(pulls[True])) < 0.6
        assert np.median(pulls[False]) > 3


@pytest.mark.parametrize("n_mocks", [2, 4, 30])
def test_one_error_bar_is_exceeded_by_32_percent(n_mocks):
    """With Student's factor, however few the mocks."""
    assert chance_of(1, n_mocks) == pytest.approx(2 * stats.norm.sf(1))
