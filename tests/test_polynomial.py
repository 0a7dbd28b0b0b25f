"""The polynomial fit and peak masking: exact on polynomials, the numbers of numpy, what becomes of peaks."""

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.removal.peaks import baseline_basis, mask_peaks, smooth_baselines
from himap.removal.polynomial import Polynomial

FREQS = np.linspace(902.5, 1397.5, 100)
U = (FREQS - 1150) / 247.5


@pytest.fixture
def sextic(rng):
    """Any polynomial of order 6 along each line of sight, around 1e3 mK."""
    return U[:, None] ** np.arange(7) @ (1e3 * rng.standard_normal((7, 48)))


def clean(maps, **options):
    return Polynomial(**options).clean(maps, freqs=FREQS)


def test_the_fit_is_that_of_numpy(sextic, rng):
    maps = sextic + rng.standard_normal(sextic.shape)
    expected = np.polynomial.polynomial.polyval(U, np.polynomial.polynomial.polyfit(U, maps, 4)).T
    residual = clean(maps, order=4).residual
    assert residual == pytest.approx(maps - expected, abs=2e-3)


def test_peaks_stay_in_the_residual(sextic, rng):
    """Without the clip the fit takes a part of the peak; with it all of the peak is left."""
    signal = 0.01 * rng.standard_normal(sextic.shape)
    signal[40] += 5
    peak = clean(sextic + signal).residual[40]
    pulled = clean(sextic + signal, n_sigma=50).residual[40]
    assert peak == pytest.approx(signal[40], abs=0.03)
    assert (pulled < 0.98 * peak).all()


def test_sources_are_coefficients_of_the_mixing(sextic):
    separation = clean(sextic).separation
    assert separation.mixing.shape == (100, 7)
    assert separation.mixing.T @ separation.mixing == pytest.approx(np.eye(7), abs=1e-13)
    model = separation.mixing @ separation.sources
    assert separation.foreground.cube() == pytest.approx(model, rel=1e-7)


class TestLogarithm:
    """log T as a polynomial of log nu."""

    @pytest.fixture
    def laws(self, rng):
        """Power laws with a running of the index, around 1e4 mK."""
        x, (index, running) = np.log(FREQS / 1150)[:, None], rng.standard_normal((2, 48))
        return 1e4 * np.exp(rng.standard_normal(48) + (index - 2.7) * x + running * x**2)

    def test_power_laws_are_exact(self, laws):
        """In all channels, in few of them, and in a wide band at low frequencies."""
        low = np.linspace(50, 250, 64)
        wide = 1e5 * (low[:, None] / 100) ** np.array([-2.7, -2.4])
        for maps, freqs, close in ((laws, FREQS, 1e-6), (laws[:20], FREQS[:20], 1e-6), (wide, low, 1e-4)):
            found = Polynomial(variable="logarithm", order=2).clean(maps, freqs=freqs)
            assert found.residual == pytest.approx(0 * maps, abs=close)
        assert np.abs(clean(laws, order=2).residual).max() > 1

    def test_the_fit_is_that_of_numpy(self, laws, rng):
        maps, x = laws * (1 + 0.01 * rng.standard_normal(laws.shape)), np.log(FREQS)
        fit = np.polynomial.Polynomial.fit
        logs = np.array([fit(x, line, 3)(x) for line in np.log(maps).T]).T
        residual = clean(maps, order=3, variable="logarithm").residual
        assert residual == pytest.approx(maps - np.exp(logs), rel=1e-4, abs=0.05)

    @pytest.mark.parametrize("missing", [slice(10, 15), slice(80, None)], ids=["within", "at the end"])
    def test_missing_voxels_change_nothing_else(self, laws, rng, missing):
        """Where a fit goes on beyond what is seen it may be steep; the channels that are seen are exact."""
        weights, maps = np.ones(laws.shape), laws + 10 * rng.standard_normal(laws.shape)
        weights[missing, ::2] = 0
        kept, gaps = weights[:, 0] > 0, np.where(weights > 0, maps, -5.0)
        method = Polynomial(order=6, variable="logarithm")
        residual = method.clean(gaps, freqs=FREQS, weights=weights).residual
        assert np.isfinite(residual).all()
        logs = np.log(maps[kept][:, ::2])
        x = np.log(FREQS[kept])
        expected = [np.polynomial.Polynomial.fit(x, line, 6)(x) for line in logs.T]
        seen = maps[kept][:, ::2] - np.exp(np.array(expected).T)
        assert residual[kept][:, ::2] == pytest.approx(seen, abs=0.5)


