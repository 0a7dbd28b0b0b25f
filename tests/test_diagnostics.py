"""Measures of how good a cleaning is, against plain formulas."""

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.measures import diagnostics
from himap.measures.diagnostics import Comparison


def test_flagged_lines_are_further_than_sigma_from_the_mean():
    errors = np.array([1.0] * 18 + [0.9, 30.0])
    assert diagnostics.flagged_lines(errors).tolist() == [False] * 19 + [True]
    low = np.array([10.0] * 19 + [0.0])  # the rule of the paper is two-sided
    assert diagnostics.flagged_lines(low).tolist() == [False] * 19 + [True]


def test_error_variance(rng):
    true = 1 + rng.random((6, 10))
    recovered = true * (1 + 0.1 * rng.standard_normal((6, 10)))
    expected = ((true - recovered) / true).var(axis=0)
    assert diagnostics.error_variance(recovered, true) == pytest.approx(expected)
    assert diagnostics.error_variance(0.7 * true, true) == pytest.approx(0, abs=1e-30)


def test_definitions_of_the_mean_squared_error():
    true, found = np.array([1.0, 4.0]), np.array([2.0, 4.0])
    assert diagnostics.mean_squared_error(found, true) == pytest.approx(0.5)
    assert diagnostics.mean_squared_error(found, true, "logarithmic") == pytest.approx(np.log(2) ** 2 / 2)
    assert diagnostics.mean_squared_error(found, true, "absolute") == pytest.approx(1 / 17)
    for definition in diagnostics.MSE_DEFINITIONS:
        assert diagnostics.mean_squared_error(true, true, definition) == 0
    with pytest.raises(
        InputError, match="unknown definition 'rms'; there are relative, logarithmic, absolute"
    ):
        diagnostics.mean_squared_error(found, true, "rms")


def test_bands():
    x, values = np.arange(5.0), np.array([9.0, 1.0, 3.0, 2.0, 9.0])
    assert diagnostics.band_mean(x, values, 0, 4) == 2
    assert diagnostics.band_max(x, values, 0, 4) == 3
    assert diagnostics.largest_deviation(x, values, 0, 4) == (2.0, 2.0)
    with pytest.raises(InputError, match="nothing lies between 4 and 9: the values go from 0 to 4"):
        diagnostics.band_max(x, values, 4, 9)


@pytest.mark.parametrize(
    ("pair", "message"), [(([1.0], [1.0, 2.0]), "one shape"), (([1.0], [0.0]), "must be positive")]
)
def test_bad_spectra(pair, message):
    with pytest.raises(InputError, match=message):
        diagnostics.ratio(*pair)


def comparison(degrees, angular, k, frequency):
    """A `Comparison` with a truth of 1."""
    true = {"true_angular": np.ones(len(degrees)), "true_frequency": np.ones(len(k))}
    return Comparison(degrees=degrees, angular=angular, k=k, frequency=frequency, **true)


def test_means_over_bands():
    degrees, k = np.arange(2, 257), np.arange(1, 51) * 0.02
    means = comparison(degrees, degrees / 10, k, k**2).wide_band_means()
    assert means["C/C0, 1 < l < 10"] == pytest.approx(0.55)
    assert means["C/C0, 10 < l < 200"] == pytest.approx(10.5)
    assert means["P/P0, 0 < k < 0.03"] == pytest.approx(4e-4)
    assert means["P/P0, highest near k = 0.31"] == pytest.approx(0.36**2)


def test_bands_without_values_are_left_out():
    few = comparison(np.arange(2, 9), np.ones(7), np.array([0.05, 0.2]), np.array([3.0, 5.0]))
    means = few.wide_band_means()
    assert means == {"C/C0, 1 < l < 8": 1, "P/P0, 0.03 < k < 0.1": 3, "P/P0, k > 0.1": 5}


def test_median_of_a_band_is_not_moved_by_a_peak():
    k = np.arange(9.0)
    ratios = np.where(k == 4, 1e6, k)
    assert diagnostics.band_median(k, ratios, 1, 7) == 5
    with pytest.raises(InputError, match="nothing lies between 10 and 20"):
        diagnostics.band_median(k, ratios, 10, 20)


def test_a_spectrum_in_the_bins_of_another():
    """Bins of three from l = 3, the last of which the first spectrum does not cover."""
    degrees = np.arange(2.0, 10)
    rest = {"k": np.ones(1), "frequency": np.ones(1), "true_frequency": np.ones(1)}
    whole = Comparison(degrees=degrees, angular=degrees**2, true_angular=degrees, **rest)
    bins = np.array([4.0, 7.0, 10.0])
    binned = whole.in_bins_of(Comparison(degrees=bins, angular=bins, true_angular=bins, **rest))
    assert binned.degrees.tolist() == [4, 7]
    assert binned.angular == pytest.approx([50 / 3, 149 / 3])
    assert binned.angular_ratio == pytest.approx([50 / 12, 149 / 21])
    same = whole.in_bins_of(whole)
    assert np.array_equal(same.angular, whole.angular) and np.array_equal(same.degrees, degrees)
