"""Filters of regions: the same as that of the whole sky where it is the same all over, better where not."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.removal.gnilc import GNILC, _cell_products, foreground_filter, local_difference

NSIDE = 16
FREQS = np.linspace(910, 1390, 12)
FIRST, SECOND = np.moveaxis((FREQS[:, None] / 1000) ** np.array([-2.13, -2.8]), 1, 0)
PRIOR = np.eye(12)


@pytest.fixture
def hemispheres(rng):
    """(foreground, HI): one spectrum in the north, another in the south, above white noise."""
    bright = 1e4 * rng.standard_normal(12 * NSIDE**2)
    north = sphere.pixel_latitude(NSIDE) > 0
    hi = rng.standard_normal((12, 12 * NSIDE**2))
    return np.where(north, FIRST[:, None], SECOND[:, None]) * bright, hi


def whole_filter(maps):
    return foreground_filter(maps @ maps.T / maps.shape[1], PRIOR)


def test_sums_over_cells_are_those_of_all_pixels(rng):
    maps = rng.standard_normal((3, 12 * NSIDE**2))
    products = _cell_products(maps, 4)
    assert products.shape == (192, 3, 3)
    assert products.sum(axis=0) == pytest.approx(maps @ maps.T)
    cell = sphere.nest_to_ring(NSIDE)[16 * 5 : 16 * 6]
    assert products[5] == pytest.approx(maps[:, cell] @ maps[:, cell].T)


def test_regions_wider_than_the_sky_are_the_sky(hemispheres):
    maps = sum(hemispheres)
    assert np.abs(local_difference(maps, PRIOR, whole_filter(maps), 1e3)).max() < 1e-3


def test_where_each_region_has_one_spectrum_one_is_taken(hemispheres):
    """Away from the border; the filter of the whole sky takes two everywhere, and twice as much HI."""
    foreground, hi = hemispheres
    whole = whole_filter(foreground + hi)
    spectra, rows = whole
    assert spectra.shape == (12, 2)
    taken = spectra @ (rows @ (foreground + hi))
    error = taken - foreground
    local = error + local_difference(foreground + hi, PRIOR, whole, 0.15)
    away = np.abs(sphere.pixel_latitude(NSIDE)) > 45
    assert np.mean(error[:, away] ** 2) == pytest.approx(2 / 12, rel=0.1)
    assert np.mean(local[:, away] ** 2) == pytest.approx(1 / 12, rel=0.1)


def test_regions_take_the_foreground_as_well(rng):
    """Of a sky that is the same all over, in the needlets that have regions, up to what chance takes."""
    cl = 1e8 / (1.0 + np.arange(3 * NSIDE)) ** 2.5
    cl[2 * NSIDE + 1 :] = 0
    maps = sphere.synthesise(np.array([sphere.gaussian_alm(cl, rng) for _ in range(2)]), NSIDE)
    hi = rng.standard_normal((12, maps.shape[1]))
    sky = np.stack([FIRST, SECOND], axis=1) @ maps + hi
    whole, local = (GNILC(first_peak=8, bias=bias).clean(sky, freqs=FREQS) for bias in (0, 0.03))
    assert whole.separation.mixing.shape[1] == 6 and local.separation.mixing.shape[1] == 18
    hi -= hi.mean(axis=1, keepdims=True)
    assert np.std(local.residual - whole.residual) > 0.01
    assert np.std(local.residual - hi) < 1.2 * np.std(whole.residual - hi)
