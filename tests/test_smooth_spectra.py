"""SmoothSpectra: closed forms of its steps, and what it was made for: HI stays, whatever n_s is."""

import warnings

import numpy as np
import pytest
from scipy.linalg import toeplitz
from skies import spectrum
from smooth_problem import BEAMS, FREQS, INDICES, LMAX, WIDTH, check_mean, hi_covariance, make_sky
from sparse_problem import largest_angle

from himap.core.errors import InputError
from himap.maps import sphere
from himap.measures.transfer import expected_mock_power
from himap.removal.base import SeparationWarning
from himap.removal.harmonic import to_modes
from himap.removal.pca import PCA
from himap.removal.smooth_spectra import (
    SmoothSpectra,
    faint_covariance,
    log_fit,
    shrunk_variance,
    smooth_basis,
)

N = 60
CHANNELS = np.linspace(900, 1400, N)


@pytest.fixture(scope="module")
def sky():
    return make_sky(np.random.default_rng(8))


def cleaned(sky, **options):
    return SmoothSpectra(**options).clean(sky.maps, freqs=FREQS, beams=BEAMS)


def power_ratio(residual, truth, low, high):
    """C/C0 from one l to another."""
    powers = (spectrum(cube.astype(float))[:, low : high + 1].sum() for cube in (residual, truth))
    return np.divide(*powers)


class TestSteps:
    def test_power_laws_are_smooth(self):
        """Six functions hold any index that there is to the last digit of float32, five nearly so."""
        spectra = (FREQS / 1150)[:, None] ** np.linspace(-3.5, -2, 7)
        for n_smooth, tolerance in ((6, 1e-7), (5, 1e-5)):
            basis = smooth_basis(FREQS, n_smooth)
            left = spectra - basis @ (basis.T @ spectra)
            assert np.abs(left).max() < tolerance
        assert basis.T @ basis == pytest.approx(np.eye(5))

    @pytest.mark.parametrize("ratio", [0.01, 0.2])
    @pytest.mark.parametrize("variance", [1.5, 4.0, 1e6])
    def test_shrinkage_undoes_what_samples_add(self, ratio, variance):
        """Sample eigenvalue and angle of a spiked covariance, 1 + variance (Baik & Silverstein 2006)."""
        sample = (1 + variance) * (1 + ratio / variance)
        cosine = (1 - ratio / variance**2) / (1 + ratio / variance)
        assert shrunk_variance(np.array([sample]), ratio) == pytest.approx([variance * cosine])

    def test_what_is_removed_is_the_mean_of_the_foreground_given_the_data(self, sky):
        check_mean(cleaned(sky).separation.filter)


class TestHI:
    def test_without_a_foreground_hardly_anything_is_removed(self, rng):
        sky = make_sky(rng, brightness=1e-9)
        for n_sources in (3, 6):
            found = cleaned(sky, n_sources=n_sources)
            assert power_ratio(found.residual, sky.truth, 5, 30) > 0.98

    def test_the_lowest_band_has_no_monopole(self, rng):
        """Channel means are subtracted: 24 modes at l < 5, and not 25 of which one is nothing."""
        sky = make_sky(rng, brightness=1e-9)
        modes = to_modes(np.array(list(map(sphere.analyse, sky.maps))), 1, 4)
        found = np.trace(cleaned(sky).separation.filter.faint[0])
        assert found == pytest.approx(np.sum(modes**2) / 24, rel=0.02)

    def test_more_spectra_than_there_are_do_no_harm(self, sky):
        three, six = (cleaned(sky, n_sources=n).residual for n in (3, 6))
        for low, high in ((5, 9), (10, 19), (20, 30)):
            ratios = [power_ratio(one, sky.truth, low, high) for one in (three, six)]
            assert ratios[1] == pytest.approx(ratios[0], abs=0.02)

    def test_it_loses_no_more_than_a_projection_on_the_true_spectra(self, sky):
        """Which no method that fits spectra to the data can keep more than."""
        spectra = (FREQS / 1150)[:, None] ** np.array(INDICES)
        put_in, kept = 0, 0
        for degree in range(5, 31):
            basis = np.linalg.qr(BEAMS[:, degree, None] * spectra)[0]
            modes = sky.hi[:, sphere.alm_degree(LMAX) == degree]
            put_in += np.sum(np.abs(modes) ** 2)
            kept += np.sum(np.abs(modes - basis @ (basis.T @ modes)) ** 2)
        assert power_ratio(cleaned(sky).residual, sky.truth, 5, 30) > kept / put_in - 0.003

    def test_what_is_lost_is_what_it_foresees(self, sky):
        """As well as the power of HI can be continued to where foregrounds are."""
        found = cleaned(sky)
        expected = expected_mock_power(found.separation, WIDTH)
        low = slice(5, 31)
        foreseen = 1 - expected.cross.angular[low].sum() / expected.input.angular[low].sum()
        lost = 1 - power_ratio(found.residual, sky.truth, 5, 30)
        assert foreseen == pytest.approx(lost, rel=0.25)
        assert lost > 0.05

    def test_the_covariance_is_that_of_hi(self, sky):
        linear = cleaned(sky).separation.filter
        for degree in (12, 22):
            truth = hi_covariance() * np.outer(BEAMS[:, degree], BEAMS[:, degree])
            found = linear.faint_at(degree)
            assert np.linalg.norm(found - truth) < 0.15 * np.linalg.norm(truth)


