"""Figures and tables of what readings lead to."""

import csv
import io
from dataclasses import replace

import pytest
from ledgers import contrast, luminance, outcome, run

from himap.paper import readings_table as tables
from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.readings import readings
from himap.paper.readings_figures import bands_figure, claims_figure, code_figure, curves_figure
from himap.paper.readings_table import MARKS, decisive_options, insensitive_claims, robustness, summary_table
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

RUNS = [run(seed, restart) for seed in (7, 8) for restart in (0, 1)]
VERDICTS = {"D1": [REPRODUCED, REPRODUCED], "O3": [REPRODUCED, FAILED], "M2": INAPPLICABLE}
SHOWN = {
    "default": outcome(VERDICTS, runs=RUNS),
    "code": outcome(VERDICTS | {"O3": [REPRODUCED] * 2}, runs=[run(7, bump=40.0), run(8)]),
    "last = repeated": outcome(VERDICTS, runs=[run(7, **{"P/P0, k > 0.1": 1e9, "P/P0, k < 0.03": None})]),
}


def numbers(figure):
    """[(panel, curve, x, y)] that a figure carries."""
    _, *rows = csv.reader(io.StringIO(figure._repr_mimebundle_()["text/csv"]))
    return [(panel, curve, float(x), float(y)) for panel, curve, x, y in rows]


def test_claims_are_grouped_by_where_they_stand():
    figure = claims_figure(SHOWN)
    (axes,) = figure.axes
    rows = [label.get_text().split()[-1] for label in axes.get_yticklabels()]
    assert rows == ["D1", "O3", "M2"]
    headings = [text.get_text() for text in axes.texts if text.get_weight() == "bold"]
    assert headings == ["under every reading", "depends on the reading", "does not apply"]
    marks = {(row.split()[-1], column, x): mark for row, column, x, mark in numbers(figure)}
    assert marks["O3", "default", 0] == 2
    assert marks["O3", "code", 0] == 0


def test_bands_have_a_point_for_every_run():
    figure = bands_figure(SHOWN)
    titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
    assert len(titles) == 5 and "$C/C_0$, 5 to 9" not in titles  # bands that no run has are left out
    found = [row for row in numbers(figure) if row[0] == "$P/P_0$, bump" and row[1]]
    assert len(found) == 7
    seeds = ("seed 7", "seed 8")
    assert {curve for _, curve, *_ in found} == {*seeds, *(f"{seed}, restart 1" for seed in seeds)}
    ((_, curve, _, row),) = [one for one in found if one[2] == 40]
    assert curve == "seed 7" and 0.5 < row < 1.5  # the second row, above the third
    assert max(x for title, _, x, _ in numbers(figure) if title == "$P/P_0$, k > 0.1") == 1000  # at the edge
    by_title = {axes.get_title(): axes for axes in figure.axes}
    assert by_title["$P/P_0$, bump"].get_xscale() == "log"
    assert by_title["$C/C_0$, 2 to 4"].get_xscale() == "linear"
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels == ["default", "code", "last = repeated"]


def test_curves_of_the_readings_with_a_name():
    rows = SHOWN["default"].curves
    apart = replace(SHOWN["default"], curves=rows.assign(value=rows["value"] * (1 + rows["restart"])))
    figure = curves_figure(SHOWN | {"default": apart})
    ways = ("across the sky", "along the line of sight")
    assert [axes.get_title() for axes in figure.axes] == [f"seed {n}, {way}" for n in (7, 8) for way in ways]
    found = {(panel, curve) for panel, curve, *_ in numbers(figure)}
    assert {curve for panel, curve in found if panel == "seed 8, across the sky"} == {
        f"{name}, {part}" for name in ("default", "code") for part in ("low", "middle", "high")
    }
    several = [("seed 8, across the sky", f"default, {part}") for part in ("low", "middle", "high")]
    low, middle, high = ([y for *curve, _, y in numbers(figure) if tuple(curve) == one] for one in several)
    assert low and all(a < b < c for a, b, c in zip(low, middle, high, strict=True))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["default", "code"]
    rows = [
        row[2:] for row in numbers(figure) if row[:2] == ("seed 7, along the line of sight", "code, middle")
    ]
    assert rows == [(0.1, 0.5), (0.2, 1.0)]


def test_both_sides_of_the_comparison_with_the_code():
    figure = code_figure({"mad": ([1e-9, 1e-8], [1e-7, 1e-6])}, (1, 5))
    found = numbers(figure)
    assert [y for panel, _, _, y in found if "authors" in panel] == pytest.approx([1e-9, 1e-8])
    assert [y for panel, _, _, y in found if "change" in panel] == pytest.approx([1e-7, 1e-6])


