"""The projection on given spectra seen through beams, against least squares for every (l, m)."""

import numpy as np
import pytest
from sparse_problem import BEAMS, LMAX, NSIDE, make_problem

from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.analysis import analysed
from himap.removal.spectral_filter import on_sky, seen_through, through_beams


@pytest.fixture
def problem(rng):
    return make_problem(rng)[:3]


def test_through_equal_beams_it_is_a_projection_of_channels(rng):
    maps = rng.standard_normal((8, 12 * NSIDE**2)).astype(np.float32)
    space = rng.standard_normal((8, 2))
    expected = space @ np.linalg.lstsq(space, maps)[0]
    found = through_beams(maps, space, np.ones((8, 3 * NSIDE)), analysed(maps)).cube()
    assert found == pytest.approx(expected, abs=1e-5)


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
    found = through_beams(maps.astype(np.float32), mixing, BEAMS, analysed(maps.astype(np.float32))).cube()
    assert (found - expected).std() < 3e-3 * expected.std()


def test_only_the_span_counts(problem, rng):
    maps, mixing, _ = problem
    other = mixing @ (np.eye(4) + rng.random((4, 4)))
    maps = maps.astype(np.float32)
    one, two = (through_beams(maps, space, BEAMS, analysed(maps)).cube() for space in (mixing, other))
    assert one == pytest.approx(two, abs=1e-5 * float(np.abs(one).max()))


def test_sources_seen_through_beams(problem, rng):
    """diag(b_l) A S_l channel by channel, whole and to a smaller l, in few spectra."""
    _, mixing, _ = problem
    sources = np.stack([sphere.gaussian_alm(1 / np.arange(1, LMAX + 2) ** 2, rng) for _ in range(4)])
    seen = seen_through(harmonic.to_modes(sources), mixing, BEAMS[:, : LMAX + 1])
    for lmax in (None, 9):
        found = on_sky(seen, NSIDE, lmax)
        alms = [sphere.multiply_beam(row @ sources, beam) for row, beam in zip(mixing, BEAMS, strict=True)]
        if lmax is not None:
            alms = [np.where(sphere.alm_degree(LMAX) <= lmax, alm, 0) for alm in alms]
        assert found.lines(slice(None)) == pytest.approx(sphere.synthesise(np.stack(alms), NSIDE), abs=1e-9)
        assert found.spectra.T @ found.spectra == pytest.approx(np.eye(found.spectra.shape[1]), abs=1e-12)
