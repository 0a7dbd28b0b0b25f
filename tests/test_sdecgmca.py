"""SDecGMCA on a problem like that of C21, and what its options do."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sparse_problem import BEAMS, LMAX, NSIDE, make_problem, mixing_error, noisy

from himap.core.errors import InputError
from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.blurred_mixture import BlurredMixture
from himap.removal.sdecgmca.method import SDecGMCA, Step
from himap.removal.sdecgmca.readings import OPTIONS, READINGS
from himap.removal.sdecgmca.scales import Scales

FREQS = np.linspace(900, 1400, 8)
QUICK = {"n_sources": 4, "n_warmup": 10, "n_refinement": 5, "noise": 0.5, "n_scales": 3}


def mixture_of(maps, noise=None, **options):
    """The data of maps up to `LMAX`, all channels with the same noise per mode."""
    modes = harmonic.to_modes(sphere.analyse(maps, LMAX))
    return BlurredMixture(modes, BEAMS[:, : LMAX + 1], noise and np.full(len(maps), noise), **options)


def clean(method, maps, **options):
    return method.clean(maps, freqs=FREQS, beams=options.pop("beams", BEAMS), **options)


@pytest.fixture(scope="module")
def clean_once():
    """What a method makes of `problem` with noise at 10 dB, once for all tests."""
    rng = np.random.default_rng(12345)
    seen = noisy(make_problem(rng)[0], 10, rng)
    return cache(lambda method: clean(method, seen))


class TestSeparation:
    def test_least_squares_both_ways(self, problem):
        maps, mixing, sources = problem
        data = mixture_of(maps, floor=0)
        found = data.sources(data.inverses(mixing, 0))
        assert found == pytest.approx(sources, abs=2e-4 * np.abs(sources).max())
        assert data.fit(sources, np.ones(LMAX + 1)) == pytest.approx(mixing, abs=1e-4)

    @pytest.mark.parametrize("reading", READINGS)
    def test_removes_a_noise_free_sky(self, problem, reading):
        maps = problem[0]
        cleaned = clean(SDecGMCA(n_sources=4, reading=reading, noise=1e-3), maps)
        assert cleaned.residual.std() < 0.1 * maps.std()

    @pytest.mark.parametrize("seed", [0, 1, 2])
    def test_recovers_mixing_and_sources(self, seed):
        """C21's kind of problem at 10 dB: mixing criterion below 0.1, NMSE of S 8 dB at l <= nside."""
        rng = np.random.default_rng(seed)
        maps, mixing, sources, beams = make_problem(rng, nside=32)
        seen = noisy(maps, 10, rng)
        noise = (seen - maps).std()
        method = SDecGMCA(n_sources=4, reading="code", regularisation=0.5, share=0.9, n_scales=3, noise=noise)
        found = clean(method, seen, beams=beams).separation
        assert mixing_error(found.mixing, mixing) < 0.1
        product = np.linalg.pinv(found.mixing) @ mixing
        match = np.abs(product).argmax(axis=0)
        recovered = harmonic.to_modes(sphere.analyse(found.sources, 64))[match]
        recovered *= np.sign(product[match, np.arange(4)])[:, None]
        wide = harmonic.degrees(64) <= 32
        error = np.sum((recovered - sources)[:, wide] ** 2) / np.sum(sources[:, wide] ** 2)
        assert -10 * np.log10(error) > 8

    def test_all_sources_may_vanish(self, problem):
        """With five scales to l = 8 no smooth rest is left, and no coefficient is above such noise."""
        method = SDecGMCA(**QUICK | {"noise": 1e6, "n_scales": 5}, lmax=8, thresholds="analytic")
        found = clean(method, problem[0]).separation
        assert np.isfinite(found.foreground.maps).all()
        assert np.linalg.norm(found.mixing, axis=0) == pytest.approx(1)

    def test_equal_channels_are_no_trouble(self, rng):
        """Data of rank one with three sources asked for: no NaN, no singular matrix, nothing left."""
        maps = np.ones((8, 1)) * np.exp(rng.standard_normal(12 * NSIDE**2))
        method = SDecGMCA(n_sources=3, noise=1e-3, last="unregularised", beyond="projection")
        cleaned = clean(method, maps, beams=np.ones((8, 3 * NSIDE)))
        assert np.isfinite(cleaned.separation.sources).all()
        assert np.abs(cleaned.residual).max() < 1e-5 * maps.max()

    def test_last_floor_acts_where_columns_are_parallel(self, problem):
        """Columns of A that differ by 1e-6 put an eigenvalue at 1e-12: above rounding, below C21's floor."""
        maps, mixing, _ = problem
        mixing = mixing.copy()
        mixing[:, 1] = mixing[:, 0] + 1e-6 * mixing[:, 1]
        floored = []
        for floor in (1e-9, 1e-14):
            mixture = mixture_of(maps, noise=1e-12, floor=floor)
            method = SDecGMCA(n_sources=4, last="unregularised", last_floor=floor, beyond="cut")
            _, epsilon = method.last_sources(mixture, None, mixing, None)
            floored.append(mixture.floored(mixing, epsilon))
        assert floored == [1, 0]

    def test_not_settling_is_recorded(self, clean_once):
        """Its limits are those of C21's code: that many iterations are its end, and no warning."""
        cleaned = clean_once(SDecGMCA(**QUICK | {"n_warmup": 1}, tolerance=0.0))
        assert not cleaned.separation.converged
        assert 50 < cleaned.separation.n_iterations <= 101


