"""What pages and stored results take from executed notebooks: figures, with picture, numbers and caption."""

import base64
import re
from ast import literal_eval
from dataclasses import dataclass, field
from pathlib import Path

from himap.app.captions import paper_figure
from himap.app.notebook_files import read_notebook
from himap.figures.data import DATA_TYPES
from himap.figures.numbers import QUOTED


@dataclass(frozen=True)
class Figure:
    """One figure of a notebook.

    Attributes
    ----------
    name, caption
        Its label and its caption, quoted numbers filled in.
    notebook
        Name of the notebook.
    paper
        Number in the paper, such as "1" or "A.2"; empty if it is not there.
    png
        The picture.
    data
        {ending of the file: its content} of the numbers behind it.
    """

    name: str
    caption: str
    notebook: str
    paper: str
    png: bytes
    data: dict[str, bytes] = field(default_factory=dict)


def figures(path):
    """The figures of the executed notebook at `path`, a list of `Figure` in order."""
    cells = read_notebook(path).cells
    said = _quoted([output for cell in cells for output in cell.get("outputs", [])])
    found = []
    for cell in cells:
        about = cell.metadata.get("mystnb", {}).get("figure")
        bundles = [output.get("data", {}) for output in cell.get("outputs", [])]
        shown = [data for data in bundles if "image/png" in data]
        if about and shown:
            caption = re.sub(r"\{glue:text\}`(\w+)`", lambda role: said[role[1]], about["caption"])
            found.append(
                Figure(
                    name=about["name"],
                    caption=caption,
                    notebook=Path(path).stem,
                    paper=paper_figure(caption),
                    png=base64.b64decode(shown[0]["image/png"]),
                    data=_numbers(shown[0]),
                )
            )
    return found


def _quoted(outputs):
    """{name: text} of what a notebook quotes."""
    named = {output.get("metadata", {}).get("scrapbook", {}).get("name"): output for output in outputs}
    return {name: literal_eval(output["data"][QUOTED[0]]) for name, output in named.items() if name}


def _numbers(data):
    texts = {ending: data[kind] for kind, ending in DATA_TYPES.items() if kind in data}
    return {
        ending: text.encode() if ending == "csv" else base64.b64decode(text) for ending, text in texts.items()
    }
