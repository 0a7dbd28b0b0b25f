"""Fingerprints: an edit changes those of what depends on it, and no others."""

import os
import textwrap

import pytest

from himap import errors, survey
from himap.errors import InputError
from himap.products import fingerprint
from himap.products.fingerprint import CodeTree, code_fingerprint

FILES = {
    "__init__.py": "VERSION = 1",
    "errors.py": "class Oops(Exception): ...",
    "spectra.py": """
        from toy.errors import Oops
        SCALE = 2
        def spectrum(x):
            '''Doc.'''
            return SCALE * x
        def unused(): raise Oops
    """,
    "sky/__init__.py": "",
    "sky/hi.py": "from toy.errors import Oops\ndef hi(): raise Oops",
    "sky/galaxy.py": "from . import hi\nclass Galaxy:\n    def maps(self): return hi.hi()",
    "removal/__init__.py": "from toy.removal.base import create\nfrom toy.removal import pca",
    "removal/base.py": "KNOWN = []\ndef create(name): return KNOWN[name]",
    "removal/pca.py": "from toy.removal import base\nclass PCA: n = 1\nbase.KNOWN.append(PCA)",
    "removal/tools/__init__.py": "def tool(): ...",
    "pipeline.py": """
        from himap.products.store import product
        import toy.spectra as spectra
        from toy import removal
        from toy.sky import hi
        from toy.sky.galaxy import Galaxy
        LIMIT = 3
        TABLE = {}
        TABLE["a"] = 1
        class Case:
            galaxy: Galaxy
        def helper(x): return helper(x - 1) if x > LIMIT else x
        @product
        def maps(): return hi.hi(), TABLE
        @product
        def cleaned(n=1): return helper(removal.create("pca")(maps()))
        @product
        def power():
            helper = 1
            from toy.spectra import spectrum
            return spectrum(maps()) + helper
    """,
    "plotting.py": "from toy import pipeline\ndef plot(): print(pipeline)",
}


@pytest.fixture
def toy(tmp_path):
    """Write a package, with one file edited; return the fingerprints of its products and a notebook."""

    def fingerprints(file="errors.py", old="", new=""):
        for name, text in FILES.items():
            text = textwrap.dedent(text).strip()
            assert name != file or old in text
            path = tmp_path / "toy" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text.replace(old, new) if name == file else text)
            os.utime(path, ns=(fingerprints.clock, fingerprints.clock))
            fingerprints.clock += 1
        tree = CodeTree(toy=tmp_path / "toy")
        found = {name: tree.fingerprint("toy.pipeline", name) for name in ("maps", "cleaned", "power")}
        found["case"] = tree.source_fingerprint("from toy import pipeline", "case = pipeline.Case()")
        found["notebook"] = tree.source_fingerprint("from toy import pipeline as p", "p.cleaned(p.Case())")
        found["tool"] = tree.source_fingerprint("from toy.removal.tools import tool")
        found["plotting"] = tree.source_fingerprint("import toy.plotting as p\np.plot()")
        return found

    fingerprints.clock = 10**18
    return fingerprints


ALL = {"maps", "cleaned", "power", "case", "notebook", "plotting", "tool"}
CLEANED = {"cleaned", "notebook", "plotting"}


@pytest.mark.parametrize(
    "file, old, new, changed",
    [
        ("spectra.py", "SCALE * x", "SCALE / x", {"power", "plotting"}),
        ("spectra.py", "SCALE = 2", "SCALE = 3", {"power", "plotting"}),
        ("spectra.py", "Doc.", "Another.", set()),
        ("spectra.py", "return SCALE", "# why\n\n    return (SCALE)", set()),
        ("spectra.py", "raise Oops", "return Oops", {"plotting"}),
        ("spectra.py", "SCALE = 2", "SCALE = 2\nprint()", {"power", "plotting"}),
        ("errors.py", "...", "x = 1", ALL - {"tool"}),
        ("sky/hi.py", "hi()", "hi(x=1)", ALL - {"tool"}),
        ("sky/galaxy.py", "maps", "other", {"case", "notebook", "plotting"}),
        ("sky/__init__.py", "", "x = 1", ALL - {"tool"}),
        ("removal/pca.py", "n = 1", "n = 2", CLEANED | {"tool"}),
        ("removal/base.py", "[]", "{}", CLEANED | {"tool"}),
        ("__init__.py", "1", "2", set()),
        ("pipeline.py", "LIMIT = 3", "LIMIT = 4", CLEANED),
        ("pipeline.py", '"a"] = 1', '"a"] = 2', ALL - {"case", "tool"}),
        ("pipeline.py", "n=1", "n=2", CLEANED),
        ("pipeline.py", "helper = 1", "helper = 2", {"power", "plotting"}),
        ("plotting.py", "print", "repr", {"plotting"}),
    ],
)
def test_an_edit_changes_what_depends_on_it_and_nothing_else(toy, file, old, new, changed):
    before, after = toy(), toy(file, old, new)
    assert {name for name in before if before[name] != after[name]} == changed
    assert len(set(before.values())) == 7


def test_the_cells_of_a_notebook():
    tree = CodeTree()
    one = tree.source_fingerprint("x = 1\ny = 2", "z = x")
    assert one == tree.source_fingerprint("x = 1  # help\ny = 2", "", "# only a comment", "z = x")
    assert one != tree.source_fingerprint("x = 1", "y = 2\nz = x")
    assert tree.source_fingerprint("%magic 1") != tree.source_fingerprint("%magic 2")
    assert tree.source_fingerprint("import himap.survey") != tree.source_fingerprint("import himap.errors")


def test_the_store_itself_does_not_count(monkeypatch):
    before = CodeTree().source_fingerprint("from himap.products.store import product")
    monkeypatch.setattr(fingerprint, "IGNORED", set())
    assert CodeTree().source_fingerprint("from himap.products.store import product") != before


def test_live_objects():
    assert code_fingerprint(survey.Survey) == CodeTree().fingerprint("himap.survey", "Survey")
    assert code_fingerprint(survey) != code_fingerprint(errors)
    assert code_fingerprint(survey) == code_fingerprint(survey, loaded=True)
    with pytest.raises(InputError, match="top level of a source file"):
        code_fingerprint(lambda: 1)


def test_f_strings_are_the_same_code_on_every_python():
    # Python 3.12 parses an empty piece at the end of this format, 3.11 and 3.13 do not.
    known = "d8a876"
    assert CodeTree().source_fingerprint('f"{x:.{y}}"')[:6] == known
