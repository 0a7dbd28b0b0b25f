"""The book renders without warning or network, and leads nowhere in vain."""

import re
from urllib.parse import unquote

import nbformat
import numpy as np
import pytest
from conftest import ROOT
from PIL import Image

from himap.app.notebooks import notebooks
from himap.app.stored import RESULTS, stored_results


@pytest.fixture(scope="module")
def book(html):
    """{path: text} of the pages."""
    return {path: path.read_text() for path in html.rglob("*.html")}


def test_book_needs_no_network(book):
    for path, page in book.items():
        tags = re.findall(r"<(?:script|link|img|iframe|source)\b[^>]*>", page)
        remote = [tag for tag in tags if re.search(r"""(src|href)=["'](https?:)?//""", tag)]
        assert not remote, f"{path.name} loads {remote}"


def test_book_brings_what_draws_equations(book):
    for path, page in book.items():
        if 'class="math' in page:
            (script,) = re.findall(r'src="([^"]*mathjax[^"]*)"', page)
            assert (path.parent / script).exists()
            assert list((path.parent / script).parent.glob("output/chtml/fonts/woff-v2/*.woff"))
    assert sum('class="math' in page for page in book.values()) >= 3


LINKS = re.compile(r'<div class="himap-links">(.*?)</div>', re.S)
SUFFIX = {".csv", ".npz"}


def figures_of_notebooks():
    """{name of a figure: name of its notebook}."""
    return {name: one.name for one in notebooks(ROOT / "notebooks") for name in one.captions}


def test_every_figure_offers_its_numbers_its_notebook_and_its_command(html, book):
    figures = figures_of_notebooks()
    assert len(figures) > 70
    for name, notebook in figures.items():
        page = html / "notebooks" / f"{notebook}.html"
        figure = re.search(rf'<figure [^>]*id="{name}".*?</figure>', book[page], re.S)[0]
        (line,) = LINKS.findall(figure)
        targets = re.findall(r'href="([^"#]+)"', line)
        data, copy, *whole = [page.parent / target for target in targets]
        assert f"himap run {notebook}" in line
        assert data.stem == name and data.suffix in SUFFIX and f'href="#{name}"' in line
        assert all(f'"name":"{name}"' in stored.read_text() for stored in whole)
        if data.suffix == ".csv":
            assert data.read_text().startswith("panel,curve,x,y\n") and data.stat().st_size > 50, name
        else:
            with np.load(data, allow_pickle=False) as file:
                assert np.isfinite(file["maps" if "maps" in file else "values"]).any(), name
        assert nbformat.read(copy, as_version=4).metadata["himap_run"]["fingerprint"]


def test_galleries_lead_to_every_figure(html, book):
    """Those of the paper in its order, then all, chapter by chapter; each with a small picture and a text."""
    pages = [book[html / "book" / f"{name}.html"] for name in ("intro", "figures")]
    item = r'<li><a href="\.\./(notebooks/\w+\.html)#([\w-]+)".*?<img src="([^"]+)" alt="([^"]+)"'
    (paper,), chapters = (re.findall(r'<ul class="himap-gallery">.*?</ul>', page, re.S) for page in pages)
    numbers = re.findall(r"<b>Fig\. ([\w.]+)</b>", paper)
    assert list(dict.fromkeys(numbers)) == [*"1234567", "A.1", "A.2", "B.1", "B.2", "B.3"]
    shown = [found for chapter in chapters for found in re.findall(item, chapter)]
    assert [name for _, name, _, _ in shown] == list(figures_of_notebooks())
    for target, name, thumbnail, alternative in [*shown, *re.findall(item, paper)]:
        assert f'id="{name}"' in book[html / target] and len(alternative) > 10
        with Image.open(html / "book" / thumbnail) as picture:
            assert picture.width == 320


def test_status_page_says_what_made_each_notebook_and_stored_result(html, book):
    page = book[html / "book" / "status.html"]
    rows = [re.sub(r"<[^>]+>", " ", row).split() for row in re.findall(r"<tr.*?</tr>", page, re.S)]
    for path in (ROOT / "notebooks").glob("[0-9]*.py"):
        (row,) = [row for row in rows if row[0] == path.stem]
        assert row[1] == "fresh" and re.fullmatch(r"[\d.]+", row[2]) and row[-1] != "edits"
    for name in ("python", "numpy", "healpy", "ducc0", "jupyter-book"):
        assert [row for row in rows if row[0] == name and re.match(r"\d+\.\d+", row[-1])], name
    for one in stored_results(RESULTS):
        (row,) = [row for row in rows if row[0] == one.name]
        assert row[1] in ({"fresh", "stale:"} if one.codes else {"timing"})
        assert {"Galaxy", *(commit for commit, _ in one.commits)} <= set(row)


def test_no_link_leads_nowhere(html, book):
    targets = {path: set(re.findall(r'\bid="([^"]+)"', page)) for path, page in book.items()}
    for path, page in book.items():
        for target in re.findall(r'<a [^>]*href="([^"]+)"', page):
            address, _, anchor = unquote(target).partition("#")
            if re.match(r"[a-z]+:", address):
                continue
            file = (path.parent / address.partition("?")[0]).resolve() if address else path
            assert file.exists(), f"{path.name} links {target}"
            assert not anchor or file not in targets or anchor in targets[file], f"{path.name}: {target}"


def test_authors_end_with_et_al(html, book):
    """Where there are more than are named, in citations, what they show when pointed at, and the list."""
    assert not [path.name for path, page in book.items() if re.search("[A-Z][\\w-]+,? and others", page)]
    assert "Chapman <em>et al.</em> 2012" in book[html / "notebooks" / "05_fastica.html"]
