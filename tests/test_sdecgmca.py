"""SDecGMCA: its parts against slow twins, and both iterations on a problem like that of C21."""

import itertools
import warnings

import numpy as np
import pytest

from himap import sphere
from himap.errors import InputError
from himap.removal import harmonic
from himap.removal.base import SeparationWarning
from himap.removal.beam_projection import through_beams
from himap.removal.channels import Channels
from himap.removal.gmca import GMCA
from himap.removal.pca import PCA
from himap.removal.sdecgmca import TABLE_1, SDecGMCA
from himap.removal.sparsity import SparseSources, share_threshold

NSIDE, LMAX = 16, 32
FREQS = np.linspace(900, 1400, 8)
BEAMS = sphere.gaussian_beam(np.deg2rad(np.linspace(12, 5, 8)), 3 * NSIDE - 1)


def sparse_sources(rng, n_sources=4, n_spots=25, nside=NSIDE, lmax=LMAX):
    """A few spots of each source on an empty sky, smooth enough for the grid: sparse in starlets."""
    maps = np.zeros((n_sources, 12 * nside**2))
    for source in maps:
        source[rng.choice(len(source), n_spots, replace=False)] = 50 + 50 * rng.random(n_spots)
    smooth = sphere.gaussian_beam(np.deg2rad(8), lmax)
    return np.stack([sphere.multiply_beam(sphere.analyse(source, lmax), smooth) for source in maps])


def make_problem(rng, nside=NSIDE):
    """(maps without noise, A, S as modes, beams): 4 sparse sources, 8 channels, beams wide and narrow."""
    lmax = 2 * nside
    beams = sphere.gaussian_beam(np.deg2rad(np.linspace(12, 5, 8)) * NSIDE / nside, 3 * nside - 1)
    mixing = rng.random((8, 4)) + 0.1
    mixing /= np.linalg.norm(mixing, axis=0)
    alms = sparse_sources(rng, nside=nside, lmax=lmax)
    maps = [
        sphere.synthesise(sphere.multiply_beam(row @ alms, beam), nside)
        for row, beam in zip(mixing, beams, strict=True)
    ]
    return np.array(maps), mixing, harmonic.to_modes(alms), beams


@pytest.fixture
def problem(rng):
    return make_problem(rng)[:3]


def mixing_criterion(found, true):
    """Mean |entry| of P A_found^+ A_true - 1, over all orders P and signs of the columns (C21, Eq. 30)."""
    product = np.abs(np.linalg.pinv(found) @ true)
    eye = np.eye(len(product))
    return min(np.abs(product[list(p)] - eye).mean() for p in itertools.permutations(range(len(product))))


def largest_angle(one, two):
    """Sine of the largest angle between the spaces that two sets of columns span."""
    one, two = np.linalg.qr(one)[0], np.linalg.qr(two)[0]
    return np.linalg.norm(two - one @ (one.T @ two), 2)


def noisy(maps, decibel, rng):
    """Maps with white noise at a signal-to-noise ratio in dB."""
    return maps + maps.std() * 10 ** (-decibel / 20) * rng.standard_normal(maps.shape)


class TestModes:
    def test_there_and_back(self, rng):
        alm = sphere.gaussian_alm(np.ones(LMAX + 1), rng)
        assert harmonic.from_modes(harmonic.to_modes(alm)) == pytest.approx(alm, abs=1e-14)

    def test_squares_are_those_of_the_coefficients(self, rng):
        alm = sphere.gaussian_alm(1 / (1.0 + np.arange(LMAX + 1)), rng)
        power = [np.mean(block**2) for block in harmonic.blocks(harmonic.to_modes(alm))]
        assert power == pytest.approx(sphere.cross_spectrum(alm))

    def test_degrees(self):
        assert harmonic.degrees(2).tolist() == [0, 1, 1, 1, 2, 2, 2, 2, 2]

    def test_safe_inverse(self, rng):
        matrices = rng.standard_normal((3, 7, 2))
        ridge = rng.random((3, 2))
        for matrix, epsilon, inverse in zip(
            matrices, ridge, harmonic.safe_inverse(matrices, ridge), strict=True
        ):
            expected = np.linalg.solve(matrix.T @ matrix + np.diag(epsilon), matrix.T)
            assert inverse == pytest.approx(expected, rel=1e-10)

    def test_safe_inverse_of_equal_columns(self):
        matrices = np.ones((1, 5, 2))
        assert harmonic.safe_inverse(matrices) == pytest.approx(np.linalg.pinv(matrices))


