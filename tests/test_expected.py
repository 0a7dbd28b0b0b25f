"""What a linear filter keeps of HI: closed forms, and Gaussian fields that go through it."""

from types import SimpleNamespace

import numpy as np
import pytest
from smooth_problem import FREQS, N_CHANNELS, WIDTH, hi_covariance

from himap.maps import sphere
from himap.measures.transfer import TransferFunction, expected_mock_power, harmonic_power
from himap.removal.smooth_spectra import smooth_basis
from himap.removal.spectral_filter import SpectralFilter

LMAX = 10


def filter_of(spectra, estimators, faint):
    """The same at every l, as a separation."""
    linear = SpectralFilter(
        spectra=np.array([spectra] * (LMAX + 1)),
        estimators=np.array([estimators] * (LMAX + 1)),
        faint=np.array([faint]),
        first=np.array([0]),
    )
    return SimpleNamespace(filter=linear, mixing=spectra)


@pytest.fixture
def wiener():
    """Of three smooth spectra, two of them bright, the third like HI."""
    spectra, faint = smooth_basis(FREQS, 3) * [10, 3, 0.05], hi_covariance()
    data = spectra @ spectra.T + faint
    return filter_of(spectra, np.linalg.solve(data, spectra).T, faint)


def test_a_filter_that_removes_nothing_keeps_all():
    found = expected_mock_power(
        filter_of(np.zeros((5, 1)), np.zeros((1, 5)), np.diag([1.0, 2, 3, 4, 5])), 2.0
    )
    for power in vars(found).values():
        assert power.angular == pytest.approx(np.full(LMAX + 1, 3.0))  # the mean variance of the channels
        assert power.power == pytest.approx(np.full((LMAX + 1, 3), 6.0))  # white: times the width


def test_a_projection_of_white_noise_keeps_what_it_leaves():
    basis = smooth_basis(FREQS, 4)
    found = expected_mock_power(filter_of(basis, basis.T, np.eye(N_CHANNELS)), WIDTH)
    share = TransferFunction(mocks=(found,)).angular
    assert share == pytest.approx(np.full(LMAX + 1, 1 - 4 / N_CHANNELS))
    assert found.output.power == pytest.approx(found.cross.power)


def test_of_gaussian_fields_it_is_the_mean(wiener, rng):
    root = np.linalg.cholesky(wiener.filter.faint[0])
    alms = np.array([root @ _white(rng) for _ in range(40)])
    keeps = np.eye(N_CHANNELS) - wiener.filter.spectra[0] @ wiener.filter.estimators[0]
    found = expected_mock_power(wiener, WIDTH)
    for expected, fields in ((found.input, alms), (found.output, keeps @ alms)):
        measured = sum(harmonic_power(field, WIDTH).power[2:].mean(axis=0) for field in fields) / 40
        assert measured == pytest.approx(expected.power[2:].mean(axis=0), rel=0.1)


def test_the_foreground_that_is_left_fills_up_what_comes_back(wiener):
    """Of a Wiener filter: what is left in all has the power that HI has in common with itself."""
    spectra, estimators, faint = (
        wiener.filter.spectra[0],
        wiener.filter.estimators[0],
        wiener.filter.faint[0],
    )
    keeps = np.eye(N_CHANNELS) - spectra @ estimators
    left = keeps @ (faint + spectra @ spectra.T) @ keeps.T
    found = expected_mock_power(wiener, WIDTH)
    assert found.cross.angular == pytest.approx(np.full(LMAX + 1, np.trace(left) / N_CHANNELS))
    assert (found.output.angular < found.cross.angular).all()


def _white(rng):
    return np.array([sphere.gaussian_alm(np.ones(LMAX + 1), rng) for _ in range(N_CHANNELS)])
