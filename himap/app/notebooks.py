"""The notebooks: where they are, what each declares, and the fingerprint of its code.

A notebook is a pair: ``NN_name.py`` (py:percent), which people edit, and ``NN_name.ipynb``, executed,
which people open.
"""

import hashlib
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path

from himap.app.captions import named_figures
from himap.app.notebook_files import code_cells, number_cells
from himap.app.parameters import read_parameters
from himap.core.errors import InputError
from himap.store.accepted import ACCEPTED, PROBES
from himap.store.fingerprint import CodeTree

_PACKAGE = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Notebook:
    """One notebook of the companion, by the path of its ``.py``."""

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
        """The notebook as nbformat has it, without outputs, every cell under an id of its own."""
        import jupytext  # slow, and most commands do without

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
    def section(self):
        """The section of the paper, from the header's ``himap: section``."""
        return str(self.node.metadata.get("himap", {}).get("section", ""))

    @property
    def figures(self):
        """The figures of the paper, from the header's ``himap: figures``."""
        return [str(figure) for figure in self.node.metadata.get("himap", {}).get("figures", [])]

    @cached_property
    def parameters(self):
        """What the cell tagged ``parameters`` declares, a list of `himap.app.parameters.Parameter`."""
        tagged = [cell for cell in self.node.cells if "parameters" in cell.metadata.get("tags", [])]
        return [parameter for cell in tagged for parameter in read_parameters(cell.source)]

    @property
    def captions(self):
        """{name of a figure: its caption, as it is written}."""
        cells = [cell.metadata.get("mystnb", {}).get("figure", {}) for cell in self.node.cells]
        return {cell["name"]: cell["caption"] for cell in cells if "caption" in cell}

    @property
    def reads(self):
        """The files of the checkout that it reads, from the patterns in the header's ``himap: reads``."""
        root, patterns = self.path.parent.parent, self.node.metadata.get("himap", {}).get("reads", [])
        files = {path for pattern in patterns for path in root.glob(pattern)}
        return sorted(path for path in files if path.name not in (ACCEPTED.name, PROBES.name))

    @property
    def paper_figures(self):
        """{figure of the paper: name of the figure in the book}, from captions that say *the paper's Fig.*"""
        found = {}
        for name, caption in self.captions.items():
            for number in named_figures(caption):
                found.setdefault(number, name)
        return found

    def fingerprint(self, tree=None):
        """{"code", "look", what it reaches in himap, file that it `reads`: digest}; see `CodeTree`."""
        code = (tree or CodeTree()).source_fingerprint(*(cell.source for cell in code_cells(self.node)))
        files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest()[:16] for path in self.reads}
        return code | files


def notebooks_folder():
    """The folder of notebooks beside the package, else ``notebooks`` in the current folder.

    Raises
    ------
    InputError
        There is neither.
    """
    for folder in (_PACKAGE.parent / "notebooks", Path.cwd() / "notebooks"):
        if any(folder.glob("*.py")):
            return folder
    raise InputError(
        "there is no folder `notebooks` beside the package nor in the current folder; run this from a "
        "checkout of himap."
    )


def notebooks(folder=None):
    """All notebooks, in order."""
    paths = (folder or notebooks_folder()).glob("[0-9]*_*.py")
    return [Notebook(path) for path in sorted(paths)]


def find(name, folder=None):
    """The notebook called `name`: its name, its number, or the path of either of its files.

    Raises
    ------
    InputError
        No such notebook; the message lists what there is.
    """
    stem = Path(name).name.removesuffix(".py").removesuffix(".ipynb")
    there = {notebook.name: notebook for notebook in notebooks(folder)}
    matches = [there[key] for key in there if stem in (key, key.partition("_")[0])]
    if len(matches) == 1:
        return matches[0]
    close = get_close_matches(stem, there, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    raise InputError(f"there is no notebook {name!r}{hint}; there are {', '.join(there) or 'none'}.")
