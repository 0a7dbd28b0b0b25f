"""Notebook files: cleaning, stamping, reading and writing of executed notebooks, and their figures.

An executed notebook is cleaned of paths, times and versions, so that repeated execution changes the file,
except for its stamp, only if the content changes; pictures are compressed. The stamp holds the fingerprint of
its code, the parameters that were passed, a digest of its text, which reveals later edits, and information on
the last execution: the commit, the run time, the versions.

The caption of a figure states which figure of the paper it reproduces, ``(the paper's Fig. A.1)``, or lists
those to which it contributes.
"""

import base64
import contextlib
import csv
import hashlib
import io
import json
import re
import tempfile
from ast import literal_eval
from dataclasses import dataclass, field
from pathlib import Path

from himap.core.errors import InputError
from himap.core.files import atomic_files, check_free
from himap.figures.numbers import QUOTED

STAMP = "himap_run"
"""Key of the stamp in the metadata; not ``himap``, used by the header, which jupytext copies to the .py."""

KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}
"""The kernelspec of every notebook."""

_JUPYTEXT = {"formats": "ipynb,py:percent", "notebook_metadata_filter": "himap"}
"""For editing in Jupyter: saving also writes the .py, and keeps its header."""

_REMARK = r"the paper's Fig\. ([\w.]*\w)"
_END = re.compile(r"(?<!\bFig)(?<!\bFigs)(?<!\bEq)(?<!\bSect)(?<!\bApp)\. ")  # of a sentence
_HEAVY = 1e5  # bytes of a picture
_LARGEST_DATA = 3_000_000  # characters of the data of one figure; larger ones are clouds of points
_LONGEST_NAME = 120  # a file name may have 255 bytes
_ROLE = re.compile(r"\{([\w:]+)\}`([^`]*)`")
_FORMULA = re.compile(r"^```\{math\}\n((?::[^\n]*\n)*)(.*?)\n```$", re.MULTILINE | re.DOTALL)
_LABEL = re.compile(r"^\([\w-]+\)=\n|\[([^]]+)\]\([\w-]+\)", re.MULTILINE)  # a label, and a link to one


def stamped(node, source, *, fingerprint, parameters, execution=None):
    """Clean the executed `node` in place, and add the header of its ``.py``, `source`, and its stamp.

    The stamp holds the other arguments; `execution` is `himap.store.provenance.environment` with "seconds".
    """
    import nbformat  # slow, as below, and needed only for notebooks

    from himap.figures.data import DATA_TYPES

    fixed = {"kernelspec": KERNEL, "language_info": {"name": "python"}, "jupytext": _JUPYTEXT}
    node.metadata = nbformat.from_dict(dict(source.metadata) | fixed)
    for cell in node.cells:
        for key in ("papermill", "execution", *([] if cell.metadata.get("tags") else ["tags"])):
            cell.metadata.pop(key, None)
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                data["image/png"] = smaller_picture(data["image/png"])
            for kind in DATA_TYPES:
                if len(data.get(kind, "")) > _LARGEST_DATA:
                    del data[kind]
    number_cells(node)
    stamp = {"fingerprint": fingerprint, "parameters": parameters, "text": text_digest(node)}
    node.metadata[STAMP] = nbformat.from_dict(stamp | ({"execution": execution} if execution else {}))
    return node


