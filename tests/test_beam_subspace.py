"""BeamSubspace: exact where it can be, unmoved by what is of no account, and inside of a mask."""

from functools import partial

import numpy as np
import pytest
from sparse_problem import BEAMS, NSIDE, largest_angle, noisy, sparse_sources

from himap.maps import sphere
from himap.maps.inpaint import inpaint, inpaint_alm
from himap.maps.low_rank import centred, projection
from himap.removal import harmonic
from himap.removal.analysis import cube_modes, inpainted_maps
from himap.removal.beam_subspace import BeamSubspace, inner_weights
from himap.removal.data import Data
from himap.removal.gmca import GMCA
from himap.removal.pca import PCA
from himap.removal.spectral_filter import through_beams

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


LATITUDE = sphere.pixel_latitude(NSIDE)
CUT = np.abs(LATITUDE) > 15
GIVEN = {"freqs": FREQS, "beams": BEAMS}
METHOD = BeamSubspace(n_sources=4)


class TestMask:
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


class TestOtherMaps:
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
