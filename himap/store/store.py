"""Expensive results, computed once and stored on disk.

A function decorated with `@product` is computed once for each set of arguments and each version of the code
that it uses, as loaded by this process; afterwards its result is read from the cache folder
(`himap.store.cache`), with arrays memory-mapped and read-only.
"""

import functools
import inspect
import sys
import time
import warnings
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from himap.core.checks import fields_on
from himap.core.errors import InputError
from himap.store import cache, sources
from himap.store.fingerprint import CodeTree, accepted_version


def product(function=None, *, name=None, version=None):
    """Decorator: store the result of a function on disk.

    The function is at the top level of a module. Its arguments are small: numbers, strings, bools, None,
    paths, tuples, lists, dicts and dataclasses of these, or an array (identified by its content). A dataclass
    also depends on the code of its class, and an argument with a method `digest()` on its result, such as the
    hash of a file; fields at the value `off` (see `parameter` of `himap.core.checks`) are ignored. The result
    is an array, or a dataclass, list, tuple or dict of arrays, text and numbers; arrays are read-only. While
    a process computes a result, others wait for it. A call raises InputError for arguments that do not fit
    the signature or have another type, and for a result that cannot be written.

    Parameters
    ----------
    name
        The name in caches, stamps and records, independent of the location; default: that of the function.
        After renaming a function, its former name avoids recomputation.
    version
        A number to increase if the result changes for a reason outside the source, such as a newer
        package.

    >>> @product
    ... def observation(survey, *, beam="degraded"): ...
    """
    return Product(function, name) if function else functools.partial(product, name=name, version=version)


@contextmanager
def temporary(*products):
    """Delete at the end the results that some products stored meanwhile, here and in processes of `make_all`.

    Earlier content of the cache stays.
    """
    names, n_before = {product.name for product in products}, len(MADE)
    try:
        yield
    finally:
        for name, key in MADE[n_before:]:
            if name in names:
                cache.remove(name, key)


MADE = []
"""(name, key) of all results stored by this process and its workers, in order."""


class Product:
    """A function whose results are stored on disk, and its fixed `name`; see `product`."""

    def __init__(self, function, name=None):
        functools.update_wrapper(self, function)
        self.name = name or function.__qualname__
        self._function = function
        self._signature = inspect.signature(function)
        place(function)  # records its code as loaded

    def __reduce__(self):
        return self.__qualname__  # by name, like functions: joblib's workers import it

    def __repr__(self):
        return f"<product {self.name}{self._signature}>"

    def __call__(self, *args, **kwargs):
        """The result, from the cache if available; see the function for arguments and result."""
        bound, key, is_current = self._key(args, kwargs)
        if not is_current:
            warnings.warn(
                f"the code behind {self.name} has changed on disk since it was loaded, so its result is "
                "neither read from the cache nor stored; restart Python or the kernel.",
                stacklevel=2,
            )
            return self._function(*bound.args, **bound.kwargs)
        with suppress(cache.Missing):
            return cache.load(self.name, key)
        with cache.lock(self.name, key):
            with suppress(cache.Missing):
                return cache.load(self.name, key)  # computed meanwhile by another process
            started = time.monotonic()
            value = self._function(*bound.args, **bound.kwargs)
            seconds, arguments = time.monotonic() - started, describe(bound.arguments)
            cache.save(self.name, key, value, arguments=arguments, seconds=seconds)
            MADE.append((self.name, key))
        with suppress(cache.Missing):  # deleted meanwhile by another process
            value = cache.load(self.name, key)  # frees the memory of the original
        return value

    def compute(self, *args, **kwargs):
        """The result, computed now and not stored."""
        return self._function(*args, **kwargs)

    def is_cached(self, *args, **kwargs):
        """Whether a call with these arguments would read from the cache."""
        _, key, is_current = self._key(args, kwargs)
        return is_current and cache.holds(self.name, key)

    def forget(self, *args, **kwargs):
        """Delete the result from the cache, if it exists."""
        cache.remove(self.name, self._key(args, kwargs)[1])

    def workplace(self, *args, n_bytes):
        """A folder for temporary files of a computation: `himap.store.cache.workplace`."""
        return cache.workplace(self.name, self._key(args, {})[1], n_bytes)

    def _key(self, args, kwargs):
        """The arguments, the name of the result on disk, and whether the code on disk is that loaded."""
        try:
            bound = self._signature.bind(*args, **kwargs)
        except TypeError as error:
            raise InputError(f"{self.name}{self._signature} got wrong arguments: {error}.") from None
        bound.apply_defaults()
        loaded, now = code_digests(frozenset({self._function, *_classes(bound.arguments)}))
        text = f"{loaded} {describe(bound.arguments)}"
        return bound, sha256(text.encode()).hexdigest()[:32], loaded == now


