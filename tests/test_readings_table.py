"""The tables of what readings lead to."""

from ledgers import contrast, luminance, outcome, run

from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.readings import readings
from himap.paper.readings_table import (
    EVERY,
    MARKS,
    NONE,
    SOME,
    VOID,
    decisive_options,
    insensitive_claims,
    option_rows,
    robustness,
    summary_table,
)
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

BAD = {"mean error": 0.4, "bump": 30.0, "C/C0, 2 to 4": 0.02, "C/C0, 5 to 9": 3.0}
KNOWN = readings()
FIRST, SECOND = [label for label, one in KNOWN.items() if one.changed and label not in READINGS][:2]
OUTCOMES = {
    "default": outcome({"D1": REPRODUCED, "O3": REPRODUCED, "O6": FAILED, "M2": INAPPLICABLE}),
    "code-rounding": outcome({"D1": REPRODUCED, "O3": IN_PART, "O6": INAPPLICABLE, "M2": INAPPLICABLE}),
    FIRST: outcome({"D1": IN_PART, "O3": FAILED, "O6": FAILED, "M2": INAPPLICABLE}, runs=[run(), run(**BAD)]),
    SECOND: outcome({"D1": REPRODUCED, "O3": REPRODUCED, "O6": FAILED, "M2": INAPPLICABLE}),
}


class TestAnswer:
    def test_where_claims_stand(self):
        assert robustness(OUTCOMES) == {EVERY: ["D1"], SOME: ["O3"], NONE: ["O6"], VOID: ["M2"]}

    def test_a_claim_that_was_not_judged_everywhere(self):
        """Only what was judged counts; a claim that nobody judged is left out."""
        some = OUTCOMES | {"code-rounding": outcome({"D1": REPRODUCED})}
        assert robustness(some) == {EVERY: ["D1"], SOME: ["O3"], NONE: ["O6"], VOID: ["M2"]}
        assert robustness({"code": outcome({"D1": REPRODUCED})})[EVERY] == ["D1"]

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
        assert (
            insensitive_claims(same | {"code-rounding": outcome({"E1": REPRODUCED}, values={"E1": 0.6})})
            == []
        )


class TestTables:
    def test_a_row_for_each_reading(self):
        table = summary_table(OUTCOMES)
        assert table["reading"].tolist() == [KNOWN[label].title for label in OUTCOMES]
        assert table["departures from the text"].tolist() == [
            f"{len(KNOWN[label].departures)}" for label in OUTCOMES
        ]
        assert table["fails"].tolist() == ["0 of 1", "0 of 1", "1 of 2", "0 of 1"]
        found = table.iloc[2]
        assert [found[sign] for sign, *_ in MARKS.values()] == ["0", "1", "0", "2", "1"]
        assert found["C/C0, 2 to 4"] == "0.0200"  # a factor of 50, where 1.25 is one of 1.25
        assert (found["C/C0, 5 to 9"], found["C/C0, 10 to 19"], found["bump"]) == ("3.00", "–", "30.0")
        far = summary_table({"default": outcome({"D1": FAILED}, runs=[run(bump=90_910.0), run(bump=2.0)])})
        assert far["bump"].tolist() == ["9e4"]

    def test_a_row_for_each_choice(self):
        rows = option_rows(OUTCOMES)
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
