"""A mask inside of the separation: exact well inside, blind outside, and clear where it cannot be."""

from functools import partial

import numpy as np
import pytest
from sparse_problem import BEAMS, NSIDE, largest_angle, noisy

from himap.maps import sphere
from himap.maps.low_rank import centred, projection
from himap.removal import harmonic
from himap.removal.analysis import cube_modes, inpainted_maps
from himap.removal.beam_subspace import BeamSubspace, inner_weights
from himap.removal.data import Data
from himap.removal.pca import PCA
from himap.removal.spectral_filter import through_beams

FREQS = np.linspace(900, 1400, 8)
LATITUDE = sphere.pixel_latitude(NSIDE)
CUT = np.abs(LATITUDE) > 15
GIVEN = {"freqs": FREQS, "beams": BEAMS}
METHOD = BeamSubspace(n_sources=4)


class TestExactness:
    def test_of_a_noise_free_sky_nothing_is_left_well_inside(self, problem):
        """Two widths of the widest beam, 24 deg, from the edge: 0.5 % of the sky, PCA 10 times that."""
        maps, mixing, _ = problem
        inside = np.abs(LATITUDE) > 39
        cleaned = METHOD.clean(maps, **GIVEN, mask=CUT)
        blind = PCA(n_sources=4).clean(maps, freqs=FREQS, mask=CUT)
        assert cleaned.separation.converged
        left, worse = (one.residual[:, inside].std() for one in (cleaned, blind))
        assert left < 5e-3 * maps[:, inside].std()
        assert left < 0.1 * worse
        assert largest_angle(cleaned.separation.mixing, mixing) < 2e-2

    def test_what_goes_on_outside_is_what_mends_the_edge(self, problem, monkeypatch):
        """Of a noise-free sky less than half is left between a quarter and a width of the beam from it."""
        maps, near = problem[0], (np.abs(LATITUDE) > 18) & (np.abs(LATITUDE) < 27)
        mended = METHOD.clean(maps, **GIVEN, mask=CUT).residual[:, near].std()
        monkeypatch.setattr("himap.removal.analysis.inpaint_alm", lambda pixels, *_: sphere.analyse(pixels))
        cut = METHOD.clean(maps, **GIVEN, mask=CUT).residual[:, near].std()
        assert mended < 0.5 * cut

    def test_against_dense_least_squares(self, problem, rng):
        """Sources free on the whole sky, the squares of what is kept at their least, by numpy; A the same."""
        maps, mixing, _ = problem
        lmax, inside = 20, np.abs(LATITUDE)[CUT] > 39
        low = [sphere.synthesise(sphere.analyse(row, lmax), NSIDE)[CUT] for row in noisy(maps, 40, rng)]
        low = centred(np.array(low)).astype(float)
        fields = sphere.synthesise(harmonic.from_modes(np.eye((lmax + 1) ** 2)), NSIDE)[:, CUT]
        seen = BEAMS[:, harmonic.degrees(lmax)]
        design = np.concatenate(
            [np.kron(row, (beam[:, None] * fields).T) for row, beam in zip(mixing, seen, strict=True)]
        )
        dense = design @ np.linalg.lstsq(design, low.ravel(), rcond=1e-8)[0]
        modes = cube_modes(low, CUT)
        best = BEAMS / BEAMS.max(axis=0)
        project = partial(projection, maps=inpainted_maps(low.astype(np.float32), CUT, modes))
        found = through_beams(project, mixing, best, modes).cube()
        apart = (found[:, CUT] - dense.reshape(low.shape))[:, inside]
        assert apart.std() < 5e-3 * low[:, inside].std()


class TestBlindness:
    def test_separating_on_other_maps(self, problem, rng):
        maps = noisy(problem[0], 30, rng).astype(np.float32)
        more = rng.standard_normal(maps.shape).astype(np.float32)
        one, two = (METHOD.clean(one, **GIVEN, mask=CUT, separate_on=maps) for one in (maps, maps + more))
        assert (two.residual - one.residual)[:, CUT] == pytest.approx(more[:, CUT], abs=1e-4)

    def test_all_kept_is_no_mask(self, problem, rng):
        maps = noisy(problem[0], 30, rng)
        whole, masked = (METHOD.clean(maps, **GIVEN, mask=m) for m in (None, np.ones(len(CUT), bool)))
        assert largest_angle(whole.separation.mixing, masked.separation.mixing) < 0.02
        assert (whole.residual - masked.residual).std() < 0.1 * whole.residual.std()


def test_a_is_found_from_what_is_farther_inside(problem, rng, monkeypatch):
    """A fifth spectrum in a strip along the edge does not move A, as it does where every pixel counts."""
    maps, mixing, _ = problem
    strip = (np.abs(LATITUDE) > 15) & (np.abs(LATITUDE) < 19)
    maps = maps + 3 * rng.random((8, 1)) * strip
    apart = largest_angle(METHOD.separate(Data.of(maps, **GIVEN, mask=CUT)).mixing, mixing)
    ones = lambda *given, **options: np.ones_like(inner_weights(*given, **options))  # noqa: E731
    monkeypatch.setattr("himap.removal.beam_subspace.inner_weights", ones)
    everywhere = largest_angle(METHOD.separate(Data.of(maps, **GIVEN, mask=CUT)).mixing, mixing)
    assert apart < 0.5 * everywhere


def test_weights_are_zero_at_the_edge_and_one_well_inside():
    beam = sphere.gaussian_beam(np.deg2rad(12.0), 32)
    weights = inner_weights(CUT, 3 * beam, 32)
    latitude = np.abs(LATITUDE)
    assert weights[latitude < 14].max() == 0 and weights[latitude > 15 + 24].min() > 0.99
    assert 0.3 < weights[(latitude > 20) & (latitude < 24)].mean() < 0.9


def test_whole_numbers_are_a_mask(problem):
    by_mask = [Data.of(problem[0], freqs=FREQS, mask=mask) for mask in (CUT, CUT.astype(int))]
    assert np.array_equal(*(PCA().separate(data).sources for data in by_mask))
