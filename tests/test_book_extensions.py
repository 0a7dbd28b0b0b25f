"""What the book's own extensions do, each by itself: numbers to play with, tolerances, ways out, the PDF."""

import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
import yaml
from conftest import ROOT, render_book
from hypothesis import example, given
from hypothesis import strategies as st
from play import LINES, SPECTRA, content_of
from play_data import of_notebook, of_stored, plain, view
from play_looks import apart, methods
from tolerances import without_tolerance

from himap.app.notebook_files import Figure, figures
from himap.figures.numbers import quoted, show

ADDRESS = "https://github.com/somebody/himap"


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The rendered pages of one chapter and the changes, with an address of the repository."""
    folder = tmp_path_factory.mktemp("small")
    config = yaml.safe_load((ROOT / "_config.yml").read_text())
    config["repository"]["url"] = ADDRESS
    (folder / "_config.yml").write_text(yaml.safe_dump(config))
    toc = {"format": "jb-book", "root": "book/changes", "chapters": [{"file": "notebooks/04_pca"}]}
    (folder / "_toc.yml").write_text(yaml.safe_dump(toc))
    (folder / "notebooks").mkdir()
    shutil.copy(ROOT / "notebooks" / "04_pca.ipynb", folder / "notebooks")
    return render_book(folder)


def test_one_setting_turns_on_all_ways_out(pages, html):
    page = (pages / "notebooks" / "04_pca.html").read_text()
    ways = {
        "source": f"{ADDRESS}/blob/main/notebooks/04_pca.ipynb",
        "edit": f"{ADDRESS}/edit/main/notebooks/04_pca.ipynb",
        "issue": f"{ADDRESS}/issues/new",
        "repository": f'"{ADDRESS}"',
        "Binder": "https://mybinder.org/v2/gh/somebody/himap/main?urlpath=lab/tree/notebooks/04_pca.ipynb",
        "Colab": "https://colab.research.google.com/github/somebody/himap/blob/main/notebooks/04_pca.ipynb",
    }
    assert not [name for name, address in ways.items() if address not in page]
    without = (html / "notebooks" / "04_pca.html").read_text()
    assert not re.search("mybinder|colab.research|issues/new|/edit/", without)


def test_what_changed_is_a_page(pages):
    page = (pages / "book" / "changes.html").read_text()
    assert "<h1>What changed" in page and "0.1.0" in page
    assert page.count("<li>") >= (ROOT / "CHANGELOG.md").read_text().count("\n- ")


def print_pdf(pages, target, **options):
    command = [sys.executable, str(ROOT / "book" / "print_pdf.py"), str(pages), str(target)]
    return subprocess.run(command, capture_output=True, text=True, **options)


def test_the_book_prints(pages, tmp_path, browser):
    target = tmp_path / "himap.pdf"
    outcome = print_pdf(pages, target)
    assert outcome.returncode == 0, outcome.stderr
    pdf = target.read_bytes()
    assert pdf.startswith(b"%PDF") and 5 < len(re.findall(rb"/Type /Page\b", pdf)) < 60
    assert len(re.findall(rb"/Subtype /Image", pdf)) >= 6  # the chapter's figures
    assert b"/Outlines" in pdf


def test_no_pdf_without_chromium(pages, tmp_path):
    outcome = print_pdf(pages, tmp_path / "himap.pdf", env={"PATH": str(tmp_path)})
    assert outcome.returncode == 1 and "needs Chromium" in outcome.stderr


@pytest.mark.parametrize(
    ("stored", "shown"),
    [
        ("0.964 ± 0.020", "0.96"),
        ("34703 ± 694", "34,700"),
        ("1.81e+08 ± 2.0e+07", "1.8 × 10⁸"),
        ("nan ± 2.0e-02", "–"),
        ("-0.5 ± 0.1", "-0.5"),
    ],
)
def test_tables_show_what_the_tolerance_is_sure_of(stored, shown):
    cell = without_tolerance(f"<td>{stored} mK</td>")
    assert cell == f'<td><span title="{stored.replace(" ±", ", to within")}">{shown}</span> mK</td>'
    assert without_tolerance("<td>5 of 6 (3 to 4)</td>") == "<td>5 of 6 (3 to 4)</td>"


@given(st.floats(-1e9, 1e9, allow_subnormal=False), st.sampled_from([1e-7, 0.01, 0.02, 0.63, 2, 3.3, 1e7]))
@example(31.496, 0.63).via("31.5 would be 32")
@example(0.6647, 0.033).via("0.665 would be 0.67")
def test_tables_and_prose_show_the_same_number(value, tolerance):
    (row,) = show({"C": (value, tolerance)}).rows
    assert f">{quoted((value, tolerance))}<" in without_tolerance(row[1])


def curves_to_play(curves):
    """{curve: what the script gets} of one panel with ratios, of curves {label: (y, ...)} at x = 1, 2."""
    points = [(label, list(enumerate(ys, start=1))) for label, ys in curves.items()]
    (panel,) = view("here", {"panel": points}, methods, with_ratios=True)["panels"]
    return {one["label"]: one for one in panel["curves"]}


def test_a_ratio_is_to_the_truth_of_the_curve():
    curves = {"HI + noise": (2, 4), "PCA": (1, 4), "PCA, masked": (1, 1), "PCA, masked: truth": (1, 2)}
    found = curves_to_play(curves)
    assert list(found) == ["HI + noise", "PCA", "PCA, masked"] and "ratio" not in found["HI + noise"]
    assert found["PCA"]["ratio"] == [0.5, 1] and found["PCA, masked"]["ratio"] == [1, 0.5]
    assert found["PCA"]["spread"] == found["PCA"]["ratio_spread"] == []


def test_an_ensemble_is_one_curve_with_a_spread():
    """Its ratios are percentiles of those of its members, each to its own truth."""
    members = np.array([[1.0, 8.0], [3.0, 6.0], [4.0, 4.0]])
    truths = np.array([[1.0, 2.0], [2.0, 2.0], [1.0, 4.0]])
    name, curves = "SDecGMCA, median of 3 (1 failed)", {"HI + noise": (2, 4)}
    for end, several in (("", members), (": truth", truths)):
        percentiles = np.percentile(several, (16, 50, 84), axis=0)
        parts = zip(("16 %", "median", "84 %"), percentiles, strict=True)
        curves |= {f"{name}{end}: {part}": ys for part, ys in parts}
        curves |= {f"{name}{end}: restart {k}": ys for k, ys in enumerate(several)}
    found = curves_to_play(curves)
    assert list(found) == ["HI + noise", name]
    for several, y, spread in ((members, "y", "spread"), (members / truths, "ratio", "ratio_spread")):
        low, middle, high = np.percentile(several, (16, 50, 84), axis=0)
        assert found[name][y] == pytest.approx(list(middle), rel=1e-4)
        ends_and_members = np.vstack([low, high, several])
        assert np.array(found[name][spread]) == pytest.approx(ends_and_members, rel=1e-4)


def test_several_points_at_one_x_are_all_kept():
    """As of restarts with their minimum at the same number of sources."""
    csv = b"panel,curve,x,y\np,all,1,7\np,all,2,8\np,all,3,9\np,least,2,5\np,least,2,6\n"
    groups = [{"x": [1, 2, 3], "y": {"all": [7, 8, 9]}}, {"x": [2, 2], "y": {"least": [5, 6]}}]
    figure = Figure(name="f", caption="", notebook="n", png=b"", data={"csv": csv})
    for panels in (of_notebook(figure), of_stored({"panels": {"p": groups}})):
        (panel,) = view("here", panels, apart)["panels"]
        assert panel["x"] == [1, 2, 2, 3]
        assert [one["y"] for one in panel["curves"]] == [[7, 8, 8, 9], [None, 5, 6, None]]


def test_curves_of_each_figure_to_play_with_look_different():
    """A style that a label no longer gets would make two curves look alike."""
    paths, playable = sorted((ROOT / "notebooks").glob("*.ipynb")), {*SPECTRA, *LINES}
    drawn = [one for path in paths for one in figures(path) if one.name in playable]
    assert {one.name for one in drawn} == playable
    for figure in drawn:
        views = content_of(ROOT, figure)["views"]
        for label, panel in [(one["label"], panel) for one in views for panel in one["panels"]]:
            curves, keys = panel["curves"], ("color", "dash", "width", "points")
            looks = [str({k: one.get(k) for k in keys}) for one in curves]
            assert len(set(looks)) == len(looks), (figure.name, label, panel["title"])
            ratios = [one.get("ratio") for one in curves if one["label"] != "HI + noise"]
            assert figure.name not in SPECTRA or all(ratios)


def test_labels_are_plain():
    assert plain(r"$k_\nu$ [MHz$^{-1}$]") == "k [MHz⁻¹]"
    assert plain(r"SDecGMCA, $C_\ell$ alone") == "SDecGMCA, C(ℓ) alone"
