"""What an edit of the real tree makes stale, and nothing else; stored results, and what made them.

Methods and beams are loaded by name in some places and named as classes in others. What an edit must make
stale is in the tables below: chapters by their number, and the experiments by name.
Stored figures are stale with the code behind them. Edits are texts in memory.
"""

import ast
import json
from pathlib import Path

import pytest
from conftest import ROOT

import himap
from himap.app import stored
from himap.app.notebooks import find, notebooks
from himap.app.stored import RESULTS, stale_results, stored_results
from himap.paper.experiments import EXPERIMENTS, measuring_code
from himap.store.fingerprint import CodeTree, moved
from himap.store.sources import behind

HIMAP = Path(himap.__file__).resolve().parent

CHAPTERS = {f"{n:02}" for n in range(28)}
SKIES = CHAPTERS - {"00", "16", "18", "19"}  # those show what is stored
JUDGING = {"claims", "readings", "restarts", "flags"}
RECORDS = {"transfer", "beam_errors", "methods", "n_sources"}
STORED = JUDGING | RECORDS | {"authors"}
CLAIMED = {"00", "11", "15", "16", "18", "27"} | JUDGING  # these show what the claims say
ALL_SIX = {"10", "12", "13", "14", "15"} | JUDGING  # name the six methods of the paper
ANY_METHOD = {"11", "17", "20", "21", "22", "23", "24", "25", "26"} | RECORDS  # take any method by its name
ANY_BEAM = SKIES - {"01", "02", "10", "15", "27"} | RECORDS  # those name the paper's three, or none
FITTED = {"07"} | ALL_SIX | ANY_METHOD

# (file, definition): what an added statement there makes stale.
NUMBERS = {
    ("removal/polynomial.py", "Polynomial._separate"): FITTED,
    ("removal/gnilc.py", "GNILC._separate"): ANY_METHOD,
    ("removal/__init__.py", "create"): ANY_METHOD,
    ("instrument/beams/meerkat.py", "MeerKAT._fwhm"): ANY_BEAM,
    ("instrument/noise.py", "noise_sigma"): SKIES - {"01"} | STORED,
    ("paper/claims/base.py", "frequency_band"): CLAIMED,
    ("sky/templates.py", "pysm_templates"): SKIES | STORED | {"boxes"},
    ("sky/templates.py", "write_templates"): set(),
    ("core/survey.py", "Survey.rng"): CHAPTERS | STORED | {"boxes"},  # presets are in the line under figures
    ("paper/masked.py", "compared"): {"24"},
    ("store/store.py", None): set(),
    ("core/errors.py", None): set(),
    ("app/cli/main.py", None): set(),
}
# The same for chapters that only look otherwise.
LOOKS = {
    ("paper/captions.py", "of_sdecgmca"): {"09"},
    ("app/stored_tables.py", "verdicts_table"): {"15", "18"},
    ("figures/plotting.py", None): CHAPTERS - {"15", "18"},
    ("store/provenance.py", "Provenance.footer"): CHAPTERS,
}
# Words in what everything uses: (file, old, new). Others, and names, are in test_fingerprint.py, on a toy.
WORDS = [
    ("core/checks.py", "must have", "has to have"),
    ("core/survey.py", "number of", "how many"),
    ("paper/claims/beams.py", "All six methods recover C to", "Each method recovers C to"),
    ("paper/claims/beams.py", "at 95 % of the l is below", "at 95 % of the l lies below"),
    ("paper/claims/peak_masking.py", '{"masked voxels by', '{"voxels that are masked, by'),
    ("paper/claims/other_sections.py", '"{:.0%}")', '"{:.1%}")'),
]
NEWEST = "from himap.{0} import {1}\nclass Newest({1}):\n    name = 'newest'"


@pytest.fixture(scope="module")
def stale():
    """Function to what other texts in some files make stale, and to what they make only look otherwise."""
    chapters = notebooks()

    def fingerprints(texts):
        tree = CodeTree(texts={HIMAP / file: text for file, text in texts.items()})
        codes = {one.name.partition("_")[0]: one.fingerprint(tree) for one in chapters}
        return codes | {name: measuring_code(name, tree) for name in EXPERIMENTS}

    before = fingerprints({})

    def compare(texts):
        after = fingerprints(texts)
        numbers = {name for name in before if moved(before[name], after[name])}
        return numbers, {name for name in before if moved(before[name], after[name], looks=True)} - numbers

    return compare


def with_statement(file, definition):
    """The source of a file with one more statement in a function, "Class.method" or at the top level."""
    tree = node = ast.parse((HIMAP / file).read_text())
    for name in definition.split(".") if definition else []:
        (node,) = [child for child in node.body if getattr(child, "name", None) == name]
    node.body.insert(-1, ast.parse("assert True").body[0])
    return ast.unparse(tree)


EDITS = NUMBERS | LOOKS


@pytest.mark.parametrize("file, definition", EDITS, ids=[f"{file}-{name or 'run'}" for file, name in EDITS])
def test_an_edit_makes_stale_what_uses_it(stale, file, definition):
    numbers, looks = stale({file: with_statement(file, definition)})
    assert numbers == NUMBERS.get((file, definition), set())
    assert (file, definition) not in LOOKS or looks & CHAPTERS == LOOKS[file, definition]


def test_words_comments_and_new_methods_and_beams_make_nothing_stale(stale):
    files = [path for path in HIMAP.rglob("*.py") if path.parent.name != "store"]
    texts = {str(path.relative_to(HIMAP)): path.read_text() + "\n# One more comment.\n" for path in files}
    for file, old, new in WORDS:
        assert old in texts[file]
        texts[file] = texts[file].replace(old, new)
    texts["removal/newest.py"] = NEWEST.format("removal.base", "ForegroundRemover")
    texts["instrument/beams/newest.py"] = NEWEST.format("instrument.beams.base", "Beam")
    assert stale(texts) == (set(), set())


def test_moving_and_renaming_makes_nothing_stale(stale):
    """A public function under another name in another module, and its old place gone."""
    noise = (HIMAP / "instrument/noise.py").read_text()
    texts = {
        "instrument/thermal.py": noise.replace("noise_sigma", "sigma_of_noise"),
        "instrument/noise.py": "",
    }
    for path in HIMAP.rglob("*.py"):
        text = path.read_text()
        if "himap.instrument.noise" in text:
            text = text.replace("himap.instrument.noise", "himap.instrument.thermal")
            texts[str(path.relative_to(HIMAP))] = text.replace("noise_sigma", "sigma_of_noise")
    numbers, _ = stale(texts)
    naming = {one.name[:2] for one in notebooks() if "instrument.noise" in one.path.read_text()}
    assert numbers == naming  # to their cells it is gone


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
