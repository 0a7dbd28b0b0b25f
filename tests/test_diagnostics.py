"""Measures of how good a cleaning is, against plain formulas."""

import numpy as np
import pytest
from skies import comparison

from himap.measures import diagnostics
from himap.measures.diagnostics import Comparison, band_means, bands
from himap.measures.spectra import AngularPower, FrequencyPower, PowerSpectra


@pytest.mark.parametrize("errors", [[1.0] * 18 + [0.9, 30.0], [10.0] * 19 + [0.0]], ids=["above", "below"])
def test_flagged_lines_are_further_than_sigma_from_the_mean(errors):
    assert diagnostics.flagged_lines(np.array(errors)).tolist() == [False] * 19 + [True]


def test_averages_over_channels():
    """C/C0 is 1, 1/2 and 3 in three channels of which the last is the brightest."""
    true, recovered = np.array([[1.0], [2.0], [6.0]]), np.array([[1.0], [1.0], [18.0]])

    def spectra(cl):
        angular = AngularPower(degrees=np.array([2.0]), cl=cl)
        return PowerSpectra(angular=angular, frequency=FrequencyPower(k=np.arange(2.0), power=np.ones(2)))

    expected = {"means": 20 / 9, "ratios": 1.5, "middle": 0.5}
    assert expected.keys() == diagnostics.AVERAGES.keys()
    for average, ratio in expected.items():
        found = Comparison.of(spectra(recovered), spectra(true), l_top=2, average=average)
        assert found.angular_ratio == pytest.approx([ratio])
        assert found.true_angular == pytest.approx([2.0 if average == "middle" else 3.0])


def test_error_variance(rng):
    true = 1 + rng.random((6, 10))
    recovered = true * (1 + 0.1 * rng.standard_normal((6, 10)))
    expected = ((true - recovered) / true).var(axis=0)
    assert diagnostics.error_variance(recovered, true) == pytest.approx(expected)
    assert diagnostics.error_variance(0.7 * true, true) == pytest.approx(0, abs=1e-30)


def test_definitions_of_the_mean_squared_error():
    true, found = np.array([1.0, 4.0]), np.array([2.0, 4.0])
    expected = {"relative": 0.5, "logarithmic": np.log(2) ** 2 / 2, "absolute": 1 / 17}
    assert expected.keys() == diagnostics.MSE_DEFINITIONS.keys()
    for definition, error in expected.items():
        assert diagnostics.mean_squared_error(found, true, definition) == pytest.approx(error)
        assert diagnostics.mean_squared_error(true, true, definition) == 0
        assert diagnostics.mean_squared_error(np.append(found[1:], np.nan), true, definition) == np.inf
    assert diagnostics.mean_squared_error(-true, true, "logarithmic") == np.inf


def test_within_two_ends():
    x, values = np.arange(5.0), np.array([9.0, 1.0, 6.0, 2.0, 9.0])
    assert diagnostics.inside(x, values, 0, 4).tolist() == [1, 6, 2]


class TestBands:
    K = np.arange(1, 20) * 0.0126

    def test_those_that_are_reached_to_their_end(self):
        found = bands(np.arange(30), self.K)
        assert list(found)[:3] == ["C/C0, 2-4", "C/C0, 5-9", "C/C0, 10-19"]
        assert found["C/C0, 2-4"][1].nonzero()[0].tolist() == [2, 3, 4]
        places = [inside.nonzero()[0].tolist() for kind, inside in found.values() if kind == "frequency"]
        assert places == [[0, 1], [2, 3, 4, 5, 6], list(range(7, 19))]
        assert "C/C0, 20-39" in bands(np.arange(30), self.K, complete=False)

    def test_middles_of_bins(self):
        assert list(bands(np.array([7.0, 12, 17, 22]), self.K))[:2] == ["C/C0, 5-9", "C/C0, 10-19"]
        assert "C/C0, 10-19" not in bands(np.array([14.5, 18.5]), self.K)

    def test_means(self):
        known = {"angular": np.arange(60.0).reshape(2, 30), "frequency": self.K}
        found = band_means(known, np.arange(30), self.K)
        assert found["C/C0, 10-19"].tolist() == [14.5, 44.5]
        assert found["P/P0, k > 0.1"] == pytest.approx(self.K[7:].mean())
        table = {"high": ("frequency", 0.1, np.inf), "none": ("frequency", 1, 2)}
        assert list(band_means(known, np.arange(30), self.K, table)) == ["high"]

    def test_wide_bands(self):
        degrees, k = np.arange(2, 257), np.arange(1, 51) * 0.02
        means = comparison(degrees, degrees / 10, k, k**2).wide_band_means()
        assert means["C/C0, 1 < l < 10"] == pytest.approx(0.55)
        assert means["C/C0, 10 < l < 200"] == pytest.approx(10.5)
        assert means["P/P0, 0 < k < 0.03"] == pytest.approx(4e-4)
        assert means["P/P0, highest near k = 0.31"] == pytest.approx(0.36**2)
        few = comparison(np.arange(2, 9), np.ones(7), [0.05, 0.2], [3.0, 5.0]).wide_band_means()
        assert few == {"C/C0, 1 < l < 8": 1, "P/P0, 0.03 < k < 0.1": 3, "P/P0, k > 0.1": 5}


def test_a_spectrum_in_the_bins_of_another():
    """Bins of three from l = 3, the last of which the first spectrum does not cover."""
    degrees, bins = np.arange(2.0, 10), np.array([4.0, 7.0, 10.0])
    fine = comparison(degrees, degrees**2)
    binned = fine.in_bins_of(comparison(bins, bins))
    assert binned.degrees.tolist() == [4, 7]
    assert binned.angular_ratio == pytest.approx([50 / 3, 149 / 3])
    same = fine.in_bins_of(fine)
    assert np.array_equal(same.angular, fine.angular) and np.array_equal(same.degrees, degrees)
