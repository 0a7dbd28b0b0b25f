"""The head of every chapter: the claims that it tests, with the stored verdicts, and what it costs."""

import io
import json
import re
import shutil
from html import unescape
from pathlib import Path

import nbformat
import pytest
from chapter_heads import cost
from conftest import ROOT
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from himap.app.notebooks import notebooks
from himap.app.stored import LEDGER, read_ledger
from himap.paper.claims import CLAIMS
from himap.paper.ledger_table import BADGES

CHAPTERS = notebooks(ROOT / "notebooks")


def head(chapter):
    """The lines of the quotation below the title."""
    first = next(cell.source for cell in chapter.node.cells if cell.cell_type == "markdown")
    return [line[2:] for line in first.splitlines() if line.startswith("> ")]


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda one: one.name)
def test_every_chapter_says_what_it_needs_tests_and_costs(chapter):
    lines = head(chapter)
    assert re.search(r"^- \*\*Read first\*\*: \S", lines[0])
    assert f"- **Time and memory**: {{cost}}`{chapter.name}`." in lines
    own = [id for id, claim in CLAIMS.items() if claim.notebook == chapter.name]
    tested = [line for line in lines if line.startswith("- **Tests**")]
    named = re.findall(r"\{claim\}`(\w+)`", " ".join(tested))
    assert named == own, "the claims whose `notebook` this is, in the order of the ledger"


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda one: one.name)
def test_code_that_draws_is_folded_and_parameters_are_not(chapter):
    code = [cell for cell in chapter.node.cells if cell.cell_type == "code"]
    drawing = [cell for cell in code if "figure" in cell.metadata.get("mystnb", {})]
    folded = [cell for cell in code if {"hide-input", "remove-input"} & set(cell.metadata.get("tags", []))]
    long = [cell.source for cell in drawing if cell not in folded and len(cell.source.splitlines()) > 3]
    assert not long, long
    hidden = any("parameters" in cell.metadata["tags"] for cell in folded)
    answer = chapter.name == "00_the_answer"
    assert hidden == answer, "a page to read rather than to run with others"
    assert not answer or not [cell for cell in code if "remove-input" not in cell.metadata["tags"]]


def rendered(page):
    """{id: (address, statement, verdict)} of the claims named on a page."""
    pattern = r'<a class="reference internal" href="([^"]*)" title="([^"]*)">(\w+)</a>\xa0'
    pattern += r'<span class="himap-verdict">([^<]*)</span>'
    found = re.findall(pattern, page)
    return {id: (address, unescape(title), said) for address, title, id, said in found}


def test_verdicts_are_those_of_the_ledger(html):
    entries = {entry.claim.id: entry for entry in read_ledger()[0]}
    ledger = (html / "notebooks" / "15_claims.html").read_text()
    seen = {}
    for chapter in CHAPTERS:
        seen |= rendered((html / "notebooks" / f"{chapter.name}.html").read_text())
    assert seen.keys() == CLAIMS.keys()
    for id, (address, title, said) in seen.items():
        assert said == f"{BADGES[entries[id].verdict][0]} {entries[id].label}"
        assert title == entries[id].claim.statement
        assert address == f"15_claims.html#claim-{id}" and f'id="claim-{id}"' in ledger


def small_page(folder, text, ledger=LEDGER, chapters=None):
    """(the page of a book of one page, errors) with a ledger, or none, and notebooks {name: node}."""
    results, written = (folder / "source" / place for place in ("book/results", "notebooks"))
    for place in (results, written):
        place.mkdir(parents=True)
    for name, node in (chapters or {}).items():
        nbformat.write(node, written / f"{name}.ipynb")
    if ledger:
        shutil.copy(ledger, results / "claims_laptop.json")
    (folder / "source" / "index.md").write_text(f"# One page\n\n{text}\n")
    warnings = io.StringIO()
    settings = {"extensions": ["myst_parser", "chapter_heads"], "html_theme": "basic"}
    places = folder / "source", None, folder / "html", folder / "trees"
    Sphinx(*places, "html", settings, status=None, warning=warnings).build()
    return (folder / "html" / "index.html").read_text(), re.findall("ERROR: .*", warnings.getvalue())


