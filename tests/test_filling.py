"""Maps continued outside of what is known: against dense least squares, and what they leave alone."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.maps.inpaint import inpaint, inpaint_alm

NSIDE = 16
LATITUDE = sphere.pixel_latitude(NSIDE)
KEPT = LATITUDE > 20


@pytest.fixture
def smooth(rng):
    """A steep field, (n_pix,), as foregrounds are."""
    cl = 1 / (1 + np.arange(25.0)) ** 3
    return sphere.synthesise(sphere.gaussian_alm(cl, rng), NSIDE)


def test_what_is_known_stays_and_the_rest_does_not_count(smooth, rng):
    """And becomes no brighter than twice what is known."""
    other, found = np.where(KEPT, smooth, rng.standard_normal(len(smooth))), inpaint(smooth, KEPT)
    assert np.array_equal(found[KEPT], smooth[KEPT]) and np.abs(found).max() < 2 * np.abs(smooth[KEPT]).max()
    assert np.array_equal(found, inpaint(other, KEPT))
    one, two = (inpaint_alm(pixels, KEPT, 1e-3) for pixels in (smooth, other))
    assert np.array_equal(one, two)


def test_it_goes_on_with_the_slope_of_the_edge():
    """A field that climbs evenly goes on climbing, where the value at the edge, carried on, would not."""
    ring = (LATITUDE <= 20) & (LATITUDE > 14)
    field = np.deg2rad(LATITUDE)
    wrong = inpaint(field, KEPT)[ring] - field[ring]
    level = field[KEPT].min() - field[ring]
    assert np.sqrt(np.mean(wrong**2)) < 0.5 * np.sqrt(np.mean(level**2))


def test_coefficients_reproduce_what_is_known(smooth):
    """To the tolerance asked for, where an analysis of the map with its edge is off by far more."""
    alm = inpaint_alm(smooth, KEPT, 1e-3)
    size = np.linalg.norm(smooth[KEPT])
    assert np.linalg.norm((sphere.synthesise(alm, NSIDE) - smooth)[KEPT]) < 1e-3 * size
    cut = sphere.synthesise(sphere.analyse(np.where(KEPT, smooth, 0)), NSIDE)
    assert np.linalg.norm((cut - smooth)[KEPT]) > 1e-2 * size


def test_coefficients_are_those_of_dense_least_squares(rng, monkeypatch):
    """The least misfit of all coefficients to l = 3 nside - 1, by numpy, at nside 4."""
    monkeypatch.setattr("himap.maps.inpaint._MOST_STEPS", 3000)
    nside, kept = 4, sphere.pixel_latitude(4) > -30
    lmax = 3 * nside - 1
    pixels = rng.standard_normal(12 * nside**2)
    units = np.eye(sphere.alm_size(lmax))
    fields = sphere.synthesise(np.concatenate([units, 1j * units]), nside)[:, kept]
    least = np.linalg.lstsq(fields.T, pixels[kept])[0] @ fields
    found = sphere.synthesise(inpaint_alm(pixels, kept, 0), nside)[kept]
    assert found == pytest.approx(least, abs=1e-3)
    misfit = np.linalg.norm(pixels[kept] - least)
    assert np.linalg.norm(pixels[kept] - found) == pytest.approx(misfit, rel=1e-6, abs=1e-4)
