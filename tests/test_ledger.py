"""The ledger: verdicts over seeds, the file, the table, and the whole on a tiny sky."""

import json
import math
import re
from pathlib import Path

import pytest
from ledgers import entry
from pages import cells

from himap.companion.notebook_files import read_notebook
from himap.companion.notebooks import notebooks
from himap.errors import InputError
from himap.figures.numbers import QUOTED
from himap.paper import pipeline
from himap.paper.claims import CLAIMS, DIFFERENT, FAILED, REPRODUCED, UNDECIDED
from himap.paper.ledger import RECORDED, evaluate, read_ledger, realisations, write_ledger
from himap.paper.ledger_table import LedgerTable, plain_rows, summary

ROOT = Path(__file__).resolve().parents[1]

TINY = {"preset": "ci", "survey": {"nside": 8, "box_cells": 16}, "n_sources_max": 3}


@pytest.mark.parametrize(
    ("verdicts", "expected", "agreeing"),
    [
        ([REPRODUCED] * 3 + [FAILED] * 2, REPRODUCED, 3),
        ([REPRODUCED] * 2 + [DIFFERENT] * 2 + [FAILED], DIFFERENT, 2),
        ([REPRODUCED] * 2 + [FAILED] * 3, FAILED, 3),
        ([REPRODUCED, FAILED], FAILED, 1),
        ([UNDECIDED] * 4 + [REPRODUCED], REPRODUCED, 1),
        ([UNDECIDED] * 5, UNDECIDED, 5),
    ],
)
def test_most_realisations_decide(verdicts, expected, agreeing):
    one = entry(*verdicts)
    assert one.verdict == expected
    assert one.agreeing == agreeing


def test_values_are_median_and_range_of_what_was_measured():
    one = entry(REPRODUCED, FAILED, FAILED, UNDECIDED, values=[3.0, 1.0, 8.0, None])
    assert one.values == (3.0, 1.0, 8.0)
    assert one.sentence == "0."
    assert one.failed_parts() == {"a": 2}
    assert all(math.isnan(value) for value in entry(UNDECIDED, values=[None]).values)


def test_file_there_and_back(tmp_path):
    entries = [entry(REPRODUCED, FAILED), entry(UNDECIDED, values=[None], id="O6")]
    path = tmp_path / "new" / "ledger.json"
    write_ledger(entries, path, {"preset": "ci"})
    assert read_ledger(path) == (entries, {"preset": "ci"})
    assert [file.name for file in path.parent.iterdir()] == ["ledger.json"]
    assert "NaN" not in path.read_text()


def test_a_ledger_that_cannot_be_written_or_read(tmp_path):
    with pytest.raises(InputError, match="there is no ledger"):
        read_ledger(tmp_path / "none.json")
    for text in ("{}", "[]", '{"about": {}, "claims": [1]}', "not JSON"):
        (tmp_path / "other.json").write_text(text)
        with pytest.raises(InputError, match="is not a ledger"):
            read_ledger(tmp_path / "other.json")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_ledger([entry(REPRODUCED)], tmp_path / "file" / "ledger.json", {})


def test_table_says_what_the_entries_say():
    entries = [
        entry(REPRODUCED, REPRODUCED, values=[0.1, 0.2]),
        entry(FAILED, id="N1"),
        entry(UNDECIDED, id="O6"),
    ]
    assert summary(entries) == {REPRODUCED: 1, DIFFERENT: 0, FAILED: 1, UNDECIDED: 1}
    assert plain_rows(entries)[0][:6] == ("D1", "degraded", REPRODUCED, "2/2", "0.15 (0.1 to 0.2)", "< 0.1")
    page = LedgerTable(entries, {"10_results": {"1": "fig-a"}})._repr_html_()
    assert '<a href="10_results.html#fig-a">Fig. 1</a>' in page
    assert '<a href="11_ns_scan.html">Fig. 3</a>' in page
    assert "&lt; 0.1" in page
    assert page.index("Sect. 4.2") < page.index("claim-D1") < page.index("Sect. 4.3") < page.index("claim-N1")
    assert "claim-D2" not in page
    rows = cells(page)
    assert [re.sub("<.*?>", "", row[0]) for row in rows] == ["", "", "D1", "O6", "", "N1"]
    assert rows[1][1].startswith("<strong>Sect. 4.2") and "✓ reproduced</span><br>2 of 2" in rows[2][2]
    assert repr(LedgerTable(entries)).count("\n") == 2


