"""The covariance of HI and noise: closed forms of what it can hold, and what it makes of the rest."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

from himap.removal.smooth_spectra import faint_covariance, log_fit

N = 60
FREQS = np.linspace(900, 1400, N)


def stationary(bend=0.1, floor=0.05):
    """Of power 1 / (1 + (k / bend)^2) + floor, by sums over many k up to Nyquist's; 1 at no lag."""
    width = FREQS[1] - FREQS[0]
    k = (np.arange(4000) + 0.5) * np.pi / width / 4000
    waves = np.cos(np.outer(width * np.arange(N), k)) @ (1 / (1 + (k / bend) ** 2) + floor)
    return toeplitz(waves / waves[0])


LEVELS = np.exp(np.linspace(0.5, -0.8, N) + 0.3 * np.linspace(-1, 1, N) ** 2)


class TestLogFit:
    def test_of_a_constant_it_is_the_mean(self, rng):
        values = rng.gamma(2, 3, size=500)
        assert np.exp(log_fit(np.ones((500, 1)), values)) == pytest.approx([values.mean()])

    def test_what_is_exactly_so_comes_back(self):
        design = np.polynomial.legendre.legvander(np.linspace(-1, 1, 20), 3)
        given = np.array([1.0, -4.0, 2.0, 0.5])
        assert log_fit(design, np.exp(design @ given)) == pytest.approx(given)

    def test_scatter_is_no_bias(self, rng):
        """The score of the likelihood vanishes; a fit to logarithms would be low by 0.27."""
        design = np.polynomial.legendre.legvander(np.linspace(-1, 1, 20000), 2)
        values = np.exp(design @ [0.3, 1.0, -2.0]) * rng.gamma(2, 0.5, size=len(design))
        found = log_fit(design, values)
        assert design.T @ (values * np.exp(-design @ found) - 1) == pytest.approx(0, abs=1e-4)
        assert found == pytest.approx([0.3, 1.0, -2.0], abs=0.03)

    def test_one_value_far_out_does_no_harm(self):
        values = np.r_[np.ones(9), 1e12]
        assert np.exp(log_fit(np.ones((10, 1)), values)) == pytest.approx([values.mean()])


class TestCovariance:
    @pytest.mark.parametrize("bend", [0.07, 0.15, 0.5, 1e3])
    def test_a_smooth_stationary_one_comes_back(self, bend):
        """From power that bends where that of HI does to white noise."""
        given = stationary(bend) * np.outer(LEVELS, LEVELS)
        found = faint_covariance(given, FREQS, 3)
        assert np.linalg.norm(found - given) < 0.06 * np.linalg.norm(given)

    def test_what_is_smooth_is_told_from_the_rest(self):
        """Of HI without a constant and a slope as much in smooth spectra as of HI."""
        axes = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, N), 3))[0]
        without = np.eye(N) - axes[:, :2] @ axes[:, :2].T
        rest = without @ stationary() @ without
        found = faint_covariance(rest, FREQS, 2)
        expected, got, kept = (
            np.trace(axes.T @ one @ axes) / np.trace(one) for one in (stationary(), found, rest)
        )
        assert got == pytest.approx(expected, rel=0.12)
        assert kept < 0.7 * expected

    @pytest.mark.parametrize("n_modes", [9, 100, 2000])
    def test_of_samples_it_is_closer_than_they_are(self, rng, n_modes):
        sample = np.linalg.cholesky(stationary()) @ rng.standard_normal((N, n_modes))
        products = sample @ sample.T / n_modes
        found = faint_covariance(products, FREQS, 3)
        assert np.linalg.eigvalsh(found).min() > 0
        assert np.linalg.norm(found - stationary()) < 0.5 * np.linalg.norm(products - stationary())

    def test_channels_may_be_missing(self):
        """Distances count, not numbers of channels."""
        kept = np.delete(np.arange(N), [20, 21, 41])
        found = faint_covariance(stationary()[np.ix_(kept, kept)], FREQS[kept], 3)
        whole = faint_covariance(stationary(), FREQS, 3)[np.ix_(kept, kept)]
        assert np.abs(found - whole).max() < 0.1

    @pytest.mark.parametrize("n_channels", [3, 4, 8])
    def test_few_channels_do(self, n_channels):
        found = faint_covariance(np.eye(n_channels), np.linspace(900, 1400, n_channels), 2)
        assert found == pytest.approx(np.eye(n_channels), abs=1e-6)
