"""How `pytest --nbval notebooks/` compares the notebooks.

nbval compares every text exactly. Here a number shown as ``value ± tolerance`` may move by its
tolerance, one marked as of one run of a chaotic method (``value†``) is compared in form only, the commit
and the time in the line under a figure may differ, and a cell that was never executed fails. The numbers
that a figure carries must be there and are not compared, as pictures are not. All the rest is exact, as in
nbval. A number for the prose carries its tolerance or its mark next to its text, and is compared likewise.
"""

import re

import nbval.kernel
from nbval.plugin import IPyNbCell

from himap.app.kernels import LocalKernelManager
from himap.app.notebook_files import has_code
from himap.figures.data import DATA_TYPES
from himap.figures.numbers import QUOTED, agree
from himap.store.provenance import VOLATILE

_compare_exactly = IPyNbCell.compare_outputs
_run = IPyNbCell.runtest


def compare_outputs(self, test, ref, skip_compare=None):
    """nbval's comparison, after texts that agree within tolerance were made the same."""
    settled = [_settled(mine, theirs) for mine, theirs in zip(test, ref, strict=False)]
    same = _compare_exactly(self, settled + test[len(ref) :], ref, skip_compare)
    if not same:  # nbval names the stream only
        self.comparison_traceback += [one["text"] for one in test if one.get("name") == "stderr"]
    return same


def runtest(self):
    """Run the cell and compare its outputs."""
    if has_code(self.cell.source) and self.cell.execution_count is None and not self.options["skip"]:
        self.raise_cell_error("the notebook was never executed: run `make book`, or `himap run --stale`")
    _run(self)


def _settled(test, reference):
    """`test`, an output or the data in one, with the texts of `reference` wherever the two agree."""
    text, whole = QUOTED
    near = whole in test and whole in reference and agree(test[whole], reference[whole])
    same = {text: reference[text]} if near else {}
    return type(test)(
        (key, _settled_value(key, value, reference[key]) if key in reference else value)
        for key, value in {**test, **same}.items()
        if key not in DATA_TYPES or key in reference  # too large to be kept
    )


def _settled_value(key, test, reference):
    if key in DATA_TYPES:
        return reference
    if isinstance(test, dict) and isinstance(reference, dict):
        return _settled(test, reference)
    texts = isinstance(test, str) and isinstance(reference, str)
    same = texts and agree(re.sub(VOLATILE, "", test), re.sub(VOLATILE, "", reference))
    return reference if same else test


nbval.kernel.KernelManager = LocalKernelManager
IPyNbCell.compare_outputs = compare_outputs
IPyNbCell.runtest = runtest
