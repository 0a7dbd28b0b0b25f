"""Python source: files on disk and as loaded by this process, and the definitions of a module."""

import ast
import hashlib
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path

from himap.store.syntax import (
    IMPORTS,
    Hole,
    Writer,
    assigns,
    bound_name,
    called,
    is_text,
    names_bound,
    names_in,
)

ROOT = Path(__file__).resolve().parents[1]
"""The folder of himap."""

RUN = "<run>"
"""Name of the part of a module that runs on import, regardless of the names used from it."""

IGNORED = {
    "himap.core.errors",
    "himap.core.files",
    "himap.core.memory",
    "himap.core.progress",
    "himap.store",
}
"""Packages, except for their `LOOKS`, that store, time, distribute, validate and label computations: no
number depends on them."""

LOOKS = {
    *("himap.figures", "himap.app.stored_tables"),
    *("himap.paper.captions", "himap.paper.experiment_figures", "himap.paper.readings_figures"),
    *("himap.paper.study_figures", "himap.store.provenance"),
}
"""Packages and modules that only display numbers: figures, tables, captions, and the line below a figure."""

_BLOCKS = (ast.If, ast.For, ast.While, ast.With, ast.Try, ast.TryStar, ast.Match)


class Code:
    """The statements of a module, indexed by the names that they define.

    Relative imports start from `package`, whose ``__init__`` this is if `is_package`. With `keeps_labels`,
    labels passed to functions, ``label="..."``, count. The `index` is {name: the top-level statements that
    define it or change it in place}, `ignored` the names imported from `IGNORED` packages.
    """

    def __init__(self, statements, package="", is_package=False, keeps_labels=True):
        self.package, self.is_package, self.keeps_labels = package, is_package, keeps_labels
        public = [child for node in statements if assigns(node, "__all__") for child in ast.walk(node)]
        self._offered = {child.value for child in public if isinstance(child, ast.Constant)}
        self._statements = [node for node in statements if not is_text(node)]
        self._loose, self.index = [], {}
        for node in self._statements:
            names = names_bound(node)
            for name in names:
                self.index.setdefault(name, []).append(node)
            if not names or isinstance(node, _BLOCKS):  # a loop defines its variable, and has effects
                self._loose.append(node)
        self.part = cache(self.part)
        imports = [node for node in ast.walk(ast.Module(statements, [])) if isinstance(node, IMPORTS)]
        aliases = [(node, alias) for node in imports for alias in node.names]
        self.ignored = {
            bound_name(alias) for node, alias in aliases if is_ignored(self.source(node, alias)[-1])
        }

    def source(self, node, alias):
        """Names imported: (module,), or for ``from module import name`` (module, module.name)."""
        if isinstance(node, ast.Import):
            return (alias.name,)
        here = self.package.split(".")
        parents = here[: len(here) - node.level + 1] if node.level else []
        module = ".".join([*parents, *([node.module] if node.module else [])])
        return module, f"{module}.{alias.name}"

    def defines(self, name):
        """Whether `name` is defined here, not only imported."""
        return any(not isinstance(node, IMPORTS) for node in self.index.get(name, ()))

    def fixed_name(self, name):
        """The fixed name of a product, or of a class with a ``name``; else None.

        For a product this is its ``name=``, else the name of its function.
        """
        (node, *others) = self.index.get(name, [None])
        if isinstance(node, ast.ClassDef) and node.bases and not others:
            values = [child.value for child in node.body if assigns(child, "name")]
            return next((value.value for value in values if isinstance(value, ast.Constant)), None)
        for one in getattr(node, "decorator_list", ()):
            if called(one) == "product" and "product" in self.ignored:
                given = {key.arg: key.value for key in getattr(one, "keywords", ())}
                return given["name"].value if "name" in given else name
        return None

    def part(self, name):
        """The definition called `name`, or the code run on import (`RUN`): digest of its text, and holes."""
        if name != RUN:
            return self._part([self.index[name]], {name}, name)
        nodes, names = self._loose, set()
        if self.is_package:  # its imports have side effects
            _, used = self.cells([node for node in self._statements if not isinstance(node, IMPORTS)])
            nodes = nodes + [node for node in self._statements if isinstance(node, IMPORTS)]
            names = {n for n in self.index if not self.defines(n)}
            names -= self._offered | {hole.name for hole in used}
        return self._part([nodes], names, RUN)

    def cells(self, *cells):
        """The same for the statements of cells, of which bare strings and variables also count."""
        return self._part(cells, (), None)

    def _part(self, cells, imported, own):
        nodes = [node for cell in cells for node in cell]
        writer = Writer(self, own, nodes)
        written = [[node for node in cell if not isinstance(node, IMPORTS)] for cell in cells]
        texts = [[writer.text(node) for node in cell if not writer.is_silent(node)] for cell in written]
        used = {hole.name for hole in writer.holes}
        for node in nodes:
            if isinstance(node, IMPORTS):
                names = {bound_name(alias) for alias in node.names}
                names = names - used if own is None else names & set(imported)
                writer.holes += [Hole([node], name, None) for name in sorted(names - self.ignored)]
        return digest_of(map(str, texts)) if any(texts) else "", writer.holes


