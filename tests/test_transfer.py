"""Signal loss, from mocks, of linear filters and by bootstrap: closed forms, and measures of cubes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from smooth_problem import FREQS, hi_covariance
from smooth_problem import WIDTH as CHANNEL_WIDTH

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures.bootstrap import chance_of, covariance, sigma, squared_pull
from himap.measures.spectra import frequency_power
from himap.measures.transfer import (
    HarmonicPower,
    MockPower,
    TransferFunction,
    expected_mock_power,
    harmonic_power,
    mock_power,
)
from himap.removal import PCA
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data
from himap.removal.smooth_spectra import smooth_basis
from himap.removal.spectral_filter import SpectralFilter

NSIDE, N_CHANNELS, WIDTH = 16, 11, 2.5
LMAX = 12  # pixels hold this exactly enough


@pytest.fixture(params=[N_CHANNELS, N_CHANNELS + 1], ids=["odd", "even"])
def alms(rng, request):
    """A cube with another spectrum in every channel, no means, float32."""
    slopes = np.linspace(-1, -2, request.param)
    cls = [np.where(np.arange(LMAX + 1) > 0, (1.0 + np.arange(LMAX + 1)) ** slope, 0) for slope in slopes]
    return np.array([sphere.gaussian_alm(cl, rng) for cl in cls]).astype(np.complex64)


@pytest.fixture
def maps(alms):
    return sphere.synthesise_cube(alms, NSIDE, n_channels=len(alms), label="")


class TestHarmonicPower:
    def test_sums_are_both_spectra(self, alms, maps):
        power, frequency = harmonic_power(alms, WIDTH), frequency_power(maps, WIDTH)
        assert power.angular == pytest.approx(sphere.power_spectrum(alms).mean(axis=0), rel=1e-5)
        assert power.k == pytest.approx(frequency.k)
        assert power.frequency == pytest.approx(frequency.power, rel=1e-3)

    def test_bins_are_means_over_modes(self, alms):
        power = harmonic_power(alms, WIDTH)
        (mean,) = power.binned([2, 5])
        assert mean == pytest.approx((5 * power.power[2] + 7 * power.power[3] + 9 * power.power[4]) / 21)


def test_an_output_with_other_channels_is_refused(alms):
    empty = LowRankCube(spectra=np.ones((len(alms), 1)), maps=np.zeros((1, 12 * NSIDE**2)))
    for output in (empty, alms):
        with pytest.raises(InputError, match=f"has {len(alms)} channels, the input {len(alms) - 1}"):
            mock_power(alms[1:], output, WIDTH)


def made_up(kept, noise=0.0, input=1.0):
    """A mock of which a share of the amplitude comes back, and noise with it."""
    powers = (
        input * np.ones((5, 4)),
        input * kept**2 * np.ones((5, 4)) + noise,
        input * kept * np.ones((5, 4)),
    )
    return MockPower(*(HarmonicPower(power=power, n_channels=6, channel_width=1.0) for power in powers))


@pytest.mark.parametrize("n_channels", [6, 7])
def test_cross_power_of_neighbours_is_the_mean_over_pairs(rng, n_channels):
    """The last and the first are a pair too."""
    alms = rng.standard_normal((2, n_channels, sphere.alm_size(5))).T @ [1, 1j]
    alms = np.ascontiguousarray(alms.T)
    found = harmonic_power(alms, 2.0)
    both = sphere.power_spectrum(alms + np.roll(alms, 1, axis=0)).mean(axis=0)
    alone = sphere.power_spectrum(alms).mean(axis=0)
    assert found.neighbours == pytest.approx((both - 2 * alone) / 2)
    assert found.angular == pytest.approx(alone)


@pytest.mark.parametrize("n_l", [2, 5, 9])
def test_power_less_that_of_a_cube_that_ends_elsewhere(n_l):
    one, other = (
        HarmonicPower(power=power, n_channels=6, channel_width=1.0)
        for power in (np.full((5, 4), 3.0), np.ones((n_l, 4)))
    )
    expected = np.array([2.0] * min(n_l, 5) + [3.0] * (5 - min(n_l, 5)))
    assert one.less(other).power == pytest.approx(np.repeat(expected, 4).reshape(5, 4))
    assert (one.power == 3).all()


class TestTransferFunction:
    def test_what_comes_back_and_is_unlike_the_mocks_is_subtracted(self):
        """0.8 of the amplitude of mocks and data of power 5 comes back, and a foreground of 0.3."""
        found = TransferFunction(mocks=tuple(made_up(0.8, noise=0.3, input=size) for size in (1.0, 3.0)))
        unlike = 0.3 + (0.8**2 - 0.8) * 2  # what a projection would not keep counts as well
        residual = 0.8**2 * 5 + 0.3
        expected = (residual - unlike) / 0.8
        whole = made_up(1).input.angular  # that of power 1 at every k
        assert found.corrected("angular", residual * whole) == pytest.approx(expected * whole)
        projection = TransferFunction(mocks=(made_up(1.0, noise=0.3), made_up(1.0, noise=0.3)))
        assert projection.corrected("frequency", 5.3 * made_up(1).input.frequency) == pytest.approx(
            5 * made_up(1).input.frequency
        )
        assert projection.errors("angular") == pytest.approx(np.zeros((2, 5)), abs=1e-12)

    def test_what_is_kept_here_and_lost_there(self):
        """Half of the amplitude is lost at one k and one l, where twice the power of the rest is."""
        kept, input = np.ones((5, 4)), np.ones((5, 4))
        kept[3, 1], input[3, 1] = 0.5, 2
        found = TransferFunction(mocks=tuple(made_up(kept, input=size * input) for size in (1, 3)))
        assert found.angular[3] == pytest.approx((1 + 2 * 1 + 2 + 1) / (1 + 2 * 2 + 2 + 1))
        assert found.frequency[1] == pytest.approx((1 + 3 + 5 + 7 * 1 + 9) / (1 + 3 + 5 + 7 * 2 + 9))
        assert found.cylindrical([3, 4])[0, 1] == pytest.approx(0.5)
        assert np.delete(found.angular, 3) == pytest.approx(1)

    def test_no_input_is_nothing_kept(self):
        found = TransferFunction(mocks=(made_up(0.9, input=0),))
        assert not found.angular.any() and not found.cylindrical([0, 5]).any()

    def test_errors_are_those_of_mocks_corrected_by_the_others(self):
        """Powers 1 and 0.6 of projections that keep all: the one is corrected by the other's foreground."""
        found = TransferFunction(mocks=(made_up(1.0, noise=0.1), made_up(1.0, noise=0.3)))
        assert found.errors("frequency")[:, 0] == pytest.approx([0.1 - 0.3, 0.3 - 0.1])

    def test_sample_variance_is_that_of_the_inputs(self):
        found = TransferFunction(mocks=(made_up(1.0, input=1), made_up(0.5, input=3)))
        assert found.sample("angular")[:, 2] == pytest.approx([-(0.5**0.5), 0.5**0.5])