def describe(value):
    """Text that is equal for equal arguments and differs for others."""
    extra = f"#{value.digest()}" if hasattr(value, "digest") else ""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, complex, str)):
        return repr(value)
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        content = sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"array({value.dtype}, {value.shape}, {content})"
    if isinstance(value, Path):
        return repr(str(value)) + extra
    if isinstance(value, (tuple, list)):
        return "(" + ", ".join(describe(item) for item in value) + ")"
    if isinstance(value, dict):
        plain = [isinstance(key, str) and key.isidentifier() for key in value]
        texts = {key if one else describe(key): value[key] for key, one in zip(value, plain, strict=True)}
        return "{" + ", ".join(f"{key}: {describe(texts[key])}" for key in sorted(texts)) + "}"
    if is_dataclass(value) and not isinstance(value, type):
        counted = {f.name: one for f, one in fields_on(value) if f.compare}
        inner = ", ".join(f"{name}={describe(one)}" for name, one in counted.items())
        return f"{type(value).__qualname__}({inner}){extra}"
    if extra:
        return type(value).__qualname__ + extra
    raise InputError(
        "the arguments of a cached product are numbers, strings, bools, None, paths, tuples, lists, dicts, "
        f"dataclasses of these, arrays, or objects with a digest(); got {type(value).__name__} {value!r}."
    )


def _classes(value):
    """The classes of the dataclasses in an argument: their code counts."""
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, (tuple, list)):
        return [kind for item in value for kind in _classes(item)]
    if is_dataclass(value):
        return [type(value), *_classes([getattr(value, item.name) for item in fields(value)])]
    return []


def code_digests(objects):
    """Two digests of the fingerprints of functions, classes and modules, a frozenset, without appearance.

    One is for the code as loaded by this process, one for the code on disk; only files with changed times or
    sizes are read again. InputError for objects not defined at the top level of a source file (a lambda, a
    nested function, or code typed into a notebook).
    """
    states = frozenset(), frozenset(sources.edited().items())
    return tuple(_digest(objects, accepted_version(), edited) for edited in states)


def tree_of(obj, **options):
    """The `CodeTree` with the package of a function, class or module, as loaded by this process."""
    return CodeTree(texts=sources.LOADED, **dict([place(obj)[0]]), **options)


@lru_cache(maxsize=1024)
def place(obj):
    """(name of its package, root of that), name of its module, its own name; records the current source."""
    module = getattr(obj, "__module__", obj.__name__)
    name = getattr(obj, "__qualname__", None)  # of a module: None
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


@lru_cache(maxsize=1024)
def _digest(objects, version, edited):
    places = [place(obj) for obj in objects]
    codes = [_tree(root, version, edited).fingerprint(module, name) for root, module, name in places]
    parts = {f"{name} {digest}" for code in codes for name, digest in code.items() if name != "look"}
    return sha256(" ".join(sorted(parts)).encode()).hexdigest()


@lru_cache(maxsize=8)
def _tree(root, version, edited):
    """The source as loaded, except for the files that are `edited`."""
    texts = {file: text for file, text in sources.LOADED.items() if file not in dict(edited)}
    return CodeTree(texts=texts, **dict([root]))
