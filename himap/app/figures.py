"""The figures of executed notebooks, with picture, numbers and caption, for pages and stored results.

A caption says which figure of the paper it shows, ``(the paper's Fig. A.1)``, or names those that it has a
share in.
"""

import base64
import csv
import io
import re
from ast import literal_eval
from dataclasses import dataclass, field
from pathlib import Path

from himap.app.notebook_files import figure_options, read_notebook
from himap.figures.numbers import QUOTED

_REMARK = r"the paper's Fig\. ([\w.]*\w)"


@dataclass(frozen=True)
class Figure:
    """One figure of a notebook.

    Attributes
    ----------
    name, caption
        Its label and its caption, quoted numbers filled in.
    notebook
        Name of the notebook.
    png
        The picture.
    data
        {ending of the file: its content} of the numbers behind it.
    """

    name: str
    caption: str
    notebook: str
    png: bytes
    data: dict[str, bytes] = field(default_factory=dict)

    @property
    def paper(self):
        """The number of the paper's figure that it is, such as "1" or "A.2"; empty if it is none."""
        number = re.search(rf"\({_REMARK}", self.caption)
        return number[1] if number else ""

    @property
    def curves(self):
        """{panel: {curve: [(x, y)]}} of its CSV; empty where it has none."""
        panels = {}
        for row in csv.DictReader(io.StringIO(self.data.get("csv", b"").decode())):
            points = panels.setdefault(row["panel"], {}).setdefault(row["curve"], [])
            points.append((float(row["x"]), float(row["y"])))
        return panels


def named_figures(caption):
    """The numbers of all figures of the paper that a caption names, those that it has a share in too."""
    return re.findall(_REMARK, caption)


def plain_caption(caption):
    """The first sentence of a caption, without the remark which figure of the paper it is."""
    return re.sub(rf" \({_REMARK}[^)]*\)", "", caption).partition(". ")[0].rstrip(".")


def figure_order(number):
    """Key that sorts numbers of the paper's figures: 1 to 7, then those of the appendices."""
    appendix, _, count = number.rpartition(".")
    return appendix, int(count)


def figures(path):
    """The figures of the executed notebook at `path`, a list of `Figure` in order."""
    from himap.figures.data import DATA_TYPES  # slow, and who runs a notebook needs none of it

    cells = read_notebook(path).cells
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    named = {output.get("metadata", {}).get("scrapbook", {}).get("name"): output for output in outputs}
    quoted = {name: literal_eval(output["data"][QUOTED[0]]) for name, output in named.items() if name}
    drawn = []
    for cell in cells:
        about = figure_options(cell)
        bundles = [output.get("data", {}) for output in cell.get("outputs", [])]
        shown = [data for data in bundles if "image/png" in data]
        if about and shown:
            caption = re.sub(r"\{glue:text\}`(\w+)`", lambda role: quoted[role[1]], about["caption"])
            data = {
                ending: shown[0][kind].encode() if ending == "csv" else base64.b64decode(shown[0][kind])
                for kind, ending in DATA_TYPES.items()
                if kind in shown[0]
            }
            png = base64.b64decode(shown[0]["image/png"])
            drawn.append(Figure(about["name"], caption, Path(path).stem, png, data))
    return drawn
