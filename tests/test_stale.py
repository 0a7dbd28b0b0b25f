"""On the real tree: an edit makes stale what uses the edited code, and nothing else.

Methods and beams are loaded by name in some places and named as classes in others. What an edit must make
stale stands in the tables below: chapters by their number, "ledger" for what `himap claims` stores,
"readings", "corrections", "beam_errors", "side_by_side" and "suggestions" for what these commands do.
Stored figures are stale with their chapter (test_stored.py).
"""

import ast
import shutil
from pathlib import Path

import pytest

import himap
from himap.companion.notebooks import notebooks
from himap.companion.staleness import (
    beam_errors_code,
    corrections_code,
    ledger_code,
    readings_code,
    side_by_side_code,
    suggestions_code,
)
from himap.products.fingerprint import CodeTree

HIMAP = Path(himap.__file__).parent

CHAPTERS = {f"{n:02}" for n in range(27)}
SKIES = CHAPTERS - {"00", "16", "18", "19"}  # those show what is stored
JUDGING = {"ledger", "readings"}
RECORDS = {"corrections", "beam_errors", "side_by_side", "suggestions"}
STORED = JUDGING | RECORDS
JUDGED = {"15"} | JUDGING
CLAIMED = JUDGED | {"16"}  # shows what the claims say
ALL_SIX = {"10", "12", "13", "14"} | JUDGED  # name the six methods of the paper
ANY_METHOD = {"11", "17", "20", "21", "22", "23", "24", "25", "26"} | RECORDS  # take any method by its name
BEAM_AWARE = {"09"} | ALL_SIX | ANY_METHOD  # SDecGMCA, or what can stand in its place
ANY_BEAM = SKIES - {"01", "02", "10", "15"} | RECORDS  # those name the paper's three, or none
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
BEAMS = {
    ("instrument/beams/degraded.py", "Degraded._fwhm"): OBSERVED,
    ("instrument/beams/evolving.py", "Evolving._fwhm"): OBSERVED,
    ("instrument/beams/oscillating.py", "Oscillating._fwhm"): OBSERVED,
    ("instrument/beams/meerkat.py", "MeerKAT._fwhm"): ANY_BEAM,
    ("instrument/beams/from_file.py", "FromFile._windows"): ANY_BEAM,
    ("instrument/beams/meerkat_lobes.py", "MeerKATLobes._windows"): ANY_BEAM,
    ("instrument/beams/misjudged.py", "Misjudged._windows"): ANY_BEAM,
    ("instrument/beams/rippled.py", "Rippled._fwhm"): ANY_BEAM,
}
CLAIMS = {
    ("paper/claims/sky.py", None): CLAIMED,
    ("paper/claims/smooth_beams.py", None): CLAIMED,
    ("paper/claims/oscillating_beam.py", None): CLAIMED,
    ("paper/claims/three_beams.py", None): CLAIMED,
    ("paper/claims/scan.py", None): CLAIMED,
    ("paper/claims/peak_masking.py", None): CLAIMED,
    ("paper/claims/post_masking.py", None): CLAIMED,
    ("paper/claims/dimming.py", None): CLAIMED,
    ("paper/claims/appendix.py", None): CLAIMED,
}
OTHERS = {
    ("removal/sdecgmca/problem.py", "Problem.fit"): {"16"} | BEAM_AWARE,
    ("removal/blurred_mixture.py", "BlurredMixture.corrected"): {"16"} | BEAM_AWARE,
    ("paper/captions.py", "of_sdecgmca"): {"09"},
    ("paper/captions.py", "in_short"): {"09", "10", "11", "12", "13", "14"},
    ("paper/losses.py", "error_parts"): {"12", "13", "23"},
    ("companion/stored_tables.py", "ledgers_table"): {"00", "11", "12", "13", "14", "15", "18"},
    ("companion/stored_tables.py", "failed_table"): {"15"},
    ("paper/claims/base.py", "bump"): {"11"} | CLAIMED,
    ("paper/claims/base.py", "total"): CLAIMED,
    ("paper/claims/verdicts.py", "parts_of"): CLAIMED,
    ("paper/evidence.py", "masked_voxels"): JUDGED,
    ("paper/ledger.py", "read_ledger"): {"00", "11", "12", "13", "14", "15", "18"},
    ("paper/ledger.py", "evaluate"): {"15", "ledger"},
    ("paper/ledger.py", "judge"): {"15", "ledger", "readings"},
    ("paper/readings.py", "evaluate"): {"readings"},
    ("paper/readings.py", "readings"): {"16", "readings"},
    ("paper/readings_file.py", "read_readings"): {"16"},
    ("paper/readings_file.py", "write_readings"): set(),
    ("paper/readings_table.py", "standing"): {"16"},
    ("paper/readings_figures.py", "bands_figure"): {"16"},
    ("paper/authors_code.py", "difference"): {"16"},
    ("removal/sdecgmca/readings.py", "resolved"): {"16"} | BEAM_AWARE,
    ("removal/__init__.py", "create"): ANY_METHOD,
    ("instrument/beams/__init__.py", "named"): ANY_BEAM,
    ("removal/base.py", "ForegroundRemover.clean"): CLEANED | {"16"},
    ("figures/plotting.py", None): CHAPTERS - {"15", "18"},
    ("survey.py", None): CHAPTERS - {"00", "16"} | STORED,
    ("instrument/noise.py", "noise_sigma"): OBSERVED,
    ("sky/pysm.py", "pysm_templates"): SKIES | STORED,
    ("sky/pysm.py", "write_templates"): set(),
    ("cli/templates.py", None): set(),
    ("cli/readings.py", None): set(),
    ("cli/records.py", None): set(),
    ("paper/mocks.py", "recovered"): {"20", "22", "25", "corrections", "side_by_side", "suggestions"},
    ("measures/transfer.py", "recovery"): {"20", "21", "22", "25"} | RECORDS,
    ("measures/transfer.py", "TransferFunction.errors"): {
        *("20", "22", "23", "25"),
        *("corrections", "side_by_side", "suggestions"),
    },
    ("paper/beam_errors.py", "misjudged_recovery"): {"21", "beam_errors"},
    ("paper/beam_errors.py", "tolerated"): {"21", "25"},
    ("paper/harmless.py", "parts"): {"23"},
    ("paper/masked.py", "compared"): {"24"},
    ("paper/patch.py", "Patch.hits"): {"26"},
    ("removal/weighted_pca.py", "weighted_components"): {"03", "04", "05", "06"} | ALL_SIX | ANY_METHOD,
    ("figures/patches.py", None): {"26"},
    ("measures/expected.py", "expected_recovery"): {"23"},
    ("paper/choice.py", "views_of"): {"22", "suggestions"},
    ("paper/suggestions.py", "summary"): {"22"},
    ("measures/how_many.py", "information"): {"17", "22", "suggestions"},
    ("paper/corrections.py", "evaluate"): {"corrections"},
    ("paper/record_file.py", "read_record"): {"20", "21", "22", "25"},
    ("paper/side_by_side.py", "evaluate"): {"25", "side_by_side"},
    ("paper/side_by_side_table.py", "overview"): {"25"},
    ("figures/marks.py", "marks"): {"16"},
    ("figures/curve_names.py", "label_ends"): {"19"},
    ("products/store.py", None): set(),
    ("progress.py", None): set(),
    ("cli/main.py", None): set(),
}
EDITS = METHODS | BEAMS | CLAIMS | OTHERS


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """A copy of the library, to edit."""
    folder = tmp_path_factory.mktemp("tree") / "himap"
    return shutil.copytree(HIMAP, folder, ignore=shutil.ignore_patterns("__pycache__"))


