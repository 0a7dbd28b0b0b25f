"""Fingerprints of code: which result depends on which lines.

A fingerprint is the SHA-256 of syntax trees from which comments, docstrings and line numbers are
gone, so that it changes with the code and with nothing else; it is the same on every version of
Python and every machine. It covers what a piece of code reaches, name by name:

- the functions, classes and constants of its own module that it names, and theirs in turn;
- what it names of other modules of the package, by ``from module import name`` or ``module.name``;
- a module as a whole where it is used in another way, and always for a sub-package: its ``__init__``
  runs when anything inside is imported, and what it imports (say, to register it) counts too;
- the statements of each module on the way that only do something and define nothing.

All of it is read from the source: nothing is imported, and cycles are harmless. The modules in
`IGNORED` cannot change a number and do not count. Code of other packages does not count either:
a new numpy does not make a notebook stale.
"""

import ast
import inspect
import sys
from functools import lru_cache
from pathlib import Path

from himap.errors import InputError
from himap.products.syntax import IMPORTS, Code, bound_name, digest_of, dump, parse_cell, parse_module

__all__ = ["IGNORED", "CodeTree", "code_fingerprint"]

_HOUSEKEEPING = ("syntax", "fingerprint", "provenance", "progress", "cache", "store", "parallel", "memory")

IGNORED = {f"himap.{name}" for name in _HOUSEKEEPING}
"""Modules that store, time, share out and label the making of results, and cannot change one."""

_ROOT = Path(__file__).resolve().parents[1]
_LOADED = {file: file.read_text(encoding="utf-8") for file in _ROOT.rglob("*.py")}
"""The source as it was when this process began: the code that it runs, whatever is edited since."""


class CodeTree:
    """The source of one or more packages, as the graph of what depends on what.

    Parameters
    ----------
    loaded
        Take the source as this process loaded it, not as it is on disk now.
    roots
        Package (or single module) name -> its folder (or file). himap is always there.
    """

    def __init__(self, *, loaded=False, **roots):
        self.loaded = loaded
        self.roots = {"himap": _ROOT} | {name: Path(path) for name, path in roots.items()}

    def fingerprint(self, module, name=None):
        """SHA-256 (hex) of the module `module`, or of the object `name` at its top level."""
        return digest_of(self._reached([(module, name)]))

    def source_fingerprint(self, *sources):
        """SHA-256 (hex) of pieces of code, such as the cells of a notebook, and of what they import."""
        cells = [parse_cell(source) for source in sources]
        code = Code([node for cell in cells for node in cell], package="")
        digests = [digest_of(map(dump, cell)) for cell in cells if cell]
        return digest_of(digests + self._reached(self._needed(code)))

    def _reached(self, units):
        """One line for each unit (module, name or None) that can be reached from `units`."""
        reached, todo = {}, list(units)
        while todo:
            module, name = unit = todo.pop()
            if unit not in reached and module not in IGNORED:
                code = self._read(module)
                reached[unit] = code.part(name).digest
                todo += self._needed(code, module, name)
        return sorted(f"{module}:{name or ''}:{digest}" for (module, name), digest in reached.items())

    def _needed(self, code, module=None, name=None):
        """The units that one unit names: its neighbours in the module, and what it imports."""
        part, units = code.part(name), []
        for used, attributes in part.uses.items():
            for node in code.index.get(used, []):
                if isinstance(node, IMPORTS):
                    units += self._imported(node, used, attributes, code.package)
                elif name is not None:
                    units.append((module, used))
        for node in part.local_imports:
            for alias in node.names:
                units += self._imported(node, bound_name(alias), None, code.package)
        return units

    def _imported(self, node, name, attributes, package):
        """The units behind `name`, bound by an import in `package`, of which `attributes` are used."""
        here = package.split(".")
        units = []
        for alias in node.names:
            if bound_name(alias) != name:
                continue
            if isinstance(node, ast.Import):
                module, names = alias.name, attributes if alias.asname or "." not in alias.name else None
            else:
                parents = here[: len(here) - node.level + 1] if node.level else []
                module, names = ".".join([*parents, *([node.module] if node.module else [])]), {alias.name}
                if self._file(f"{module}.{alias.name}"):
                    module, names = f"{module}.{alias.name}", attributes
            units += self._members(module, names, package)
        return units

    def _members(self, module, names, package):
        """The units of `names` of a module, or of all of it; and the sub-packages that are entered for it."""
        if not self._file(module):
            return []
        parts = module.split(".")
        parents = [".".join(parts[:n]) for n in range(2, len(parts))]
        entered = [(parent, None) for parent in parents if not f"{package}.".startswith(f"{parent}.")]
        if names is None or self._file(module).name == "__init__.py":
            inside = [f"{module}.{name}" for name in names or ()]
            return [*entered, (module, None), *((item, None) for item in inside if self._file(item))]
        index = self._read(module).index
        return entered + [(module, name if name in index else None) for name in names]

    def _file(self, module):
        """The source file of a module of ours, else None."""
        top, *rest = module.split(".")
        root = self.roots.get(top)
        if root is None or root.suffix == ".py":
            return None if rest else root
        path = root.joinpath(*rest)
        candidates = [path / "__init__.py"] + [path.with_suffix(".py")] * bool(rest)
        return next((item for item in candidates if item.is_file()), None)

    def _read(self, module):
        file = self._file(module)
        stat = file.stat()
        text = _read_text(file, stat.st_mtime_ns, stat.st_size)
        if self.loaded:
            text = _LOADED.setdefault(file, text)
        return parse_module(text, module if file.name == "__init__.py" else module.rpartition(".")[0])


def code_fingerprint(obj, *, loaded=False):
    """SHA-256 (hex) of a function, class or module and of all that it reaches (see the module).

    Parameters
    ----------
    obj
        The function, class or module.
    loaded
        Take the source as this process loaded it, not as it is on disk now.

    Raises
    ------
    InputError
        `obj` is not defined at the top level of a source file (a lambda, a nested function, or
        something typed into a notebook).
    """
    is_module = inspect.ismodule(obj)
    module = obj.__name__ if is_module else getattr(obj, "__module__", None)
    name = None if is_module else getattr(obj, "__qualname__", "")
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or (name is not None and not name.isidentifier()):
        raise InputError(
            f"{obj!r} has no fingerprint: it must be a module, or a function or class defined at the top "
            "level of a source file; move it into a module and import it from there."
        )
    top, *rest = module.split(".")
    path = Path(file).resolve()
    depth = len(rest) + (path.name == "__init__.py")
    root = path.parents[depth - 1] if depth else path
    return _remembered(top, root, module, name, None if loaded else _version(_ROOT, root))


@lru_cache(maxsize=1024)
def _remembered(top, root, module, name, version):
    """The fingerprint of the source as loaded, or of the `version` that is on disk."""
    return CodeTree(loaded=version is None, **{top: root}).fingerprint(module, name)


def _version(*roots):
    """What changes when a source file does."""
    files = {file for root in roots for file in (root.rglob("*.py") if root.is_dir() else [root])}
    return frozenset((file, (stat := file.stat()).st_mtime_ns, stat.st_size) for file in files)


@lru_cache(maxsize=512)
def _read_text(file, mtime, size):
    return file.read_text(encoding="utf-8")
