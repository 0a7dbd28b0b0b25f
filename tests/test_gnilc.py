"""GNILC: against the equations as they are published, and on skies whose HI is known."""

import healpy as hp
import numpy as np
import pytest

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.starlets import cosine_needlets
from himap.removal.data import Data
from himap.removal.gnilc import GNILC, foreground_filter, n_foreground, stationary

NSIDE = 16
LMAX = 3 * NSIDE - 1
FREQS = np.linspace(910, 1390, 25)
SPECTRA = (FREQS[:, None] / 1000) ** np.array([-2.13, -2.8])
CORRELATION = np.exp(-np.abs(FREQS[:, None] - FREQS) / 30)


def hi_of(rng):
    """A Gaussian field of unit C_l up to l = 2 nside with `CORRELATION` between channels."""
    cl = np.where(np.arange(LMAX + 1) > 2 * NSIDE, 0, 1.0)
    alms = np.array([sphere.gaussian_alm(cl, rng) for _ in FREQS])
    return sphere.synthesise(np.linalg.cholesky(CORRELATION) @ alms, NSIDE)


@pytest.fixture
def sky(rng):
    """(foreground, HI): two spectra 1e4 times brighter, with little on small scales."""
    cl = 1e8 / (1.0 + np.arange(LMAX + 1)) ** 2.5
    cl[2 * NSIDE + 1 :] = 0
    maps = sphere.synthesise(np.array([sphere.gaussian_alm(cl, rng) for _ in range(2)]), NSIDE)
    return SPECTRA @ maps, hi_of(rng)


@pytest.fixture
def mock(tmp_path):
    """A file with the HI of another sky."""
    np.save(tmp_path / "mock.npy", hi_of(np.random.default_rng(7)))
    return str(tmp_path / "mock.npy")


def covariances(rng, n_lines=4000):
    root = np.linalg.cholesky(CORRELATION)
    lines = root @ rng.standard_normal((len(FREQS), n_lines))
    return lines @ lines.T / n_lines + 1e6 * SPECTRA @ SPECTRA.T, CORRELATION


def test_filter_is_the_published_one(rng):
    """S (S^T R^-1 S)^-1 S^T R^-1 for HI, S = Q^1/2 U, on the whitened covariance by its square root."""
    covariance, prior = covariances(rng)
    values, axes = np.linalg.eigh(prior)
    half, inverse = (axes * values**power @ axes.T for power in (0.5, -0.5))
    white, vectors = np.linalg.eigh(inverse @ covariance @ inverse)
    assert np.count_nonzero(white > 10) == 2
    space = half @ vectors[:, :-2]
    weighted = space.T @ np.linalg.inv(covariance)
    expected = space @ np.linalg.solve(weighted @ space, weighted)
    spectra, rows = foreground_filter(covariance, prior)
    assert spectra.shape == (25, 2)
    assert np.eye(25) - spectra @ rows == pytest.approx(expected, abs=1e-5)


def test_spectra_of_the_foreground_go_whole(rng):
    spectra, rows = foreground_filter(*covariances(rng))
    left = SPECTRA - spectra @ (rows @ SPECTRA)
    assert np.abs(left).max() < 1e-3


@pytest.mark.parametrize("values", [[1e9, 50, 4.0, 3.0, 1.2, 0.9], [1.1, 1, 1], [9, 8, 7], [3.2], [3.1]])
def test_number_of_axes_with_foreground(values):
    """A loop over m; none of these is below one by much."""
    costs = [
        2 * m + sum(value - np.log(value) - 1 for value in values[m:] if value > 1)
        for m in range(len(values) + 1)
    ]
    assert n_foreground(np.array(values)) == costs.index(min(costs))


def test_axes_that_are_too_faint_have_no_foreground():
    """Where the prior is ten times too high for nearly all, the published sum takes all of them."""
    values = np.r_[1e4, np.full(30, 1e-2)]
    unexplained = values - np.log(values) - 1
    published = [2 * m + unexplained[m:].sum() for m in range(32)]
    assert np.argmin(published) == 31
    assert n_foreground(values) == 1


