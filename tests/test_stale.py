"""On the real tree: an edit makes stale what uses the edited code, and nothing else.

Methods and beams are loaded by name in some places and named as classes in others. What an edit must make
stale is in the tables below: chapters by their number, and the experiments by name.
Stored figures are stale with their chapter (test_stored.py). Edits are texts in memory.
"""

import ast
from functools import cache
from pathlib import Path

import pytest

import himap
from himap.app.notebooks import notebooks
from himap.paper.experiments import EXPERIMENTS
from himap.paper.record import measuring_code
from himap.store.fingerprint import CodeTree, moved

HIMAP = Path(himap.__file__).resolve().parent

CHAPTERS = {f"{n:02}" for n in range(28)}
SKIES = CHAPTERS - {"00", "16", "18", "19"}  # those show what is stored
JUDGING = {"claims", "readings", "restarts", "flags"}
RECORDS = {"transfer", "beam_errors", "methods", "n_sources"}
STORED = JUDGING | RECORDS | {"authors"}
JUDGED = {"15"} | JUDGING
CLAIMED = JUDGED | {"00", "11", "16", "18", "27"}  # these show what the claims say
ALL_SIX = {"10", "12", "13", "14"} | JUDGED  # name the six methods of the paper
ANY_METHOD = {"11", "17", "20", "21", "22", "23", "24", "25", "26"} | RECORDS  # take any method by its name
BEAM_AWARE = {"09", "27", "authors"} | ALL_SIX | ANY_METHOD  # SDecGMCA, or what can stand in its place
ANY_BEAM = SKIES - {"01", "02", "10", "15", "27"} | RECORDS  # those name the paper's three, or none
OBSERVED = SKIES - {"01"} | STORED
CLEANED = OBSERVED - {"02"}

# (file, definition): what an added statement there makes stale.
METHODS = {
    ("removal/pca.py", "PCA._separate"): {"03", "04", "05", "06"} | ALL_SIX | ANY_METHOD,
    ("removal/fastica.py", "FastICA._separate"): {"05"} | ALL_SIX | ANY_METHOD,
    ("removal/gmca.py", "GMCA._separate"): {"06"} | ALL_SIX | ANY_METHOD,
    ("removal/polynomial.py", "Polynomial._separate"): {"07"} | ALL_SIX | ANY_METHOD,
    ("removal/parametric.py", "Parametric._separate"): {"08"} | ALL_SIX | ANY_METHOD,
    ("removal/beam_subspace.py", "BeamSubspace._separate"): BEAM_AWARE,
    ("removal/sdecgmca/method.py", "SDecGMCA._separate"): {"16"} | BEAM_AWARE,
    ("removal/gnilc.py", "GNILC._separate"): ANY_METHOD,
    ("removal/smooth_spectra.py", "SmoothSpectra._separate"): ANY_METHOD,
    ("removal/gaussian_process.py", "GaussianProcess._separate"): ANY_METHOD,
}
OTHERS = {
    ("instrument/beams/paper.py", "Oscillating._fwhm"): OBSERVED,
    ("instrument/beams/meerkat.py", "MeerKAT._fwhm"): ANY_BEAM,
    ("instrument/beams/others.py", "FromFile._windows"): ANY_BEAM,
    ("paper/claims/beams.py", None): CLAIMED,
    ("paper/claims/other_sections.py", "dimmed_peak"): CLAIMED,
    ("paper/claims/base.py", "frequency_band"): CLAIMED,
    ("removal/blurred_mixture.py", "BlurredMixture.fit"): {"16"} | BEAM_AWARE,
    ("removal/weighted_pca.py", "weighted_components"): {"03", "04", "05", "06"} | ALL_SIX | ANY_METHOD,
    ("removal/base.py", "ForegroundRemover.clean"): CLEANED | {"16"},
    ("removal/__init__.py", "create"): ANY_METHOD,
    ("instrument/beams/__init__.py", "named"): ANY_BEAM,
    ("instrument/noise.py", "noise_sigma"): OBSERVED,
    ("sky/templates.py", "pysm_templates"): SKIES | STORED | {"boxes"},
    ("sky/templates.py", "write_templates"): set(),
    ("core/survey.py", "Survey.rng"): CHAPTERS | STORED | {"boxes"},  # presets are in the line under figures
    ("measures/transfer.py", "mock_power"): {"20", "21", "22", "25"} | RECORDS,
    ("measures/transfer.py", "expected_mock_power"): {"23"},
    ("paper/mocks.py", "recovered"): {"20", "21", "22", "25"} | RECORDS,
    ("paper/evidence.py", "masked_voxels"): JUDGED,
    ("paper/masked.py", "compared"): {"24"},
    ("store/store.py", None): set(),
    ("core/errors.py", None): set(),
    ("app/cli/main.py", None): set(),
}
LOOKS = {
    ("paper/captions.py", "of_sdecgmca"): {"09"},
    ("paper/study_figures.py", "mixing_figure"): {"04", "05", "06", "09"},
    ("app/stored_tables.py", "verdicts_table"): {"15", "18"},
    ("figures/plotting.py", None): CHAPTERS - {"15", "18"},
    ("figures/planes.py", "marks"): {"16"},
    ("store/provenance.py", "Provenance.footer"): CHAPTERS,
}


