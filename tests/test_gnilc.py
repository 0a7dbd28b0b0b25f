"""GNILC: against the equations as they are published, and on skies whose HI is known."""

import healpy as hp
import numpy as np
import pytest
from scipy.integrate import quad

from himap.maps import sphere
from himap.maps.starlets import cosine_needlets
from himap.removal import gnilc
from himap.removal.gnilc import GNILC, foreground_filter
from himap.sky.cosmology import FREQ_21CM

NSIDE = 16
LMAX = 3 * NSIDE - 1
FREQS = np.linspace(910, 1390, 25)
SPECTRA = (FREQS[:, None] / 1000) ** np.array([-2.13, -2.8])
CHANNELS = np.linspace(905, 1395, 50)
FEW = np.linspace(910, 1390, 12)
FIRST, SECOND = np.moveaxis((FEW[:, None] / 1000) ** np.array([-2.13, -2.8]), 1, 0)
CORRELATION = np.exp(-np.abs(FREQS[:, None] - FREQS) / 30)


def hi_of(rng):
    """A Gaussian field of unit C_l up to l = 2 nside with `CORRELATION` between channels."""
    cl = np.where(np.arange(LMAX + 1) > 2 * NSIDE, 0, 1.0)
    alms = np.array([sphere.gaussian_alm(cl, rng) for _ in FREQS])
    return sphere.synthesise(np.linalg.cholesky(CORRELATION) @ alms, NSIDE)


def bright_maps(rng):
    """Two, 1e4 times brighter than HI, with little on small scales."""
    cl = 1e8 / (1.0 + np.arange(LMAX + 1)) ** 2.5
    cl[2 * NSIDE + 1 :] = 0
    return sphere.synthesise(np.array([sphere.gaussian_alm(cl, rng) for _ in range(2)]), NSIDE)


@pytest.fixture
def sky(rng):
    """(foreground, HI)"""
    return SPECTRA @ bright_maps(rng), hi_of(rng)


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


def test_axes_that_are_too_faint_have_no_foreground():
    """Where the prior is ten times too high for nearly all, the published sum takes all of them."""
    values = np.r_[1e4, np.full(30, 1e-2)]
    unexplained = values - np.log(values) - 1
    published = [2 * m + unexplained[m:].sum() for m in range(32)]
    assert np.argmin(published) == 31
    assert gnilc.n_foreground(values) == 1


def test_slow_twin(sky, mock):
    """Every needlet with healpy, and its filter on all channels; up to l = 2 nside, where HEALPix is good."""
    maps, hi = sum(sky), sky[1]
    left = GNILC(first_peak=8, prior=mock).clean(maps, freqs=FREQS).residual
    alms = np.array([hp.map2alm(channel, lmax=LMAX, iter=10) for channel in maps])
    others = np.array([hp.map2alm(channel, lmax=LMAX, iter=10) for channel in np.load(mock)])
    alms[:, 0] = 0
    found = np.zeros_like(alms)
    for window in cosine_needlets([8, 16, 32], LMAX):
        needlets, mocks = ([hp.almxfl(alm, window) for alm in each] for each in (alms, others))
        data, mock_maps = (np.array([hp.alm2map(alm, 64) for alm in each]) for each in (needlets, mocks))
        prior = gnilc.stationary(np.cov(mock_maps, bias=True))
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


def test_sky_without_foreground_is_not_changed(rng, mock):
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


def test_shape_is_that_of_matter_with_power_like_one_over_k_squared():
    """The integral over waves along the line of sight, between the distances of two channels."""
    degree, freqs = 60, np.linspace(1090, 1110, 11)
    covariance = gnilc.expected_covariance(np.eye(11), freqs, degree)
    near, far = FREQ_21CM / freqs[[6, 4]] - 1
    across = degree / np.sqrt(near * far)

    def power(wave):
        return 1 / (wave**2 + across**2)

    along, _ = quad(power, 0, np.inf, weight="cos", wvar=far - near)
    found = covariance[4, 6] / np.sqrt(covariance[4, 4] * covariance[6, 6])
    assert 0.2 < found < 0.8
    assert found == pytest.approx(along / quad(power, 0, np.inf)[0], rel=1e-3)


