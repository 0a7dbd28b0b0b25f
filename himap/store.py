"""Heavy results, computed once and kept on disk.

A function under `@product` is computed once for each set of arguments and each version of the code
that it reaches (`himap.fingerprint`); after that its result is read from the cache folder, its
arrays mapped from disk and read-only. The folder is the one named by the variable HIMAP_CACHE, else
``himap`` in the user's cache folder. joblib.Memory does the storing: a result is written under
another name and then renamed, so it is there whole or not at all, and two processes at once do no
harm.
"""

import contextlib
import functools
import inspect
import json
import os
import shutil
import threading
import time
import warnings
from dataclasses import dataclass, fields, is_dataclass
from datetime import datetime
from hashlib import sha256
from pathlib import Path

import joblib
import numpy as np
import platformdirs

from himap.errors import InputError
from himap.fingerprint import code_fingerprint
from himap.provenance import Provenance

__all__ = [
    "CacheEntry",
    "Product",
    "Provenance",
    "cache_folder",
    "cache_info",
    "clear_cache",
    "code_fingerprint",
    "product",
]

_ABANDONED_AFTER = 86_400.0  # s without a write, after which an unfinished file has no writer any more


def cache_folder():
    """The folder that products are kept in."""
    folder = os.environ.get("HIMAP_CACHE")
    return (
        Path(os.path.expanduser(folder)) if folder else platformdirs.user_cache_path("himap", appauthor=False)
    )


def product(function):
    """Decorator: keep what `function` returns on disk.

    `function` stands at the top level of a module. Its arguments are small: numbers, strings,
    bools, None, paths, tuples, lists, dicts and dataclasses of these, or an array (which counts by
    its content). A dataclass also counts with the code of its class, and an argument with a method
    `digest()` with what that returns, for instance the hash of a file. The result is an array, or
    a dataclass that holds arrays; the arrays are read-only.

    Raises
    ------
    InputError
        When called: arguments that do not fit the signature, or that have no such text.

    >>> @product
    ... def observation(survey, *, beam="degraded"): ...
    """
    return Product(function)


class Product:
    """A function whose results are kept on disk; see `product`.

    Attributes
    ----------
    name
        module.function, without the leading ``himap.``.
    """

    def __init__(self, function):
        functools.update_wrapper(self, function)
        self.name = f"{function.__module__}.{function.__qualname__}".removeprefix("himap.")
        self._function = function
        self._signature = inspect.signature(function)
        self._code([], loaded=True)  # so that the source is noted as it is now

    def __reduce__(self):
        return self.__qualname__  # by name, as functions are: joblib's workers import it

    def __repr__(self):
        return f"<product {self.name}{self._signature}>"

    def __call__(self, *args, **kwargs):
        """The result, from the cache if it is there; see the function for arguments and result."""
        bound = self._bind(args, kwargs)
        key, current = self._key(bound)
        if not current:
            warnings.warn(
                f"the code behind {self.name} has changed on disk since it was loaded, so its result is "
                "neither read from the cache nor kept; restart Python or the kernel.",
                stacklevel=2,
            )
            return self._function(*bound.args, **bound.kwargs)
        call = _Call(self._function, bound)
        memory = _memory()
        if memory.check_call_in_cache(*key, call):
            entry = memory.call_and_shelve(*key, call)
            try:
                return entry.get()
            except Exception as error:  # a damaged pickle raises anything
                text = f"the cached {self.name} cannot be read and is computed again ({error})."
                warnings.warn(text, stacklevel=2)
                entry.clear()
        return _compute(memory, key, call)

    def compute(self, *args, **kwargs):
        """The result, computed now and not kept."""
        return self._function(*args, **kwargs)

    def is_cached(self, *args, **kwargs):
        """Whether a call with these arguments would be read from the cache."""
        key, current = self._key(self._bind(args, kwargs))
        return current and _memory().check_call_in_cache(*key, None)

    def _bind(self, args, kwargs):
        try:
            bound = self._signature.bind(*args, **kwargs)
        except TypeError as error:
            raise InputError(f"{self.name}{self._signature} was called otherwise: {error}.") from None
        bound.apply_defaults()
        return bound

    def _key(self, bound):
        """What names the result, all text; and whether the code on disk is what this process runs."""
        classes = _classes(bound.arguments)
        code = self._code(classes, loaded=True)
        return (self.name, code, _describe(bound.arguments)), code == self._code(classes, loaded=False)

    def _code(self, classes, loaded):
        parts = {code_fingerprint(item, loaded=loaded) for item in [self._function, *classes]}
        return sha256(" ".join(sorted(parts)).encode()).hexdigest()