def test_claims_without_the_page_of_the_ledger_without_a_ledger_and_without_a_claim(tmp_path):
    page, said = small_page(tmp_path / "a", "See {claim}`D1`.")
    assert re.search(r'See D1\xa0<span class="himap-verdict">\S [^<]+</span>', page) and not said
    page, said = small_page(tmp_path / "b", "See {claim}`D1`.", ledger=None)
    assert "<p>See D1.</p>" in page and not said
    _, (said,) = small_page(tmp_path / "c", "See {claim}`Z9`.")
    assert "the ledger has no claim 'Z9'" in said


@pytest.mark.parametrize("old", [{}, {"claims_laptop": "the code behind claims changed", "other": "too"}])
def test_stale_results_are_named_with_their_commit(tmp_path, monkeypatch, old):
    monkeypatch.setattr("chapter_heads.stale_results", lambda *folders: old)
    page, errors = small_page(tmp_path, "{stale}`claims_*`")
    commit = json.loads(LEDGER.read_text())["about"]["commit"]
    stale = f"Stale, measured with code that has changed since: claims_laptop (commit {commit})."
    assert (stale in page) == bool(old) and ("No stored result" in page) != bool(old) and not errors


@pytest.mark.parametrize("role", ["{stale}`claims_* methods_*`", "{cost}`01_a`"])
def test_a_name_of_no_stored_result_is_an_error_and_a_page_depends_on_others(tmp_path, monkeypatch, role):
    noted = []
    monkeypatch.setattr("chapter_heads.stale_results", lambda *folders: {})
    monkeypatch.setattr(BuildEnvironment, "note_dependency", lambda self, path: noted.append(Path(path).name))
    reads = [f"book/results/{name}.json" for name in ("claims_*", "methods_*")]
    node = nbformat.v4.new_notebook(metadata={"himap": {"reads": reads}})
    page, (said,) = small_page(tmp_path, role, chapters={"01_a": node})
    assert "no stored result fits 'methods_*.json'" in said and "No stored result" not in page
    assert LEDGER.name in noted


@pytest.mark.parametrize("name, n_stale", [("14_diagnostics", 1), ("17_your_own_cube", 0)])
def test_a_head_with_verdicts_says_that_the_ledger_is_stale(tmp_path, monkeypatch, name, n_stale):
    monkeypatch.setattr("chapter_heads.stale_results", lambda *folders: {"claims_laptop": "changed"})
    page, errors = small_page(tmp_path, f"{{cost}}`{name}`", chapters={name: nbformat.v4.new_notebook()})
    assert page.count("stale stored results: 1 of 1") == n_stale and not errors


SIZE = 'preset: str = "laptop"  # size'


@pytest.mark.parametrize(
    ("seconds", "parameters", "runs", "said"),
    [
        (12.3, SIZE, {}, "12 s and up to 1.8 GB at laptop; what"),
        (12.3, SIZE, {"a": 600, "b": 1200}, "; 10 to 20 min and up to 10.7 GB at the paper’s size; "),
        (12.3, SIZE, {"a": 600, "b": 1200, "c": 7200}, "; 10 min to 2.0 h and up to"),
        (5, "results: str | None = None  # folder", {}, "5.0 s, for it shows what is stored"),
        (None, SIZE.replace("laptop", "quick"), {}, "an unknown time and up to 0.7 GB at quick"),
    ],
)
def test_the_cost_is_what_was_measured_and_what_is_asked_for(tmp_path, seconds, parameters, runs, said):
    """Of a notebook with one figure that ran for some time, and `runs` of it with stored figures."""
    about = {parameters: {"tags": ["parameters"]}, "1": {"mystnb": {"figure": {"name": "fig-a"}}}}
    cells = [nbformat.v4.new_code_cell(text, metadata=metadata) for text, metadata in about.items()]
    execution = {} if seconds is None else {"seconds": seconds}
    node = nbformat.v4.new_notebook(cells=cells, metadata={"himap_run": {"execution": execution}})
    nbformat.write(node, tmp_path / "01_a.ipynb")
    for name, value in runs.items():
        (tmp_path / name).mkdir()
        rows = [{"name": "fig-a", "execution": {"seconds": value}}]
        rows += [{"name": "fig-b", "execution": {"seconds": 1}}]
        (tmp_path / name / "figures.json").write_text(json.dumps({"figures": rows}))
    assert said in cost(tmp_path / "01_a.ipynb", tmp_path)