@pytest.fixture(scope="module")
def fingerprints(library):
    """Function to {chapter or "ledger": fingerprint} of the copy as it is now."""
    chapters = notebooks()

    def compute():
        tree = CodeTree(himap=library)
        codes = {one.name.partition("_")[0]: one.fingerprint(tree) for one in chapters}
        return codes | {
            "beam_errors": beam_errors_code(tree),
            "corrections": corrections_code(tree),
            "ledger": ledger_code(tree),
            "readings": readings_code(tree),
            "side_by_side": side_by_side_code(tree),
            "suggestions": suggestions_code(tree),
        }

    return compute


@pytest.fixture(scope="module")
def before(fingerprints):
    return fingerprints()


def with_statement(source, definition):
    """The source with one more statement in a function, "Class.method" or at the top level."""
    tree = node = ast.parse(source)
    for name in definition.split(".") if definition else []:
        (node,) = [child for child in node.body if getattr(child, "name", None) == name]
    node.body.insert(-1, ast.parse("assert True").body[0])
    return ast.unparse(tree)


@pytest.mark.parametrize(
    "file, definition", EDITS, ids=[f"{file}-{definition or 'run'}" for file, definition in EDITS]
)
def test_an_edit_makes_stale_what_uses_it(library, fingerprints, before, file, definition):
    path = library / file
    source = path.read_text()
    path.write_text(with_statement(source, definition))
    after = fingerprints()
    path.write_text(source)
    assert {name for name in after if after[name] != before[name]} == EDITS[file, definition]


@pytest.mark.parametrize(
    "room, base, stale",
    [("removal", "ForegroundRemover", ANY_METHOD), ("instrument.beams", "Beam", ANY_BEAM)],
)
def test_a_new_one_makes_stale_what_takes_any(library, fingerprints, before, room, base, stale):
    path = library / room.replace(".", "/") / "newest.py"
    path.write_text(f"from himap.{room}.base import {base}\nclass Newest({base}): ...\n")
    after = fingerprints()
    path.unlink()
    assert {name for name in after if after[name] != before[name]} == stale


def test_comments_make_nothing_stale(library, fingerprints, before):
    for path in library.rglob("*.py"):
        path.write_text(path.read_text() + "\n# One more comment.\n")
    assert fingerprints() == before
    for path in library.rglob("*.py"):
        path.write_text(path.read_text().removesuffix("\n# One more comment.\n"))


def test_every_method_beam_and_file_of_claims_is_tried():
    removal, beams, claims = (HIMAP / room for room in ("removal", "instrument/beams", "paper/claims"))
    shared = {claims / "base.py", claims / "verdicts.py"}
    methods = [path for path in removal.rglob("*.py") if "(ForegroundRemover)" in path.read_text()]
    assert {HIMAP / file for file, _ in METHODS} == set(methods)
    assert {HIMAP / file for file, _ in BEAMS} == set(beams.glob("[a-z]*.py")) - {beams / "base.py"}
    assert {HIMAP / file for file, _ in CLAIMS} == set(claims.glob("[a-z]*.py")) - shared
    assert {notebook.name[:2] for notebook in notebooks()} == CHAPTERS
