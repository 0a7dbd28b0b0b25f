"""The folder of results: each is complete or absent, and checked before use.

A result is a folder, ``PRODUCT/KEY``, with the value as arrays and JSON (`himap.store.arrays`), and a note
with its arguments and the checksums of its files. It is written under a temporary name and then renamed, and
renamed before deletion: neither a killed process nor one that writes the same result leaves incomplete data
under the final name. While a process computes a result, others wait for it. Arrays are memory-mapped. A
folder that others can write to is refused.
"""

import contextlib
import json
import re
import shutil
import sys
import time
import warnings
import zlib
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

from himap.core.errors import InputError
from himap.core.files import cache_folder, check_private, is_abandoned, make_private, unfinished_name
from himap.store.arrays import TREE, read_value, write_value

_NOTE, _UNFINISHED = "note.json", "unfinished"
_UNFINISHED_NAME = rf"{_UNFINISHED}-([0-9a-f]{{32}}|.+-\d+-[0-9a-f]{{8}})"
_checked = set()  # files written by this process, or with a verified checksum: (path, time, size)


class Missing(LookupError):
    """The result does not exist."""


def holds(product, key):
    """Whether a result of `product` exists under `key`; InputError if others can write to the cache."""
    return (_home() / product / key / _NOTE).is_file()


def _home():
    """The folder of results, if nobody else can write to it."""
    home = cache_folder()
    check_private(home)
    return home


def load(product, key):
    """The result of `product` under `key`, its arrays memory-mapped and read-only; else `Missing`.

    Every process verifies the checksums of the files once. A truncated or altered result is deleted, with a
    warning. InputError if it may not be read, or the machine lacks resources.
    """
    folder = _home() / product / key
    if not (folder / _NOTE).is_file():
        raise Missing(key)
    try:
        note = json.loads((folder / _NOTE).read_text())
        for name, checksum in note["files"].items():
            identity = _identity(folder / name)
            if identity not in _checked and _checksum(folder / name) != checksum:
                raise ValueError(f"{name} has a wrong checksum")
            _checked.add(identity)
        return read_value(folder)
    except Exception as error:  # a class with changed fields may raise any error
        is_damage = isinstance(error, FileNotFoundError | IsADirectoryError | NotADirectoryError)
        if isinstance(error, OSError | MemoryError) and not is_damage:
            raise InputError(f"the cached {product} cannot be read ({error!r}).") from None
        if folder.exists():  # else deleted by another process
            _delete(folder)
            text = f"the cached {product} is damaged and will be computed again ({error})."
            warnings.warn(text, stacklevel=3)
        raise Missing(key) from None


@contextlib.contextmanager
def lock(product, key):
    """Wait until no other process computes the result of `product` under `key`, and let others wait.

    The operating system releases the lock if a process dies. On file systems without locks, nobody waits.
    InputError if the cache is not writable.
    """
    with _writing(product) as folder:
        file = folder / f"{key}.lock"
        file.touch()
    held = FileLock(file, fallback_to_soft=False)
    with contextlib.suppress(OSError):
        held.acquire()
    try:
        yield
    finally:
        if held.is_locked:  # processes waiting for a deleted file open a new one
            with contextlib.suppress(OSError):
                file.unlink()
        held.release()


@contextlib.contextmanager
def _writing(product):
    """The folder of a product, accessible only to its owner; an OSError inside becomes an `InputError`."""
    home = _home()
    try:
        make_private(home)
        make_private(home / product)
        yield home / product
    except OSError as error:
        message = f"the result {product} cannot be stored in {home} ({error.strerror or error})"
        with contextlib.suppress(OSError):
            message += f", where {shutil.disk_usage(home).free / 1e9:.2g} GB are free"
        raise InputError(
            f"{message}. Free space with `himap cache clear`, or set the variable HIMAP_CACHE to a writable "
            "folder with more space."
        ) from None


def save(product, key, value, *, arguments, seconds):
    """Store `value` as the result of `product` under `key`; a complete existing one is not replaced.

    `arguments`, a text, describes the input, `seconds` is the computing time. InputError, and nothing is
    stored, if it cannot be written: a full disk, a folder of another user, a value not of arrays and JSON.
    """
    with _writing(product) as home:
        for path in filter(is_abandoned, home.glob(f"{_UNFINISHED}-*")):
            shutil.rmtree(path, ignore_errors=True)
        part, folder = home / unfinished_name(_UNFINISHED), home / key
        try:
            make_private(part)
            names = write_value(value, part)
            files = {name: _checksum(part / name) for name in names}
            note = {"product": product, "arguments": arguments, "seconds": seconds, "files": files}
            (part / _NOTE).write_text(json.dumps(note, indent=1))
            if not holds(product, key):
                _delete(folder)  # an incomplete one
            try:
                part.rename(folder)
                _checked.update(_identity(folder / name) for name in names)
            except OSError:
                if not holds(product, key):
                    raise
        finally:
            shutil.rmtree(part, ignore_errors=True)


