"""Gaussian process regression: against scikit-learn, and on draws from a process that is known."""

import warnings

import numpy as np
import pytest
from scipy import linalg
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

from himap.removal.covariance import channel_covariance
from himap.removal.gaussian_process import GaussianProcess, cost, smoother, squared_exponential

FREQS = np.linspace(902.5, 1397.5, 40)
TRUE = np.array([1e4, 300, 30, 90, 0.5, 12, 0.2])  # variance and length of each part, variance of the noise
KERNEL = (
    ConstantKernel(TRUE[0]) * RBF(TRUE[1])
    + ConstantKernel(TRUE[2]) * RBF(TRUE[3])
    + ConstantKernel(TRUE[4]) * Matern(TRUE[5], nu=0.5)
    + WhiteKernel(TRUE[6])
)


def foreground_kernel(freqs):
    return KERNEL.k1.k1(freqs[:, None])


def drawn(n_lines, rng):
    """Foreground, and HI and noise, drawn from the process, (n_channels, n_lines) each."""
    smooth = foreground_kernel(FREQS)
    rest = KERNEL(FREQS[:, None]) - smooth
    roots = (linalg.sqrtm(one).real for one in (smooth, rest))
    return tuple(root @ rng.standard_normal((len(FREQS), n_lines)) for root in roots)


@pytest.fixture
def fitted(rng):
    """scikit-learn's regression of a few lines of sight, and these."""
    lines = sum(drawn(5, rng))
    return GaussianProcessRegressor(KERNEL, alpha=0, optimizer=None).fit(FREQS[:, None], lines), lines


def test_mean_is_that_of_scikit_learn(fitted):
    """Of the foreground alone, the part of its predictive mean that K_foreground makes."""
    model, lines = fitted
    expected = foreground_kernel(FREQS) @ model.alpha_
    spectra, rows = smoother(np.log(TRUE), FREQS)
    assert spectra @ (rows @ lines) == pytest.approx(expected, abs=1e-5 * np.abs(lines).max())
    hi = KERNEL.k1.k2(FREQS[:, None]) @ model.alpha_
    assert expected + hi == pytest.approx(model.predict(FREQS[:, None]), abs=1e-6 * np.abs(lines).max())


def test_likelihood_and_slope_are_those_of_scikit_learn(fitted):
    model, lines = fitted
    n_channels, n_lines = lines.shape
    value, slope = cost(np.log(TRUE), FREQS, lines @ lines.T / n_lines)
    expected, gradient = model.log_marginal_likelihood(KERNEL.theta, eval_gradient=True)
    constant = 0.5 * n_channels * np.log(2 * np.pi)
    assert -n_lines * (value + constant) == pytest.approx(expected, rel=1e-8)
    assert -n_lines * slope == pytest.approx(gradient, rel=1e-5, abs=1e-5 * np.abs(gradient).max())


def test_slope_is_that_of_the_value_where_foregrounds_are_bright(rng):
    """By differences, at the brightness of a sky: 1e11 times the variance of HI."""
    logs = np.log(TRUE * [1e7, 2, 1e3, 2, 1, 1, 1])
    covariance = np.cov(sum(drawn(200, rng)), bias=True)
    _, slope = cost(logs, FREQS, covariance)
    for number, step in enumerate(1e-4 * np.eye(7)):
        ahead, back = (cost(logs + sign * step, FREQS, covariance)[0] for sign in (1, -1))
        assert slope[number] == pytest.approx((ahead - back) / 2e-4, rel=1e-3, abs=1e-3)


def test_parameters_of_a_known_process_are_found(rng):
    """HI and noise to a tenth; what is left is what is left with the true parameters."""
    foreground, rest = drawn(20_000, rng)
    maps = (foreground + rest).astype(np.float32)
    method = GaussianProcess()
    covariance = channel_covariance(maps)
    variance = np.trace(covariance) / len(FREQS)
    found = np.exp(method._maximised(FREQS, covariance / variance, 1e-14, 1e-2, np.ptp(FREQS) / 5).x)
    found[[0, 2, 4, 6]] *= variance
    assert found[4:] == pytest.approx(TRUE[4:], rel=0.1)
    assert found[[1, 3]] == pytest.approx(TRUE[[1, 3]], rel=0.1)
    spectra, rows = smoother(np.log(TRUE), FREQS)
    centred = maps - maps.mean(axis=1, keepdims=True, dtype=float)
    best = centred - spectra @ (rows @ centred)
    left = method.clean(maps, freqs=FREQS).residual
    assert np.std(left - best) < 0.03 * rest.std()


def test_foregrounds_that_float64_alone_holds_are_removed(rng):
    """1e8 times brighter than HI, which has less of the variance than float32 has digits."""
    spectra = (FREQS[:, None] / 1000) ** np.array([-2.1, -2.7, -2.9])
    foreground = 1e8 * spectra @ rng.standard_normal((3, 2000))
    hi = np.linalg.cholesky(np.exp(-np.abs(FREQS[:, None] - FREQS) / 10)) @ rng.standard_normal((40, 2000))
    residual = GaussianProcess().clean(foreground + hi, freqs=FREQS).residual
    assert np.std(residual - hi) < np.std(hi)


def test_foregrounds_longer_than_the_band_are_no_trouble(rng):
    """Lengths of thousands of MHz, and HI that is all noise: the search stays inside its bounds."""
    flat = 1e3 * rng.standard_normal(300) + 0.1 * rng.standard_normal((40, 300))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        left = GaussianProcess().clean(flat, freqs=FREQS).residual
    assert left.std() == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("length", [20.0, 6.0, 3.0])
def test_the_root_is_that_of_the_kernel_however_short(length):
    """Of a band of 500 MHz: factors of its terms are below what a float holds from 6.7 MHz down."""
    place = np.linspace(-250, 250, 100)
    root, slope = squared_exponential(place, 0.0, np.log(length))
    ratio = (place[:, None] - place) / length
    kernel = np.exp(-0.5 * ratio**2)
    assert root @ root.T == pytest.approx(kernel, abs=1e-10)
    assert slope @ root.T + root @ slope.T == pytest.approx(ratio**2 * kernel, abs=1e-8)


def test_a_short_ripple_is_found(rng):
    """The mixing of a beam with a period of 20 MHz, from whichever start: two of them miss it."""
    freqs, n_pix = np.linspace(900, 1400, 100), 2000
    angle = 2 * np.pi * freqs[:, None] / 20
    ripple = rng.standard_normal(n_pix) * np.cos(angle) + rng.standard_normal(n_pix) * np.sin(angle)
    sky = 1e3 * rng.lognormal(size=n_pix) * (freqs[:, None] / 1150) ** -2.7
    kernel = 0.01 * np.exp(-np.abs(freqs[:, None] - freqs) / 3) + 1e-4 * np.eye(len(freqs))
    hi = np.linalg.cholesky(kernel) @ rng.standard_normal((len(freqs), n_pix))
    cleaned = GaussianProcess(shortest=5.0).clean(sky + ripple + hi, freqs=freqs)
    assert np.std(cleaned.residual - hi) < 0.2