N_PIX = 60


@pytest.fixture
def smooth():
    """Power laws of many indices, 1e4 mK, as polynomials of order 6: what these cannot follow is 0.1 mK."""
    laws = 1e4 * (FREQS[:, None] / 1150) ** np.linspace(-3.2, -2.1, N_PIX)
    return np.polynomial.chebyshev.chebval(U, np.polynomial.chebyshev.chebfit(U, laws, 6)).T


@pytest.fixture
def peaked(smooth, rng):
    """Noise of 0.05 mK; up to three peaks on two of three lines of sight, also at the ends of the band."""
    lines = smooth + 0.05 * rng.standard_normal(smooth.shape)
    where = np.zeros(lines.shape, dtype=bool)
    for pixel in np.flatnonzero(np.arange(N_PIX) % 3):
        where[rng.choice(len(FREQS), 1 + pixel % 3, replace=False), pixel] = True
    where[0, 1] = where[-1, 2] = True
    return lines + np.where(where, rng.choice([2, -2], where.shape), 0), where


def twin(line, kept):
    """The plain fit of numpy, to the channels that are kept."""
    return np.polynomial.Polynomial.fit(FREQS[kept], line[kept], 6)(FREQS)


def test_both_fits_are_those_of_numpy(peaked):
    lines, where = peaked
    found = smooth_baselines(lines, FREQS)
    for pixel, line in enumerate(lines.T):
        first = twin(line, np.full(len(FREQS), True))
        assert found.basis @ found.first[:, pixel] == pytest.approx(first, abs=1e-9)
        outliers = np.abs(line - first) > 5 * np.std(line - first)
        assert np.array_equal(found.flagged[:, pixel], outliers)
        assert found.basis @ found.second[:, pixel] == pytest.approx(twin(line, ~outliers), abs=1e-9)
    assert found.flagged.sum() > 30 and (found.flagged <= where).all()


@pytest.mark.parametrize(
    "spread, deviation",
    [
        ("channel", lambda rest: rest.std(axis=1, keepdims=True)),
        ("cube", lambda rest: rest.std()),
        ("mad", lambda rest: 1.4826 * np.median(np.abs(rest), axis=0)),
    ],
)
def test_the_spread_of_channel_cube_and_median(peaked, spread, deviation):
    lines, _ = peaked
    rest = lines - np.array([twin(line, np.full(len(FREQS), True)) for line in lines.T]).T
    rest -= rest.mean(axis=1, keepdims=True) if spread == "channel" else 0
    flagged = smooth_baselines(lines, FREQS, spread=spread).flagged
    assert np.mean(flagged == (np.abs(rest) > 5 * deviation(rest))) > 0.999
    assert flagged.any() and not np.array_equal(flagged, smooth_baselines(lines, FREQS).flagged)


def test_a_ripple_is_a_peak_of_the_cube_but_never_of_its_line(smooth, rng):
    """A sine of amplitude 1 is sqrt(2) of its own deviations, whatever its amplitude."""
    lines = smooth + 0.05 * rng.standard_normal(smooth.shape)
    lines[:, 7] += 10 * np.sin(np.arange(100))
    assert not smooth_baselines(lines, FREQS).flagged[:, 7].any()
    found = smooth_baselines(lines, FREQS, spread="cube")
    assert found.flagged[:, 7].mean() > 0.5 and not np.delete(found.flagged, 7, axis=1).any()
    assert np.array_equal(found.second[:, 7], found.first[:, 7]) or found.flagged[:, 7].mean() < 0.93