class TestChannels:
    """The products per l against loops over every (l, m)."""

    @pytest.fixture
    def small(self, rng):
        modes = rng.standard_normal((5, 16))
        beams = 0.5 + rng.random((5, 4))
        return Channels(modes, beams, rng.random(5)), rng.standard_normal((5, 2))

    def test_sources_one_mode_at_a_time(self, small):
        channels, mixing = small
        found = harmonic.project(harmonic.safe_inverse(channels.matrices(mixing)), channels.modes)
        for mode, degree in enumerate(harmonic.degrees(3)):
            matrix = np.diag(channels.beams[:, degree]) @ mixing
            expected = np.linalg.lstsq(matrix, channels.modes[:, mode])[0]
            assert found[:, mode] == pytest.approx(expected)

    def test_fit_one_channel_at_a_time(self, small, rng):
        channels, _ = small
        sources, window = rng.standard_normal((2, 16)), rng.random(4)
        degree = harmonic.degrees(3)
        for row, seen, beam in zip(
            channels.fit(sources, window), channels.modes, channels.beams, strict=True
        ):
            expected = np.linalg.lstsq((beam[degree] * sources).T, window[degree] * seen)[0]
            assert row == pytest.approx(expected)

    def test_correction_leaves_nothing_of_the_kept_sources(self, small, rng):
        channels, mixing = small
        sources, kept = rng.standard_normal((2, 2, 16))
        corrected = channels.corrected(mixing, sources, kept)
        degree = harmonic.degrees(3)
        for row, seen, beam in zip(corrected, channels.modes, channels.beams, strict=True):
            left = seen - beam[degree] * (row @ sources)
            assert kept @ (beam[degree] * left) == pytest.approx(0, abs=1e-10)

    def test_truth_is_a_fixed_point_of_the_correction_but_not_of_the_fit(self, rng):
        mixing, sources = rng.standard_normal((5, 2)), rng.standard_normal((2, 16))
        beams = 0.5 + rng.random((5, 4))
        channels = Channels(beams[:, harmonic.degrees(3)] * (mixing @ sources), beams, None)
        kept = np.where(np.abs(sources) > 0.7, sources, 0)
        assert channels.corrected(mixing, sources, kept) == pytest.approx(mixing, abs=1e-12)
        assert np.abs(channels.fit(kept, np.ones(4)) - mixing).max() > 0.01

    def test_noise_of_sources(self, small, rng):
        channels, mixing = small
        inverses = harmonic.safe_inverse(channels.matrices(mixing))
        expected = [np.diag(inverse @ np.diag(channels.noise) @ inverse.T) for inverse in inverses]
        assert channels.noise_of(inverses) == pytest.approx(np.array(expected))

    def test_misfit(self, small, rng):
        channels, mixing = small
        sources = rng.standard_normal((2, 16))
        model = channels.beams[:, harmonic.degrees(3)] * (mixing @ sources)
        assert channels.misfit(mixing, sources) == pytest.approx(np.sum((channels.modes - model) ** 2))


