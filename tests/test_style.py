"""The project's style: ruff, and the direction of the imports."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# A room (a module or package of himap) may import the rooms before it, and no other.
# fmt: off
ROOMS = [
    "errors", "outputs", "checks", "numbers", "progress", "blocked", "survey", "memory",  # no physics
    "syntax", "fingerprint", "provenance", "cache", "store", "parallel",
    "cosmology", "sphere", "masks", "starlets", "sky", "instrument", "removal", "spectra", "diagnostics",
    "results", "pipeline", "evidence", "claims", "ledger", "ledger_table", "figure_data", "plotting", "study",
    "cubes", "parameters", "notebook_files", "notebooks", "kernels", "kernel_manager", "reproduce",
    "cli_shared", "cli_cache", "cli_cubes", "cli", "__main__",
]
# fmt: on

# What the order alone does not forbid: a method knows neither the simulations nor where results are kept,
# and the two halves of a simulation know nothing of each other.
STRANGERS = {"removal": {"sky", "instrument", "cache", "store"}, "instrument": {"sky"}}

# Packages that few modules may import; the templates and cubes use healpy for FITS.
KEEPERS = {
    "matplotlib": {"plotting"},
    "healpy": {"sphere", "sky.templates", "cubes.files", "cubes.fits", "cubes.writing"},
    "ducc0": {"sphere"},
    "papermill": {"reproduce", "cli"},
    "jupytext": {"notebooks"},
    "click": {"cli", "cli_cache", "cli_cubes", "cli_shared"},
    "pysm3": {"sky.galaxy", "sky.templates"},
}


def library():
    """Source of every module of himap, by its name without the leading "himap."."""
    sources = {}
    for path in sorted((ROOT / "himap").rglob("*.py")):
        parts = path.relative_to(ROOT / "himap").with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)
        sources[name] = path.read_text()
    return sources


def imported(source):
    """Dotted names that a module imports, anywhere in it, with a leading dot for relative imports."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            # `from himap import x` may name a module or something in himap/__init__.py.
            yield from (f"{module}.{alias.name}" for alias in node.names)


def violations(name, source):
    """The rules that a module breaks, one sentence each."""
    room = name.partition(".")[0]
    if room not in ROOMS and room != "__init__":
        return [f"himap/{room} has no place in ROOMS of tests/test_style.py: say which rooms it may import"]
    return [message for target in imported(source) if (message := _violation(name, room, target))]


def _violation(name, room, target):
    top, _, rest = target.partition(".")
    other = rest.partition(".")[0]
    if target.startswith("."):
        return f"{name}: {target} is a relative import; write it in full"
    if top in KEEPERS and name not in KEEPERS[top]:
        return f"{name} imports {top}, which is left to {', '.join(sorted(KEEPERS[top]))}"
    if top != "himap" or other in (room, "__version__"):
        return None
    if room == "__init__" or other not in ROOMS:
        return f"{name} imports {target}: himap/__init__.py neither imports nor offers anything"
    if ROOMS.index(other) > ROOMS.index(room) or other in STRANGERS.get(room, ()):
        return f"{name} must not import himap.{other}"
    return None


@pytest.mark.parametrize(("name", "source"), library().items(), ids=library())
def test_imports_point_one_way(name, source):
    assert not violations(name, source)


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("survey", "import himap.sphere"),
        ("sphere", "from himap import sky"),
        ("sky.hi", "from himap.removal import PCA"),
        ("instrument.observe", "from himap.sky import hi"),
        ("removal.pca", "from himap import spectra"),
        ("removal.pca", "from himap.sky.hi import hi_maps"),
        ("removal.pca", "from himap.instrument import beams"),
        ("removal.pca", "def f():\n    from himap.diagnostics import ratio"),
        ("spectra", "from himap.diagnostics import ratio"),
        ("diagnostics", "from himap.plotting import spectrum"),
        ("diagnostics", "import himap.pipeline"),
        ("store", "from himap.sphere import analyse"),
        ("progress", "from himap import cosmology"),
        ("plotting", "from himap import reproduce"),
        ("reproduce", "from himap.cli import main"),
        ("spectra", "import matplotlib.pyplot as plt"),
        ("instrument.beams", "import healpy as hp"),
        ("sky.hi", "from ducc0 import sht"),
        ("pipeline", "import papermill"),
        ("plotting", "import jupytext"),
        ("store", "import click"),
        ("sky.hi", "from . import box"),
        ("sky.hi", "from himap import PCA"),
        ("__init__", "from himap.removal import PCA"),
        ("attic", ""),
    ],
)
def test_wrong_way_is_seen(name, source):
    assert violations(name, source)


def test_right_way_is_not_seen():
    assert not violations(
        "removal.pca", "from himap import sphere\nfrom himap.removal.base import Separation"
    )
    assert not violations(
        "pipeline", "from himap.sky import hi\nfrom himap.spectra import angular\nimport numpy"
    )
    assert not violations("sky.templates", "import healpy")


@pytest.mark.parametrize("command", [["check"], ["format", "--check"]], ids=["check", "format"])
def test_ruff(command):
    folders = ["himap", "tests", "notebooks", "benchmarks", "book"]
    there = [folder for folder in folders if (ROOT / folder).exists()]
    ruff = [sys.executable, "-m", "ruff", *command, "--no-cache", *there]
    outcome = subprocess.run(ruff, cwd=ROOT, capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr


@pytest.mark.parametrize(("name", "source"), library().items(), ids=library())
def test_modules_are_small_and_explicit(name, source):
    tree = ast.parse(source)
    assert ast.get_docstring(tree), "a module says in its docstring what it is for"
    assert len(source.splitlines()) < 350, "a module fits on a few screens; split it"
    defines = any(isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Assign) for node in tree.body)
    assert not defines or "__all__ = [" in source, "a module lists what it offers in __all__"
