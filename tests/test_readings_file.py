"""The file and the tables of what readings lead to."""

import json
import math

import pytest
from outcomes import outcome, run

from himap.errors import InputError
from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.readings import readings
from himap.paper.readings_file import read_readings, write_readings
from himap.paper.readings_table import (
    EVERY,
    HEADER,
    MARKS,
    NONE,
    SOME,
    VOID,
    deciding,
    nearest_sound,
    option_rows,
    plain_rows,
    standing,
    unmoved,
    with_columns,
)
from himap.removal.sdecgmca.readings import OPTIONS

BAD = {"mean_error": 0.4, "bump": 30.0, "angular": {"2 to 4": 0.02, "5 to 9": 3.0}}
OUTCOMES = {
    "default": outcome({"D1": REPRODUCED, "O3": REPRODUCED, "O6": FAILED, "M2": INAPPLICABLE}),
    "letter": outcome(
        {"D1": IN_PART, "O3": FAILED, "O6": FAILED, "M2": INAPPLICABLE}, runs=[run(), run(**BAD)]
    ),
    "code": outcome({"D1": REPRODUCED, "O3": IN_PART, "O6": INAPPLICABLE, "M2": INAPPLICABLE}),
    "last = repeated": outcome({"D1": REPRODUCED, "O3": REPRODUCED, "O6": FAILED, "M2": INAPPLICABLE}),
}


class TestFile:
    def test_there_and_back(self, tmp_path):
        path = tmp_path / "new" / "readings.json"
        write_readings(dict(reversed(OUTCOMES.items())), path, {"preset": "ci", "code": "abc"})
        found, about = read_readings(path)
        assert about == {"preset": "ci", "code": "abc"}
        assert list(found) == list(OUTCOMES)  # in the order of the readings
        assert str(found) == str(OUTCOMES)  # as text, in which NaN is NaN
        assert [file.name for file in path.parent.iterdir()] == ["readings.json"]
        assert "NaN" not in path.read_text()

    def test_numbers_are_rounded(self, tmp_path):
        runs = [run(mean_error=0.123456789, near_plane=math.nan, degrees=(2.0, 1 / 3), angular_ratio=(1, 2))]
        write_readings({"code": outcome({"D1": FAILED}, runs=runs)}, tmp_path / "a.json", {})
        (found,) = read_readings(tmp_path / "a.json")[0]["code"].runs
        assert found.mean_error == 0.12346 and math.isnan(found.near_plane)
        assert found.degrees == (2, 0.33333)

    def test_all_readings_and_claims_fit(self, tmp_path):
        """Two skies and three noise levels with curves of full length: below 600 kB."""
        curve = tuple(math.pi * (n + 1) for n in range(40))
        long = {"degrees": curve, "angular_ratio": curve, "k": curve, "frequency_ratio": curve}
        runs = [run(seed, level, **long) for seed in (7, 8) for level in (1.0, 0.999, 1.001)]
        one = outcome(dict.fromkeys(CLAIMS, [IN_PART, IN_PART]), runs=runs)
        write_readings(dict.fromkeys(readings(), one), tmp_path / "a.json", {})
        assert 2e5 < (tmp_path / "a.json").stat().st_size < 6e5

    def test_no_file(self, tmp_path):
        with pytest.raises(InputError, match="no stored readings .*none.json; `himap readings` writes them"):
            read_readings(tmp_path / "none.json")

    @pytest.fixture
    def changed(self, tmp_path):
        """Function to the path of a good file after a change of its content."""

        def write(change):
            path = tmp_path / "readings.json"
            write_readings(OUTCOMES, path, {"preset": "ci"})
            content = json.loads(path.read_text())
            change(content)
            path.write_text(json.dumps(content))
            return path

        return write

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda content: content.update(format=0), "format 0, not 1"),
            (lambda content: content.pop("about"), "about"),
            (lambda content: content.update(readings=[]), "a reading twice, or none"),
            (lambda content: content["readings"].append(content["readings"][0]), "a reading twice"),
            (lambda content: content["readings"][0].pop("runs"), "runs"),
            (lambda content: content["readings"][0]["runs"].clear(), "not of the same seeds"),
            (lambda content: content["readings"][0]["runs"][0].update(seed=9), "not of the same seeds"),
            (lambda content: content["readings"][0]["runs"][0].pop("bump"), "bump"),
            (lambda content: content["readings"][0]["runs"][0].update(bump="high"), "high"),
            (lambda content: content["readings"][0]["runs"][0].update(more=1), "more"),
            (lambda content: content["readings"][0]["runs"][0]["k"].pop(), "not of one length"),
            (lambda content: content["readings"][0]["claims"]["D1"]["7"].update(verdict="so"), "no verdict"),
            (lambda content: content["readings"][0]["claims"]["D1"]["7"].pop("n_held"), "n_held"),
        ],
    )
    def test_another_kind_of_file(self, changed, change, message):
        with pytest.raises(InputError, match=f"is not a file that `himap readings` wrote .*{message}"):
            read_readings(changed(change))

    @pytest.mark.parametrize("text", ["{}", "[]", "nothing", '{"claims": []}'])
    def test_no_readings_at_all(self, tmp_path, text):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(InputError, match="is not a file that `himap readings` wrote"):
            read_readings(tmp_path / "a.json")

    def test_readings_and_claims_that_himap_does_not_have(self, changed):
        path = changed(lambda content: content["readings"][0].update(reading="backwards"))
        with pytest.raises(InputError, match="has readings of another version of himap, backwards"):
            read_readings(path)
        path = changed(lambda content: content["readings"][0]["claims"].update(Z1={}) or None)
        with pytest.raises(InputError, match="not of the same seeds"):
            read_readings(path)
        one = {"7": {"verdict": FAILED, "n_held": 0, "n_parts": 1, "value": 1.0}}
        path = changed(lambda content: content["readings"][0]["claims"].update(Z1=one))
        with pytest.raises(InputError, match="has claims of another version of himap, Z1"):
            read_readings(path)


