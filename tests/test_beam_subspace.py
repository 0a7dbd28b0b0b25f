"""BeamSubspace: exact where it can be, and unmoved by what is of no account."""

import numpy as np
import pytest
from sparse_problem import BEAMS, NSIDE, largest_angle, noisy, sparse_sources

from himap.maps import sphere
from himap.removal.beam_subspace import BeamSubspace
from himap.removal.gmca import GMCA
from himap.removal.pca import PCA

FREQS = np.linspace(900, 1400, 8)


def separated(maps, beams=BEAMS, **options):
    return BeamSubspace(**{"n_sources": 4} | options).clean(maps, freqs=FREQS, beams=beams).separation


class TestExactness:
    def test_of_a_noise_free_sky_nothing_is_left(self, problem):
        """With as many spectra as sources or more; what is left is the error of transforms at this nside."""
        maps, mixing, _ = problem
        methods = PCA(n_sources=4), *(BeamSubspace(n_sources=n) for n in (3, 5, 4))
        cleanings = [method.clean(maps, freqs=FREQS, beams=BEAMS) for method in methods]
        blind, three, five, four = (cleaned.residual.std() / maps.std() for cleaned in cleanings)
        assert max(four, five) < 1e-3
        assert min(blind, three) > 0.03
        found = cleanings[-1].separation
        assert found.converged and largest_angle(found.mixing, mixing) < 1e-4

    def test_it_finds_the_space_under_noise(self, problem, rng):
        maps, mixing, _ = problem
        seen = noisy(maps, 30, rng)
        blind = PCA(n_sources=4).clean(seen, freqs=FREQS).separation
        angle = largest_angle(separated(seen).mixing, mixing)
        assert angle < 0.1
        assert angle < 0.5 * largest_angle(blind.mixing, mixing)

    def test_through_one_beam_it_finds_what_gmca_finds(self, problem, rng):
        """The same space of spectra as GMCA in pixels, whose noise is the only difference."""
        maps = noisy(problem[1] @ sphere.synthesise(sparse_sources(rng), NSIDE), 30, rng)
        ours = separated(maps, np.ones((8, 3 * NSIDE)))
        theirs = GMCA(n_sources=4).clean(maps, freqs=FREQS).separation
        assert largest_angle(ours.mixing, theirs.mixing) < 0.05

    def test_spectra_are_orthonormal_and_sources_uncorrelated(self, problem, rng):
        found = separated(noisy(problem[0], 30, rng))
        assert found.mixing.T @ found.mixing == pytest.approx(np.eye(4), abs=1e-10)
        assert (np.diff(np.var(found.sources, axis=1)) < 0).all()
        off = np.corrcoef(found.sources) - np.eye(4)
        assert np.abs(off).max() < 0.02  # the sums over modes vanish, those over pixels nearly


class TestStability:
    def test_it_does_not_feel_noise_level_or_threshold(self, problem, rng):
        seen = noisy(problem[0], 30, rng)
        options = ({"noise": 0.1}, {"noise": 0.1001}, {"noise": 0.1, "share": 0.35}, {"thresholds": "mad"})
        first, *others = (separated(seen, **kw).mixing for kw in options)
        angles = [largest_angle(first, space) for space in others]
        assert angles[0] < 1e-3
        assert max(angles) < 0.05

    @pytest.mark.parametrize(
        "options",
        [
            {"thresholds": "mad"},
            {"share": 1.0},
            {"n_scales": 2},
            {"lmax": 12},
            {"n_sigma": 10.0},
            {"noise": tuple(np.linspace(0.1, 4, 8))},
        ],
    )
    def test_every_parameter_is_used(self, problem, rng, options):
        """They move the space a little, but they move it."""
        seen = noisy(problem[0], 30, rng)
        assert 1e-6 < largest_angle(separated(seen).mixing, separated(seen, **options).mixing) < 0.2


def test_noise_as_an_array_is_noise_as_a_tuple():
    """Methods are keys of what is stored."""
    one, two = BeamSubspace(noise=np.full(8, 0.1)), BeamSubspace(noise=(0.1,) * 8)
    assert one == two and hash(one) == hash(two)
