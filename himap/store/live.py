"""Fingerprints of functions, classes and modules of this process, and whether their source changed since."""

import inspect
import sys
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

from himap.core.errors import InputError
from himap.store import sources
from himap.store.fingerprint import CodeTree, accepted_version, moved


def code_fingerprint(obj):
    """The fingerprint (see `CodeTree`) of a function, class or module as this process loaded it.

    Raises
    ------
    InputError
        `obj` is not defined at the top level of a source file (a lambda, a nested function, or
        something typed into a notebook).
    """
    root, *where = place(obj)
    return _tree(root, accepted_version()).fingerprint(*where)


def code_digest(objects):
    """One digest of the fingerprints of some functions and classes, a frozenset, but for their looks."""
    return _digest(objects, accepted_version())


@lru_cache(maxsize=1024)
def _digest(objects, version):
    digests = [item for obj in objects for item in code_fingerprint(obj).items()]
    parts = {f"{name} {digest}" for name, digest in digests if name != "look"}
    return sha256(" ".join(sorted(parts)).encode()).hexdigest()


def is_current(obj):
    """Whether the code of a function, class or module on disk is, but for words, what this process loaded.

    It looks at the times and sizes of the files that the fingerprint was read from, some dozens, and reads
    again only where one has changed.
    """
    root, *where = place(obj)
    files = _files_of(root, *where)
    if all(map(sources.is_unchanged, files)):
        return True
    version = frozenset((file, file.stat().st_mtime_ns) for file in files if file.exists())
    return not moved(code_fingerprint(obj), _tree_now(root, version).fingerprint(*where))


def tree_of(obj, **options):
    """The `CodeTree` with the package of a function, class or module, as this process loaded it."""
    return CodeTree(texts=sources.LOADED, **dict([place(obj)[0]]), **options)


@lru_cache(maxsize=1024)
def place(obj):
    """(name of its package, root of that), name of its module, its own name; notes the source there now."""
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
    sources.note(root)
    return (top, root), module, name


@lru_cache(maxsize=4)
def _tree(root, version):
    return CodeTree(texts=sources.LOADED, **dict([root]))


@lru_cache(maxsize=4)
def _tree_now(root, version):
    """The source on disk; `version` is what changes when it does."""
    return CodeTree(**dict([root]))


@lru_cache(maxsize=1024)
def _files_of(root, module, name):
    return _tree(root, accepted_version()).files(module, name)
