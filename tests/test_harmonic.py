"""Real modes and inverses, against the coefficients and formulas that they stand for."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.removal import harmonic

LMAX = 32


def test_there_and_back(rng):
    alm = sphere.gaussian_alm(np.ones(LMAX + 1), rng)
    assert harmonic.from_modes(harmonic.to_modes(alm)) == pytest.approx(alm, abs=1e-14)


def test_squares_are_those_of_the_coefficients(rng):
    alm = sphere.gaussian_alm(1 / (1.0 + np.arange(LMAX + 1)), rng)
    power = [np.mean(block**2) for block in harmonic.blocks(harmonic.to_modes(alm))]
    assert power == pytest.approx(sphere.power_spectrum(alm))


def test_safe_inverse(rng):
    """Also of two columns that are equal."""
    matrices = np.concatenate([rng.standard_normal((3, 7, 2)), np.ones((1, 7, 2))])
    assert harmonic.safe_inverse(matrices) == pytest.approx(np.linalg.pinv(matrices), rel=1e-10)
