"""Stored results: what made them, and which are stale."""

import json

import pytest
from conftest import ROOT

from himap.app import stored
from himap.app.notebooks import find
from himap.app.stored import RESULTS, stale_results, stored_results
from himap.store.fingerprint import CodeTree
from himap.store.sources import behind

NOTEBOOK = """\
# %% mystnb={"figure": {"name": "fig-a", "caption": "One."}}
1 + 1

# %% mystnb={"figure": {"name": "fig-b", "caption": "Other."}}
2 + 2
"""
RUN = {"commit": "abc1234", "dirty": False, "seconds": 90.0}
ABOUT = RUN | {"preset": "paper", "galaxy": "templates"}
TODAY = {"code": "claims"}
CHECKED = {"code": TODAY, "commit": "def5678", "dirty": False}


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """Results and notebooks; `folders(code=..., figures=names, text=...)` writes the results.

    An experiment has a fingerprint with its name.
    """
    monkeypatch.setattr(stored, "measuring_code", lambda name, tree: {"code": name})
    (tmp_path / "notebooks").mkdir()
    (tmp_path / "notebooks" / "01_toy.py").write_text(NOTEBOOK)
    (tmp_path / "results" / "paper_a").mkdir(parents=True)
    toy = find("01", tmp_path / "notebooks")
    codes = {name: toy.figure_fingerprint(name) for name in toy.captions}

    def write(*, about=None, figures=("fig-a", "fig-b"), text=NOTEBOOK, **changed):
        (tmp_path / "notebooks" / "01_toy.py").write_text(text)
        rows = [
            {"name": name, "parameters": {"preset": "paper"}, "execution": RUN, "code": codes.get(name)}
            | changed
            for name in figures
        ]
        about = about or ABOUT | {"code": TODAY}
        readings = ABOUT | {"code": {"code": "readings"}}
        files = {
            "claims_a": {"about": about, "experiment": "claims"},
            "paper_a/figures": {"figures": rows},
            "readings_a": {"about": readings | changed, "experiment": "readings"},
            "steps_a": {"about": ABOUT, "steps": []},
        }
        for name, content in files.items():
            (tmp_path / "results" / f"{name}.json").write_text(json.dumps(content))
        return tmp_path / "results", tmp_path / "notebooks"

    return write


def test_what_made_a_result(folders):
    ledger, figures, readings, steps = stored_results(folders(about=ABOUT | {"checked": CHECKED})[0])
    names = [one.name for one in (ledger, figures, readings, steps)]
    assert names == ["claims_a", "paper_a", "readings_a", "steps_a"] and set(readings.codes) == {"readings"}
    assert (ledger.preset, ledger.galaxy, ledger.seconds) == ("paper", "templates", 90)
    assert ledger.commits == {("abc1234", False)} and ledger.checked == "def5678"
    assert (figures.preset, figures.galaxy, figures.seconds) == ("paper", "synthetic", 90)  # one execution
    assert set(figures.codes) == {"fig-a", "fig-b"} and not steps.codes


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        ({}, {}),
        ({"text": NOTEBOOK.replace("2 + 2", "2 + 3")}, {"paper_a": "fig-b"}),
        ({"text": NOTEBOOK.replace("1 + 1", "1 + 3")}, {"paper_a": "fig-a"}),
        ({"about": ABOUT | {"code": "other"}}, {"claims_a": "claims"}),
        ({"about": ABOUT | {"code": "other", "checked": CHECKED}}, {}),
        ({"about": ABOUT | {"code": TODAY, "checked": CHECKED | {"code": "older"}}}, {"claims_a": "claims"}),
        ({"figures": ["fig-a", "fig-c"]}, {"paper_a": "fig-c"}),
        (
            {"about": ABOUT, "code": None},
            {"claims_a": "claims", "paper_a": "fig-a, fig-b", "readings_a": "readings"},
        ),
    ],
)
def test_results_of_other_code_are_stale(folders, made, expected):
    """Those of no known code too, and figures that no notebook has any more; timings have no state."""
    found = stale_results(*folders(**made))
    assert found == {name: f"the code behind {what} changed" for name, what in expected.items()}


CELLS = """\
from a import f, g
wide = [other for other in range(3)]
rows = {}
def double(x): return factor * x
other = double(wide)

factor = 2
rows["a"] = other
shown = {rows: 1 for rows in wide}
show(rows)

for n in range(2):
    rows.update(n=n)
unused = f(other)

g(rows)
"""


@pytest.mark.parametrize(
    ("old", "new", "is_stale"),
    [
        ("range(3)", "range(4)", True),  # through several names
        ("factor = 2", "factor = 3", True),  # of a function, made after it
        ('rows["a"] = other', 'rows["b"] = other', True),
        ("rows.update(n=n)", "rows.update(m=n)", True),
        ("import f, g", "import f, h as g", True),
        ("unused = f(other)", "unused = f(wide)", False),
        ("1 for rows in wide", "2 for rows in wide", False),  # which is a name of the comprehension
        ("show(rows)", "show(wide)", False),  # is shown, and changes nothing
        ("import f, g", "import f, g, h", False),
    ],
)
def test_what_is_behind_a_cell(old, new, is_stale):
    assert CELLS.count(old) == 1
    cells = CELLS.replace(old, new)
    tree = CodeTree()
    codes = [tree.source_fingerprint(behind(*text.split("\n\n"))) for text in (CELLS, cells)]
    assert (codes[0] != codes[1]) == is_stale


def test_those_in_the_book():
    names = {path.stem for path in RESULTS.glob("*.json")} | {
        path.parent.name for path in RESULTS.glob("*/figures.json")
    }
    assert {one.name for one in stored_results(RESULTS)} == names - {"accepted", "probes"}
    assert stale_results(RESULTS, ROOT / "notebooks").keys() <= names