class TestResult:
    def test_spectra_span_the_foreground(self, sky):
        found = cleaned(sky, n_sources=3).separation
        assert found.converged and 1 < found.n_iterations < 20
        assert found.mixing.T @ found.mixing == pytest.approx(np.eye(3), abs=1e-10)
        assert (np.diff(found.sources.var(axis=1)) < 0).all()
        truth = (FREQS / 1150)[:, None] ** np.array(INDICES)
        blind = PCA(n_sources=3).clean(sky.maps, freqs=FREQS).separation
        assert largest_angle(truth, found.mixing[:, :2]) < 1e-3
        assert largest_angle(found.mixing, truth) < largest_angle(blind.mixing, truth)

    @pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
    def test_every_parameter_is_used(self, sky):
        four = cleaned(sky).residual
        for options in ({"n_sources": 1}, {"n_smooth": 5}):
            assert np.std(cleaned(sky, **options).residual - four) > 1e-4 * np.std(four)


def test_a_band_too_narrow_for_so_many_functions(rng):
    """HI that is as smooth over the band as the functions themselves: an error that says what to do."""
    freqs = np.linspace(1000, 1060, 20)
    covariance = np.exp(-np.square(freqs[:, None] - freqs) / 2 / 60**2) + 1e-14 * np.eye(20)
    hi = np.linalg.cholesky(covariance) @ rng.standard_normal((20, 12 * 8**2))
    maps = (hi + 1e3 * (freqs[:, None] / 1000) ** -2.7 * rng.standard_normal(hi.shape[1])).astype(np.float32)
    with pytest.raises(InputError, match="over 60 MHz in 20 channels, .* take fewer, such as n_smooth=4"):
        SmoothSpectra(n_sources=3).clean(maps, freqs=freqs, beams=np.ones((20, 24)))


def stationary(bend=0.1, floor=0.05):
    """Of power 1 / (1 + (k / bend)^2) + floor, by sums over many k up to Nyquist's; 1 at no lag."""
    width = CHANNELS[1] - CHANNELS[0]
    k = (np.arange(4000) + 0.5) * np.pi / width / 4000
    waves = np.cos(np.outer(width * np.arange(N), k)) @ (1 / (1 + (k / bend) ** 2) + floor)
    return toeplitz(waves / waves[0])


LEVELS = np.exp(np.linspace(0.5, -0.8, N) + 0.3 * np.linspace(-1, 1, N) ** 2)


class TestLogFit:
    def test_of_a_constant_it_is_the_mean_and_an_exact_model_comes_back(self):
        """One value that is far out does no harm."""
        values = np.r_[np.ones(9), 1e12]
        assert np.exp(log_fit(np.ones((10, 1)), values)) == pytest.approx([values.mean()])
        design = np.polynomial.legendre.legvander(np.linspace(-1, 1, 20), 3)
        given = np.array([1.0, -4.0, 2.0, 0.5])
        assert log_fit(design, np.exp(design @ given)) == pytest.approx(given)


