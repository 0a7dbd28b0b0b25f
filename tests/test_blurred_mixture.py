"""Modes of a cube, products per l and filters by multipole, against loops over every (l, m)."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from smooth_problem import make_sky
from sparse_problem import BEAMS, LMAX, NSIDE, largest_angle

from himap.maps import sphere
from himap.maps.low_rank import projection
from himap.removal import harmonic
from himap.removal.analysis import CubeModes, cube_modes
from himap.removal.blurred_mixture import BlurredMixture
from himap.removal.spectral_filter import (
    SpectralFilter,
    combined,
    filtered,
    on_sky,
    seen_through,
    through_beams,
)


@pytest.fixture
def small(rng):
    modes = rng.standard_normal((5, 16))
    beams = 0.5 + rng.random((5, 4))
    return BlurredMixture(modes, beams), rng.standard_normal((5, 2))


def test_sources_one_mode_at_a_time(small):
    channels, mixing = small
    found = channels.sources(channels.least_squares(mixing))
    for mode, degree in enumerate(harmonic.degrees(3)):
        matrix = np.diag(channels.beams[:, degree]) @ mixing
        expected = np.linalg.lstsq(matrix, channels.modes[:, mode])[0]
        assert found[:, mode] == pytest.approx(expected)


def test_safe_inverse(rng):
    """Also of two columns that are equal."""
    matrices = np.concatenate([rng.standard_normal((3, 7, 2)), np.ones((1, 7, 2))])
    assert harmonic.safe_inverse(matrices) == pytest.approx(np.linalg.pinv(matrices), rel=1e-10)


def test_correction_leaves_nothing_of_the_kept_sources(small, rng):
    channels, mixing = small
    sources, kept = rng.standard_normal((2, 2, 16))
    corrected = channels.corrected(mixing, channels.residual(mixing, sources), sources, kept)
    degree = harmonic.degrees(3)
    for row, seen, beam in zip(corrected, channels.modes, channels.beams, strict=True):
        left = seen - beam[degree] * (row @ sources)
        assert kept @ (beam[degree] * left) == pytest.approx(0, abs=1e-10)


def test_truth_is_a_fixed_point_of_the_correction_but_not_of_a_fit(rng):
    """What a threshold takes away does not move A, where least squares of the data on what is kept does."""
    mixing, sources = rng.standard_normal((5, 2)), rng.standard_normal((2, 16))
    beams = 0.5 + rng.random((5, 4))
    by_mode = beams[:, harmonic.degrees(3)]
    channels = BlurredMixture(by_mode * (mixing @ sources), beams)
    kept = np.where(np.abs(sources) > 0.7, sources, 0)
    left = channels.residual(mixing, sources)
    assert channels.corrected(mixing, left, sources, kept) == pytest.approx(mixing, abs=1e-12)
    seen = zip(by_mode, channels.modes, strict=True)
    fitted = [np.linalg.lstsq((beam * kept).T, data)[0] for beam, data in seen]
    assert np.abs(fitted - mixing).max() > 0.01


def test_start_is_the_space_of_the_spectra_at_the_worst_beam(rng):
    """Without noise it is A itself, however different the beams; of the data as they are it is not."""
    mixing, sources = rng.standard_normal((5, 2)), rng.standard_normal((2, 16))
    beams = 0.2 + 0.8 * rng.random((5, 4))
    channels = BlurredMixture(beams[:, harmonic.degrees(3)] * (mixing @ sources), beams)
    start = channels.start(2)
    assert start.T @ start == pytest.approx(np.eye(2))
    assert largest_angle(start, mixing) < 1e-10
    blurred = np.linalg.svd(channels.modes)[0][:, :2]
    assert largest_angle(blurred, mixing) > 0.05


def test_the_lowest_resolution_is_that_of_the_widest_beam_at_every_l(small):
    channels, _ = small
    beams = channels.beams[:, harmonic.degrees(3)]
    seen = channels.modes * beams.min(axis=0) / beams
    assert channels.at_one_resolution() == pytest.approx(seen @ seen.T)


@pytest.mark.parametrize("n_bright", [0, 2])
@pytest.mark.parametrize("copied", [False, True])
def test_modes_of_a_cube_do_as_an_array_does(small, rng, copied, n_bright):
    """They go further than the beams, and are made for one l after the other, or copied."""
    channels, mixing = small
    further = np.hstack([channels.modes, rng.standard_normal((5, 9))])
    axes, _ = np.linalg.qr(rng.standard_normal((5, n_bright)))
    bright = axes.T @ further
    modes = CubeModes(spectra=axes, bright=bright, rest=(further - axes @ bright).astype(np.float32))
    made = replace(channels, modes=modes.by_degree(3) if copied else modes)
    assert modes.upto(3) == pytest.approx(channels.modes, abs=1e-6)
    channels = replace(channels, modes=modes.upto(3))
    sources = rng.standard_normal((2, 16))
    inverses, window = channels.least_squares(mixing), np.ones(4)
    for of_cube, of_array in (
        (made.sources(inverses), channels.sources(inverses)),
        (made.residual(mixing, sources), channels.residual(mixing, sources)),
        (made.fit(sources, window), channels.fit(sources, window)),
        (made.at_one_resolution(), channels.at_one_resolution()),
        (made.at_one_resolution("first"), channels.at_one_resolution("first")),
    ):
        assert of_cube == pytest.approx(of_array, rel=1e-10, abs=1e-12)


@pytest.fixture
def cube(rng):
    """Maps (8, n_pix) of a foreground of two spectra, 1e4 times noise, plus noise; the modes of both."""
    freqs = np.linspace(1.0, 1.5, 8)
    spectra = np.stack([freqs**-2.7, freqs**-2.1], axis=1)
    steep = 1 / (1.0 + np.arange(LMAX + 1)) ** 2
    bright = np.stack([sphere.gaussian_alm(1e8 * steep, rng) for _ in range(2)])
    faint = np.stack([sphere.gaussian_alm(np.ones(LMAX + 1), rng) for _ in range(8)])
    maps = np.stack([sphere.synthesise(alm, NSIDE) for alm in spectra @ bright + faint])
    return maps.astype(np.float32), harmonic.to_modes(spectra @ bright), harmonic.to_modes(faint)


def test_modes_are_those_that_the_cube_was_made_of(cube):
    """The quadrature that does for noise misses more of the foreground than there is noise."""
    maps, bright, faint = cube
    modes = cube_modes(maps)
    found, rough = modes.upto(LMAX), harmonic.to_modes(sphere.analyse(maps, LMAX, n_iter=0))
    assert found.dtype == np.float64 and found.shape == bright.shape
    assert (found - bright - faint).std() < 0.1 * faint.std()
    assert (rough - bright - faint).std() > faint.std()
    assert modes.spectra.shape == (8, 2)


def test_modes_along_spectra_are_their_sums(cube, rng):
    maps = cube[0]
    modes, rows = cube_modes(maps), rng.standard_normal((3, 8))
    expected = rows @ modes.upto(LMAX)
    np.testing.assert_allclose(modes.along(rows, LMAX), expected, atol=1e-5 * cube[2].std())


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
