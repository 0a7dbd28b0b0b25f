"""The project around the library: what the pages promise exists, and the files agree with each other."""

import ast
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
from functools import reduce
from importlib.metadata import packages_distributions
from pathlib import Path
from pkgutil import resolve_name

import click
import h5py
import healpy as hp
import numpy as np
import pytest
import yaml
from book_examples import blocks, example_of
from conftest import ROOT
from cube_files import run, write_hdf5
from test_style import lint_imports

from himap import __version__
from himap.app.cli.main import main
from himap.app.cli.shared import named_values
from himap.app.notebook_files import figures
from himap.app.notebooks import find
from himap.app.parameters import check_parameters, parse_texts
from himap.core.survey import PRESETS

PAGES = [ROOT / "README.md", *sorted((ROOT / "book").glob("*.md"))]
NOTEBOOKS = sorted(path.stem for path in (ROOT / "notebooks").glob("*.py") if path.stem[0].isdigit())
PAPER = [f"Fig. {number}" for number in (*range(1, 8), "A.1", "A.2", "B.1", "B.2", "B.3")] + ["Table 1"]


def commands():
    """Every `himap ...` and `make ...` of the pages, in a block or between backquotes."""
    for page in PAGES:
        text = page.read_text()
        lines = [line for block in blocks(text, "bash") for line in block.splitlines()]
        for line in lines + re.findall(r"`([^`\n]+)`", text):
            if re.match(r"(himap|make) [a-z-]", line):
                yield page.name, line.partition("#")[0].strip()


def table_rows():
    """Cells of each row of the table of figures, by the first cell."""
    text = (ROOT / "book" / "figures.md").read_text()
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in row] for row in rows]
    assert cells[0] == ["Paper", "What it shows", "Notebook"]
    return cells[1:]


@pytest.mark.parametrize(("page", "line"), sorted(set(commands())))
def test_commands_of_the_pages_exist(page, line):
    program, *words = shlex.split(line)
    if program == "make":
        assert re.search(rf"^{words[0]}:", (ROOT / "Makefile").read_text(), flags=re.M)
        return
    command, name = main, "himap"
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        name = words.pop(0)
        assert name in command.commands
        command = command.commands[name]
    try:
        options = command.make_context(name, words).params
    except click.exceptions.Exit as end:  # help is shown and that is all
        assert end.exit_code == 0
        return
    for notebook in options.get("names") or ():
        declared = find(notebook).parameters
        check_parameters(declared, parse_texts(declared, named_values(options["pairs"], options["preset"])))
    if name == "list" and options["name"]:
        find(options["name"])


def test_table_and_toc_have_every_figure_and_notebook():
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text())
    chapters = [chapter["file"] for part in toc["parts"] for chapter in part["chapters"]]
    assert sorted(Path(file).name for file in chapters if file.startswith("notebooks/")) == NOTEBOOKS
    assert all((ROOT / f"{file}.md").exists() for file in chapters if file.startswith("book/"))
    assert {Path(page.stem).name for page in PAGES[1:]} == {
        Path(file).name for file in [toc["root"], *chapters] if file.startswith("book/")
    }
    linked = set()
    for paper, what, notebook in table_rows():
        links = re.findall(r"\[(\w+)\]\(\.\./notebooks/(\w+)\.ipynb\)", notebook)
        assert what and (links or notebook == "planned"), paper
        assert all(text == target for text, target in links), paper
        assert paper in PAPER or paper.startswith("Sect. ") or paper == "Beyond the paper"
        linked |= dict(links).keys()
    assert linked == set(NOTEBOOKS)
    assert [paper for paper, _, _ in table_rows() if paper in PAPER] == PAPER
    single = [notebook for paper, _, notebook in table_rows() if paper in PAPER]
    assert all(re.fullmatch(r"\[\w+\]\(\.\./notebooks/\w+\.ipynb\)", notebook) for notebook in single)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_table_agrees_with_the_notebook_about_its_figures(name):
    notebook = find(name)
    assert set(notebook.figures) - {"Table 1"} <= set(notebook.paper_figures), "captioned as the paper's"
    stated = {figure if " " in figure else f"Fig. {figure}" for figure in notebook.figures}
    assert {row[0] for row in table_rows() if f"/{name}.ipynb" in row[2] and row[0] in PAPER} == stated