@pytest.mark.parametrize("bright", [1e8, 1e14])
@pytest.mark.parametrize(("level", "tolerance"), [((1, 5), 0.1), ((2, 2), 1e-3)])
def test_level_is_that_of_the_data_without_their_foreground(level, tolerance, bright):
    """HI whose level rises by a factor of five or does not, below much brighter spectra."""
    freqs = CHANNELS if level[0] < level[1] else CHANNELS[::5]
    shape = gnilc.expected_covariance(np.eye(len(freqs)), freqs, 60)
    shape /= np.sqrt(np.outer(np.diag(shape), np.diag(shape)))
    level = np.geomspace(*level, len(freqs))
    spectra = (freqs[:, None] / 1000) ** np.array([-2.1, -2.8])
    hi = np.outer(level, level) * shape
    found = gnilc.expected_covariance(hi + bright * spectra @ spectra.T, freqs, 60)
    assert np.sqrt(np.diag(found)) == pytest.approx(level, rel=tolerance if bright < 1e14 else 0.2)


def test_regions_of_a_part_of_the_sky_keep_hi(rng):
    """Outside there is none, so that HI is brighter than in the mean of the sphere, and no foreground."""
    cap = sphere.pixel_latitude(NSIDE) > 60
    hi = hi_of(rng)[: len(FEW)]
    maps = np.stack([FIRST, SECOND], axis=1) @ bright_maps(rng) + hi
    found = [GNILC(first_peak=8, bias=0.3).clean(maps, freqs=FEW, **more) for more in ({}, {"mask": cap})]
    errors = [one.residual[:, cap] - hi[:, cap] for one in found]
    before, after = (np.std(error - error.mean(axis=1, keepdims=True)) for error in errors)
    assert after < 1.1 * before


def test_stationary_keeps_variances_and_has_no_negative_power(rng):
    few = rng.standard_normal((50, 3)) * np.geomspace(1, 4, 50)[:, None]
    found = gnilc.stationary(few @ few.T / 3)
    assert np.linalg.eigvalsh(found).min() > 0
    lines = rng.standard_normal((51, 200_000))
    lines = (lines[1:] + 0.5 * lines[:-1]) * np.geomspace(1, 4, 50)[:, None]
    many = gnilc.stationary(lines @ lines.T / 200_000)
    truth = np.cov(lines, bias=True)
    assert np.diag(many) == pytest.approx(np.diag(truth), rel=0.06)
    assert np.diag(many, 1)[5:-5] == pytest.approx(np.diag(truth, 1)[5:-5], rel=0.06)


def test_where_each_region_has_one_spectrum_one_is_removed(rng):
    """One in the north, another in the south: the filter of the sky has two, and removes twice as much HI."""
    bright, hi = 1e4 * rng.standard_normal(12 * NSIDE**2), rng.standard_normal((12, 12 * NSIDE**2))
    foreground = np.where(sphere.pixel_latitude(NSIDE) > 0, FIRST[:, None], SECOND[:, None]) * bright
    maps = foreground + hi
    spectra, rows = foreground_filter(maps @ maps.T / maps.shape[1], np.eye(12))
    assert spectra.shape == (12, 2)
    error = spectra @ (rows @ maps) - foreground
    everywhere = np.ones(maps.shape[1], dtype=bool)
    local = error + gnilc.local_difference(maps, np.eye(12), (spectra, rows), 0.15, everywhere)
    away = np.abs(sphere.pixel_latitude(NSIDE)) > 45
    assert np.mean(error[:, away] ** 2) == pytest.approx(2 / 12, rel=0.1)
    assert np.mean(local[:, away] ** 2) == pytest.approx(1 / 12, rel=0.1)


def test_regions_take_the_foreground_as_well(rng):
    """Of a sky that is the same all over, in the needlets that have regions, up to what chance takes."""
    maps = bright_maps(rng)
    hi = rng.standard_normal((12, maps.shape[1]))
    sky = np.stack([FIRST, SECOND], axis=1) @ maps + hi
    whole, local = (GNILC(first_peak=8, bias=bias).clean(sky, freqs=FEW) for bias in (0, 0.03))
    assert whole.separation.mixing.shape[1] == 6 and local.separation.mixing.shape[1] == 18
    hi -= hi.mean(axis=1, keepdims=True)
    assert np.std(local.residual - whole.residual) > 0.01
    assert np.std(local.residual - hi) < 1.2 * np.std(whole.residual - hi)
