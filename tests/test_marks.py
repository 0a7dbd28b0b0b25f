"""Tables of marks as figures."""

import csv
import io

import matplotlib
import numpy as np
import pytest

from himap.figures.planes import marks

LOOKS = {"good": ("✓", "#004400", "white"), "bad": ("✗", "#ffddbb", "black")}
GROUPS = {
    "first": {"A1": [["good", "good"], ["good", "bad"]]},
    "second": {"A2": [["bad"], []], "A3": [["bad", "bad"], ["good"]]},
}


@pytest.fixture
def figure():
    return marks(GROUPS, ["one", "two"], LOOKS, breaks=[1])


def test_signs_stand_in_their_cells(figure):
    (axes,) = figure.axes
    signs = [(text.get_text(), *text.get_position()) for text in axes.texts if text.get_text() in "✓✗"]
    wanted = [("✓", 0.5, 1), ("✓", 1.25, 1), ("✗", 1.75, 1), ("✗", 0.5, 3), ("✗", 0.5, 4), ("✓", 1.5, 4)]
    assert [(sign, x, int(y)) for sign, x, y in signs] == wanted
    assert [label.get_text() for label in axes.get_yticklabels()] == ["A1", "A2", "A3"]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["one", "two"]
    assert {text.get_text() for text in axes.texts} >= {"first", "second"}
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["✓ good", "✗ bad"]


def test_cells_have_their_colours(figure):
    colours = [matplotlib.colors.to_hex(patch.get_facecolor()) for patch in figure.axes[0].patches]
    dark, light = (look[1] for look in LOOKS.values())
    assert colours == [dark, dark, light, light, light, dark]


def test_it_carries_the_numbers_of_the_marks(figure):
    rows = list(csv.reader(io.StringIO(figure._repr_mimebundle_()["text/csv"])))
    assert rows[0] == ["panel", "curve", "x", "y"]
    assert rows[1:5] == [["A1", "one", "0", "0"], ["A1", "one", "1", "0"]] + [
        ["A1", "two", "0", "0"],
        ["A1", "two", "1", "1"],
    ]


def test_signs_fit_their_cells():
    """With as many columns as there are readings, a sign in half a cell does not touch the next."""
    rows = {f"A{n}": [["good", "bad"]] * 19 for n in range(4)}
    figure = marks({"all": rows}, [f"reading {n}" for n in range(19)], LOOKS)
    figure.canvas.draw()
    (axes,) = figure.axes
    widths = [patch.get_window_extent().width for patch in axes.patches]
    texts = [text.get_window_extent().width for text in axes.texts if text.get_text() in "✓✗"]
    assert max(texts) < min(widths)
    heights = [patch.get_window_extent().height for patch in axes.patches]
    assert np.ptp(heights) < 1