def test_slow_twin(sky, mock):
    """Every needlet with healpy, and its filter on all channels; up to l = 2 nside, where HEALPix is good."""
    foreground, hi = sky
    maps = foreground + hi
    left = GNILC(first_peak=8, prior=mock).clean(maps, freqs=FREQS).residual
    alms = np.array([hp.map2alm(channel, lmax=LMAX, iter=10) for channel in maps])
    others = np.array([hp.map2alm(channel, lmax=LMAX, iter=10) for channel in np.load(mock)])
    alms[:, 0] = 0
    found = np.zeros_like(alms)
    for window in cosine_needlets([8, 16, 32], LMAX):
        needlets, mocks = ([hp.almxfl(alm, window) for alm in each] for each in (alms, others))
        data, mock_maps = (np.array([hp.alm2map(alm, 64) for alm in each]) for each in (needlets, mocks))
        prior = stationary(np.cov(mock_maps, bias=True))
        spectra, rows = foreground_filter(np.cov(data, bias=True), prior)
        hi_in_it = np.array(needlets) - spectra @ (rows @ np.array(needlets))
        found += [hp.almxfl(alm, window) for alm in hi_in_it]
    expected = np.array([hp.alm2map(alm, NSIDE) for alm in found])
    assert np.std(left - expected) < 0.02 * np.std(hi)


def test_what_is_lost_of_hi_is_what_looks_like_the_foreground(sky, mock):
    """A (A^T Q^-1 A)^-1 A^T Q^-1 of it, the least that a filter with spectra A takes; and no foreground."""
    foreground, hi = sky
    cleaned = GNILC(first_peak=8, prior=mock).clean(foreground + hi, freqs=FREQS)
    weighted = np.linalg.solve(CORRELATION, SPECTRA).T
    hi = hi - hi.mean(axis=1, keepdims=True)
    lost = SPECTRA @ np.linalg.solve(weighted @ SPECTRA, weighted @ hi)
    assert np.std(cleaned.residual - (hi - lost)) < 0.1 * np.std(hi)


@pytest.mark.parametrize("told", [True, False])
def test_two_axes_in_each_needlet(sky, mock, told):
    foreground, hi = sky
    method = GNILC(first_peak=8, prior=mock if told else None)
    assert method.separate(Data.of(foreground + hi, freqs=FREQS)).mixing.shape[1] == 2 * 3


def test_sky_without_foreground_is_left_alone(rng, mock):
    hi = hi_of(rng)
    cleaned = GNILC(first_peak=8, prior=mock).clean(hi, freqs=FREQS)
    assert cleaned.separation.mixing.shape[1] == 0
    assert cleaned.residual == pytest.approx(hi - hi.mean(axis=1, keepdims=True), abs=1e-5)


def test_result_in_the_cache_is_that_of_the_mock(mock):
    """A file with other content under the same name is another prior."""
    first = GNILC(prior=mock).digest()
    np.save(mock, np.zeros((2, 12)))
    assert GNILC(prior=mock).digest() != first
    assert GNILC().digest() == ""


def test_what_it_refuses(sky, mock):
    foreground, _ = sky
    with pytest.raises(InputError, match="prior must be the path"):
        GNILC(prior=3)
    with pytest.raises(InputError, match="first_peak .* must be at least 2"):
        GNILC(first_peak=1)
    with pytest.raises(InputError, match="must have the shape of the maps"):
        GNILC(prior=mock).clean(foreground[:-1], freqs=FREQS[:-1])
    with pytest.raises(InputError, match="prior must be a .npy file .*gone.npy"):
        GNILC(prior="gone.npy").clean(foreground, freqs=FREQS)
    with pytest.raises(InputError, match="HI is expected below"):
        GNILC().clean(foreground, freqs=FREQS + 100)
