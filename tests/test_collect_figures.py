"""The figures of executed copies are gathered with their numbers and with what made them."""

import json

import collect_figures
import nbformat
import numpy as np
import pytest
from click.testing import CliRunner
from conftest import ROOT
from PIL import Image

from himap.app.notebook_files import (
    STAMP,
    Figure,
    figure_order,
    figures,
    named_figures,
    plain_caption,
    read_notebook,
    write_notebook,
)
from himap.app.notebooks import find
from himap.figures.numbers import QUOTED
from himap.maps.healpix_io import write_maps


@pytest.fixture(scope="module")
def gathered(tmp_path_factory):
    """The folder that is written for a copy of a chapter with other parameters, and the copy."""
    folder = tmp_path_factory.mktemp("gathered")
    node = read_notebook(ROOT / "notebooks" / "10_results.ipynb")
    parameters = {"preset": "paper", "galaxy": "templates", "template_dir": "/somewhere/else"}
    node.metadata[STAMP]["parameters"] = parameters
    write_notebook(node, folder / "copy.ipynb")
    arguments = [str(folder / "copy.ipynb"), str(folder / "out")]
    CliRunner().invoke(collect_figures.main, arguments, catch_exceptions=False)
    return folder / "out", folder / "copy.ipynb"


def rows_of(folder):
    return json.loads((folder / "figures.json").read_text())["figures"]


def test_what_made_a_figure_stays_with_it_but_no_path(gathered):
    folder, copy = gathered
    stamp = read_notebook(copy).metadata[STAMP]
    execution = stamp["execution"]
    assert [row["paper"] for row in rows_of(folder)] == ["1", "2"]
    for row in rows_of(folder):
        assert row["parameters"] == {"preset": "paper", "galaxy": "templates"}
        assert row["execution"] == execution and execution["commit"]
        assert row["code"] == find("10_results").figure_fingerprint(row["name"])
        with Image.open(folder / f"{row['name']}.png") as picture:
            assert picture.width > 500
    assert "somewhere" not in (folder / "figures.json").read_text()


def test_templates_that_are_there_tell_their_nside(tmp_path):
    for name in ("synchrotron_408MHz", "synchrotron_beta", "freefree_30GHz"):
        pixels = np.full((1, 12 * 8**2), 1.0)
        write_maps(tmp_path / f"{name}.fits", pixels, names=["T"], unit="K", nested=False)
    parameters = {"preset": "paper", "galaxy": "templates", "template_dir": str(tmp_path)}
    made = collect_figures.without_places(parameters)
    assert made == {"preset": "paper", "galaxy": "templates (nside 8)"}


def test_numbers_are_those_of_the_notebook(gathered):
    folder, copy = gathered
    for figure, row in zip(figures(copy), rows_of(folder), strict=True):
        found = {
            (panel, curve): list(zip(group["x"], ys, strict=True))
            for panel, groups in row["panels"].items()
            for group in groups
            for curve, ys in group["y"].items()
        }
        panels = figure.curves.items()
        expected = {(panel, one): points for panel, many in panels for one, points in many.items()}
        assert found.keys() == expected.keys() and len(found) > 10
        assert all(np.allclose(found[key], points, rtol=1e-3) for key, points in expected.items())


def test_captions_say_the_numbers_that_they_quote(gathered, tmp_path):
    node = read_notebook(gathered[1])
    named = {"scrapbook": {"name": "results_loss", "mime_prefix": "application/papermill.record/"}}
    quoted = nbformat.v4.new_output("display_data", {QUOTED[0]: "'95\\xa0%'"}, metadata=named)
    node.cells.append(nbformat.v4.new_code_cell("", outputs=[quoted]))
    (first, *_) = [cell for cell in node.cells if "figure" in cell.metadata.get("mystnb", {})]
    first.metadata["mystnb"]["figure"]["caption"] = "Of it {glue:text}`results_loss` is left."
    write_notebook(node, tmp_path / "copy.ipynb")
    assert figures(tmp_path / "copy.ipynb")[0].caption == "Of it 95\N{NO-BREAK SPACE}% is left."


def test_curves_on_other_points_keep_their_own():
    text = b"panel,curve,x,y\np,a,1,2\np,a,2,3\np,b,1,4\np,b,2,5\np,c,7,nan\n"
    one = Figure(name="f", caption="", notebook="n", png=b"", data={"csv": text})
    groups = [{"x": [1, 2], "y": {"a": [2, 3], "b": [4, 5]}}, {"x": [7], "y": {"c": [None]}}]
    assert collect_figures.curves(one) == {"p": groups}


def test_notebooks_without_such_figures_are_told(tmp_path):
    arguments = [str(ROOT / "notebooks" / "01_simulations.ipynb"), str(tmp_path / "out")]
    outcome = CliRunner().invoke(collect_figures.main, arguments)
    assert outcome.exit_code and "has a figure of the paper" in outcome.output
    assert not (tmp_path / "out").exists()


WHOLE = "Pearson r, of six (the paper's Fig. A.1). {glue:text}`n` of them ([readings](a)). Grey: 10 %."
SHARE = "Angular power spectrum. (PCA's share of the paper's Fig. 1.)"
EQUATION = "The paper's Eq. 3 and Fig. 1 on a map"


@pytest.mark.parametrize(
    ("caption", "paper", "named", "plain"),
    [
        (WHOLE, "A.1", ["A.1"], "Pearson r, of six"),
        (SHARE, "", ["1"], "Angular power spectrum"),
        ("A map.", "", [], "A map"),
        (f"{EQUATION}. Grey: 10 %.", "", [], EQUATION),
    ],
)
def test_captions_say_which_figure_of_the_paper_they_show(caption, paper, named, plain):
    assert Figure(name="f", caption=caption, notebook="n", png=b"").paper == paper
    assert (named_figures(caption), plain_caption(caption)) == (named, plain)
    assert plain_caption(WHOLE, whole=True) == "Pearson r, of six. Grey: 10 %"
    assert sorted(["B.1", "7", "A.2", "1", "A.1"], key=figure_order) == ["1", "7", "A.1", "A.2", "B.1"]