@contextlib.contextmanager
def workplace(product, key, n_bytes):
    """A folder for `n_bytes` of temporary files needed to compute the result of `product` under `key`.

    It is deleted at the end, also after an error. If the work is interrupted or killed it remains, and the
    next call with this key can use its content. Another process waits. InputError if space is insufficient.
    """
    with lock(product, f"{_UNFINISHED}-{key}"):
        with _writing(product) as home:
            folder = home / f"{_UNFINISHED}-{key}"
            make_private(folder)
            missing = n_bytes - sum(file.stat().st_size for file in folder.iterdir())
            free = shutil.disk_usage(home).free
        try:
            if free < missing:
                raise InputError(
                    f"{product} needs {missing / 1e9:.3g} GB of temporary disk space, and {free / 1e9:.3g} "
                    f"GB are free in {home}. Free space with `himap cache clear`, or set HIMAP_CACHE to a "
                    "folder with more space; a smaller box, or more memory, needs no disk space."
                )
            yield folder
        finally:
            if not isinstance(sys.exception(), KeyboardInterrupt):
                shutil.rmtree(folder, ignore_errors=True)


def remove(product, key):
    """Delete the result of `product` under `key`; processes that have it mapped can still read it."""
    _delete(_home() / product / key)


def _delete(path):
    """Delete a result, complete or not; return whether it is gone."""
    try:
        with contextlib.suppress(FileNotFoundError):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path.rename(path.with_name(unfinished_name(_UNFINISHED))))
            else:
                path.unlink()
    except OSError:
        return False
    return True


def _in_use(unfinished):
    """Whether a process works in a `workplace`; a process that writes a result does not need its folder."""
    file = unfinished.with_name(f"{unfinished.name}.lock")
    if not file.is_file():
        return False
    try:
        with FileLock(file, blocking=False, fallback_to_soft=False):
            return False
    except Timeout:
        return True
    except OSError:  # no locks on this file system
        return False


def _identity(file):
    status = file.stat()
    return str(file), status.st_mtime_ns, status.st_size


def _checksum(file):
    """Size and CRC-32 of a file, a list as in a note."""
    return [file.stat().st_size, zlib.crc32(np.memmap(file, mode="r"))]


@dataclass(frozen=True)
class CacheEntry:
    """A result in the cache: product, arguments, size, date and computing time."""

    product: str
    arguments: str
    n_bytes: int
    created: datetime
    seconds: float
    path: Path


def cache_info():
    """The `CacheEntry` of every result in the cache, newest first; those being written are "unfinished".

    Other content of the folder HIMAP_CACHE and links are not listed.
    """
    entries = []
    for path in _home().glob("*/*"):
        is_unfinished = re.fullmatch(_UNFINISHED_NAME, path.name)
        if path.is_symlink() or path.parent.is_symlink():
            continue
        with contextlib.suppress(OSError):  # finished or deleted by another process, or not a folder
            files = {file.name: file.lstat() for file in path.iterdir()}
            is_result = re.fullmatch(r"[0-9a-f]{32}", path.name) and files.keys() & {TREE, _NOTE}
            if not (is_unfinished or is_result):
                continue
            arguments, seconds = "", 0.0
            with contextlib.suppress(FileNotFoundError, ValueError, KeyError, TypeError):  # any content
                note = json.loads((path / _NOTE).read_text())
                arguments, seconds = str(note["arguments"]), float(note["seconds"])
            times = [status.st_mtime for status in files.values()] or [path.stat().st_mtime]
            entries.append(
                CacheEntry(
                    product=_UNFINISHED if is_unfinished else path.parent.name,
                    arguments=arguments,
                    n_bytes=sum(status.st_size for status in files.values()),
                    created=datetime.fromtimestamp(min(max(times), time.time())),  # clocks can be wrong
                    seconds=seconds,
                    path=path,
                )
            )
    return sorted(entries, key=lambda entry: entry.created, reverse=True)


def clear_cache(entries=None):
    """Delete the results of `CacheEntry` objects, default all. Returns the number of bytes freed.

    A `workplace` in use stays. InputError if some cannot be deleted.
    """
    entries = cache_info() if entries is None else entries
    entries = [entry for entry in entries if entry.product != _UNFINISHED or not _in_use(entry.path)]
    kept = [entry for entry in entries if not _delete(entry.path)]
    if kept:
        raise InputError(
            f"{len(kept)} of {len(entries)} results could not be deleted, such as {kept[0].path}: check "
            "that you can write to it and to its folder."
        )
    return sum(entry.n_bytes for entry in entries)