def smaller_picture(png):
    """Reduce a picture (base64) to 256 colours, a large one to 128, so that pages load quickly.

    This is a third of the size, without visible difference.
    """
    from PIL import Image

    with Image.open(io.BytesIO(base64.b64decode(png))) as picture:
        if picture.mode == "P":
            return png
        paper = Image.new("RGB", picture.size, "white")
        paper.paste(picture, mask=picture.getchannel("A") if picture.mode == "RGBA" else None)
    for n_colours in (256, 128):
        out = io.BytesIO()
        paper.quantize(n_colours, kmeans=2, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
        if len(out.getvalue()) < _HEAVY:
            break
    return base64.b64encode(out.getvalue()).decode()


def code_cells(node):
    """The code cells that are not only blank lines and comments."""
    return [cell for cell in node.cells if cell.cell_type == "code" and has_code(cell.source)]


def has_code(source):
    """Whether a cell does something, beyond blank lines and comments."""
    return any(line and not line.startswith("#") for line in map(str.strip, source.splitlines()))


def figure_options(cell):
    """{"name", "caption"} of the figure drawn by a cell; empty if none."""
    return cell.metadata.get("mystnb", {}).get("figure", {})


def number_cells(node):
    """Assign ids to cells from their content, so that they persist when other cells are added or removed."""
    seen = {}
    for cell in node.cells:
        key = hashlib.sha256(f"{cell.cell_type}\n{cell.source}".encode()).hexdigest()[:8]
        seen[key] = seen.get(key, 0) + 1
        cell["id"] = f"{key}-{seen[key]}"


def for_jupyter(node, notebook, parameters, seconds):
    """Write into an executed copy of a notebook what otherwise only the book shows.

    Quoted numbers, references, formulas and captions are roles, directives and metadata. The copy of a
    `Notebook`, `node`, is changed: it begins with the parameters, {name: value}, of its execution, and states
    the run time in seconds.
    """
    import nbformat

    numbers = {"": _quoted(node.cells)}

    def plain(role):
        kind, text = role[1], role[2]
        if kind == "cost":
            return f"{seconds:.0f} s for this copy"
        if kind == "glue:text":
            path, _, name = text.rpartition("::")
            if path not in numbers:  # from another chapter of the book
                with contextlib.suppress(OSError, ValueError):
                    numbers[path] = _quoted(read_notebook(notebook.path.parent / path).cells)
            name = name.partition(":")[0]
            return numbers.get(path, {}).get(name, f"`{name}`")  # do not fail after hours of computation
        if kind.startswith("cite"):
            keys = (re.fullmatch(r"(\D*)(.*)", key) for key in text.split(","))
            return f"[{', '.join(f'{key[1].title()} {key[2]}'.strip() for key in keys)}]"
        title, _, target = text.rstrip(">").rpartition("<")
        return f"{title}(`{target}`)" if title else text if kind in ("claim", "term") else f"`{text}`"

    passed = ", ".join(f"`{name}={value}`" for name, value in parameters.items()) or "the book's parameters"
    head = f"> A copy of `{notebook.name}`, executed with {passed}. Its numbers are those of this run; the "
    cells = [nbformat.v4.new_markdown_cell(f"{head}sentences around them were written for that in the book.")]
    for cell in node.cells:
        if cell.cell_type == "markdown":
            cell.source = _ROLE.sub(plain, _LABEL.sub(r"\1", _FORMULA.sub(_formula, cell.source)))
        cells.append(cell)
        if caption := figure_options(cell).get("caption"):
            shown = _ROLE.sub(plain, _LABEL.sub(r"\1", caption))
            cells.append(nbformat.v4.new_markdown_cell(f"*{shown}*"))
    node.cells = cells


def _formula(directive):
    """A formula between dollars, with its label as its number."""
    label = re.search(r":label: (\S+)", directive[1])
    tag = rf"\tag{{{label[1]}}}" if label else ""
    return f"$$\n{directive[2]}{tag}\n$$"


def _quoted(cells):
    """{name: text} of the numbers stored by `himap.figures.numbers.quote` in executed cells."""
    outputs = (output for cell in cells for output in cell.get("outputs", []))
    named = {output.get("metadata", {}).get("scrapbook", {}).get("name"): output for output in outputs}
    return {name: literal_eval(output["data"][QUOTED[0]]) for name, output in named.items() if name}


def text_digest(node):
    """SHA-256 (hex) of the visible source: all cells, their tags and captions, the header."""
    shown = [
        [cell.cell_type, cell.source, cell.metadata.get("tags") or [], cell.metadata.get("mystnb") or {}]
        for cell in node.cells
    ]
    text = json.dumps([shown, node.metadata.get("himap", {})], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def read_notebook(path):
    """The notebook in an ``.ipynb`` file; OSError or ValueError if there is none."""
    import nbformat

    return nbformat.read(path, as_version=4)


def write_notebook(node, path):
    """Write a notebook under a temporary name, then rename it: the file is complete or not written."""
    import nbformat

    with atomic_files(path) as (temporary,):
        temporary.write_text(nbformat.writes(node) + "\n", encoding="utf-8")


def copy_name(notebook, preset, values, suffix=".ipynb"):
    """File name of an executed copy: notebook, preset, and the other parameters that were passed."""
    others = {**values, **values.get("survey", {})}
    pairs = [f"{key}={others[key]}" for key in sorted(set(others) - {"preset", "survey"})]
    label = re.sub(r"[^\w.=+-]+", "-", "_".join([notebook, *([preset] if preset else []), *pairs]))
    if len(label) > _LONGEST_NAME:
        label = f"{label[: _LONGEST_NAME - 9]}_{hashlib.sha256(label.encode()).hexdigest()[:8]}"
    return f"{label}{suffix}"


def check_output(path, suffix=".ipynb", *, overwrite=False):
    """Return `path`, or raise an InputError before hours of computation.

    For another ending, a path that is not writable, or, without `overwrite`, an existing file.
    """
    if path.suffix != suffix:
        raise InputError(f"the output must be a file name ending in {suffix}, got {str(path)!r}.")
    try:  # permissions are not always reliable
        parent = next(folder for folder in path.absolute().parents if folder.exists())
        with tempfile.TemporaryFile(dir=parent):
            pass
    except OSError as error:
        raise InputError(f"the output {path} cannot be written ({error.strerror}).") from None
    check_free([path], overwrite=overwrite)
    return path


@dataclass(frozen=True)
class Figure:
    """A figure: its label, its caption with quoted numbers inserted, the name of its notebook, the picture,
    and {file ending: content} of its data."""

    name: str
    caption: str
    notebook: str
    png: bytes
    data: dict[str, bytes] = field(default_factory=dict)

    @property
    def paper(self):
        """Number of the paper's figure, such as "1" or "A.2"; empty if none."""
        number = re.search(rf"\((?:\w+; )?{_REMARK}", self.caption)
        return number[1] if number else ""

    @property
    def curves(self):
        """{panel: {curve: [(x, y)]}} of its CSV; empty if none."""
        panels = {}
        for row in csv.DictReader(io.StringIO(self.data.get("csv", b"").decode())):
            points = panels.setdefault(row["panel"], {}).setdefault(row["curve"], [])
            points.append((float(row["x"]), float(row["y"])))
        return panels


def named_figures(caption):
    """Numbers of all figures of the paper in a caption, including those to which it contributes."""
    return re.findall(_REMARK, caption)


def plain_caption(caption, *, whole=False):
    """The first sentence of a caption, or all those without roles, without the figure number of the paper."""
    sentences = _END.split(re.sub(rf" \({_REMARK}[^)]*\)", "", caption).rstrip("."))
    return ". ".join(one for one in sentences if "{" not in one) if whole else sentences[0]


def figure_order(number):
    """Sort key for numbers of the paper's figures: 1 to 7, then those of the appendices."""
    appendix, _, count = number.rpartition(".")
    return appendix, int(count)


def figures(path):
    """The figures of the executed notebook at `path`, a list of `Figure` in order."""
    from himap.figures.data import DATA_TYPES  # slow, and not needed to run a notebook

    cells = read_notebook(path).cells
    quoted, drawn = _quoted(cells), []
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
