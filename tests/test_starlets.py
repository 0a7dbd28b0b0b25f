"""Starlets and needlets: their formulas, a slow twin in the plane, and what any decomposition must do."""

import healpy as hp
import numpy as np
import pytest
from scipy import ndimage
from sdecgmca_twin import low_passes

from himap.core.errors import InputError
from himap.maps.starlets import PlaneStarlets, cosine_needlets, starlet_filters, starlets

NSIDE = 16
LMAX = 3 * NSIDE - 1
SHAPE = 19, 26
KERNEL = np.outer(*[np.array([1, 4, 6, 4, 1]) / 16] * 2)


def test_filters_are_the_formula():
    """phi_j are those of the twin, with B3 by its textbook sum of cubes; scales are differences of these."""
    lmax = 40
    first, second, third = low_passes(3, lmax, "cascade")
    filters = starlet_filters(3, lmax)
    assert filters[0] == pytest.approx(1 - first, abs=1e-12)
    assert filters[1] == pytest.approx(first - second, abs=1e-12)
    assert filters[3] == pytest.approx(third, abs=1e-12)
    assert filters.sum(axis=0) == pytest.approx(np.ones(lmax + 1))


def test_scales_are_a_map_through_the_filters(rng):
    """As by healpy; the finest has what is beyond, so that they add up to the map."""
    pixels = rng.standard_normal(12 * NSIDE**2)
    scales, alm = starlets(pixels, 4), hp.map2alm(pixels, iter=3)
    expected = [hp.alm2map(hp.almxfl(alm, band), NSIDE) for band in starlet_filters(4, LMAX)[1:]]
    assert scales[1:] == pytest.approx(np.array(expected), abs=1e-11)
    assert scales.sum(axis=0) == pytest.approx(pixels, abs=1e-12)


@pytest.fixture
def seen(rng):
    """Three quarters of the pixels, a corner and a column of none among the others."""
    seen = rng.random(SHAPE) < 0.75
    seen[:6, :7] = seen[:, 11] = False
    return seen


def scipy_smooth(image, seen, step):
    """The mean of an image (n_y, n_x) over the seen pixels under the dilated kernel."""
    dilated = np.zeros((4 * step + 1,) * 2)
    dilated[::step, ::step] = KERNEL
    total, weight = (ndimage.convolve(part, dilated, mode="constant") for part in (seen * image, 1.0 * seen))
    return np.where(seen, total / np.where(seen, weight, 1), 0)


def test_scales_are_differences_of_scipy_convolutions(seen, rng):
    maps = rng.standard_normal((2, np.count_nonzero(seen)))
    ours = PlaneStarlets(seen, 4).details(maps)
    assert ours.shape == (4, *maps.shape)
    for n, line in enumerate(maps):
        smooth = np.zeros(SHAPE)
        smooth[seen] = line
        for scale in range(4):
            finer, smooth = smooth, scipy_smooth(smooth, seen, 2**scale)
            assert ours[scale, n] == pytest.approx((finer - smooth)[seen], abs=1e-12)


@pytest.mark.parametrize(("shape", "most"), [((16, 3), 4), ((17, 3), 5), ((2, 2), 1)])
def test_scales_that_would_be_empty_are_refused(shape, most, rng):
    image = np.ones(shape, dtype=bool)
    coarsest = PlaneStarlets(image, most).details(rng.standard_normal((1, image.size)))[-1]
    assert np.abs(coarsest).max() > 0.01
    with pytest.raises(InputError, match=f"n_scales must be at most {most} for an image of .*{shape[0]}"):
        PlaneStarlets(image, most + 1)


def test_windows_are_quarters_of_a_cosine():
    """So that what goes twice through all of them is as it was."""
    windows = cosine_needlets([4, 8, 20], 30)
    assert windows.shape == (3, 31)
    assert windows[1, 6] == pytest.approx(np.cos(np.pi / 4))
    assert windows[1, 11] == pytest.approx(np.cos(0.5 * np.pi * 3 / 12))
    assert windows[:, 8] == pytest.approx([0, 1, 0], abs=1e-15)
    assert windows[0, :5] == pytest.approx(1) and windows[2, 20:] == pytest.approx(1)
    assert np.sum(windows**2, axis=0) == pytest.approx(1)
    assert cosine_needlets([20], 23) == pytest.approx(np.ones((1, 24)))