class TestAnswer:
    def test_where_claims_stand(self):
        assert standing(OUTCOMES) == {EVERY: ["D1"], SOME: ["O3"], NONE: ["O6"], VOID: ["M2"]}

    def test_a_claim_that_was_not_judged_everywhere(self):
        """Only what was judged counts; a claim that nobody judged is left out."""
        some = OUTCOMES | {"code": outcome({"D1": REPRODUCED})}
        assert standing(some) == {EVERY: ["D1"], SOME: ["O3"], NONE: ["O6"], VOID: ["M2"]}
        assert standing({"code": outcome({"D1": REPRODUCED})})[EVERY] == ["D1"]

    def test_which_choice_decides(self):
        assert deciding(OUTCOMES, "O3") == ["letter"]
        assert deciding(OUTCOMES, "D1") == deciding(OUTCOMES, "S1") == []
        without = {label: one for label, one in OUTCOMES.items() if label != "default"}
        assert deciding(without, "O3") == []
        other = OUTCOMES | {"code": outcome({"D1": FAILED})}
        assert deciding(other, "D1") == []  # many choices at once

    def test_what_no_choice_moves(self):
        assert unmoved(OUTCOMES) == ["M2"]
        same = dict.fromkeys(("default", "code"), outcome({"E1": REPRODUCED}))
        assert unmoved(same) == ["E1"]
        assert unmoved(same | {"letter": outcome({"E1": REPRODUCED}, values={"E1": 0.6})}) == []

    def test_the_rule_of_the_default(self):
        assert nearest_sound(OUTCOMES) == ["default"]
        assert nearest_sound(OUTCOMES | {"letter": OUTCOMES["code"]}) == ["letter"]
        failing = outcome({"D1": FAILED}, runs=[run(**BAD)])
        assert nearest_sound(OUTCOMES | {"default": failing}) == ["last = repeated"]
        assert nearest_sound({"default": failing}) == []


class TestTables:
    def test_a_row_for_each_reading(self):
        rows = plain_rows(OUTCOMES)
        assert [row[:3] for row in rows] == [
            ("default", "0", "0 of 1"),
            ("letter (thresholds = mad)", "0", "1 of 2"),
            ("code", "6", "0 of 1"),
            ("last = repeated", "0", "0 of 1"),
        ]
        assert {len(row) for row in rows} == {len(HEADER)}
        found = dict(zip(HEADER, rows[1], strict=True))
        assert [found[sign] for sign, *_ in MARKS.values()] == ["0", "1", "2", "1"]
        assert found["C/C0, 2 to 4"] == "0.0200"  # a factor of 50, where 1.25 is one of 1.25
        assert (found["C/C0, 5 to 9"], found["C/C0, 10 to 19"], found["bump"]) == ("3.00", "–", "30.0")
        far = plain_rows({"default": outcome({"D1": FAILED}, runs=[run(bump=90_910.0), run(bump=2.0)])})
        assert far[0][-1] == "9e4"

    def test_columns_without_a_number_are_left_out(self):
        rows = plain_rows(OUTCOMES)
        header, lines = with_columns(("reading", "C/C0, 10 to 19", "C/C0, 2 to 4"), rows)
        assert header == ["reading", "C/C0, 2 to 4"]
        assert lines[1] == ["letter (thresholds = mad)", "0.0200"] and len(lines) == len(rows)

    def test_a_row_for_each_choice(self):
        rows = option_rows(OUTCOMES)
        assert len(rows) == sum(len(option.choices) for option in OPTIONS.values())
        by_choice = {row[0]: row[1:] for row in rows}
        *_, taken, fails, decides = by_choice["thresholds = mad"]
        assert (taken, fails, decides) == ("letter, code, follow-up", "1 of 2", "O3")
        assert by_choice["last = repeated"][-3:] == ("code, follow-up", "0 of 1", "none")
        assert by_choice["sign = nonnegative"][-3:] == ("default, letter", "", "")
        assert by_choice["last = unregularised"][-3:] == ("", "", "")

    def test_marks_go_from_dark_to_light(self):
        """Grey tells them apart; signs stand out by 4.5 to 1 (WCAG)."""

        def luminance(colour):
            colour = {"white": "#ffffff", "black": "#000000"}.get(colour, colour)
            shares = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
            linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in shares]
            return sum(weight * x for weight, x in zip((0.2126, 0.7152, 0.0722), linear, strict=True))

        shades = [luminance(colour) for _, colour, _ in MARKS.values()]
        assert all(light - dark > 0.2 for dark, light in zip(shades, shades[1:], strict=False))
        for _, colour, ink in MARKS.values():
            dark, light = sorted((luminance(colour), luminance(ink)))
            assert (light + 0.05) / (dark + 0.05) >= 4.5
