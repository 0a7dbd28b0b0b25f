"""The project's style: ruff, and the direction of the imports (import-linter, rules in pyproject.toml)."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from conftest import ROOT


def library():
    """Source of every module of himap, by its name without the leading "himap."."""
    sources = {}
    for path in sorted((ROOT / "himap").rglob("*.py")):
        parts = path.relative_to(ROOT / "himap").with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)
        sources[name] = path.read_text()
    return sources


def lint_imports(folder):
    """Outcome of import-linter on the himap of a folder, by the contracts in its pyproject.toml."""
    code = "from importlinter.cli import lint_imports_command as f; f()"
    linter = [sys.executable, "-c", code, "--no-cache"]
    environment = os.environ | {"PYTHONPATH": str(folder)}
    return subprocess.run(linter, cwd=folder, env=environment, capture_output=True, text=True)


def test_wrong_ways_are_seen(tmp_path):
    """Wrong imports in a copy break each contract, and so does a room that has no place."""
    shutil.copytree(ROOT / "himap", tmp_path / "himap", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    wrong = {
        "core/survey": "import himap.maps.sphere",
        "instrument/noise": "from himap.sky import hi",
        "removal/pca": "def f():\n    from himap.sky.hi import hi_maps",
        "store/store": "from himap.maps.sphere import analyse",
        "cubes/cube": "from himap.store.store import product",
        "paper/study": "import matplotlib.pyplot as plt",
        "maps/masks": "from ducc0 import sht",
        "sky/hi": "import healpy as hp",
        "figures/numbers": "import jupytext",
        "app/notebooks": "import click",
        "attic": '"""No place."""',
    }
    for name, line in wrong.items():
        with open(tmp_path / "himap" / f"{name}.py", "a") as file:
            file.write(f"\n{line}\n")
    outcome = lint_imports(tmp_path)
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    broken = re.findall(r"^(.*) BROKEN\b", outcome.stdout, re.M)
    assert {name.strip() for name in broken} == {one["name"] for one in contracts}
    ways = "core.survey -> himap.maps.sphere", "instrument.noise -> himap.sky.hi"
    assert all(f"himap.{said}" in outcome.stdout for said in ("attic", *ways))


@pytest.mark.parametrize("command", [["check"], ["format", "--check"]], ids=["check", "format"])
def test_ruff(command):
    folders = ["himap", "tests", "notebooks", "benchmarks", "book"]
    there = [folder for folder in folders if (ROOT / folder).exists()]
    ruff = [sys.executable, "-m", "ruff", *command, "--no-cache", *there]
    outcome = subprocess.run(ruff, cwd=ROOT, capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr


@pytest.mark.parametrize(
    "path", sorted((ROOT / "himap").rglob("__init__.py")), ids=lambda path: path.parent.name
)
def test_a_package_lists_what_it_offers(path):
    source = path.read_text()
    imports = [node for node in ast.parse(source).body if isinstance(node, ast.ImportFrom)]
    assert not imports or "__all__ = [" in source


WORDS = {"told", "taken", "found", "stands", "hangs", "beside", "lean", "misjudged", "lacking", "came", "put"}
"""In place of which the field has others: residual, assumed, recovered, removed, missing, input, output."""


@pytest.mark.parametrize(("name", "source"), library().items(), ids=library())
def test_modules_are_small_and_their_names_are_words_of_the_field(name, source):
    """Names of functions, classes, their arguments and fields; and imports are written in full."""
    tree, names = ast.parse(source), set()
    assert ast.get_docstring(tree), "a module says in its docstring what it is for"
    assert len(source.splitlines()) < 350, "a module fits on a few screens; split it"
    for node in ast.walk(tree):
        assert not (isinstance(node, ast.ImportFrom) and node.level)
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
    assert not [item for item in names if set(re.split("_|(?<=[a-z])(?=[A-Z])", item.lower())) & WORDS]