def test_presets_of_the_conventions():
    text = (ROOT / "book" / "conventions.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \| (\d+) × (\d+) MHz \| (\d+)³ \|", text, flags=re.M)
    assert {name: tuple(map(int, numbers)) for name, *numbers in rows} == {
        name: (survey.nside, survey.n_channels, survey.channel_width, survey.box_cells)
        for name, survey in PRESETS.items()
    }
    assert all((survey.freq_min, survey.freq_max) == (900, 1400) for survey in PRESETS.values())


def test_citation_and_versions_agree():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    changelog = (ROOT / "CHANGELOG.md").read_text()
    assert citation["version"] == project["version"] == __version__
    assert re.search(rf"^## {re.escape(__version__)}$", changelog, re.M)
    assert citation["license"] == project["license"] == "MIT"
    assert citation["authors"][0]["name"] in (ROOT / "LICENSE").read_text()
    (paper,) = citation["references"]
    families = [author["family-names"] for author in paper["authors"]]
    assert families == ["Gkogkou", "Bonjean", "Starck", "Spinelli", "Tsakalides"]
    entry = bibliography()["gkogkou2025"]
    assert all(family in entry for family in families)
    assert f"{{{paper['year']}}}" in entry


def test_entries_to_cite_are_those_of_the_book():
    """What the intro offers to copy: the paper as in the bibliography, the software as in CITATION.cff."""
    (text,) = blocks((ROOT / "book" / "intro.md").read_text(), "bibtex")
    paper, software = re.findall(r"^@\w+\{(.*?)^\}", text, flags=re.M | re.S)

    def fields(entry):
        return dict(re.findall(r"(\w+)\s*= \{(.*?)\}(?=,? *\w+ = |,?\n|$)", entry))

    assert fields(paper) == fields(bibliography()["gkogkou2025"])
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    cited = {key: re.sub("[{}]", "", value) for key, value in fields(software).items()}
    assert cited["title"] == citation["title"] and cited["version"] == str(citation["version"])
    assert cited["author"] == citation["authors"][0]["name"]


def bibliography():
    """Entries of the bibliography by key."""
    text = (ROOT / "book" / "references.bib").read_text()
    entries = re.findall(r"^@\w+\{([\w-]+),(.*?\})\}$", text, flags=re.M | re.S)
    assert len(dict(entries)) == len(entries) == text.count("\n@")
    return dict(entries)


def test_bibliography_is_complete():
    entries = bibliography()
    for key, entry in entries.items():
        fields = dict(re.findall(r"(\w+) = \{(.*?)\}(?=, \w|,\n|$)", entry))
        assert {"author", "title", "year"} <= set(fields), key
        assert {"journal", "publisher", "booktitle"} & set(fields), key
        assert re.fullmatch(r"\d{4}", fields["year"]), key
        assert re.fullmatch(r"\d{4}\.\d{4,5}|[a-z-]+/\d{7}", fields.get("eprint", "0000.0000")), key
    cited = set()
    for path in [*PAGES, *(ROOT / "notebooks").glob("*.py")]:
        for keys in re.findall(r"\{cite:\w+\}`([^`]+)`", path.read_text()):
            cited |= {key.strip() for key in keys.split(",")}
    assert cited and cited <= set(entries)


