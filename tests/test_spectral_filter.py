"""Filters by multipole, and projections on spectra seen through beams, against slow twins."""

from functools import partial

import numpy as np
import pytest
from smooth_problem import make_sky
from sparse_problem import BEAMS, LMAX, NSIDE

from himap.maps import sphere
from himap.maps.low_rank import projection
from himap.removal import harmonic
from himap.removal.analysis import cube_modes
from himap.removal.spectral_filter import (
    SpectralFilter,
    combined,
    filtered,
    on_sky,
    seen_through,
    through_beams,
)


@pytest.fixture(scope="module")
def sky():
    return make_sky(np.random.default_rng(4))


def some_filter(rng, n_channels, lmax, n_sources=2):
    """Another one at every l, none beyond the first source from l = 20 on."""
    spectra = rng.standard_normal((lmax + 1, n_channels, n_sources))
    spectra[20:, :, 1] = 0
    return SpectralFilter(
        spectra=spectra,
        estimators=0.1 * rng.standard_normal((lmax + 1, n_sources, n_channels)),
        faint=np.array([np.eye(n_channels), 2 * np.eye(n_channels)]),
        first=np.array([0, 5]),
    )


def foreground(linear, maps):
    project = partial(projection, maps=maps)
    return filtered(linear.spectra, linear.estimators, project, cube_modes(maps)).cube()


class TestFilter:
    def test_one_multipole_at_a_time(self, sky, rng):
        """Maps that end at the last l of the filter: what a transform holds is all that there is."""
        linear, modes = some_filter(rng, len(sky.maps), LMAX), cube_modes(sky.maps)
        expected = modes.upto(LMAX)
        for degree, block in enumerate(harmonic.blocks(expected)):
            assert np.array(modes.at(degree)) == pytest.approx(block)
            block[:] = linear.spectra[degree] @ linear.estimators[degree] @ block
        expected = np.array([sphere.synthesise(alm, NSIDE) for alm in harmonic.from_modes(expected)])
        assert np.std(foreground(linear, sky.maps) - expected) < 1e-3 * np.std(expected)

    def test_other_sources_at_the_first_multipoles(self, sky, rng):
        """In place of G_l X_l, on maps with a bright part: W_l times the difference is what changes."""
        linear, modes = some_filter(rng, len(sky.maps), LMAX), cube_modes(sky.maps)
        more = rng.standard_normal((2, 10**2))
        low = more.copy()
        for degree, out in enumerate(harmonic.blocks(low)):
            out += linear.estimators[degree] @ modes.at(degree)
        project = partial(projection, maps=sky.maps)
        found, without = (
            filtered(linear.spectra, linear.estimators, project, modes, one).cube() for one in (low, None)
        )
        expected = on_sky(combined(more, linear.spectra[:10]), NSIDE).cube()
        assert found - without == pytest.approx(expected, abs=1e-3)

    def test_beyond_the_last_multipole_it_goes_on_as_there(self, rng):
        """A map of all l that the pixels hold, and a filter that is the same at every l."""
        maps = rng.standard_normal((6, 12 * NSIDE**2)).astype(np.float32)
        linear = some_filter(rng, 6, 12)
        linear.spectra[:], linear.estimators[:] = linear.spectra[0], linear.estimators[0]
        expected = linear.spectra[0] @ linear.estimators[0] @ maps
        assert foreground(linear, maps) == pytest.approx(expected, abs=1e-5)


class TestBeams:
    def test_against_every_mode_by_itself(self, problem, rng):
        """Least squares for every (l, m), without the common basis, on noise that the transform can hold."""
        _, mixing, _ = problem
        alms = np.stack([sphere.gaussian_alm(np.ones(LMAX + 1), rng) for _ in range(8)])
        maps = np.stack([sphere.synthesise(alm, NSIDE) for alm in alms]).astype(np.float32)
        modes = harmonic.to_modes(alms)
        for mode, degree in enumerate(harmonic.degrees(LMAX)):
            matrix = BEAMS[:, degree, None] * mixing
            modes[:, mode] = matrix @ np.linalg.lstsq(matrix, modes[:, mode])[0]
        expected = sphere.synthesise(harmonic.from_modes(modes), NSIDE)
        found = through_beams(partial(projection, maps=maps), mixing, BEAMS, cube_modes(maps)).cube()
        assert (found - expected).std() < 3e-3 * expected.std()

    @pytest.mark.parametrize("lmax", [None, 9])
    def test_sources_seen_through_beams(self, problem, rng, lmax):
        """diag(b_l) A S_l channel by channel, all l and to a smaller one, in few spectra."""
        _, mixing, _ = problem
        sources = np.stack([sphere.gaussian_alm(1 / np.arange(1, LMAX + 2) ** 2, rng) for _ in range(4)])
        found = on_sky(seen_through(harmonic.to_modes(sources), mixing, BEAMS[:, : LMAX + 1]), NSIDE, lmax)
        alms = [sphere.multiply_beam(row @ sources, beam) for row, beam in zip(mixing, BEAMS, strict=True)]
        alms = np.where(sphere.alm_degree(LMAX) <= (LMAX if lmax is None else lmax), alms, 0)
        assert found.lines(slice(None)) == pytest.approx(sphere.synthesise(alms, NSIDE), abs=1e-9)
        assert found.spectra.T @ found.spectra == pytest.approx(np.eye(found.spectra.shape[1]), abs=1e-12)
