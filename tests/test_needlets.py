"""Needlets: what their windows must add up to, and where each of them is."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.maps.starlets import cosine_needlets

PEAKS = [4, 8, 20]


def test_windows_are_quarters_of_a_cosine():
    windows = cosine_needlets(PEAKS, 30)
    assert windows.shape == (3, 31)
    assert windows[1, 6] == pytest.approx(np.cos(np.pi / 4))
    assert windows[1, 11] == pytest.approx(np.cos(0.5 * np.pi * 3 / 12))
    assert windows[:, 8] == pytest.approx([0, 1, 0], abs=1e-15)
    assert windows[0, :5] == pytest.approx(1) and windows[2, 20:] == pytest.approx(1)


def test_twice_through_all_windows_is_the_map_itself(rng):
    alm = sphere.gaussian_alm(np.ones(31), rng)
    degree = sphere.alm_degree(30)
    back = sum(alm * window[degree] ** 2 for window in cosine_needlets(PEAKS, 30))
    assert back == pytest.approx(alm)


def test_one_window_is_all():
    assert cosine_needlets([20], 23) == pytest.approx(np.ones((1, 24)))
