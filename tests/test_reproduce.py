"""Notebooks run with other parameters, and again when something they depend on changed."""

import base64
import copy
import io
import json
import os
import re
import shutil
import sys
from pathlib import Path

import jupytext
import nbformat
import numpy as np
import pytest
from PIL import Image

import himap
from himap import __version__
from himap.app import notebook_files, notebooks, reproduce
from himap.core.errors import InputError
from himap.figures.numbers import QUOTED

TOY = """\
# ---
# jupyter:
#   himap:
#     section: "2.1"
#     figures: ["Fig. 1", "Fig. 2"]
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# A line before.
#
# # The toy
# Some text.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
scale: float = 1.0  # a factor
mode: str = "good"
survey: dict = {}  # Survey fields that differ from the preset

# %%
# A cell of comments only.

# %%
import os

from himap.core.survey import Survey

made = Survey.preset(preset, **survey)
if mode == "bug":
    1 / 0
if mode == "killed":
    os.kill(os.getpid(), 9)

# %%
print(made.nside, scale, os.path.basename(os.getcwd()))
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of one notebook, next to a working folder."""
    (tmp_path / "notebooks").mkdir()
    (tmp_path / "notebooks" / "01_toy.py").write_text(TOY)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "notebooks"


def outputs(path):
    node = nbformat.read(path, as_version=4)
    return "".join(out.text for cell in node.cells if cell.cell_type == "code" for out in cell.outputs)


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def papermill_without_kernel(node, *_, **options):
    """In the place of an execution: the outputs are the numbers of the cells, and nothing on itself."""
    for number, cell in enumerate(reproduce.code_cells(node)):
        cell.execution_count = number + 1
        cell.outputs = [nbformat.v4.new_output("stream", name="stdout", text=f"{number}\n")]
    node.cells[-1].outputs[0].text = "{}"
    return node


@pytest.fixture
def no_kernel(monkeypatch):
    monkeypatch.setattr("papermill.execute_notebook", papermill_without_kernel)


@pytest.fixture
def executed(folder, no_kernel):
    """The path of an executed notebook."""
    reproduce.refresh(folder=folder)
    return folder / "01_toy.ipynb"


def test_what_a_notebook_says_of_itself_and_how_it_is_found(folder):
    (notebook,) = notebooks.notebooks(folder)
    assert (notebook.name, notebook.title, notebook.section) == ("01_toy", "The toy", "2.1")
    assert notebook.figures == ["Fig. 1", "Fig. 2"]
    assert [p.name for p in notebook.parameters] == ["preset", "scale", "mode", "survey"]
    for name in ["01_toy", "01", "notebooks/01_toy.ipynb", str(folder / "01_toy.py")]:
        assert notebooks.find(name, folder).name == "01_toy"
    with pytest.raises(InputError, match=r"no notebook '01_tyo' \(did you mean 01_toy\?\); there are 01_toy"):
        notebooks.find("01_tyo", folder)


def test_the_folder_of_notebooks(folder, monkeypatch, tmp_path):
    monkeypatch.setattr(notebooks, "_PACKAGE", tmp_path / "site-packages" / "himap")
    with pytest.raises(InputError, match="no folder `notebooks`"):
        notebooks.notebooks_folder()
    monkeypatch.chdir(tmp_path)
    assert notebooks.notebooks_folder() == folder
    monkeypatch.setattr(notebooks, "_PACKAGE", tmp_path / "himap")
    monkeypatch.chdir("work")
    assert notebooks.notebooks_folder() == folder


def test_names_of_copies_differ_and_fit_a_file_system():
    assert notebook_files.copy_name("01_toy", "ci", {"preset": "ci"}) == "01_toy_ci.ipynb"
    one, two = (notebook_files.copy_name("01_toy", None, {"path": f"{n}/a folder/" * 40}) for n in (1, 2))
    assert one != two and len(one) == len(two) < 130
    assert not set("/ ") & set(one)


@pytest.mark.parametrize("name", ["good", "~/good"])
def test_a_file_that_a_parameter_names_and_that_changed_is_read_again(folder, no_kernel, monkeypatch, name):
    monkeypatch.setenv("HOME", os.getcwd())
    Path("good").write_text("1")
    once = {"parameters": {"mode": name, "preset": "ci"}, "folder": folder, "again": False}
    assert [reproduce.run("01", **once)[1] for _ in range(2)] == [True, False]
    Path("good").write_text("12")
    assert reproduce.run("01", **once)[1]
    Path("good").unlink()
    Path("good").mkdir()
    Path("good/table.txt").write_text("1")
    assert [reproduce.run("01", **once)[1] for _ in range(2)] == [True, False]