class TestCovariance:
    @pytest.mark.parametrize("bend", [0.07, 0.15, 0.5, 1e3])
    def test_a_smooth_stationary_one_comes_back(self, bend):
        """From power that bends where that of HI does to white noise."""
        given = stationary(bend) * np.outer(LEVELS, LEVELS)
        found = faint_covariance(given, CHANNELS, 3)
        assert np.linalg.norm(found - given) < 0.06 * np.linalg.norm(given)

    def test_what_is_smooth_is_separated_from_the_rest(self):
        """Of HI without a constant and a slope as much in smooth spectra as of HI."""
        axes = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, N), 3))[0]
        without = np.eye(N) - axes[:, :2] @ axes[:, :2].T
        rest = without @ stationary() @ without
        found = faint_covariance(rest, CHANNELS, 2)
        expected, got, kept = (
            np.trace(axes.T @ one @ axes) / np.trace(one) for one in (stationary(), found, rest)
        )
        assert got == pytest.approx(expected, rel=0.12)
        assert kept < 0.7 * expected

    @pytest.mark.parametrize("n_modes", [9, 100, 2000])
    def test_of_samples_it_is_closer_than_they_are(self, rng, n_modes):
        sample = np.linalg.cholesky(stationary()) @ rng.standard_normal((N, n_modes))
        products = sample @ sample.T / n_modes
        found = faint_covariance(products, CHANNELS, 3)
        assert np.linalg.eigvalsh(found).min() > 0
        assert np.linalg.norm(found - stationary()) < 0.5 * np.linalg.norm(products - stationary())

    def test_channels_may_be_missing(self):
        """Distances count, not numbers of channels."""
        kept = np.delete(np.arange(N), [20, 21, 41])
        found = faint_covariance(stationary()[np.ix_(kept, kept)], CHANNELS[kept], 3)
        expected = faint_covariance(stationary(), CHANNELS, 3)[np.ix_(kept, kept)]
        assert np.abs(found - expected).max() < 0.1

    @pytest.mark.parametrize(
        "freqs",
        [
            np.delete(CHANNELS, np.arange(12, 30)),
            np.delete(CHANNELS, [3, 4, 20, 41]),
            np.sort(1 / np.linspace(1 / 900, 1 / 1400, N)),
        ],
    )
    def test_white_noise_is_white_however_channels_are_spaced(self, freqs):
        values = np.linalg.eigvalsh(faint_covariance(np.eye(len(freqs)), freqs, 3))
        assert values.min() > 0.5 and values.max() < 2


def narrow(rng, nside=16):
    """Two power laws, HI and noise in 24 channels of a narrow band; also HI and noise, and frequencies."""
    freqs, degrees = np.linspace(900, 1015, 24), np.arange(1.0, 2 * nside)
    fields = [np.r_[0, degrees[: nside - 1] ** -2.4]] * 2 + [np.r_[0, 1 / degrees[1:]]] * len(freqs)
    one, other, *hi = [sphere.synthesise(sphere.gaussian_alm(cl, rng), nside) for cl in fields]
    faint = hi + 0.3 * rng.standard_normal((len(freqs), 12 * nside**2))
    bright = (freqs / 1000)[:, None] ** np.array([-2.1, -2.8]) @ [1e3 * np.exp(one), 3 * np.exp(other)]
    return (bright + faint).astype(np.float32), faint, freqs


def test_where_it_takes_the_foreground_for_hi_it_has_not_converged():
    """On some skies hundreds of times the amplitude of HI remains; on others it is as it should be."""
    is_good = []
    for seed in range(10):
        maps, faint, freqs = narrow(np.random.default_rng(seed))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeparationWarning)
            try:
                found = SmoothSpectra(n_smooth=6).clean(maps, freqs=freqs, beams=np.ones((24, 48)))
            except InputError:
                continue
        is_good.append(found.residual.std() < 1.3 * faint.std())
        assert is_good[-1] or not found.separation.converged, seed
    assert 0 < sum(is_good) < len(is_good)