def test_ratios_of_output_and_cross():
    found = made_up(0.8, noise=0.1)
    for part, expected in (("output", 0.74), ("cross", 0.8)):
        for ratio in found.ratios(part).values():
            assert np.isnan(ratio[0]) and ratio[1:] == pytest.approx(expected)


class TestExpected:
    """What a linear filter keeps of HI: closed forms, and Gaussian fields that go through it."""

    @staticmethod
    def filter_of(spectra, estimators, faint):
        """The same at every l, as a separation."""
        linear = SpectralFilter(
            spectra=np.array([spectra] * (LMAX + 1)),
            estimators=np.array([estimators] * (LMAX + 1)),
            faint=np.array([faint]),
            first=np.array([0]),
        )
        return SimpleNamespace(filter=linear, mixing=spectra)

    @pytest.fixture
    def wiener(self):
        """Of three smooth spectra, two of them bright, the third like HI."""
        spectra, faint = smooth_basis(FREQS, 3) * [10, 3, 0.05], hi_covariance()
        data = spectra @ spectra.T + faint
        return self.filter_of(spectra, np.linalg.solve(data, spectra).T, faint)

    def test_a_projection_of_white_noise_keeps_what_it_leaves(self):
        basis = smooth_basis(FREQS, 4)
        found = expected_mock_power(self.filter_of(basis, basis.T, np.eye(len(FREQS))), CHANNEL_WIDTH)
        share = TransferFunction(mocks=(found,)).angular
        assert share[1:] == pytest.approx(np.full(LMAX, 1 - 4 / len(FREQS)))
        assert found.output.power == pytest.approx(found.cross.power)

    def test_there_are_no_channel_means(self, wiener):
        """They are subtracted, so that P(k) averaged over the sphere has (lmax + 1)^2 - 1 modes."""
        found = expected_mock_power(wiener, CHANNEL_WIDTH)
        assert (found.input.power[0] == 0).all() and (found.input.power[1:] > 0).all()

    def test_of_gaussian_fields_it_is_the_mean(self, wiener, rng):
        root = np.linalg.cholesky(wiener.filter.faint[0])
        white = (sphere.gaussian_alm(np.ones(LMAX + 1), rng) for _ in range(40 * len(FREQS)))
        alms = root @ np.array(list(white)).reshape(40, len(FREQS), -1)
        keeps = np.eye(len(FREQS)) - wiener.filter.spectra[0] @ wiener.filter.estimators[0]
        found = expected_mock_power(wiener, CHANNEL_WIDTH)
        for expected, fields in ((found.input, alms), (found.output, keeps @ alms)):
            measured = [harmonic_power(field, CHANNEL_WIDTH).power[2:].mean(axis=0) for field in fields]
            assert np.mean(measured, axis=0) == pytest.approx(expected.power[2:].mean(axis=0), rel=0.1)

    def test_the_foreground_that_is_left_fills_up_what_comes_back(self, wiener):
        """Of a Wiener filter: what is left in all has the power that HI has in common with itself."""
        linear = wiener.filter
        spectra, estimators, faint = linear.spectra[0], linear.estimators[0], linear.faint[0]
        keeps = np.eye(len(FREQS)) - spectra @ estimators
        left = keeps @ (faint + spectra @ spectra.T) @ keeps.T
        found = expected_mock_power(wiener, CHANNEL_WIDTH)
        assert found.cross.angular[1:] == pytest.approx(np.full(LMAX, np.trace(left) / len(FREQS)))
        assert (found.output.angular < found.cross.angular)[1:].all()


