"""Fingerprints: an edit changes those of what depends on it, and no others."""

import textwrap

import pytest

from himap.core import errors, survey
from himap.core.errors import InputError
from himap.store.fingerprint import CodeTree, moved
from himap.store.store import code_digests, tree_of


@pytest.fixture
def written(tmp_path):
    """Write a package, with `old` made `new` in one file; return its tree."""

    def write(files, file, old, new):
        for name, text in files.items():
            text = textwrap.dedent(text).strip()
            assert name != file or old in text
            path = tmp_path / "toy" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text.replace(old, new) if name == file else text)
        return CodeTree(toy=tmp_path / "toy")

    return write


FILES = {
    "__init__.py": "",
    "registry.py": "class Registry:\n    def named(self, name): return 1",
    "methods/__init__.py": """
        from numpy.fft import rfft
        from toy.methods.base import Base, plain
        from toy.registry import Registry
        __all__ = ["Base", "available", "create"]
        _METHODS = Registry(__name__, __path__)
        def available(): return sorted(_METHODS)
        def create(name): return _METHODS.named(name)
        def __getattr__(name): return _METHODS.named(name)
        def power(x): return plain(rfft(x))
        def listed(): return [*__path__]
    """,
    "methods/base.py": "class Base: ...\ndef plain(x): return x",
    "methods/pca.py": "from toy.methods.base import Base\n"
    "class PCA(Base): name = 'pca'; n = 1\ndef axes(): ...",
    "methods/gmca.py": "from toy.methods.pca import PCA, axes\nclass GMCA(A): name = 'gmca'; k = axes()",
    "methods/deep/__init__.py": "from toy.methods.deep.method import Deep\n__all__ = ['Deep']",
    "methods/deep/method.py": "class Deep(A):\n    name: str = 'deep'\n    d = 1",
    "methods/deep/tools.py": "TOOL = 1",
    "methods/lazy/__init__.py": "def __getattr__(name): raise AttributeError(name)",
    "methods/lazy/method.py": "class Lazy(A): name = 'lazy'; z = 1",
    "folder.py": "import pkgutil\nfrom toy import methods\ndef names(): return list(methods.__path__)",
    "sky/__init__.py": "",
    "sky/galaxy.py": "class Galaxy: n = 1",
    "spectra.py": """
        from toy.sky.galaxy import Galaxy
        SCALE = 2
        TABLE = {}
        TABLE["a"] = 1
        class Case:
            galaxy: Galaxy
        def spectrum(x, n=1):
            '''Doc.'''
            return SCALE * x
        def table(): return TABLE
        def unused(): return 1
    """,
}
READERS = {
    "create": "from toy.methods import create\ncreate('pca')",
    "available": "from toy import methods\nmethods.available()",
    "folder": "from toy.folder import names",
    "listed": "from toy import methods\nmethods.listed()",
    "whole": "from toy import methods\nprint(methods)",
    "unknown": "from toy.methods import Unknown",
    "PCA": "from toy.methods import PCA",
    "methods.PCA": "from toy import methods as m\nm.PCA()",
    "GMCA": "from toy.methods.gmca import GMCA",
    "Deep": "from toy.methods import Deep",
    "Lazy": "from toy.methods import Lazy",
    "Base": "from toy.methods import Base",
    "power": "from toy.methods import power",
    "spectrum": "from toy.spectra import spectrum",
    "table": "import toy.spectra as s\ns.table()",
    "case": "from toy import spectra\ncase = spectra.Case()",
}
BY_NAME = {"create", "available", "folder", "listed", "whole", "unknown"}
BY_REGISTRY = BY_NAME - {"folder", "listed"}
SPECTRA = {"spectrum", "table", "case"}
METHODS = set(READERS) - SPECTRA


