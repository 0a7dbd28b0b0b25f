"""The committed notebooks are those of today's code, and nbval compares numbers as they are meant."""

import importlib.util
import os
from pathlib import Path

import nbformat
import pytest
from nbval.plugin import IPyNbFile, NbCellError

import himap
from himap.app import reproduce
from himap.app.notebooks import notebooks
from himap.figures.numbers import QUOTED

ROOT = Path(himap.__file__).parents[1]
CONFTEST = ROOT / "notebooks" / "conftest.py"
FOOTER = "quick · synthetic Galaxy · seed 2025 · himap 0.1.0, commit {} · {}"
LINE = FOOTER.format("abc1234", "2.1 s")


def test_the_committed_notebooks_are_fresh():
    stale = reproduce.stale(ROOT / "notebooks")
    lines = "\n".join(f"  {name}: {why}" for name, why in stale.items())
    assert not stale, f"stale notebooks; run `make book`, or `himap run --stale`:\n{lines}"


def test_every_notebook_is_a_pair():
    folder = ROOT / "notebooks"
    executed = {path.stem for path in folder.glob("*.ipynb")}
    assert executed == {notebook.name for notebook in notebooks(folder)}


def test_every_notebook_describes_its_parameters():
    for notebook in notebooks(ROOT / "notebooks"):
        assert notebook.title != notebook.name, notebook.name
        undescribed = [p.name for p in notebook.parameters if not p.help]
        assert notebook.parameters and not undescribed, (notebook.name, undescribed)


def test_no_committed_notebook_shows_a_warning():
    """What Python writes to stderr names a path of one machine and a process, and reads like an accident."""
    for one in notebooks(ROOT / "notebooks"):
        outputs = [
            output for cell in nbformat.read(one.executed, 4).cells for output in cell.get("outputs", [])
        ]
        said = [output.text for output in outputs if output.get("name") == "stderr"]
        assert not said, f"{one.name}: {said[0]}"


def cell(code, *outputs, executed=True):
    """A cell with outputs that a former run is said to have left."""
    return nbformat.v4.new_code_cell(code, execution_count=1 if executed else None, outputs=list(outputs))


def printed(text):
    return nbformat.v4.new_output("stream", name="stdout", text=f"{text}\n")


def shown(text, html):
    data = {"text/plain": text, "text/html": html}
    return nbformat.v4.new_output("execute_result", data, execution_count=1)


def quoted(text, whole=None):
    kinds = dict(zip(QUOTED, filter(None, (repr(text), whole)), strict=False))
    kept = {"scrapbook": {"name": "some_ratio", "mime_prefix": "application/papermill.record/"}}
    return nbformat.v4.new_output("display_data", kinds, metadata=kept)


QUOTE = "from himap.figures.numbers import quote\nquote(some_ratio={})"
SHOW = "from himap.figures.numbers import show\nshow({'ratio': (1.002, 0.01)})"
TABLE = (
    '<div class="himap-table"><table>\n<tr>'
    '<th scope="row" style="text-align:left; vertical-align:top">{}</th>'
    '<td style="text-align:right; vertical-align:top; white-space:nowrap">{} ± 0.010</td>'
    '<td style="text-align:left; vertical-align:top"></td></tr>\n</table></div>'
)
CELLS = {  # what agrees within a tolerance is tested with `agree`; here in which outputs it is looked for
    "within": cell("print('x = 0.987 ± 0.010')", printed("x = 0.996 ± 0.010")),
    "beyond": cell("print('x = 0.987 ± 0.010')", printed("x = 0.998 ± 0.010")),
    "more": cell("print(1)\n2", printed("1")),
    "table_within": cell(SHOW, shown("ratio: 0.999 ± 0.010", TABLE.format("ratio", "0.999"))),
    "table_beyond": cell(SHOW, shown("ratio: 0.999 ± 0.010", TABLE.format("ratio", "0.991"))),
    "quoted_within": cell(QUOTE.format("(95.8, 1, '%')"), quoted("95 %", "95.1 ± 1.0 %")),
    "quoted_beyond": cell(QUOTE.format("(95.8, 1, '%')"), quoted("94 %", "94.1 ± 1.0 %")),
    "quoted_count": cell(QUOTE.format("27"), quoted("27")),
    "quoted_another": cell(QUOTE.format("27"), quoted("26")),
    "quoted_nothing": cell(QUOTE.format("27")),
    "footer": cell(f"print({LINE!r})", printed(FOOTER.format("unknown with edits", "11 min"))),
    "seed": cell(f"print({LINE!r})", printed(LINE.replace("2025", "2026"))),
    "unexecuted": cell("x = 1", executed=False),
    "comment": cell("# only a comment", executed=False),
}
PASSING = {"within", "table_within", "quoted_within", "quoted_count", "footer", "comment"}


@pytest.fixture(scope="module")
def verdicts(request, tmp_path_factory):
    """{name of a cell: what nbval says of it, empty if it passes}."""
    if not request.config.pluginmanager.has_plugin(str(CONFTEST)):  # no notebooks are tested along with this
        spec = importlib.util.spec_from_file_location("conftest_of_notebooks", CONFTEST)
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    path = tmp_path_factory.mktemp("nbval") / "cells.ipynb"
    metadata = {"kernelspec": reproduce.KERNEL}
    nbformat.write(nbformat.v4.new_notebook(cells=list(CELLS.values()), metadata=metadata), path)
    file = IPyNbFile.from_parent(request.session, path=path)
    items = dict(zip(CELLS, file.collect(), strict=True))
    with open(os.devnull, "w") as nowhere, pytest.MonkeyPatch.context() as patch:
        patch.setattr("nbval.kernel.open", lambda *_: nowhere, raising=False)  # nbval would not close it
        file.setup()
        try:
            return {name: said_of(item) for name, item in items.items()}
        finally:
            file.teardown()


def said_of(item):
    try:
        item.runtest()
    except NbCellError:
        return item.repr_failure(pytest.ExceptionInfo.from_current())
    return ""


@pytest.mark.parametrize("name", CELLS)
def test_nbval_with_tolerances(verdicts, name):
    assert (not verdicts[name]) == (name in PASSING), verdicts[name]


def test_nbval_says_how_to_mend_an_unexecuted_notebook(verdicts):
    assert "never executed: run `make book`, or `himap run --stale`" in verdicts["unexecuted"]