def requirements(*extras):
    """What an installation with `extras` asks for, as pyproject.toml has it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = list(project["dependencies"])
    for extra in extras:
        for line in project["optional-dependencies"][extra]:
            own = re.fullmatch(r"himap\[([\w,]+)\]", line)
            lines += requirements(*own[1].split(",")) if own else [line]
    return lines


ROOMS = {
    "himap": (),
    "himap/app": ("notebooks",),
    "notebooks": ("test",),
    "tests": ("test",),
    "benchmarks": ("test",),
    "book/_ext": ("book",),
}
LAZY = {"himap/figures/numbers.py": {"ipython"}, "himap/store/parallel.py": {"distributed"}}


@pytest.mark.parametrize("folder", ROOMS)
def test_every_import_is_required(folder):
    """The library and the command ask for nothing that only notebooks, the book or tests need."""
    required = {re.match(r"[\w-]+", line)[0].lower() for line in requirements(*ROOMS[folder])}
    # Jupyter Book brings Sphinx and its bibliography, in the versions that it works with.
    required |= (
        {"sphinx", "sphinxcontrib-bibtex", "docutils"} if "book" in folder or folder == "tests" else set()
    )
    owners = packages_distributions()
    for path in (ROOT / folder).rglob("*.py"):
        place = path.relative_to(ROOT).as_posix()
        if folder == "himap" and place.startswith("himap/app/"):
            continue
        nodes = [*ast.walk(ast.parse(path.read_text()))]
        modules = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        modules += [node.module for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
        names = {module.partition(".")[0] for module in modules}
        for name in names - set(sys.stdlib_module_names) - {"himap", "conftest"}:
            # What is not installed is a module that a test writes, or the import itself fails.
            projects = {owner.lower().replace("_", "-") for owner in owners.get(name, ())}
            allowed = required | LAZY.get(place, set())
            assert not projects or projects & allowed, f"{place} imports {name}: {projects} is not required"


def test_readme_runs_in_order(tmp_path, monkeypatch, rng, no_pages):
    """The commands on a cube one after the other, and the examples in Python among them.

    As they are there, but for fewer restarts and mocks.
    """
    section = (ROOT / "README.md").read_text().partition("## Clean your own cube")[2].partition("\n## ")[0]
    monkeypatch.chdir(tmp_path)
    n_pix, freqs = 12 * 8**2, np.arange(955.0, 1100, 10)
    foreground = (freqs[:, None] / 900) ** np.array([-2.1, -2.7]) @ rng.lognormal(size=(2, n_pix))
    hi, *mocks = 1e-3 * rng.standard_normal((3, len(freqs), n_pix))
    np.save("maps.npy", foreground + hi)
    np.save("freqs.npy", freqs)
    np.savetxt("freqs.txt", freqs, header="MHz")
    hp.write_map("cube.fits", (foreground + hi) / 1e3, dtype=np.float32)
    for name, maps in {"cube": foreground + hi, "mock1": mocks[0], "mock2": mocks[1]}.items():
        write_hdf5(f"{name}.h5", maps, freqs=freqs, unit="mK", order="RING")
    ran = []
    for language, block in re.findall(r"^```(bash|python)\n(.*?)^```", section, flags=re.M | re.S):
        if language == "python":
            exec(compile(block, "README.md", "exec"), {})
            continue
        for line in block.splitlines():
            _, *words = shlex.split(re.sub(r"(restarts|mocks) \d+", r"\1 2", line), comments=True)
            run(*words)
            ran.append(words[0])
    assert ran == ["suggest", "clean", "clean", "transfer", "clean", "clean", "sensitivity", "suggest"]
    residual = np.load("residual.npy")
    assert residual.shape == hi.shape and np.corrcoef(residual.ravel(), hi.ravel())[0, 1] > 0.8
    with h5py.File("cleaned.h5") as file:
        assert file["residual"].shape == hi.shape


def test_readme_shows_what_there_is():
    """A figure of the book, and not an old one; `make book` copies it. And links lead somewhere."""
    script = runpy.run_path(str(ROOT / "book" / "readme_figure.py"))
    (shown,) = [one.png for one in figures(script["NOTEBOOK"]) if one.name == script["FIGURE"]]
    assert script["TARGET"].read_bytes() == shown
    for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / "README.md").read_text()):
        assert (ROOT / target).exists(), target
    assert {page for page, _ in commands()} >= {"README.md", "intro.md", "contributing.md"}


def test_the_library_with_the_examples_of_the_book_keeps_to_the_rules(tmp_path):
    """Their style, and the rooms; that they fulfil the contract is tested with the methods and the beams."""
    shutil.copytree(ROOT / "himap", tmp_path / "himap", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    paths = [tmp_path / "himap" / place / "example.py" for place in ("removal", "instrument/beams")]
    for path, page in zip(paths, ("add_a_method", "add_a_beam"), strict=True):
        path.write_text(example_of(page))
    for check in (["check", "-q"], ["format", "--check", "-q"]):
        subprocess.run([sys.executable, "-m", "ruff", *check, *paths], check=True, cwd=tmp_path)
    outcome = lint_imports(tmp_path)
    assert outcome.returncode == 0, outcome.stdout


@pytest.mark.parametrize("name", ["test", "book"])
def test_workflows_run_what_there_is(name):
    """Targets of the Makefile, actions with a version, weekly, and never without a limit of time.

    YAML reads the key `on` of GitHub Actions as true.
    """
    found = yaml.safe_load((ROOT / ".github/workflows" / f"{name}.yml").read_text())
    assert {"push", "pull_request", "schedule", "workflow_dispatch"} == set(found[True])
    for step in [step for job in found["jobs"].values() for step in job["steps"]]:
        assert re.fullmatch(r"actions/[\w-]+@v\d+", step["uses"]) if "uses" in step else step["run"]
        for target in re.findall(r"^make (\w+)", step.get("run", "")):
            assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), flags=re.M)
    assert all("timeout-minutes" in job for job in found["jobs"].values() if "strategy" in job)
    if name == "test":
        low, high = re.search(r"Python 3\.(\d+) to 3\.(\d+)", (ROOT / "README.md").read_text()).groups()
        promised = [f"3.{minor}" for minor in range(int(low), int(high) + 1)]
        assert found["jobs"]["test"]["strategy"]["matrix"]["python"] == promised


def test_what_is_installed():
    """Versions with both bounds; in a checkout and by Binder all of it, and with it the commands of hooks."""
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    assert [line for line in lines if not line.startswith("#")] == ["-e .[test]"]
    assert (ROOT / ".binder" / "requirements.txt").read_text() == "-r ../requirements.txt\n"
    build = ROOT / ".binder" / "postBuild"
    assert os.access(build, os.X_OK) and "install" in build.read_text()
    needed = requirements("test")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(needed) == set(requirements(*extras))
    assert all(re.fullmatch(r"[\w-]+>=[\d.]+,<[\d.]+", line) for line in needed)
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    commands = {re.match(r"\.venv/bin/(\w+)", hook["entry"])[1] for hook in hooks}
    assert commands <= {line.split(">=")[0] for line in needed}


EQUATIONS = re.findall(r"^\| ([\dA.]+) \|(.*)\|$", (ROOT / "book" / "equations.md").read_text(), re.M)


def definition(tree, name):
    """The function or class `name` in the body of a syntax tree."""
    return next(node for node in tree.body if getattr(node, "name", None) == name)


def test_every_equation_has_a_row():
    assert [number for number, _ in EQUATIONS] == [*map(str, range(1, 24)), "A.1", "A.2", "A.3"]


@pytest.mark.parametrize(("number", "row"), EQUATIONS, ids=[number for number, _ in EQUATIONS])
def test_what_a_row_of_equations_names_exists(number, row):
    """Every function, chapter, label and test."""
    _, chapter, code = row.split("|")
    functions, test = (re.findall(r"`([\w.]+)`", part) for part in code.split(";"))
    assert functions and all(resolve_name(name) is not None for name in functions)
    (page,) = re.findall(r"\(\.\./(notebooks/\w+)\.ipynb\)", chapter)
    source = (ROOT / f"{page}.py").read_text()
    assert all(f":label: {label}\n" in source for label in re.findall(r"\{eq\}`([\w-]+)`", chapter))
    file, *steps = test
    found = reduce(definition, steps, ast.parse((ROOT / "tests" / file).read_text()))
    assert isinstance(found, ast.FunctionDef) and found.name.startswith("test_")