class TestRestarts:
    """What each run says of itself; that restarts differ is tested in test_restarts.py and the ensemble."""

    def test_diagnostics(self, clean_once):
        separation = clean_once(SDecGMCA(**QUICK)).separation
        diagnostics = separation.diagnostics
        assert diagnostics["n_warmup"] + diagnostics["n_refinement"] == separation.n_iterations
        assert diagnostics["condition"] == pytest.approx(np.linalg.cond(separation.mixing))
        assert (diagnostics["refinement_change"] <= 1e-4) == separation.converged
        assert 0 <= diagnostics["floored"] <= 1 and diagnostics["cost"] > 0

    def test_cost_is_misfit_and_penalty(self, problem):
        """Of sources that vanish it is the power of the data, of those of the truth only the penalty."""
        maps, mixing, sources = problem
        mixture = mixture_of(maps, noise=1e-6)
        method = SDecGMCA(n_sources=4, thresholds="analytic", n_scales=3)
        scales = Scales(method, LMAX, NSIDE)
        step = Step(mixing=mixing, sources=0 * sources, refining=True, change=0, converged=True)
        assert method._cost(mixture, scales, step) == pytest.approx(np.sum(mixture.modes**2))
        true = method._cost(mixture, scales, replace(step, sources=sources))
        louder = replace(mixture, noise=4 * mixture.noise)
        misfit = np.sum(mixture.residual(mixing, sources) ** 2)
        assert method._cost(louder, scales, replace(step, sources=sources)) - misfit == pytest.approx(
            2 * (true - misfit)
        )


class TestBeyond:
    @pytest.mark.parametrize("beyond", ["regularised", "projection"])
    def test_up_to_lmax_it_is_the_same(self, clean_once, beyond):
        method = SDecGMCA(**QUICK, lmax=20, last="once")
        cut, whole = (clean_once(replace(method, beyond=way)) for way in ("cut", beyond))
        assert whole.separation.lmax is None
        low, other = (sphere.analyse(one.residual.astype(float), 15, n_iter=5) for one in (cut, whole))
        assert np.linalg.norm(low - other) < 0.1 * np.linalg.norm(low)
        fine = sphere.analyse(whole.residual.astype(float))[:, sphere.alm_degree(47) > 25]
        assert np.abs(fine).std() > 0

    def test_projection_leaves_nothing_of_its_spectra(self, clean_once):
        """Beyond lmax the residual is orthogonal to the spectra seen through the beams, at every l."""
        cleaned = clean_once(SDecGMCA(**QUICK, lmax=20, beyond="projection"))
        modes = harmonic.to_modes(sphere.analyse(cleaned.residual.astype(float), 30, n_iter=5))
        block = harmonic.blocks(modes)[26]
        seen_spectra = np.linalg.qr(BEAMS[:, 26, None] * cleaned.separation.mixing)[0]
        assert np.abs(seen_spectra.T @ block).max() < 0.03 * np.abs(block).max()


class TestOptions:
    @pytest.mark.parametrize("name", sorted(set(OPTIONS) - {"floor", "last_floor"}))
    def test_each_changes_something(self, clean_once, name):
        """Every value of every option; but for the floors, which data of 10 dB do not reach."""
        base = SDecGMCA(**QUICK, regularisation=0.1, last="once", beyond="cut")
        methods = [replace(base, **{name: choice}) for choice in OPTIONS[name].choices]
        results = [clean_once(method).foreground for method in methods]
        for one, two in itertools.combinations(results, 2):
            assert np.abs(one - two).max() > 1e-6 * np.abs(one).max()

    def test_readings_are_sets_of_options(self):
        assert SDecGMCA(reading="letter", sign="free").sign == "free"
        assert SDecGMCA(reading="letter", sign="free").mixing_scales == "all"
        assert replace(SDecGMCA(reading="letter"), n_sources=7).mixing_scales == "all"

    def test_noise_of_the_method_comes_first_and_mad_and_matrices_need_none(self, problem):
        own = clean(SDecGMCA(**QUICK), problem[0], noise=3.0).residual
        assert np.array_equal(own, clean(SDecGMCA(**QUICK | {"noise": None}), problem[0], noise=0.5).residual)
        method = SDecGMCA(**QUICK | {"noise": None}, coefficients="matrix", last_coefficients="matrix")
        assert np.isfinite(clean(replace(method, thresholds="mad"), problem[0]).residual).all()
        with pytest.raises(InputError, match="thresholds='analytic'"):
            clean(replace(method, thresholds="analytic"), problem[0])
