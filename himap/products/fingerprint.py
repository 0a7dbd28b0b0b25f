"""Fingerprints of code: which result depends on which lines.

A fingerprint is the SHA-256 of syntax trees from which comments, docstrings and line numbers are
gone, so that it changes with the code and with nothing else; it is the same on every version of
Python and every machine. It covers what a piece of code reaches, name by name:

- the functions, classes and constants of its own module that it names, and theirs in turn;
- what it names of other modules of the package, by ``from module import name`` or ``module.name``,
  and a module as a whole where it is used in another way;
- what a package offers under a name: what its ``__init__`` defines, or imports from elsewhere; and where it
  has a ``__getattr__``, the definition of that name in the modules of the package;
- every module of a package, where the code names ``__path__`` and so looks into the package's folder;
- what each module on the way, and each package that it is in, does when it is imported: the statements that
  only do something and define nothing, and the imports of a package that are neither used there nor offered
  in ``__all__``, so that they are there for what they do (say, to register).

All of it is read from the source: nothing is imported, and cycles are harmless. The modules in the rooms
`IGNORED` cannot change a number and do not count. Code of other packages counts by its name alone: a new
numpy does not make a notebook stale.
"""

import ast
import inspect
import os
import sys
from functools import lru_cache
from pathlib import Path

from himap.errors import InputError
from himap.products.syntax import IMPORTS, RUN, Code, bound_name, digest_of, dump, parse_cell, parse_module

__all__ = ["IGNORED", "CodeTree", "code_fingerprint"]

IGNORED = {"himap.products", "himap.progress"}
"""Rooms, with all that is in them, that store, time, share out and label the making of results."""

_ROOT = Path(__file__).resolve().parents[1]
_LOADED = {file: file.read_text(encoding="utf-8") for file in _ROOT.rglob("*.py")}
"""The source as it was when this process began: the code that it runs, whatever is edited since."""


class CodeTree:
    """The source of one or more packages, as the graph of what depends on what.

    Parameters
    ----------
    loaded
        Take the source as this process loaded it, not as it is on disk when it is first asked for.
    himap
        The folder of himap, where it is not this one.
    roots
        Name of another package (or single module) -> its folder (or file).
    """

    def __init__(self, *, loaded=False, himap=_ROOT, **roots):
        self.loaded = loaded
        self.roots = {name: Path(path) for name, path in {"himap": himap, **roots}.items()}
        self._files, self._units = {}, {}

    def fingerprint(self, module, name=None):
        """SHA-256 (hex) of the module `module`, or of the object `name` at its top level."""
        return digest_of(self._reached([(module, name)]))

    def source_fingerprint(self, *sources):
        """SHA-256 (hex) of pieces of code, such as the cells of a notebook, and of what they import."""
        cells = [parse_cell(source) for source in sources]
        code = Code([node for cell in cells for node in cell])
        digests = [digest_of(map(dump, cell)) for cell in cells if cell]
        return digest_of(digests + self._reached(self._needed(code)))

    def _reached(self, units):
        """One line for each unit (module, name, `RUN` or None) that can be reached from `units`."""
        reached, todo = {}, list(units)
        while todo:
            unit = todo.pop()
            if unit not in reached and not _is_ignored(unit[0]):
                if unit not in self._units:
                    self._units[unit] = self._unit(*unit)
                reached[unit], needed = self._units[unit]
                todo += needed
        return sorted(f"{module}:{name or ''}:{digest}" for (module, name), digest in reached.items())

    def _unit(self, module, name):
        """Digest of a unit, and the units that it needs."""
        if not self._file(module):  # of another package
            return "", []
        code, parts = self._read(module), module.split(".")
        packages = [".".join(parts[:n]) for n in range(2, len(parts))]
        run = [(one, RUN) for one in [*packages, module]]
        return code.part(name).digest, run + self._needed(code, module, name)

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
        if "__path__" in part.uses and code.is_package:
            units += self._inside(module)
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
            units += [unit for one in names or [None] for unit in self._named(module, one)]
        return units

    def _named(self, module, name):
        """The units behind `name` of a module, whose own or which a package offers; None for all of it."""
        if name is None or not self._file(module):
            return [(module, name)]
        code = self._read(module)
        units = [(module, name)] if name in code.index else []
        if code.is_package:
            if name == "__path__":
                return self._inside(module)
            if self._file(f"{module}.{name}"):
                units.append((f"{module}.{name}", None))
            if not units and "__getattr__" in code.index:
                units = self._offered(module, name) or [(module, "__getattr__")]
        return units or [(module, None)]

    def _offered(self, package, name):
        """The definitions of `name` in the modules of a package, and those that its sub-packages offer."""
        units = []
        for module in self._modules(package):
            code = self._read(module)
            if code.defines(name) or (code.is_package and name in code.index):
                units.append((module, name))
            elif code.is_package and "__getattr__" in code.index:
                units += self._offered(module, name)
        return units

    def _inside(self, package):
        """All that the folder of a package holds, as units: its modules, and those of its sub-packages."""
        modules = self._modules(package)
        deeper = [unit for one in modules if self._read(one).is_package for unit in self._inside(one)]
        return [(one, None) for one in modules] + deeper

    def _modules(self, package):
        """Names of the modules and sub-packages in the folder of a package."""
        names = {path.stem for path in self._file(package).parent.iterdir()} - {"__init__"}
        modules = [f"{package}.{name}" for name in sorted(names) if name.isidentifier()]
        return [module for module in modules if self._file(module)]

    def _file(self, module):
        """The source file of a module of ours, else None."""
        if module not in self._files:
            self._files[module] = self._find(module)
        return self._files[module]

    def _find(self, module):
        top, *rest = module.split(".")
        root = self.roots.get(top)
        if root is None or root.suffix == ".py":
            return None if rest else root
        path = root.joinpath(*rest)
        candidates = [path / "__init__.py"] + [path.with_suffix(".py")] * bool(rest)
        return next((item for item in candidates if item.is_file() and _is_spelt(item, root)), None)

    def _read(self, module):
        file = self._file(module)
        stat = file.stat()
        text = _read_text(file, stat.st_mtime_ns, stat.st_size)
        if self.loaded:
            text = _LOADED.setdefault(file, text)
        is_package = file.name == "__init__.py"
        return parse_module(text, module if is_package else module.rpartition(".")[0], is_package)


def _is_ignored(module):
    return any(f"{module}.".startswith(f"{room}.") for room in IGNORED)


def _is_spelt(file, root):
    """Whether a file below `root` is there in these letters: some disks take PCA.py for pca.py."""
    below = [file, *file.parents][: len(file.relative_to(root).parts)]
    return all(path.name in os.listdir(path.parent) for path in below)


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