@pytest.mark.parametrize("even", [True, False])
def test_many_channels_left_out_at_one_end(even, rng):
    """The worst case for the normal equations: 15 of 100 channels at the end of the band are flagged."""
    freqs = FREQS if even else np.sort(rng.uniform(900, 1400, 100))
    line = np.where(np.arange(100) < 15, 50.0, 0.0) + 1e4 * (freqs / 1150) ** -2.7
    found = smooth_baselines(line[:, None], freqs, order=2, n_sigma=1.5)
    kept = ~found.flagged[:, 0]
    assert np.count_nonzero(~kept) >= 3 and not kept[0]
    expected = np.polynomial.Polynomial.fit(freqs[kept], line[kept], 2)(freqs)
    assert found.basis @ found.second[:, 0] == pytest.approx(expected, abs=1e-8)


def test_a_peak_is_replaced_by_the_smooth_sky(smooth, rng):
    lines = smooth + 1e-4 * rng.standard_normal(smooth.shape)
    lines[40, 7] += 20
    masked = mask_peaks(lines, FREQS)
    assert np.argwhere(masked.flagged).tolist() == [[40, 7]]
    assert masked.maps == pytest.approx(smooth, abs=2e-3)  # float32 of 1e4 mK
    assert np.array_equal(masked.maps == lines.astype(np.float32), ~masked.flagged)
    assert masked.maps.dtype == np.float32


def test_high_orders_keep_their_digits(rng):
    """Polynomials of order 60: powers of the frequency would be noise there."""
    series = rng.standard_normal((61, 3))
    lines = np.polynomial.chebyshev.chebval(U, series).T
    found = smooth_baselines(lines, FREQS, order=60, n_sigma=50)
    assert found.basis.T @ found.basis == pytest.approx(np.eye(61), abs=1e-13)
    assert found.basis @ found.first == pytest.approx(lines, abs=1e-11)


def test_the_lowest_threshold_that_is_allowed_leaves_enough_channels(rng):
    """Nine channels, order 1: what can be flagged at the lowest threshold is at most six of them."""
    noise = rng.standard_t(1, (9, 5000))
    freqs = np.linspace(900, 1400, 9)
    with pytest.raises(InputError, match="could flag 7 of 9"):
        smooth_baselines(noise, freqs, order=1, n_sigma=1.1)
    found = smooth_baselines(noise, freqs, order=1, n_sigma=1.14)
    assert found.flagged.sum(axis=0).max() <= 6
    assert np.isfinite(found.second).all()


def test_clipping_with_many_gaps_and_uneven_weights(rng):
    """Deviations are of what is seen, and each is in units of the error that its weight is of.

    So a bright voxel of little weight stays.
    """
    freqs = np.linspace(900, 1100, 60)
    lines, weights = rng.standard_normal((60, 400)), rng.choice([0.0, 1e-6, 0.2, 1.0, 3.0], (60, 400))
    lines[weights == 1e-6] += 30
    found = mask_peaks(lines, freqs, order=2, n_sigma=2.2, weights=weights)
    basis = baseline_basis(freqs, 2)

    def fit(line, weight):
        root = np.sqrt(weight)
        return basis @ np.linalg.lstsq(root[:, None] * basis, root * line, rcond=None)[0]

    rows = zip(lines.T, weights.T, found.flagged.T, found.maps.T, strict=True)
    for line, weight, flagged, masked in rows:
        pull = np.sqrt(weight) * np.abs(line - fit(line, weight))
        assert np.array_equal(flagged, pull > 2.2 * np.sqrt(np.sum(pull**2) / np.count_nonzero(weight)))
        assert masked[flagged] == pytest.approx(fit(line, weight * ~flagged)[flagged], abs=1e-6)
    assert found.flagged.any()