@lru_cache(maxsize=4096)
def parse(text, package, is_package, keeps_labels):
    """The `Code` of the text of a module in `package`, or of that package's ``__init__``."""
    return Code(ast.parse(text).body, package, is_package, keeps_labels)


@lru_cache(maxsize=256)
def parse_cells(sources):
    """The `Code` of the cells of a notebook, a tuple of texts, and `Code.cells` of all."""
    cells = [cell for cell in map(_statements, sources) if cell]
    code = Code([node for cell in cells for node in cell])
    return code, code.cells(*cells)


def behind(*cells):
    """Statements behind the last of some cells, as text: its own, and those behind its names.

    Names used there or in statements behind it count. A statement changes what it assigns to, including
    parts, and objects whose methods it calls, unless it is the last of its cell, which is displayed.
    """
    *before, last = map(_statements, cells)
    rest = [node for nodes in before for node in nodes]
    changed = [_changed_by(node, node is not nodes[-1]) for nodes in before for node in nodes]
    behind, names = set(), names_in(last)
    while new := {n for n, some in enumerate(changed) if n not in behind and some & names}:
        behind |= new
        names |= names_in(rest[n] for n in new)
    for node in rest:
        if isinstance(node, IMPORTS):
            node.names = [alias for alias in node.names if bound_name(alias) in names]
    return "\n".join(map(ast.unparse, [*(rest[n] for n in sorted(behind)), *last]))


def _changed_by(node, is_hidden):
    """The names that a statement defines or changes in place."""
    changed = names_bound(node)
    for one in ast.walk(node) if is_hidden or not isinstance(node, ast.Expr) else ():
        if isinstance(one, ast.Expr) and isinstance(one.value, ast.Call):
            base = one.value.func
            while isinstance(base, ast.Attribute | ast.Subscript | ast.Call):
                base = base.func if isinstance(base, ast.Call) else base.value
            changed |= names_in([base]) if isinstance(one.value.func, ast.Attribute) else set()
    return changed


def _statements(source):
    try:
        return ast.parse(source).body
    except SyntaxError:  # a magic is not Python: it counts as text
        return [ast.Expr(ast.Constant(source))]


@lru_cache(maxsize=4096)
def is_ignored(module):
    """Whether no number depends on a module."""
    return any(f"{module}.".startswith(f"{room}.") for room in IGNORED) and not is_look(module)


@lru_cache(maxsize=4096)
def is_look(module):
    """Whether a module only displays numbers."""
    return any(f"{module}.".startswith(f"{room}.") for room in LOOKS)


def digest_of(lines):
    """The first 64 bits of SHA-256 (hex) of some lines of text."""
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


LOADED = {}
"""{source file: its text as loaded by this process}."""

_STATES = {}  # {source file: its time and size then}


@cache
def note(root):
    """Record the files of a package, or of a single module, loaded now by this process."""
    for file in [root] if root.suffix == ".py" else root.rglob("*.py"):
        _STATES[file], LOADED[file] = _state(file), file.read_text(encoding="utf-8")


def edited():
    """{file: its time and size now, None if deleted} of the recorded files that were edited."""
    now = {file: _state(file) for file in _STATES}
    return {file: state for file, state in now.items() if state != _STATES[file]}


def _state(file):
    with suppress(FileNotFoundError):
        status = file.stat()
        return status.st_mtime_ns, status.st_size


note(ROOT)
