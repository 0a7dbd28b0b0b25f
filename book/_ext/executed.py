"""What the pages take from the executed notebooks: their figures, with picture, numbers and caption."""

import base64
import re
from dataclasses import dataclass, field
from pathlib import Path

import nbformat

from himap.figures.data import DATA_TYPES


@dataclass(frozen=True)
class Figure:
    """One figure of a notebook.

    Attributes
    ----------
    name, caption
        Its label and its caption.
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
    """The figures of one notebook, in order."""
    found = []
    for cell in nbformat.read(path, as_version=4).cells:
        about = cell.metadata.get("mystnb", {}).get("figure")
        bundles = [output.get("data", {}) for output in cell.get("outputs", [])]
        shown = [data for data in bundles if "image/png" in data]
        if about and shown:
            number = re.search(r"\(the paper's Fig\. ([\w.]*\w)", about["caption"])
            found.append(
                Figure(
                    name=about["name"],
                    caption=about["caption"],
                    notebook=Path(path).stem,
                    paper=number[1] if number else "",
                    png=base64.b64decode(shown[0]["image/png"]),
                    data=_numbers(shown[0]),
                )
            )
    return found


def _numbers(data):
    texts = {ending: data[kind] for kind, ending in DATA_TYPES.items() if kind in data}
    return {
        ending: text.encode() if ending == "csv" else base64.b64decode(text) for ending, text in texts.items()
    }
