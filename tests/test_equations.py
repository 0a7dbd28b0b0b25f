"""The table of the paper's equations: every function, chapter, label and test that it names exists."""

import ast
import re
from functools import reduce
from pkgutil import resolve_name

import pytest
from conftest import ROOT

ROWS = re.findall(r"^\| ([\dA.]+) \|(.*)\|$", (ROOT / "book" / "equations.md").read_text(), re.M)


def definition(tree, name):
    """The function or class `name` in the body of a syntax tree."""
    return next(node for node in tree.body if getattr(node, "name", None) == name)


def test_every_equation_has_a_row():
    assert [number for number, _ in ROWS] == [*map(str, range(1, 24)), "A.1", "A.2", "A.3"]


@pytest.mark.parametrize(("number", "row"), ROWS, ids=[number for number, _ in ROWS])
def test_what_a_row_names_exists(number, row):
    _, chapter, code = row.split("|")
    functions, test = (re.findall(r"`([\w.]+)`", part) for part in code.split(";"))
    assert functions and all(resolve_name(name) is not None for name in functions)
    (page,) = re.findall(r"\(\.\./(notebooks/\w+)\.ipynb\)", chapter)
    source = (ROOT / f"{page}.py").read_text()
    assert all(f":label: {label}\n" in source for label in re.findall(r"\{eq\}`([\w-]+)`", chapter))
    file, *steps = test
    found = reduce(definition, steps, ast.parse((ROOT / "tests" / file).read_text()))
    assert isinstance(found, ast.FunctionDef) and found.name.startswith("test_")