class TestThresholds:
    def test_share(self):
        sizes = np.array([1.0, 5.0, 2.0, 4.0, 3.0, 0.1])
        assert share_threshold(sizes, 0.5, 1.0) == 0.5
        assert share_threshold(sizes, 0.5, 0.4) == 3.0  # of five above 0.5 the two largest stay
        assert share_threshold(sizes, 9.0, 0.4) == 9.0

    def test_nothing_dropped_is_the_detail_scales(self, rng):
        modes = harmonic.to_modes(sphere.gaussian_alm(np.ones(LMAX + 1), rng))[None]
        sparse = SparseSources(LMAX, 3, n_sigma=3, analytic=True)
        kept = sparse(modes, np.zeros((LMAX + 1, 1)), 1.0)
        assert kept + sparse.coarse(modes) == pytest.approx(modes, abs=1e-10)

    def test_noise_alone_is_dropped(self, rng):
        modes = harmonic.to_modes(sphere.gaussian_alm(np.ones(LMAX + 1), rng))[None]
        kept = SparseSources(LMAX, 3, n_sigma=5, analytic=True)(modes, np.ones((LMAX + 1, 1)), 1.0)
        assert np.linalg.norm(kept) < 0.01 * np.linalg.norm(modes)

    def test_analytic_noise_is_that_of_the_scales(self, rng):
        """The standard deviation of white noise in every scale: formula against maps, and against the MAD."""
        noise = np.full((LMAX + 1, 1), 2.0)
        sparse = SparseSources(LMAX, 3, n_sigma=3, analytic=True)
        alm = np.sqrt(2) * sphere.gaussian_alm(np.ones(LMAX + 1), rng)
        scales = sphere.synthesise_grid(alm * sparse.filters[:2, sphere.alm_degree(LMAX)])
        degree = np.arange(LMAX + 1)
        expected = np.sqrt((2 * degree + 1) @ (sparse.filters[:2] ** 2 * noise.T).T / (4 * np.pi))
        equator = scales[
            :, scales.shape[1] // 4 : 3 * scales.shape[1] // 4
        ]  # away from the dense polar rings
        assert equator.std(axis=1) == pytest.approx(expected, rel=0.1)

    def test_reweighting_spares_what_is_large(self, rng):
        modes = harmonic.to_modes(sphere.gaussian_alm(np.ones(LMAX + 1), rng))[None]
        noise = np.full((LMAX + 1, 1), 1e-4)
        sparse = SparseSources(LMAX, 3, n_sigma=3, analytic=True)
        plain = sparse(modes, noise, 0.5)
        again = sparse(modes, noise, 0.5, reweighted=True)
        detail = modes - sparse.coarse(modes)
        assert np.linalg.norm(again - detail) < 0.5 * np.linalg.norm(plain - detail)


class TestProjection:
    def test_through_equal_beams_it_is_a_projection_of_channels(self, rng):
        maps = rng.standard_normal((8, 12 * NSIDE**2)).astype(np.float32)
        space = rng.standard_normal((8, 2))
        expected = space @ np.linalg.lstsq(space, maps)[0]
        assert through_beams(maps, space, np.ones((8, 3 * NSIDE))) == pytest.approx(expected, abs=1e-5)

    def test_against_every_mode_by_itself(self, problem, rng):
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
        found = through_beams(maps.astype(np.float32), mixing, BEAMS)
        assert (found - expected).std() < 3e-3 * expected.std()

    def test_only_the_span_counts(self, problem, rng):
        maps, mixing, _ = problem
        other = mixing @ (np.eye(4) + rng.random((4, 4)))
        one, two = (through_beams(maps.astype(np.float32), space, BEAMS) for space in (mixing, other))
        assert one == pytest.approx(two, abs=1e-5 * float(np.abs(one).max()))


