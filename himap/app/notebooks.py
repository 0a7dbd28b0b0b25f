"""The notebooks: their location, their declarations, and the fingerprints of their code.

A notebook is a pair: ``NN_name.py`` (py:percent), which is edited, and ``NN_name.ipynb``, executed, which is
read.
"""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from himap.app.notebook_files import code_cells, figure_options, named_figures, number_cells
from himap.app.parameters import read_parameters
from himap.core.errors import InputError, nearest
from himap.store.fingerprint import ACCEPTED, PROBES, CodeTree
from himap.store.sources import behind

_PACKAGE = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Notebook:
    """A notebook of the companion, identified by the path of its ``.py``."""

    path: Path

    @property
    def name(self):
        return self.path.stem

    @property
    def executed(self):
        """Path of the ``.ipynb``."""
        return self.path.with_suffix(".ipynb")

    @cached_property
    def node(self):
        """The notebook as an nbformat node, without outputs, with the id of every cell."""
        import jupytext  # slow, and not needed by most commands

        node = jupytext.read(self.path)
        number_cells(node)
        return node

    @property
    def title(self):
        """The first heading."""
        text = "\n".join(cell.source for cell in self.node.cells if cell.cell_type == "markdown")
        headings = [line[2:].strip() for line in text.splitlines() if line.startswith("# ")]
        return headings[0] if headings else self.name

    @property
    def _header(self):
        return {"section": "", "figures": [], "reads": []} | self.node.metadata.get("himap", {})

    @property
    def section(self):
        """Section of the paper, from ``himap: section`` in the header."""
        return str(self._header["section"])

    @property
    def figures(self):
        """Figures of the paper, from ``himap: figures`` in the header."""
        return list(map(str, self._header["figures"]))

    @cached_property
    def parameters(self):
        """The declared parameters, a list of `himap.app.parameters.Parameter`."""
        return declared_parameters(self.node)

    @property
    def reads(self):
        """Files of the checkout read by the notebook, from the patterns ``himap: reads`` in the header."""
        files = {path for pattern in self._header["reads"] for path in self.path.parents[1].glob(pattern)}
        return sorted(path for path in files if path.name not in (ACCEPTED.name, PROBES.name))

    @property
    def captions(self):
        """{name of a figure: its caption}, without substitutions."""
        abouts = map(figure_options, self.node.cells)
        return {about["name"]: about["caption"] for about in abouts if "caption" in about}

    @property
    def paper_figures(self):
        """{figure of the paper: name of the figure in the book}, from captions with *the paper's Fig.*"""
        names = {}
        for name, caption in self.captions.items():
            for number in named_figures(caption):
                names.setdefault(number, name)
        return names

    def fingerprint(self, tree=None):
        """{"code", "look", products and classes used in himap, files in `reads`: digest}.

        Paths of files are relative to the checkout, from "./": see `himap.store.fingerprint.moved`.
        """
        return self._fingerprint(tree, *(cell.source for cell in code_cells(self.node)))

    def figure_fingerprint(self, name, tree=None):
        """The same for the code behind a figure: its cell, and statements before it that it needs."""
        cells = code_cells(self.node)
        (last,) = (n for n, cell in enumerate(cells) if figure_options(cell).get("name") == name)
        return self._fingerprint(tree, behind(*(cell.source for cell in cells[: last + 1])))

    def _fingerprint(self, tree, *sources):
        code, checkout = (tree or CodeTree()).source_fingerprint(*sources), self.path.parents[1]
        return code | {
            f"./{path.relative_to(checkout)}": hashlib.sha256(path.read_bytes()).hexdigest()[:16]
            for path in self.reads
        }


def declared_parameters(node):
    """Parameters declared by the cells of a notebook tagged ``parameters``, a list of `Parameter`."""
    tagged = [cell for cell in node.cells if "parameters" in cell.metadata.get("tags", [])]
    return [parameter for cell in tagged for parameter in read_parameters(cell.source)]


def notebooks_folder():
    """The folder ``notebooks`` next to the package or in the current folder; InputError if there is none."""
    for folder in (_PACKAGE.parent / "notebooks", Path.cwd() / "notebooks"):
        if any(folder.glob("*.py")):
            return folder
    raise InputError(
        "there is no folder `notebooks` next to the package or in the current folder; run this from a "
        "checkout of himap."
    )


def notebooks(folder=None):
    """All notebooks, in order."""
    return [Notebook(path) for path in sorted((folder or notebooks_folder()).glob("[0-9]*_*.py"))]


def find(name, folder=None):
    """The notebook called `name`: its name, number, or the path of either of its files, case-insensitive.

    InputError if there is none; the message lists the available ones.
    """
    stem = Path(name).name.lower().removesuffix(".py").removesuffix(".ipynb")
    known = {notebook.name: notebook for notebook in notebooks(folder)}
    matches = [known[key] for key in known if stem in (key, key.partition("_")[0])]
    if len(matches) == 1:
        return matches[0]
    names = f"{name!r}{nearest(stem, known)}; there are {', '.join(known) or 'none'}"
    raise InputError(f"there is no notebook {names}.")