def test_files_in_lists_and_of_beams_are_found_and_folders_are_the_same_in_a_kernel(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    Path("w.txt").write_text("1")
    for value in (
        "w.txt",
        ["a", "w.txt"],
        {"a": ["w.txt"]},
        "file:path=w.txt",
        "misjudged:beam=w.txt,width=0.1",
    ):
        found = [reproduce._files_in({"beam": value}) for _ in range(2)]
        Path("w.txt").write_text(Path("w.txt").read_text() + "1")
        assert found[0] == found[1] != reproduce._files_in({"beam": value}) and "beam" in found[0]
    assert reproduce._files_in({"beam": "meerkat:band=L", "n": 3, "names": ["a"]}) == {}
    monkeypatch.setenv("HIMAP_CACHE", "cache")
    assert reproduce._kernel_variables()["HIMAP_CACHE"] == str(tmp_path / "cache")


WORDS = """
# %% mystnb={"figure": {"name": "fig-toy", "caption": "Of {glue:text}`toy_scale` ([end](toy-end))."}}
from himap.figures.numbers import quote

quote(toy_scale=(scale, 0.1, "mK"))

# %% [markdown]
# (toy-end)=
# Here {glue:text}`toy_scale`, there {glue:text}`00_book.ipynb::toy_scale:s`.
# {cite:p}`bigot-sazy2015,wolz2014`.
# {doc}`Other <00_book>`, {doc}`00_book`, {claim}`B1`, {eq}`eq-toy`, {cost}`01_toy`.
#
# ```{math}
# :label: eq-toy
# x = \\hat{y}
# ```
"""


def test_a_copy_reads_well_where_roles_and_captions_are_not_known(folder, monkeypatch):
    toy = folder / "01_toy.py"
    toy.write_text(TOY + WORDS)
    reproduce.refresh(folder=folder)
    kept = toy.with_suffix(".ipynb")
    assert "{glue:text}`toy_scale`" in kept.read_text() and reproduce.stale(folder) == {}
    shutil.copy(kept, folder / "00_book.ipynb")
    passed = {"parameters": {"scale": 4}, "folder": folder}
    path, _ = reproduce.run("01", **passed)
    cells = nbformat.read(path, as_version=4).cells
    first, *_, drawn, caption, words = cells
    assert first.source.startswith("> A copy of `01_toy`, executed with `scale=4.0`.")
    assert "quote(" in drawn.source and caption.source == "*Of 4.0\N{NO-BREAK SPACE}mK (end).*"
    seconds = words.source.partition("B1, `eq-toy`, ")[2].partition(" s for this copy.")[0]
    assert words.source == (
        "Here 4.0\N{NO-BREAK SPACE}mK, there 1.0\N{NO-BREAK SPACE}mK.\n[Bigot-Sazy 2015, Wolz 2014].\n"
        f"Other (`00_book`), `00_book`, B1, `eq-toy`, {seconds} s for this copy.\n\n"
        "$$\nx = \\hat{y}\\tag{eq-toy}\n$$"
    )
    assert 0 < float(seconds) < 600
    monkeypatch.setattr("papermill.execute_notebook", papermill_without_kernel)
    assert reproduce.run("01", **passed) == (path, True)  # it counts as himap's own, which nobody edited


def test_a_copy_is_written_although_a_number_is_missing(folder, no_kernel):
    words = "{glue:text}`no_such`, {glue:text}`99_none.ipynb::other:s`, {glue:text}`broken.ipynb::more:s`"
    (folder / "01_toy.py").write_text(f"{TOY}\n# %% [markdown]\n# {words}, {{cite:t}}`2024`\n")
    (folder / "broken.ipynb").write_text("{")
    path, _ = reproduce.run("01", folder=folder)
    assert nbformat.read(path, as_version=4).cells[-1].source == "`no_such`, `other`, `more`, [2024]"


def test_a_run_with_other_parameters(folder, monkeypatch):
    passed = {"parameters": {"preset": "ci", "scale": 2, "nside": 16}, "folder": folder}
    path, done = reproduce.run("01", **passed)
    assert done and str(path) == "results/01_toy_ci_nside=16_scale=2.0.ipynb"
    assert outputs(path) == "16 2.0 work\n"
    assert os.listdir("results") == [path.name]
    assert os.listdir(folder) == ["01_toy.py"]
    text = path.read_text()
    assert str(folder.parent) not in text and "papermill" not in text and "start_time" not in text
    assert all(re.fullmatch(r"[0-9a-f]{8}-1", cell["id"]) for cell in json.loads(text)["cells"])
    stamp = json.loads(text)["metadata"]["himap_run"]
    assert stamp["parameters"] == {"preset": "ci", "scale": 2.0, "survey": {"nside": 16}}
    assert stamp["fingerprint"] == notebooks.find("01", folder).fingerprint()
    monkeypatch.setattr("papermill.execute_notebook", papermill_without_kernel)
    book = notebooks.find("01", folder).executed
    shutil.copy(path, book)
    assert reproduce.stale(folder) == {"01_toy": "it was executed with other parameters"}
    book.unlink()
    values = {"preset": "ci", "scale": 3, "nside": 16}
    other = passed | {"parameters": values, "output": path, "overwrite": True}
    assert reproduce.run("01", **other, again=False)[1]  # those of the file, not of its name
    with pytest.raises(InputError, match="exists"):
        reproduce.run("01", **passed)
    assert reproduce.run("01", **passed, overwrite=True)[1]
    text = path.read_text()
    execution = stamp["execution"]
    assert 0 < execution["seconds"] < 600 and execution["himap"] == __version__
    assert execution["packages"]["numpy"] == np.__version__
    assert reproduce.run("01", **passed, again=False) == (path, False)
    assert path.read_text() == text
    assert reproduce.run("01", **passed)[1]
    edit(folder / "01_toy.py", "A cell of comments only.", "Other comments.")
    edit(folder / "01_toy.py", "print(made", "made.nside\nprint(made")
    assert reproduce.run("01", **passed, again=False)[1]


def test_the_kernel_is_of_this_python_and_says_what_it_ran_with(folder, tmp_path, monkeypatch):
    """And of this himap, also where it lies in the current folder, as in a checkout that is not installed.

    The kernel is not one called python3 elsewhere on Jupyter's path, nor started by what is configured
    elsewhere; and the stamp is what it says. Neither a home that cannot be written nor what a user lets
    IPython do at each start comes into the notebook.
    """
    elsewhere, startup = tmp_path / "elsewhere", tmp_path / "ipython" / "profile_default" / "startup"
    spec = elsewhere / "kernels" / "python3" / "kernel.json"
    for path in (spec.parent, startup):
        path.mkdir(parents=True)
    spec.write_text(json.dumps({"argv": ["false"], "display_name": "Python 3", "language": "python"}))
    (startup / "own.py").write_text("mine = 1")
    monkeypatch.setenv("JUPYTER_PATH", str(elsewhere))
    monkeypatch.setenv("JUPYTER_DEFAULT_PROVISIONER_NAME", "on-another-machine")
    monkeypatch.setenv("HOME", "/dev/null")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.delenv("MPLCONFIGDIR", raising=False)
    place = Path(himap.__file__).resolve().parents[1]
    monkeypatch.chdir(place)
    code = "import matplotlib.pyplot, sys\nfrom himap.store import provenance\n\n"
    code += f"provenance.__version__ = sys.executable\nprint({str(place)!r} in sys.path, 'mine' in globals())"
    (folder / "02_who.py").write_text(f"# %%\n{code}")
    path, _ = reproduce.run("02", folder=folder, output=tmp_path / "who.ipynb")
    node = nbformat.read(path, as_version=4)
    execution = node.metadata["himap_run"]["execution"]
    version = ".".join(map(str, sys.version_info[:3]))
    assert (execution["himap"], execution["python"]) == (sys.executable, version)
    assert outputs(path) == "True False\n" and len(node.cells) == 2  # it begins with its parameters


@pytest.mark.parametrize(
    "mode, message",
    [
        ("bug", r"01_toy stopped in cell \[3\] with ZeroDivisionError: division"),
        ("killed", r"kernel of 01_toy died of signal 9 \(SIGKILL\)\.$"),
    ],
)
def test_a_run_that_fails_leaves_nothing(folder, mode, message):
    """An InputError in a kernel is in test_cli.py."""
    with pytest.raises(reproduce.NotebookError, match=message):
        reproduce.run("01", parameters={"mode": mode}, output="new/out.ipynb", folder=folder)
    assert os.listdir() == []


def test_bad_outputs_are_refused_at_once(folder, tmp_path):
    (tmp_path / "work" / "file").touch()
    (tmp_path / "work" / "folder.ipynb").mkdir()
    for output in ["", "out", "folder.ipynb", "file/out.ipynb", "x" * 300 + ".ipynb"]:
        with pytest.raises(InputError, match="the output"):
            reproduce.run("01", output=output, folder=folder)
    with pytest.raises(InputError, match="the book's copy"):
        reproduce.run("01", output=folder / "01_toy.ipynb", folder=folder)
    assert not (folder / "01_toy.ipynb").exists()


SECONDS = r'"seconds": [\d.]+'  # all that two executions of the same code differ in


def test_refreshing_executes_once_and_writes_the_same_file_again(folder):
    """Where only the text changed, without executing: with the outputs, and among them numbers for prose."""
    code = "from himap.figures.numbers import quote\nquote(toy_scale=(scale, 0.1))\n"
    edit(folder / "01_toy.py", "print(made", f"{code}print(made")
    executed, said = folder / "01_toy.ipynb", []

    def kept():
        cells = nbformat.read(executed, as_version=4).cells
        return [out for cell in cells for out in cell.get("outputs", [])]

    assert reproduce.stale(folder) == {"01_toy": "there is no executed notebook"}
    done = reproduce.refresh(folder=folder, report=lambda *what: said.append(what))
    assert done == {"01_toy": "there is no executed notebook"} and said == [*done.items()]
    before = number, printed = kept()
    assert number.data == dict(zip(QUOTED, ("'1.0'", "1.00 ± 0.10"), strict=True))
    assert number.metadata.scrapbook.name == "toy_scale" and printed.text == "64 1.0 notebooks\n"
    assert reproduce.stale(folder) == {} == reproduce.refresh(folder=folder)
    first = re.sub(SECONDS, "", executed.read_text())
    executed.unlink()
    reproduce.refresh(["01"], folder=folder)
    assert re.sub(SECONDS, "", executed.read_text()) == first
    edit(folder / "01_toy.py", "Some text", "Other text")
    edit(folder / "01_toy.py", "# %%\n# A cell of comments only.\n", "# %%\n# One.\n\n# %%\n# Two.\n")
    assert reproduce.refresh(folder=folder) == {"01_toy": "its text changed"} and kept() == before
    assert "Other text" in executed.read_text() and reproduce.stale(folder) == {}


@pytest.mark.parametrize(
    "file, old, new, why",
    [
        ("py", "1 / 0", "1 / 0  # on purpose", "its text changed"),
        ("py", "Some text", "Other text", "its text changed"),
        ("py", "2.1", "2.2", "its text changed"),
        ("py", "comments only", "comments", "its text changed"),
        ("py", "# %%\n# A cell of comments only.\n", "", "its text changed"),
        ("py", "# %%\nprint(made", '# %% tags=["hide-input"]\nprint(made', "its text changed"),
        ("py", "scale: float = 1.0", "scale: float = 2.0", "the code behind it changed"),
        ("ipynb", '"execution_count": 2', '"execution_count": null', "it was never executed"),
        ("ipynb", '"cells": [', '"cells": ', "there is no executed notebook"),
    ],
)
def test_an_edit_of_one_of_the_pair(folder, executed, file, old, new, why):
    assert reproduce.stale(folder) == {}
    edit(folder / f"01_toy.{file}", old, new)
    assert reproduce.stale(folder) == {"01_toy": why}


CODE = "the code behind it changed"
LOOKS = "only its looks changed"


@pytest.mark.parametrize(
    "changes, why",
    [
        ({"code": "other"}, CODE),
        ({"code": "other", "look": "other"}, CODE),
        ({"look": "other"}, LOOKS),
        ({"pca": "a method that was not there"}, ""),
    ],
)
def test_code_of_the_library_that_changes(folder, executed, monkeypatch, changes, why):
    """Where only the looks did, a notebook is drawn again, but not stale."""
    real = notebooks.CodeTree.source_fingerprint
    monkeypatch.setattr(notebooks.CodeTree, "source_fingerprint", lambda *args: real(*args) | changes)
    expected = {"01_toy": why} if why else {}
    assert reproduce.stale(folder) == ({} if why == LOOKS else expected)
    assert reproduce.stale(folder, looks=True) == expected == reproduce.refresh(folder=folder)
    assert reproduce.stale(folder, looks=True) == {}


def test_a_file_that_a_notebook_reads_changes(folder, no_kernel):
    """The header names such files by patterns, from the folder above; those of one name are two files."""
    first, second = (folder.parent / name / "stored.json" for name in "ab")
    for path in (first, second):
        path.parent.mkdir()
        path.write_text("1")
    edit(folder / "01_toy.py", "#     section:", '#     reads: ["*/*.json"]\n#     section:')
    reproduce.refresh(folder=folder)
    (first.parent / "accepted.json").write_text("{}")  # what is accepted is no result
    assert notebooks.find("01_toy", folder).reads == [first, second] and reproduce.stale(folder) == {}
    first.write_text("2")
    assert reproduce.stale(folder) == {"01_toy": "./a/stored.json changed"}
    first.write_text("1")
    (first.parent / "another.json").write_text("1")  # which the chapter would read if it was executed now
    assert reproduce.stale(folder) == {"01_toy": "./a/another.json changed"}


def test_saving_in_jupyter_keeps_the_header(folder, executed):
    node = nbformat.read(executed, as_version=4)
    text = jupytext.writes(node, "py:percent")
    lines = {line.lstrip("# ") for line in text.splitlines()[:40]}
    assert lines >= {"section: '2.1'", "- Fig. 1", "name: python3"} and "himap_run" not in text
    (folder / "01_toy.py").write_text(text)
    assert reproduce.stale(folder) == {}


def test_edits_made_in_jupyter_are_not_lost(folder, executed):
    edit(executed, "Some text", "My text")
    assert reproduce.stale(folder) == {"01_toy": "edited in Jupyter, differs from its .py"}
    before = executed.read_bytes()
    with pytest.raises(InputError, match="01_toy.ipynb was edited in Jupyter"):
        reproduce.refresh(folder=folder)
    assert executed.read_bytes() == before
    edit(folder / "01_toy.py", "Some text", "My text")  # what jupytext does on saving
    assert reproduce.stale(folder) == {"01_toy": "its text changed"}
    reproduce.refresh(folder=folder)
    assert reproduce.stale(folder) == {}


def test_pictures_are_packed_and_stay_what_they_were():
    """256 colours do for a figure: a photograph-like gradient moves by a few of its 255 levels, once. What is
    transparent becomes white.
    """
    rng = np.random.default_rng(1)
    levels = np.clip(np.linspace(0, 200, 120)[:, None] + 30 * rng.random((120, 160)), 0, 255)
    opaque = np.where(np.arange(120) < 100, 255, 0)[:, None] + np.zeros((120, 160))
    pixels = np.stack([levels, levels[::-1], np.full_like(levels, 120), opaque], axis=-1).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    before = base64.b64encode(buffer.getvalue()).decode()
    after = notebook_files.smaller_picture(before)
    assert len(after) < 0.7 * len(before)
    packed = np.asarray(Image.open(io.BytesIO(base64.b64decode(after))).convert("RGB"), dtype=float)
    assert np.abs(packed - pixels[..., :3])[:100].mean() < 5 and (packed[100:] == 255).all()
    assert notebook_files.smaller_picture(after) == after


def test_clouds_of_points_are_not_kept():
    source = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1")])
    node = copy.deepcopy(source)
    curves_of_the_paper = "degraded,SDecGMCA,123,1.2345e-05\n" * 40_000
    for text in (curves_of_the_paper, "1,2\n" * 1_000_000):
        data = {"text/csv": text, "text/plain": "1"}
        node.cells[0].outputs.append(nbformat.v4.new_output("display_data", data=data))
    outputs = notebook_files.stamped(node, source, fingerprint="", parameters={}).cells[0].outputs
    assert ["text/csv" in output.data for output in outputs] == [True, False]


@pytest.mark.parametrize("harm", ["a cell", "another file", "other parameters", "nothing"])
def test_what_somebody_wrote_is_not_lost(folder, no_kernel, harm):
    """It stays without --overwrite: a copy that was edited, a file of another kind or of a chosen name.

    And a copy with other parameters whose name is the same, as a file system does not take all characters.
    """
    output = "mine.ipynb" if harm == "nothing" else None
    passed = {"parameters": {"mode": "a/b" + "b" * 300}, "folder": folder, "output": output}
    path, done = reproduce.run("01", **passed)
    assert done and (harm == "nothing" or reproduce.run("01", **passed) == (path, True))
    if harm == "a cell":
        node = nbformat.read(path, as_version=4)
        node.cells.append(nbformat.v4.new_code_cell("mine = 1", id="mine"))
        nbformat.write(node, path)
    elif harm == "another file":
        path.write_text("a thesis")
    elif harm == "other parameters":
        passed["parameters"] = {"mode": "a b" + "b" * 300}
    before = path.read_bytes()
    with pytest.raises(InputError, match=f"{path.name} exists; .* give --overwrite"):
        reproduce.run("01", **passed)
    assert path.read_bytes() == before
    assert reproduce.run("01", **passed, overwrite=True)[1]
    assert (path.read_bytes() == before) == (harm == "nothing")
