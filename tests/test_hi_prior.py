"""The covariance that is expected of HI and noise, against integrals and slow twins."""

import healpy as hp
import numpy as np
import pytest
from scipy.integrate import quad

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.starlets import cosine_needlets
from himap.removal import gnilc, harmonic
from himap.sky.cosmology import FREQ_21CM

NSIDE = 16
FREQS = np.linspace(905, 1395, 50)


def test_the_line_is_where_the_simulations_have_it():
    assert gnilc.LINE == FREQ_21CM


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


def test_level_is_that_of_the_data_without_their_foreground(rng):
    """HI whose level rises by a factor of five over the band, below a foreground of two spectra."""
    shape = gnilc.expected_covariance(np.eye(50), FREQS, 60)
    shape /= np.sqrt(np.outer(np.diag(shape), np.diag(shape)))
    level = np.geomspace(1, 5, 50)
    hi = np.outer(level, level) * shape
    spectra = (FREQS[:, None] / 1000) ** np.array([-2.1, -2.8])
    found = gnilc.expected_covariance(hi + 1e8 * spectra @ spectra.T, FREQS, 60)
    assert np.sqrt(np.diag(found)) == pytest.approx(level, rel=0.1)


def test_what_the_axes_of_the_foreground_take_of_the_level_is_given_back():
    """A level that is the same in all channels is found to the digits of a foreground 1e4 times brighter."""
    freqs = FREQS[::5]
    shape = gnilc.expected_covariance(np.eye(10), freqs, 60)
    shape /= np.sqrt(np.outer(np.diag(shape), np.diag(shape)))
    spectra = (freqs[:, None] / 1000) ** np.array([-2.1, -2.8])
    found = gnilc.expected_covariance(4 * shape + 1e8 * spectra @ spectra.T, freqs, 60)
    assert np.diag(found) == pytest.approx(4, rel=1e-3)


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


def test_covariance_in_a_window_is_that_of_its_maps(rng):
    """Of Gaussian maps that healpy has filtered, without the monopole, which no map of fluctuations has."""
    window = cosine_needlets([6, 12, 24], 40)[1]
    alms = np.array([sphere.gaussian_alm(np.r_[0, np.ones(40)], rng) for _ in range(3)])
    maps = [hp.alm2map(hp.almxfl(alm, window), 64) for alm in alms]
    found = gnilc.band_covariance(harmonic.to_modes(alms), window)
    assert found == pytest.approx(np.cov(maps, bias=True), rel=1e-3, abs=1e-3 * found.max())


def test_mock_by_its_maps(rng):
    """The variance of white noise in each window, from its modes."""
    maps = rng.standard_normal((30, 12 * NSIDE**2)).astype(np.float32) + np.float32(7)
    windows = cosine_needlets([10, 20], 32)
    for window, found in zip(windows, gnilc.mock_covariances(maps, windows), strict=True):
        n_modes = np.sum((2 * np.arange(1, 33) + 1) * window[1:] ** 2)
        assert np.diag(found).mean() == pytest.approx(n_modes / maps.shape[1], rel=0.05)
        assert np.abs(found[0, 1:]).max() < 0.1 * found[0, 0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "prior must be a .npy file"),
        (b"words", "prior must be a .npy file"),
        (np.zeros((3, 12)), r"the shape of the maps, \(3, 48\), got \(3, 12\)"),
        (np.full((3, 48), np.nan), "the mock of prior must be finite everywhere"),
    ],
)
def test_mocks_that_are_none(content, message, tmp_path):
    path = tmp_path / "mock.npy"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        np.save(path, content)
    with pytest.raises(InputError, match=message):
        gnilc.read_mock(path, (3, 48))
