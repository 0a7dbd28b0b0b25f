"""Thresholds on starlet scales: what they keep, what they drop, and the noise they assume."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.sparse_sources import SparseSources, share_threshold

LMAX = 32


def test_share():
    sizes = np.array([1.0, 5.0, 2.0, 4.0, 3.0, 0.1])
    assert share_threshold(sizes, 0.5, 1.0) == 0.5
    assert share_threshold(sizes, 0.5, 0.4) == 3.0  # of five above 0.5 the two largest stay
    assert share_threshold(sizes, 9.0, 0.4) == 9.0


def test_nothing_dropped_is_the_detail_scales(rng):
    modes = harmonic.to_modes(sphere.gaussian_alm(np.ones(LMAX + 1), rng))[None]
    sparse = SparseSources(LMAX, 3, n_sigma=3, analytic=True)
    kept = sparse(modes, np.zeros((LMAX + 1, 1)), 1.0)
    smooth = sparse.filters[-1, harmonic.degrees(LMAX)]
    assert kept == pytest.approx((1 - smooth) * modes, abs=1e-10)


def test_noise_alone_is_dropped(rng):
    modes = harmonic.to_modes(sphere.gaussian_alm(np.ones(LMAX + 1), rng))[None]
    kept = SparseSources(LMAX, 3, n_sigma=5, analytic=True)(modes, np.ones((LMAX + 1, 1)), 1.0)
    assert np.linalg.norm(kept) < 0.01 * np.linalg.norm(modes)


def test_analytic_noise_is_that_of_the_scales(rng):
    """The standard deviation of white noise in every scale: formula against maps, and against the MAD."""
    noise = np.full((LMAX + 1, 1), 2.0)
    sparse = SparseSources(LMAX, 3, n_sigma=3, analytic=True)
    alm = np.sqrt(2) * sphere.gaussian_alm(np.ones(LMAX + 1), rng)
    scales = sphere.synthesise_grid(alm * sparse.filters[:2, sphere.alm_degree(LMAX)])
    degree = np.arange(LMAX + 1)
    expected = np.sqrt((2 * degree + 1) @ (sparse.filters[:2] ** 2 * noise.T).T / (4 * np.pi))
    equator = scales[:, scales.shape[1] // 4 : 3 * scales.shape[1] // 4]  # away from the dense polar rings
    assert equator.std(axis=1) == pytest.approx(expected, rel=0.1)