class TestSeparation:
    def test_without_noise_or_thresholds_it_inverts_exactly(self, problem):
        maps, mixing, sources = problem
        channels = Channels(harmonic.modes_of_maps(maps, LMAX, label=""), BEAMS[:, : LMAX + 1], None)
        found = harmonic.project(harmonic.safe_inverse(channels.matrices(mixing)), channels.modes)
        assert found == pytest.approx(sources, abs=2e-4 * np.abs(sources).max())
        assert channels.fit(sources, np.ones(LMAX + 1)) == pytest.approx(mixing, abs=1e-4)

    @pytest.mark.parametrize("iteration", ["stable", "published"])
    def test_removes_a_noise_free_sky(self, problem, iteration):
        maps = problem[0]
        method = SDecGMCA(n_sources=4, iteration=iteration)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeparationWarning)
            cleaned = method.clean(maps, freqs=FREQS, beams=BEAMS)
        assert cleaned.separation.converged or iteration == "published"
        assert cleaned.residual.std() < (1e-3 if iteration == "stable" else 1e-2) * maps.std()

    @pytest.mark.parametrize("seed", [0, 1, 2])
    def test_published_iteration_recovers_mixing_and_sources(self, seed):
        """C21's kind of problem at 10 dB: mixing criterion below 0.1, NMSE of S 8 dB at l <= nside."""
        rng = np.random.default_rng(seed)
        maps, mixing, sources, beams = make_problem(rng, nside=32)
        method = SDecGMCA(n_sources=4, iteration="published", regularisation=0.1, share=1.0, n_scales=3)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeparationWarning)
            found = method.clean(noisy(maps, 10, rng), freqs=FREQS, beams=beams).separation
        assert mixing_criterion(found.mixing, mixing) < 0.1
        product = np.linalg.pinv(found.mixing) @ mixing
        match = np.abs(product).argmax(axis=0)
        recovered = harmonic.to_modes(sphere.analyse(found.sources, 64))[match]
        recovered *= np.sign(product[match, np.arange(4)])[:, None]
        wide = harmonic.degrees(64) <= 32
        error = np.sum((recovered - sources)[:, wide] ** 2) / np.sum(sources[:, wide] ** 2)
        assert -10 * np.log10(error) > 8

    def test_stable_iteration_finds_the_space(self, problem, rng):
        maps, mixing, _ = problem
        seen = noisy(maps, 30, rng)
        found = SDecGMCA(n_sources=4).clean(seen, freqs=FREQS, beams=BEAMS).separation
        blind = PCA(n_sources=4).clean(seen, freqs=FREQS).separation
        assert largest_angle(found.mixing, mixing) < 0.1
        assert largest_angle(found.mixing, mixing) < 0.5 * largest_angle(blind.mixing, mixing)

    def test_rounding_does_not_end_it_early(self, problem, rng, monkeypatch):
        """Signal a hundred thousand times fainter than the sky, as HI is, is still no rounding."""
        seen = noisy(problem[0], 100, rng)
        runs = []
        for rounding in (None, 0.0):
            if rounding is not None:
                monkeypatch.setattr("himap.removal.sdecgmca._ROUNDING", rounding)
            runs.append(SDecGMCA(n_sources=4).clean(seen, freqs=FREQS, beams=BEAMS).separation)
        assert runs[0].n_iterations == runs[1].n_iterations > 1
        assert np.array_equal(*(run.foreground for run in runs))

    def test_through_one_beam_it_finds_what_gmca_finds(self, problem, rng):
        """The same space of spectra as GMCA in pixels, whose noise is the only difference."""
        maps = noisy(problem[1] @ sphere.synthesise(sparse_sources(rng), NSIDE), 30, rng)
        ours = SDecGMCA(n_sources=4).clean(maps, freqs=FREQS, beams=np.ones((8, 3 * NSIDE)))
        theirs = GMCA(n_sources=4).clean(maps, freqs=FREQS)
        assert largest_angle(ours.separation.mixing, theirs.separation.mixing) < 0.05

    def test_stable_iteration_does_not_feel_noise_level_or_threshold(self, problem, rng):
        seen = noisy(problem[0], 30, rng)
        options = ({"noise": 0.1}, {"noise": 0.1001}, {"noise": 0.1, "share": 0.35}, {"thresholds": "mad"})
        spaces = [
            SDecGMCA(n_sources=4, **kw).clean(seen, freqs=FREQS, beams=BEAMS).separation.mixing
            for kw in options
        ]
        angles = [largest_angle(spaces[0], space) for space in spaces[1:]]
        print(angles)
        assert angles[0] < 1e-3
        assert max(angles) < 0.05

    def test_equal_channels_are_no_trouble(self, rng):
        """Data of rank one with three sources asked for: no NaN, no singular matrix, nothing left."""
        maps = np.ones((8, 1)) * np.exp(rng.standard_normal(12 * NSIDE**2))
        for iteration in ("stable", "published"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SeparationWarning)
                cleaned = SDecGMCA(n_sources=3, iteration=iteration).clean(
                    maps, freqs=FREQS, beams=np.ones((8, 3 * NSIDE))
                )
            assert np.isfinite(cleaned.separation.sources).all()
            assert np.abs(cleaned.residual).max() < 1e-5 * maps.max()

    def test_near_degenerate_mixing_is_a_warning_and_a_remark(self, problem, monkeypatch):
        monkeypatch.setattr("himap.removal.sdecgmca._CONDITION_LIMIT", 0.5)
        with pytest.warns(SeparationWarning, match="near-degenerate"):
            cleaned = SDecGMCA(n_sources=2).clean(problem[0], freqs=FREQS, beams=BEAMS)
        assert "use fewer sources" in cleaned.separation.remark

    def test_not_settling_is_a_warning_and_a_flag(self, problem, rng):
        method = SDecGMCA(n_sources=4, iteration="published", n_warmup=1, n_refinement=1, tolerance=0.0)
        with pytest.warns(SeparationWarning, match="without converging"):
            cleaned = method.clean(noisy(problem[0], 10, rng), freqs=FREQS, beams=BEAMS)
        assert not cleaned.separation.converged
        assert cleaned.separation.n_iterations <= 3

    @pytest.mark.parametrize(
        "options",
        [
            {"coefficients": "matrix"},
            {"nonnegative": True},
            {"reweighted": False},
            {"thresholds": "mad"},
            {"noise": tuple(np.linspace(0.1, 0.2, 8))},
        ],
    )
    def test_options_change_the_published_iteration(self, problem, rng, options):
        seen = noisy(problem[0], 10, rng)
        base = {"n_sources": 4, "iteration": "published", "n_warmup": 10, "n_refinement": 5}
        base |= {"regularisation": 0.1, "n_scales": 3}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeparationWarning)
            one, two = (
                SDecGMCA(**kw).clean(seen, freqs=FREQS, beams=BEAMS).separation.mixing
                for kw in (base, base | options)
            )
        assert np.abs(one - two).max() > 1e-6
        if options.get("nonnegative"):
            assert two.min() >= 0