@pytest.mark.parametrize(
    "file, old, new, changed",
    [
        ("methods/pca.py", "n = 1", "n = 2", BY_NAME | {"PCA", "methods.PCA"}),
        ("methods/pca.py", "axes(): ...", "axes(): return 1", BY_NAME | {"GMCA"}),
        ("methods/pca.py", "n = 1", "n = 1\nprint()", BY_NAME | {"PCA", "methods.PCA", "GMCA"}),
        ("methods/gmca.py", "k = axes()", "k = 1", BY_NAME | {"GMCA"}),
        ("methods/gmca.py", "class GMCA", "print()\nclass GMCA", BY_NAME | {"GMCA"}),  # imports PCA, no more
        ("methods/base.py", "class Base: ...", "class Base: b = 1", BY_NAME | {"PCA", "methods.PCA", "Base"}),
        ("methods/base.py", "return x", "return 2 * x", {"power", "whole"}),
        ("methods/deep/method.py", "d = 1", "d = 2", BY_NAME | {"Deep"}),
        ("methods/deep/tools.py", "1", "2", set()),  # no class with a name
        ("methods/lazy/method.py", "z = 1", "z = 2", BY_NAME | {"Lazy"}),
        ("methods/deep/__init__.py", "__all__", "print()\n__all__", BY_NAME | {"Deep"}),
        ("methods/__init__.py", "create(name)", "create(name, n=1)", {"create", "whole"}),
        ("methods/__init__.py", "__path__)", "__path__, 1)", BY_REGISTRY),
        ("methods/__init__.py", "numpy.fft", "scipy.fft", {"power", "whole"}),
        ("methods/__init__.py", '"Base", ', "", METHODS - {"Base"}),  # there to register
        ("methods/__init__.py", "__all__", "print()\n__all__", METHODS),
        ("registry.py", "return 1", "return 2", BY_REGISTRY),
        ("spectra.py", "SCALE * x", "SCALE / x", {"spectrum"}),
        ("spectra.py", "SCALE = 2", "SCALE = 3", {"spectrum"}),
        ("spectra.py", "Doc.", "Another.", set()),
        ("spectra.py", "return SCALE", "# why\n\n    return (SCALE)", set()),
        ("spectra.py", "SCALE = 2", "SCALE = 2\nprint()", SPECTRA),
        ("spectra.py", '"a"] = 1', '"a"] = 2', {"table"}),
        ("spectra.py", "n=1", "n=2", {"spectrum"}),
        ("spectra.py", "unused(): return 1", "unused(): return 2", set()),
        ("sky/galaxy.py", "n = 1", "n = 2", {"case"}),
        ("sky/__init__.py", "", "for x in [1]: print(x)", {"case"}),
        ("sky/__init__.py", "", "x = 1", set()),
        ("__init__.py", "", "VERSION = 2", set()),
    ],
)
def test_an_edit_changes_what_depends_on_it_and_nothing_else(written, file, old, new, changed):
    """Also where a package offers names by its ``__getattr__``, and loads what is in its folder."""
    before, after = (
        {name: tree.source_fingerprint(cell) for name, cell in READERS.items()}
        for tree in (written(FILES, file, old, one) for one in (old, new))
    )
    assert {name for name in READERS if moved(before[name], after[name])} == changed


def test_the_cells_of_a_notebook():
    tree = CodeTree()
    one = tree.source_fingerprint("x = 1\ny = 2", "z = x")
    assert one == tree.source_fingerprint("x = 1  # help\ny = 2", "", "# only a comment", "z = x")
    assert one != tree.source_fingerprint("x = 1", "y = 2\nz = x")
    assert tree.source_fingerprint("%magic 1") != tree.source_fingerprint("%magic 2")
    one, other = (tree.source_fingerprint(f"import himap.core.{name}") for name in ("survey", "errors"))
    assert one != other


def test_live_objects():
    where = "himap.core.survey", "Survey"
    assert tree_of(survey.Survey).fingerprint(*where) == CodeTree().fingerprint(*where)
    several = [frozenset(one) for one in ([survey], [survey.Survey], [survey, errors])]
    loaded, now = zip(*map(code_digests, several), strict=True)
    assert len(set(loaded)) == 3 and now == loaded
    with pytest.raises(InputError, match="top level of a source file"):
        code_digests(frozenset([lambda: 1]))


def test_f_strings_are_the_same_code_on_every_python():
    # Python 3.12 parses an empty piece at the end of this format, 3.11 and 3.13 do not.
    known = "5275d5"
    assert CodeTree().source_fingerprint('f"{x:.{y}}"')["code"][:6] == known


