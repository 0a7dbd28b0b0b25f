"""The bootstrap of a cleaning: draws whose coverage is known, and the loss of a projection."""

import numpy as np
import pytest
from scipy import stats

from himap.maps import sphere
from himap.measures.bootstrap import chance_of, covariance, sigma, squared_pull
from himap.measures.transfer import TransferFunction, mock_power
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
    found = [covariance(errors) for errors in rng.multivariate_normal(np.zeros(3), true, size=(5_000, 6))]
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


def foreground(rng):
    """Three smooth spectra, each with a Gaussian map."""
    spectra = np.linalg.qr(FREQS[:, None] ** -np.arange(1.0, 4))[0] * np.sqrt(len(FREQS))
    return spectra @ (np.array([[1e4], [1e3], [1e2]]) * rng.standard_normal((3, 12 * NSIDE**2)))


def test_the_loss_of_members_is_that_of_a_projection(rng):
    """PCA with as many components as a bright foreground has is one, whose axes are known.

    Of white noise it takes n_s of n channels, in C_l; in P(k) the share of the axes at that k.
    """
    maps, powers = (foreground(rng) + white(rng)).astype(np.float32), []
    cleaned = Cleaning.of(Data.of(maps, freqs=FREQS), PCA(n_sources=3), peaks=False)
    for mock in (white(rng) for _ in range(4)):
        member = cleaned.resampled(mock)
        wrong = (cleaned.separation.foreground + -member.separation.foreground).truncate(0)
        powers.append(mock_power(sphere.analyse(mock), wrong, WIDTH))
    found = TransferFunction(mocks=tuple(powers))
    assert found.angular[4:].mean() == pytest.approx(1 - 3 / 20, rel=2e-3)
    waves = np.abs(np.fft.rfft(cleaned.separation.mixing, axis=0)) ** 2
    share = waves.sum(axis=1) / np.linalg.norm(cleaned.separation.mixing[:, 0]) ** 2 / 20
    assert found.frequency[2:] == pytest.approx(1 - share[2:], abs=0.01)


@pytest.mark.parametrize("n_mocks", [2, 4, 30])
def test_one_error_bar_is_exceeded_by_32_percent(n_mocks):
    """With Student's factor, however few the mocks."""
    assert chance_of(1, n_mocks) == pytest.approx(2 * stats.norm.sf(1))
