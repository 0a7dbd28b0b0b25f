"""Figures of what readings lead to."""

import csv
import io

import pytest
from ledgers import outcome, run

from himap.paper.claims import FAILED, INAPPLICABLE, REPRODUCED
from himap.paper.readings_figures import bands_figure, claims_figure, code_figure, curves_figure

RUNS = [run(seed, restart) for seed in (7, 8) for restart in (0, 1)]
VERDICTS = {"D1": [REPRODUCED, REPRODUCED], "O3": [REPRODUCED, FAILED], "M2": INAPPLICABLE}
OUTCOMES = {
    "default": outcome(VERDICTS, runs=RUNS),
    "code": outcome(VERDICTS | {"O3": [REPRODUCED] * 2}, runs=[run(7, bump=40.0), run(8)]),
    "last = repeated": outcome(VERDICTS, runs=[run(7, **{"P/P0, k > 0.1": 1e9, "P/P0, k < 0.03": None})]),
}


def numbers(figure):
    """[(panel, curve, x, y)] that a figure carries."""
    _, *rows = csv.reader(io.StringIO(figure._repr_mimebundle_()["text/csv"]))
    return [(panel, curve, float(x), float(y)) for panel, curve, x, y in rows]


def test_claims_are_grouped_by_where_they_stand():
    figure = claims_figure(OUTCOMES)
    (axes,) = figure.axes
    rows = [label.get_text().split()[-1] for label in axes.get_yticklabels()]
    assert rows == ["D1", "O3", "M2"]
    headings = [text.get_text() for text in axes.texts if text.get_weight() == "bold"]
    assert headings == ["under every reading", "depends on the reading", "does not apply"]
    marks = {(row.split()[-1], column, x): mark for row, column, x, mark in numbers(figure)}
    assert marks["O3", "default", 0] == 2
    assert marks["O3", "code", 0] == 0


def test_bands_have_a_point_for_every_run():
    figure = bands_figure(OUTCOMES)
    titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
    assert len(titles) == 5 and "$C/C_0$, 5 to 9" not in titles  # bands that no run has are left out
    found = [row for row in numbers(figure) if row[0] == "$P/P_0$, bump" and row[1]]
    assert len(found) == 7
    assert {curve for _, curve, *_ in found} == {
        "seed 7",
        "seed 7, restart 1",
        "seed 8",
        "seed 8, restart 1",
    }
    ((_, curve, _, row),) = [one for one in found if one[2] == 40]
    assert curve == "seed 7" and 0.5 < row < 1.5  # the second row, above the third
    assert max(x for title, _, x, _ in numbers(figure) if title == "$P/P_0$, k > 0.1") == 1000  # at the edge
    by_title = {axes.get_title(): axes for axes in figure.axes}
    assert by_title["$P/P_0$, bump"].get_xscale() == "log"
    assert by_title["$C/C_0$, 2 to 4"].get_xscale() == "linear"
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels == ["default", "code", "last = repeated"]


def test_curves_of_the_readings_with_a_name():
    figure = curves_figure(OUTCOMES)
    assert [axes.get_title() for axes in figure.axes] == [
        "seed 7, across the sky",
        "seed 7, along the line of sight",
        "seed 8, across the sky",
        "seed 8, along the line of sight",
    ]
    found = {(panel, curve) for panel, curve, *_ in numbers(figure)}
    assert {curve for panel, curve in found if panel == "seed 8, across the sky"} == {
        *(f"default: {part}" for part in ("16 %", "median", "84 %", "restart 0", "restart 1")),
        "code",
        "truth",
    }
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["default", "code"]
    rows = [row[2:] for row in numbers(figure) if row[:2] == ("seed 7, along the line of sight", "code")]
    assert rows == [(0.1, 0.5), (0.2, 1.0)]


def test_both_sides_of_the_comparison_with_the_code():
    figure = code_figure({"mad": ([1e-9, 1e-8], [1e-7, 1e-6])}, (1, 5))
    found = numbers(figure)
    assert [y for panel, _, _, y in found if "authors" in panel] == pytest.approx([1e-9, 1e-8])
    assert [y for panel, _, _, y in found if "change" in panel] == pytest.approx([1e-7, 1e-6])
