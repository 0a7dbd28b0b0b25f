"""The projection on given spectra seen through beams, against least squares for every (l, m)."""

import numpy as np
import pytest
from sparse_problem import BEAMS, LMAX, NSIDE, make_problem

from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.analysis import analysed
from himap.removal.beam_projection import through_beams


@pytest.fixture
def problem(rng):
    return make_problem(rng)[:3]


def test_through_equal_beams_it_is_a_projection_of_channels(rng):
    maps = rng.standard_normal((8, 12 * NSIDE**2)).astype(np.float32)
    space = rng.standard_normal((8, 2))
    expected = space @ np.linalg.lstsq(space, maps)[0]
    assert through_beams(maps, space, np.ones((8, 3 * NSIDE)), analysed(maps)) == pytest.approx(
        expected, abs=1e-5
    )


def test_against_every_mode_by_itself(problem, rng):
    """Least squares for every (l, m), without the common basis, on noise that the transform can hold."""
    _, mixing, _ = problem
    alms = np.stack([sphere.gaussian_alm(np.ones(LMAX + 1), rng) for _ in range(8)])
    maps = np.stack([sphere.synthesise(alm, NSIDE) for alm in alms])
    seen = harmonic.to_modes(alms)
    foreground = np.empty_like(seen)
    for mode, degree in enumerate(harmonic.degrees(LMAX)):
        matrix = BEAMS[:, degree, None] * mixing
        foreground[:, mode] = matrix @ np.linalg.lstsq(matrix, seen[:, mode])[0]
    expected = sphere.synthesise(harmonic.from_modes(foreground), NSIDE)
    found = through_beams(maps.astype(np.float32), mixing, BEAMS, analysed(maps.astype(np.float32)))
    assert (found - expected).std() < 3e-3 * expected.std()


def test_only_the_span_counts(problem, rng):
    maps, mixing, _ = problem
    other = mixing @ (np.eye(4) + rng.random((4, 4)))
    maps = maps.astype(np.float32)
    one, two = (through_beams(maps, space, BEAMS, analysed(maps)) for space in (mixing, other))
    assert one == pytest.approx(two, abs=1e-5 * float(np.abs(one).max()))