CHANNELS, STEP = np.linspace(900, 1000, 20, endpoint=False), 5.0


@pytest.mark.parametrize("n_mocks", [3, 8, 50])
def test_error_bars_of_few_draws_cover_68_percent_and_squared_pulls_are_as_expected(rng, n_mocks):
    """Gaussian biases of some mocks, each corrected by the mean of the others, and data by that of all."""
    data, mocks = np.split(rng.standard_normal((n_mocks + 1, 40_000)), [1])
    errors = mocks - (mocks.sum(axis=0) - mocks) / (n_mocks - 1)
    pulls = (data - mocks.mean(axis=0)) / sigma(errors)
    assert 0.67 < np.mean(np.abs(pulls) < 1) < 0.683 + 0.06 / (n_mocks - 1)
    expected = squared_pull(n_mocks)
    assert expected == np.inf if n_mocks == 3 else np.mean(pulls**2) == pytest.approx(expected, rel=0.05)


def test_a_covariance_is_that_of_what_was_drawn(rng):
    """Its diagonal is error bars squared, also of means; its expectation is the true one times Student's."""
    true = np.array([[4.0, -1.0, 0.0], [-1.0, 1.0, 0.5], [0.0, 0.5, 2.0]])
    found = [covariance(rng.multivariate_normal(np.zeros(3), true, size=6)) for _ in range(20_000)]
    factor = stats.t.ppf(stats.norm.cdf(1), 5) ** 2
    assert np.mean(found, axis=0) == pytest.approx(factor * true, abs=0.1)
    errors = rng.multivariate_normal(np.zeros(3), true, size=6)
    weights = np.array([[0.2, 0.3, 0.5], [1.0, 0.0, 0.0]])
    expected = weights @ covariance(errors) @ weights.T
    assert covariance(errors @ weights.T) == pytest.approx(expected)
    assert sigma(errors @ weights.T) == pytest.approx(np.sqrt(np.diag(expected)))


def white(rng):
    """Noise of 1 mK in pixels and channels, less its means."""
    maps = rng.standard_normal((len(CHANNELS), 12 * NSIDE**2))
    maps -= maps.mean(axis=1, keepdims=True)
    return maps.astype(np.float32)


def foreground(rng, n=3, brightness=(1e4, 1e3, 1e2)):
    """Of known rank and smooth spectra, each with a Gaussian map."""
    spectra = np.linalg.qr(CHANNELS[:, None] ** -np.arange(1.0, n + 1))[0] * np.sqrt(len(CHANNELS))
    return spectra @ (np.array(brightness)[:n, None] * rng.standard_normal((n, 12 * NSIDE**2)))


def members(cleaned, mocks, separation=None):
    """The `TransferFunction` of members of a bootstrap, with the foreground of a `Separation`."""
    separation = cleaned.separation if separation is None else separation
    powers = (powers_of(separation, cleaned.resampled(mock, separation), mock) for mock in mocks)
    return TransferFunction(mocks=tuple(powers))


def powers_of(before, member, mock):
    wrong = (before.foreground + -member.separation.foreground).truncate(0)
    return mock_power(sphere.analyse(mock), wrong, STEP)


def power_of(cleaned):
    return harmonic_power(sphere.analyse(cleaned.residual), STEP)


