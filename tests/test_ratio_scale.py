"""The axis of ratios: there and back, what is seen near 1, and the numbers beside it."""

import numpy as np
import pytest

from himap.figures import axes as ratio_scale
from himap.figures import plotting


def test_there_and_back():
    ratios = np.array([1e-3, 0.5, 0.999, 1, 1.05, 2, 1e7])
    assert ratio_scale.backward(ratio_scale.forward(ratios)) == pytest.approx(ratios)
    ratios = ratios[:-1]  # what is below 1e-4 is drawn there
    assert ratio_scale.forward(1 / ratios) == pytest.approx(-ratio_scale.forward(ratios))
    assert ratio_scale.forward(1.001) == pytest.approx(0.001 / ratio_scale.NEAR, rel=1e-2)


def test_nothing_negative_is_lost():
    assert np.isfinite(ratio_scale.forward([-1, 0])).all()


def test_limits_hold_all_and_the_surroundings_of_1():
    low, high = ratio_scale.ratio_limits([[0.99, 1.01], [np.nan]])
    assert (low, high) == (0.8, 1.2)
    low, high = ratio_scale.ratio_limits([[0.01, 1e7]])
    assert low < 0.01 and high > 1e7


@pytest.mark.parametrize("limits", [(0.8, 1.2), (0.5, 100), (1e-3, 1e7), (0.9, 1.1)])
def test_numbers_find_room(limits):
    shown = ratio_scale.ratio_ticks(*limits)
    places = ratio_scale.forward(shown)
    height = np.ptp(ratio_scale.forward(limits))
    assert 1 in shown and len(shown) >= 3
    assert np.diff(places).min() >= 0.06 * height and limits[0] <= shown[0] <= shown[-1] <= limits[1]


def test_five_percent_are_seen_beside_a_factor_of_ten_million():
    """On an axis of 300 pixels: more than 10 of them."""
    height = np.ptp(ratio_scale.forward(ratio_scale.ratio_limits([[0.9, 1e7]])))
    assert 300 * ratio_scale.forward(1.05) / height > 10


def test_figure():
    x, mean = np.array([2.0, 10, 100]), np.array([0.9, 1.0, 30])
    style = {"label": "one", "color": "C0"}
    panel = {"curves": [(x, mean, 0.9 * mean, 1.1 * mean, style)], "title": "sky", "xlabel": "l"}
    figure = plotting.ratios([panel, panel | {"title": "other"}], columns=2)
    first, second = figure.axes
    assert first.get_ylim() == second.get_ylim() and first.get_ylim()[1] > 33
    assert [label.get_text() for label in first.get_yticklabels()][:2] == ["0.8", "0.9"]
    assert len(figure.legends[0].get_texts()) == 1
    (data,) = figure._repr_mimebundle_().values()
    assert 'sky,"one, mean",100,30' in data and 'sky,"one, high",100,33' in data