def test_seeds_follow_that_of_the_survey():
    skies = realisations(preset="ci", survey={"seed": 7}, n_realisations=3)
    assert [sky.survey.seed for sky in skies] == [7, 8, 9]
    assert len({(sky.galaxy, sky.n_sources, sky.survey.nside) for sky in skies}) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_realisations": 0}, "n_realisations must be a whole number between 1"),
        ({"n_sources_min": 5, "n_sources_max": 4}, "the scan needs"),
        ({"n_sources_max": 101}, "up to the 100 channels"),
        ({"n_sources_min": 0}, "the scan needs"),
        ({"galaxy": "milky way"}, "unknown Galaxy source"),
        ({"oscillating": "meerkat"}, "a Case takes a beam"),
        ({"plane_weight": 2.0}, "at most 1"),
    ],
)
def test_bad_settings_are_refused_before_any_work(options, message):
    with pytest.raises(InputError, match=message):
        realisations(**({"preset": "ci"} | options))


def test_a_tiny_sky_is_judged_from_end_to_end(monkeypatch, tmp_path):
    """Every row, from simulation to verdict; what lies beyond the maps is not evaluated.

    Of the cubes those that were there before are left, and no other.
    """
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    (sky,) = realisations(**TINY, n_realisations=1)
    before, *others = dict.fromkeys(case for case, *_ in sky.cases.values())
    pipeline.observation(before)
    entries = evaluate([sky])
    assert pipeline.observation.is_cached(before) and pipeline.hi_of_sky.is_cached(sky.survey.sky)
    assert others and not any(pipeline.observation.is_cached(case) for case in others)
    assert not any(pipeline.peak_masked.is_cached(case) for case in [before, *others])
    assert [one.claim["id"] for one in entries] == list(CLAIMS)
    by_id = {one.claim["id"]: one for one in entries}
    assert [id for id, one in by_id.items() if one.verdict == UNDECIDED] == ["O6", "N1", "N2", "N3"]
    assert all(math.isfinite(one.values[0]) for one in entries if one.verdict != UNDECIDED)
    assert by_id["E2"].verdict == REPRODUCED  # holds by far even here
    assert by_id["N1"].sentence == "The scan does not hold n_s = 5."


def test_recorded_ledger_is_complete():
    entries, about = read_ledger(RECORDED)
    assert [one.claim["id"] for one in entries] == list(CLAIMS)
    assert len({tuple(one.findings) for one in entries}) == 1
    assert about["preset"] == "laptop"
    stored = json.loads(RECORDED.read_text())["claims"]
    assert [row["verdict"] for row in stored] == [one.verdict for one in entries]


def test_intro_says_what_the_ledger_says():
    """Its counts are those that the chapter of the ledger quotes."""
    entries, _ = read_ledger(RECORDED)
    count = summary(entries)
    path = ROOT / "notebooks" / "15_claims.ipynb"
    outputs = [output for cell in read_notebook(path).cells for output in cell.get("outputs", [])]
    named = {output.get("metadata", {}).get("scrapbook", {}).get("name"): output for output in outputs}
    wanted = {
        "claims_total": len(entries),
        "claims_reproduced": count[REPRODUCED],
        "claims_different": count[DIFFERENT],
        "claims_failed": count[FAILED],
        "claims_realisations": len(entries[0].findings),
    }
    text = (ROOT / "book" / "intro.md").read_text()
    for name, number in wanted.items():
        assert named[name]["data"][QUOTED[0]] == repr(str(number))
        assert f"{{glue:text}}`../notebooks/15_claims.ipynb::{name}:s`" in text


def test_every_claim_has_a_figure_in_the_book():
    links = {notebook.name: notebook.paper_figures for notebook in notebooks()}
    assert all(claim.figure in links[claim.notebook] for claim in CLAIMS.values())


def test_every_figure_of_the_paper_is_in_one_notebook():
    """Numbered as in the paper, and captioned as such."""
    shown = [figure for notebook in notebooks() for figure in notebook.figures]
    assert sorted(shown) == sorted(
        ["1", "2", "3", "4", "5", "6", "7", "A.1", "A.2", "B.1", "B.2", "B.3", "Table 1"]
    )
    for notebook in notebooks():
        wanted = set(notebook.figures) - {"Table 1"}
        assert wanted <= set(notebook.paper_figures), notebook.name