class TestClosedForms:
    """PCA with as many components as a bright foreground has is a projection whose axes are known."""

    @pytest.fixture
    def cleaned(self, rng):
        maps = (foreground(rng) + white(rng)).astype(np.float32)
        return Cleaning.of(Data.of(maps, freqs=CHANNELS), PCA(n_sources=3), peaks=False)

    def test_the_loss_is_that_of_the_projection(self, cleaned, rng):
        """Of white noise n_s of n channels, in C_l; in P(k) the share of the axes at that k."""
        found = members(cleaned, [white(rng) for _ in range(4)])
        assert found.angular[4:].mean() == pytest.approx(1 - 3 / 20, rel=2e-3)
        waves = np.abs(np.fft.rfft(cleaned.separation.mixing, axis=0)) ** 2
        share = waves.sum(axis=1) / np.linalg.norm(cleaned.separation.mixing[:, 0]) ** 2 / 20
        assert found.frequency[2:] == pytest.approx(1 - share[2:], abs=0.01)

    def test_the_covariance_of_a_projection_is_the_sample_variance_of_the_lost(self, cleaned, rng):
        """It leaves no foreground: corrected power is off by what the lost modes have more than their share.

        Of a Gaussian this has the variance 2 n_s / ((2 l + 1) n (n - n_s)) in C_l over channels of the sum.
        """
        found = members(cleaned, [white(rng) for _ in range(30)])
        degrees = np.arange(10, 40)
        errors = found.errors("angular")[:, degrees]
        expected = np.sqrt(2 * 3 / ((2 * degrees + 1) * 20 * 17))
        assert np.sqrt(np.mean((errors / expected) ** 2)) == pytest.approx(1, abs=0.1)
        correlation = np.corrcoef(errors.T)
        assert np.abs(correlation[np.triu_indices(len(degrees), 1)]).mean() < 0.2


class TestAMissedSource:
    """Of a faint fourth source PCA of three leaves nearly all: its power is known, a share of white noise."""

    @staticmethod
    def cleaned(rng, faint, truth):
        """PCA of three sources, and the true foreground, a `Separation`."""
        true = foreground(rng, 4, (1e4, 1e3, 1e2, faint))
        true -= true.mean(axis=1, keepdims=True)
        maps = (true + truth).astype(np.float32)
        cleaned = Cleaning.of(Data.of(maps, freqs=CHANNELS), PCA(n_sources=3), peaks=False)
        spectra = np.linalg.svd(true, full_matrices=False)[0][:, :4]
        known = replace(cleaned.separation, mixing=spectra, sources=spectra.T @ true)
        return cleaned, known

    @pytest.mark.parametrize("faint", [0.1, 0.3, 1.0])
    def test_its_power_is_unlike_the_mocks(self, rng, faint):
        """In C_l averaged over channels it has faint^2 of the power of noise of 1 mK."""
        cleaned, known = self.cleaned(rng, faint, white(rng))
        found = members(cleaned, [white(rng) for _ in range(8)], known)
        true = np.mean([one.input.angular for one in found.mocks], axis=0)
        residual = np.mean([one.output.angular for one in found.mocks], axis=0)
        excess = np.mean(((residual - found.angular * true) / true)[5:40])
        assert excess == pytest.approx(faint**2, rel=0.1, abs=0.003)

    def test_error_bars_cover_where_members_have_it(self, rng):
        """And not where the estimated foreground lacks it: the residual is high by its power."""
        pulls = {True: [], False: []}
        for _ in range(6):
            truth = white(rng)
            cleaned, known = self.cleaned(rng, 0.2, truth)
            true, residual = harmonic_power(sphere.analyse(truth), STEP).angular, power_of(cleaned).angular
            mocks, bands = [white(rng) for _ in range(8)], np.array_split(np.arange(4, 40), 6)
            for knows, separation in ((True, known), (False, None)):
                found = members(cleaned, mocks, separation)
                excess, errors = found.corrected("angular", residual) / true - 1, found.errors("angular")
                pulls[knows] += [excess[band].mean() / sigma(errors[:, band].mean(axis=1)) for band in bands]
        assert 0.45 < np.mean(np.abs(pulls[True]) < 1) < 0.9
        assert np.sqrt(np.mean(np.square(pulls[True]))) < 1.6 and abs(np.mean(pulls[True])) < 0.6
        assert np.median(pulls[False]) > 3


@pytest.mark.parametrize("n_mocks", [2, 4, 30])
def test_one_error_bar_is_exceeded_by_32_percent(n_mocks):
    """With Student's factor, however few the mocks."""
    assert chance_of(1, n_mocks) == pytest.approx(2 * stats.norm.sf(1))