def test_table_1():
    assert {beam: SDecGMCA.for_beam(beam).n_sources for beam in TABLE_1} == {
        "degraded": 3, "evolving": 4, "oscillating": 5,
    }  # fmt: skip
    assert SDecGMCA.for_beam("evolving", share=0.5).share == 0.5
    assert SDecGMCA.for_beam("evolving").regularisation == 5e-3
    with pytest.raises(InputError, match="no beam 'round'; it has degraded, evolving, oscillating"):
        SDecGMCA.for_beam("round")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"iteration": "quick"}, "iteration must be stable or published, got 'quick'"),
        ({"coefficients": 3}, "coefficients must be spectrum or matrix"),
        ({"thresholds": None}, "thresholds must be analytic or mad"),
        ({"nonnegative": 2}, "nonnegative must be False or True"),
        ({"noise": -1}, "noise must be above zero"),
        ({"noise": (0.1, np.nan)}, "noise must be above zero"),
        ({"noise": "white"}, "noise must be above zero"),
        ({"share": 0}, "share .* must be above 0"),
        ({"share": 1.5}, "at most 1"),
        ({"regularisation": -1}, "at least 0"),
        ({"lmax": 2}, "at least 4"),
    ],
)
def test_bad_parameters(options, message):
    with pytest.raises(InputError, match=message):
        SDecGMCA(**options)


def test_noise_for_another_number_of_channels(problem):
    with pytest.raises(InputError, match="one value or 8, one for each channel, got 3"):
        SDecGMCA(noise=(1, 2, 3)).clean(problem[0], freqs=FREQS, beams=BEAMS)