@dataclass
class _Call:
    """What is to be computed; joblib does not look into it."""

    function: object
    bound: inspect.BoundArguments
    result: object = None
    done: bool = False


def _produce(product, fingerprint, arguments, call):
    # The one function that joblib sees. It wipes the results of a function whose source changes,
    # and this one never does: what matters is in the first three arguments, all of them text.
    call.result = call.function(*call.bound.args, **call.bound.kwargs)
    call.done = True
    return call.result


def _compute(memory, key, call):
    try:
        result = memory(*key, call)
    except KeyError:
        if not call.done:
            raise
        # It could not be written (a full disk), which joblib has warned of; go on with what is in memory.
        _remove_unfinished(f"-{os.getpid()}-{id(threading.current_thread())}")
        return call.result
    _remove_unfinished()
    return result


def _memory():
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return joblib.Memory(folder, mmap_mode="r", verbose=0).cache(_produce, ignore=["call"])
    except OSError as error:
        raise InputError(
            f"the cache folder {folder} cannot be used ({error.strerror}); set the variable HIMAP_CACHE to "
            "a folder that can be written."
        ) from None


def _describe(value):
    """Text that is the same for equal arguments and differs for others."""
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
        return "(" + ", ".join(_describe(item) for item in value) + ")"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_describe(value[key])}" for key in sorted(value)) + "}"
    if is_dataclass(value) and not isinstance(value, type):
        inner = ", ".join(f"{f.name}={_describe(getattr(value, f.name))}" for f in fields(value) if f.compare)
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
        return [found for item in value.values() for found in _classes(item)]
    if isinstance(value, (tuple, list)):
        return [found for item in value for found in _classes(item)]
    if is_dataclass(value):
        inner = [found for item in fields(value) for found in _classes(getattr(value, item.name))]
        return [type(value), *inner]
    return []


@dataclass(frozen=True)
class CacheEntry:
    """One result in the cache: its product, its arguments, its size, when and in what time it was made."""

    product: str
    arguments: str
    n_bytes: int
    created: datetime
    seconds: float
    path: Path


def cache_info():
    """The `CacheEntry` of every result in the cache, newest first; unfinished files are named so."""
    return sorted((_entry(path) for path in _results()), key=lambda entry: entry.created, reverse=True)


def clear_cache(products=()):
    """Delete the results of the named products (`CacheEntry.product`), or all of them.

    Returns
    -------
    int
        Bytes freed.

    Raises
    ------
    InputError
        A product of which the cache holds nothing; the message lists what it holds.
    """
    entries = cache_info()
    unknown = set(products) - {entry.product for entry in entries}
    if unknown:
        names = ", ".join(sorted({entry.product for entry in entries})) or "nothing"
        raise InputError(f"the cache holds no {', '.join(sorted(unknown))}; it holds {names}.")
    doomed = [entry for entry in entries if not products or entry.product in products]
    for entry in doomed:
        shutil.rmtree(entry.path, ignore_errors=True)
    return sum(entry.n_bytes for entry in doomed)


def _results():
    """The folders that hold one result each."""
    folder = cache_folder()
    return {path.parent for path in folder.rglob("output.pkl*")} if folder.is_dir() else set()


def _entry(path):
    try:
        metadata = json.loads((path / "metadata.json").read_text())
    except (OSError, ValueError):  # killed on the way
        metadata = {}
    texts = {name: text[1:-1] for name, text in metadata.get("input_args", {}).items()}
    files = [file.stat() for file in path.iterdir()]
    return CacheEntry(
        product=texts.get("product", "unfinished"),
        arguments=texts.get("arguments", ""),
        n_bytes=sum(stat.st_size for stat in files),
        created=datetime.fromtimestamp(max(stat.st_mtime for stat in files)),
        seconds=metadata.get("duration", 0.0),
        path=path,
    )


def _remove_unfinished(writer=None):
    """Delete what interrupted writers left: the given writer, or all whose file is a day old."""
    for path in cache_folder().rglob("output.pkl.*"):
        with contextlib.suppress(OSError):  # another process renames or deletes it first
            if (
                path.name.endswith(writer)
                if writer
                else time.time() - path.stat().st_mtime > _ABANDONED_AFTER
            ):
                path.unlink()