@pytest.fixture(scope="module")
def fingerprints():
    """Function to {chapter or "claims": fingerprint} of the library, with other texts in some files."""
    chapters = notebooks()

    @cache
    def compute(texts=()):
        tree = CodeTree(texts={HIMAP / file: text for file, text in texts})
        codes = {one.name.partition("_")[0]: one.fingerprint(tree) for one in chapters}
        return codes | {name: measuring_code(name, tree) for name in EXPERIMENTS}

    return compute


@pytest.fixture(scope="module")
def stale(fingerprints):
    """Function to what texts in the place of files make stale, and to what they make look otherwise."""
    before = fingerprints()

    def compare(texts):
        after = fingerprints(tuple(texts.items()))
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


def named(edits):
    return pytest.mark.parametrize("file, definition", edits, ids=[f"{a}-{b or 'run'}" for a, b in edits])


@named(METHODS | OTHERS)
def test_an_edit_makes_stale_what_uses_it(stale, file, definition):
    numbers, _ = stale({file: with_statement(file, definition)})
    assert numbers == (METHODS | OTHERS)[file, definition]


@named(LOOKS)
def test_an_edit_of_what_only_looks_makes_nothing_stale(stale, file, definition):
    chapters = LOOKS[file, definition]
    numbers, looks = stale({file: with_statement(file, definition)})
    assert not numbers and looks & CHAPTERS == chapters


@pytest.mark.parametrize(
    "room, base",
    [("removal", "removal.base.ForegroundRemover"), ("instrument/beams", "instrument.beams.base.Beam")],
)
def test_a_new_method_or_beam_makes_nothing_stale(stale, room, base):
    module, _, name = base.rpartition(".")
    text = f"from himap.{module} import {name}\nclass Newest({name}):\n    name = 'newest'"
    assert stale({f"{room}/newest.py": text}) == (set(), set())


# What everything uses: (file, old, new)
WORDS = [
    ("core/checks.py", "must have", "has to have"),
    ("core/checks.py", "finite where `kept` is True", "finite there"),
    ("core/checks.py", "_count_bad", "_n_bad"),
    ("maps/sphere.py", "raise InputError(", 'raise InputError("No: " '),
    ("maps/sphere.py", '"analysis"', '"harmonics"'),
    ("maps/sphere.py", "_adjoint_synthesis", "_back"),
    ("maps/sphere.py", "rows", "lines"),
    ("core/errors.py", "class InputError(", 'TEXT = "a longer text"\n\n\nclass InputError('),
    ("core/survey.py", "number of", "how many"),
    ("paper/claims/beams.py", "All six methods recover C to", "Each method recovers C to"),
    ("paper/claims/beams.py", "at 95 % of the l is below", "at 95 % of the l lies below"),
    ("paper/claims/beams.py", "The parametric fit overestimates", "The fit overestimates"),
    ("paper/claims/beams.py", "median C/C0 of PAR", "C/C0 of PAR, its median"),
    ("paper/claims/peak_masking.py", '{"masked voxels by', '{"voxels that are masked, by'),
    ("paper/claims/other_sections.py", '"{:.0%}")', '"{:.1%}")'),
    ("core/survey.py", "def preset(cls, name", "def preset(cls, name: str"),
    ("removal/base.py", "def _separation_of(self, data)", "def _separation_of(self, data: object)"),
    ("removal/base.py", "stopped after", "ended after"),
    ("removal/base.py", "found = self._separate(whole)", "found: object = self._separate(whole)"),
    ("instrument/observe.py", "\n    ", "\n\n    "),
]


@pytest.mark.parametrize("file, old, new", WORDS)
def test_words_make_nothing_stale(stale, file, old, new):
    source = (HIMAP / file).read_text()
    assert old in source
    assert stale({file: source.replace(old, new)}) == (set(), set())


def test_a_number_makes_its_chapters_and_records_stale(stale):
    source = (HIMAP / "removal/polynomial.py").read_text()
    texts = {"removal/polynomial.py": source.replace("parameter(", "parameter(1 + ", 1)}
    assert stale(texts)[0] == METHODS["removal/polynomial.py", "Polynomial._separate"]


def test_comments_make_nothing_stale(stale):
    files = [path for path in HIMAP.rglob("*.py") if path.parent.name != "store"]
    texts = {str(path.relative_to(HIMAP)): path.read_text() + "\n# One more comment.\n" for path in files}
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


def test_every_method_is_tried():
    methods = [
        path for path in (HIMAP / "removal").rglob("*.py") if "(ForegroundRemover)" in path.read_text()
    ]
    assert {HIMAP / file for file, _ in METHODS} == set(methods)
    assert {notebook.name[:2] for notebook in notebooks()} == CHAPTERS
