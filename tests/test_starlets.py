"""Starlets: the formula of their filters, and what any decomposition must do."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.maps.starlets import starlet_filters, starlets

NSIDE = 16
LMAX = 3 * NSIDE - 1


def test_filters_are_the_formula():
    """phi = (3/2) B3(2 l / cut-off), B3 by its textbook sum of cubes; scales are differences of these."""
    lmax, degree = 40, np.arange(41)

    def low_pass(cut_off):
        x = 2 * degree / cut_off
        terms = zip((1, -4, 6, -4, 1), (-2, -1, 0, 1, 2), strict=True)
        return 1.5 * sum(factor * np.abs(x + shift) ** 3 for factor, shift in terms) / 12

    filters = starlet_filters(3, lmax)
    assert filters[0] == pytest.approx(1 - low_pass(lmax / 2), abs=1e-12)
    assert filters[1] == pytest.approx(low_pass(lmax / 2) - low_pass(lmax / 4), abs=1e-12)
    assert filters[3] == pytest.approx(low_pass(lmax / 8), abs=1e-12)
    assert filters.sum(axis=0) == pytest.approx(np.ones(lmax + 1))


def test_reconstruct_exactly(rng):
    pixels = rng.standard_normal(12 * NSIDE**2)
    scales = starlets(pixels, 4)
    assert scales.shape == (5, len(pixels))
    assert scales.sum(axis=0) == pytest.approx(pixels, abs=1e-12)


def test_a_multipole_lands_in_its_scale(rng):
    """Power at small l is in the coarse scales and none of it in the finest."""
    cl = np.where(np.arange(LMAX + 1) <= 2, 1.0, 0.0)
    scales = starlets(sphere.synthesise(sphere.gaussian_alm(cl, rng), NSIDE), 3)
    power = scales.var(axis=1)
    assert power[0] < 1e-2 * power.sum()
    assert power[-2:].sum() > 0.9 * power.sum()
