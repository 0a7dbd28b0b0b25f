"""On the real tree: an edit makes stale what uses the edited code, and nothing else.

Methods and beams are loaded by name in some places and named as classes in others. What an edit must make
stale is in the tables below: chapters by their number, and the experiments by name.
Stored figures are stale with the code behind them (test_staleness.py). Edits are texts in memory.
"""

import ast
from pathlib import Path

import pytest

import himap
from himap.app.notebooks import notebooks
from himap.paper.experiments import EXPERIMENTS, measuring_code
from himap.store.fingerprint import CodeTree, moved

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