FREE = [  # (code, the same in other words)
    ("b = a + 1; return b", "c = a + 1; return c"),
    ("return [x for x in a]", "return [y for y in a]"),
    ("return {x: y for x, y in a if x}", "return {y: x for y, x in a if y}"),
    ("g = lambda q: q + a; return g", "h = lambda q: q + a; return h"),
    ("def inner(x): return x\n    return inner(a)", "def deep(x): return x\n    return deep(a)"),
    ("try: g()\n    except a as e: return e", "try: g()\n    except a as x: return x"),
    ("from math import pi as p; return p", "from math import pi as q; return q"),
    ("raise ValueError(f'no {a}')", "raise ValueError('never')"),
    ("assert a, 'why'", "assert a, 'because'"),
    ("import warnings; warnings.warn('a')", "import warnings; warnings.warn('b', stacklevel=2)"),
    ("return one(a, label='first')", "return one(a, label='second')"),
    ("b: int = 1; return b", "b = 1; return b"),
    ("return _two(a)", "return two_(a)"),
    ("return np.abs(a)", "return num.abs(a)"),
    ("return mutual(a)", "return round(a)"),
]
FIXED = [  # (code, other code)
    ("b = 1; c = 2; return b - c", "b = 1; c = 2; return c - b"),
    ("return one(a)", "return _two(a)"),
    ("return one(x=a)", "return one(y=a)"),
    ("return a.x", "return a.y"),
    ("b = a; return f'{b=}'", "c = a; return f'{c=}'"),
    ("b = a; return locals()", "c = a; return locals()"),
    ("return lambda x: a", "return lambda y: a"),
    ("return 'x'", "return 'y'"),
    ("return max(a)", "max = min; return max(a)"),
    ("max = a\n    def g(): return min(a)", "max = a\n    def g(): return max(a)"),
    ("return [x for x in x]", "return [x for x in a]"),
    ("for wording in a: print(wording)", "for wording in a: print(wording, a)"),
    ("raise ValueError", "raise KeyError"),
    ("return np.abs(a)", "return np.sign(a)"),
    ("return mutual(a)", "return other(a)"),
    ("return C(field=1)", "return C(place=1)"),
    ("return D", "return C"),
    ("return first", "return second"),
    ("global k; k = 1", "k = 1"),
    ("return claims_of(1)", "return claims_of(2)"),
    ("return my_claim(1, 2, 3)", "return my_claim(1, 2, 4)"),
    ("return finding(1, 2, 3)", "return finding(1, 2, 4)"),  # not that of himap
    ("wording = 1; return wording", "wording = 2; return wording"),
]
AROUND = """
import numpy as np
import numpy as num
first, second = 1, 2
k = 0
def one(x=1, y=2, label=""): return x
def _two(x): return 2 * x
def two_(x): return 2 * x
def mutual(x): return other(x - 1)
def other(x): return mutual(x + 1)
def round(x): return square(x - 1)
def square(x): return round(x + 1)
class C: field = 1
class D: place = 1
def f(a):
    """


def of_function(written, code):
    return written({"__init__.py": "", "m.py": AROUND + code}, "m.py", "", "").fingerprint("toy.m", "f")


@pytest.mark.parametrize("one, other", FREE)
def test_names_and_words_that_can_be_chosen_freely_do_not_count(written, one, other):
    assert of_function(written, one) == of_function(written, other)


@pytest.mark.parametrize("one, other", FIXED)
def test_what_can_change_a_result_counts(written, one, other):
    assert of_function(written, one) != of_function(written, other)


def test_a_product_keeps_its_name_and_has_a_version(written):
    text = "from himap.store.store import product\n{}\ndef {}(x): return x\ndef user(): return {}(1)"
    cases = {
        "plain": ("@product", "maps"),
        "renamed": ('@product(name="maps")', "cubes"),
        "newer": ("@product(version=2)", "maps"),
    }
    found = {}
    for case, (decorator, name) in cases.items():
        tree = written({"__init__.py": "", "m.py": text.format(decorator, name, name)}, "m.py", "", "")
        found[case] = tree.fingerprint("toy.m", "user")
    assert found["plain"].keys() == {"code", "look", "maps"} and found["plain"] == found["renamed"]
    assert moved(found["plain"], found["newer"]) == ["maps"]
