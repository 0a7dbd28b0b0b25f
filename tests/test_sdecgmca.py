"""SDecGMCA on a problem like that of C21."""

import itertools
import warnings

import numpy as np
import pytest
from sparse_problem import BEAMS, LMAX, NSIDE, make_problem, noisy

from himap.errors import InputError
from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.base import SeparationWarning
from himap.removal.sdecgmca.method import SDecGMCA
from himap.removal.sdecgmca.mixture import BlurredMixture
from himap.removal.sdecgmca.sparse_sources import SparseSources

FREQS = np.linspace(900, 1400, 8)


@pytest.fixture
def problem(rng):
    return make_problem(rng)[:3]


def mixing_criterion(found, true):
    """Mean |entry| of P A_found^+ A_true - 1, over all orders P and signs of the columns (C21, Eq. 30)."""
    product = np.abs(np.linalg.pinv(found) @ true)
    eye = np.eye(len(product))
    return min(np.abs(product[list(p)] - eye).mean() for p in itertools.permutations(range(len(product))))


class TestSeparation:
    def test_without_noise_or_thresholds_it_inverts_exactly(self, problem):
        maps, mixing, sources = problem
        mixture = BlurredMixture(harmonic.to_modes(sphere.analyse(maps, LMAX)), BEAMS[:, : LMAX + 1], None)
        found = harmonic.project(harmonic.safe_inverse(mixture.matrices(mixing)), mixture.modes)
        assert found == pytest.approx(sources, abs=2e-4 * np.abs(sources).max())
        assert mixture.fit(sources, np.ones(LMAX + 1)) == pytest.approx(mixing, abs=1e-4)

    def test_removes_a_noise_free_sky(self, problem):
        maps = problem[0]
        method = SDecGMCA(n_sources=4, iteration="published")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeparationWarning)
            cleaned = method.clean(maps, freqs=FREQS, beams=BEAMS)
        assert cleaned.residual.std() < 1e-2 * maps.std()

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

    def test_equal_channels_are_no_trouble(self, rng):
        """Data of rank one with three sources asked for: no NaN, no singular matrix, nothing left."""
        maps = np.ones((8, 1)) * np.exp(rng.standard_normal(12 * NSIDE**2))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeparationWarning)
            cleaned = SDecGMCA(n_sources=3, iteration="published").clean(
                maps, freqs=FREQS, beams=np.ones((8, 3 * NSIDE))
            )
        assert np.isfinite(cleaned.separation.sources).all()
        assert np.abs(cleaned.residual).max() < 1e-5 * maps.max()

    def test_near_degenerate_mixing_is_a_warning_and_a_remark(self, problem, monkeypatch):
        monkeypatch.setattr("himap.removal.sdecgmca.method._CONDITION_LIMIT", 0.5)
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


def test_fit_one_channel_at_a_time(rng):
    mixture = BlurredMixture(rng.standard_normal((5, 16)), 0.5 + rng.random((5, 4)))
    sources, window = rng.standard_normal((2, 16)), rng.random(4)
    degree = harmonic.degrees(3)
    for row, seen, beam in zip(mixture.fit(sources, window), mixture.modes, mixture.beams, strict=True):
        expected = np.linalg.lstsq((beam[degree] * sources).T, window[degree] * seen)[0]
        assert row == pytest.approx(expected)


def test_reweighting_spares_what_is_large(rng):
    modes = harmonic.to_modes(sphere.gaussian_alm(np.ones(LMAX + 1), rng))[None]
    noise = np.full((LMAX + 1, 1), 1e-4)
    sparse = SparseSources(LMAX, 3, n_sigma=3, analytic=True)
    plain = sparse(modes, noise, 0.5)
    again = sparse(modes, noise, 0.5, reweighted=True)
    detail = modes - sparse.coarse(modes)
    assert np.linalg.norm(again - detail) < 0.5 * np.linalg.norm(plain - detail)


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