BAD = {"mean error": 0.4, "bump": 30.0, "C/C0, 2 to 4": 0.02, "C/C0, 5 to 9": 3.0}
KNOWN = readings()
FIRST, SECOND = [label for label, one in KNOWN.items() if one.changed and label not in READINGS][:2]
OUTCOMES = {
    "default": outcome({"D1": REPRODUCED, "O3": REPRODUCED, "O6": FAILED, "M2": INAPPLICABLE}),
    "code-rounding": outcome({"D1": REPRODUCED, "O3": IN_PART, "O6": INAPPLICABLE, "M2": INAPPLICABLE}),
    FIRST: outcome({"D1": IN_PART, "O3": FAILED, "O6": FAILED, "M2": INAPPLICABLE}, runs=[run(), run(**BAD)]),
    SECOND: outcome({"D1": REPRODUCED, "O3": REPRODUCED, "O6": FAILED, "M2": INAPPLICABLE}),
}


ROBUST = {tables.EVERY: ["D1"], tables.SOME: ["O3"], tables.NONE: ["O6"], tables.VOID: ["M2"]}


class TestAnswer:
    def test_where_claims_stand(self):
        assert robustness(OUTCOMES) == ROBUST

    def test_a_claim_that_was_not_judged_everywhere(self):
        """Only what was judged counts; a claim that nobody judged is left out."""
        some = OUTCOMES | {"code-rounding": outcome({"D1": REPRODUCED})}
        assert robustness(some) == ROBUST
        assert robustness({"code": outcome({"D1": REPRODUCED})})[tables.EVERY] == ["D1"]

    def test_which_choice_decides(self):
        assert decisive_options(OUTCOMES, "O3") == [FIRST]
        assert decisive_options(OUTCOMES, "D1") == decisive_options(OUTCOMES, "S1") == []
        without = {label: one for label, one in OUTCOMES.items() if label != "default"}
        assert decisive_options(without, "O3") == []
        other = OUTCOMES | {"code-rounding": outcome({"D1": FAILED})}
        assert decisive_options(other, "D1") == []  # many choices at once

    def test_what_no_choice_moves(self):
        assert insensitive_claims(OUTCOMES) == ["M2"]
        same = dict.fromkeys(("default", "code"), outcome({"E1": REPRODUCED}))
        assert insensitive_claims(same) == ["E1"]
        other = {"code-rounding": outcome({"E1": REPRODUCED}, values={"E1": 0.6})}
        assert insensitive_claims(same | other) == []


class TestTables:
    def test_a_row_for_each_reading(self):
        table = summary_table(OUTCOMES)
        assert table["reading"].tolist() == [KNOWN[label].title for label in OUTCOMES]
        departures = [f"{len(KNOWN[label].departures)}" for label in OUTCOMES]
        assert table["departures from the text"].tolist() == departures
        assert table["fails"].tolist() == ["0 of 1", "0 of 1", "1 of 2", "0 of 1"]
        found = table.iloc[2]
        assert [found[sign] for sign, *_ in MARKS.values()] == ["0", "1", "0", "2", "1"]
        assert found["C/C0, 2 to 4"] == "0.0200"  # a factor of 50, where 1.25 is one of 1.25
        assert (found["C/C0, 5 to 9"], found["C/C0, 10 to 19"], found["bump"]) == ("3.00", "–", "30.0")
        far = summary_table({"default": outcome({"D1": FAILED}, runs=[run(bump=90_910.0), run(bump=2.0)])})
        assert far["bump"].tolist() == ["9e4"]

    def test_a_row_for_each_choice(self):
        rows = tables.option_rows(OUTCOMES)
        assert len(rows) == sum(len(option.choices) for option in OPTIONS.values())
        by_choice = {row[0]: row[1:] for row in rows}
        assert by_choice[FIRST][-2:] == ("1 of 2", "O3") and by_choice[SECOND][-2:] == ("0 of 1", "none")
        option, value = next(iter(READINGS["default"].items()))
        *_, readings_with_it, fails, decides = by_choice[f"{option} = {value}"]
        assert "default" in readings_with_it and (fails, decides) == ("", "")

    def test_marks_go_from_dark_to_light(self):
        """Grey tells them apart; signs stand out by 4.5 to 1 (WCAG)."""
        shades = [luminance(colour) for _, colour, _ in MARKS.values()]
        assert all(light - dark > 0.2 for dark, light in zip(shades, shades[1:], strict=False))
        assert all(contrast(colour, ink) >= 4.5 for _, colour, ink in MARKS.values())
