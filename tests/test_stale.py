"""On the real tree: an edit makes stale what uses the edited code, and nothing else.

Methods are loaded by name in some places and named as classes in others. What an edit must make stale stands
in the tables below: chapters by their number, and "ledger" for what `himap claims` stores. Stored figures are
stale with their chapter (test_stored.py).
"""

import ast
import shutil
from pathlib import Path

import pytest

import himap
from himap.companion.notebooks import notebooks
from himap.companion.stored import ledger_code
from himap.products.fingerprint import CodeTree

HIMAP = Path(himap.__file__).parent

CHAPTERS = {f"{n:02}" for n in range(1, 17)}
JUDGED = {"15", "ledger"}
ALL_SIX = {"10", "12", "13", "14"} | JUDGED  # name the six methods of the paper
ANY = {"11", "16"}  # take any method by its name
OBSERVED = CHAPTERS - {"01"} | {"ledger"}
CLEANED = OBSERVED - {"02"}

# (file, definition): what an added statement there makes stale.
METHODS = {
    ("removal/pca.py", "PCA._separate"): {"03", "04", "05", "06"} | ALL_SIX | ANY,
    ("removal/fastica.py", "FastICA._separate"): {"05"} | ALL_SIX | ANY,
    ("removal/gmca.py", "GMCA._separate"): {"06"} | ALL_SIX | ANY,
    ("removal/polynomial.py", "Polynomial._separate"): {"07"} | ALL_SIX | ANY,
    ("removal/parametric.py", "Parametric._separate"): {"08"} | ALL_SIX | ANY,
    ("removal/sdecgmca/method.py", "SDecGMCA._separate"): {"09"} | ALL_SIX | ANY,
}
BEAMS = {
    ("instrument/beams.py", "diffraction_fwhm"): OBSERVED,
    ("instrument/beams.py", "oscillating_fwhm"): OBSERVED,
    ("instrument/beams.py", "beam_model"): OBSERVED,
    ("instrument/beams.py", "beam_from_array"): set(),
}
CLAIMS = {
    ("paper/claims/methods_and_beams.py", None): JUDGED,
    ("paper/claims/scan.py", None): JUDGED,
    ("paper/claims/masking.py", None): JUDGED,
    ("paper/claims/appendix.py", None): JUDGED,
}
OTHERS = {
    ("paper/claims/base.py", "bump"): {"11"} | JUDGED,
    ("paper/claims/base.py", "total"): JUDGED,
    ("paper/ledger.py", "read_ledger"): {"15"},
    ("removal/__init__.py", "create"): ANY,
    ("removal/base.py", "ForegroundRemover.clean"): CLEANED,
    ("figures/plotting.py", None): CHAPTERS - {"15"},
    ("survey.py", None): CHAPTERS | {"ledger"},
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
        return codes | {"ledger": ledger_code(tree)}

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


def test_a_new_method_makes_stale_what_takes_any(library, fingerprints, before):
    path = library / "removal" / "newest.py"
    path.write_text(
        "from himap.removal.base import ForegroundRemover\n\nclass Newest(ForegroundRemover): ...\n"
    )
    after = fingerprints()
    path.unlink()
    assert {name for name in after if after[name] != before[name]} == ANY


def test_comments_make_nothing_stale(library, fingerprints, before):
    for path in library.rglob("*.py"):
        path.write_text(path.read_text() + "\n# One more comment.\n")
    assert fingerprints() == before
    for path in library.rglob("*.py"):
        path.write_text(path.read_text().removesuffix("\n# One more comment.\n"))


def test_every_method_and_every_file_of_claims_is_tried():
    removal, claims = HIMAP / "removal", HIMAP / "paper" / "claims"
    methods = [path for path in removal.rglob("*.py") if "(ForegroundRemover)" in path.read_text()]
    assert {HIMAP / file for file, _ in METHODS} == set(methods)
    assert {HIMAP / file for file, _ in CLAIMS} == set(claims.glob("[a-z]*.py")) - {claims / "base.py"}
    assert {notebook.name[:2] for notebook in notebooks()} == CHAPTERS
