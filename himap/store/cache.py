"""The folder of results: each is complete or not there, and checked before it is used.

A result is a folder, ``PRODUCT/KEY``, with the value as arrays and JSON (`himap.store.arrays`), and a note of
its arguments and of the checksums of its files. All is written under another name, which is then renamed, and
deleted under another one: a process that is killed, or a second one that writes the same, leaves nothing half
done under the right name. While a process computes a result, others wait for it. Arrays are mapped from disk.
A folder that others can write to is refused.
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
_checked = set()  # files that this process wrote, or whose checksum it has compared: (path, time, size)


class Missing(LookupError):
    """There is no such result."""


def holds(product, key):
    """Whether there is a result of `product` under `key`; InputError where others can write to the cache."""
    return (_home() / product / key / _NOTE).is_file()


def _home():
    """The folder of results, if nobody else can write there."""
    home = cache_folder()
    check_private(home)
    return home


def load(product, key):
    """The result of `product` under `key`, its arrays mapped from disk and read-only; else `Missing`.

    Every process that reads it compares the checksums of its files once. A result that was cut short or
    altered since it was written is deleted, with a warning. InputError where it may not be read, or the
    machine is short of something.
    """
    folder = _home() / product / key
    if not (folder / _NOTE).is_file():
        raise Missing(key)
    try:
        note = json.loads((folder / _NOTE).read_text())
        for name, checksum in note["files"].items():
            identity = _identity(folder / name)
            if identity not in _checked and _checksum(folder / name) != checksum:
                raise ValueError(f"{name} has another checksum than when it was written")
            _checked.add(identity)
        return read_value(folder)
    except Exception as error:  # a class that has other fields now raises anything
        is_damage = isinstance(error, FileNotFoundError | IsADirectoryError | NotADirectoryError)
        if isinstance(error, OSError | MemoryError) and not is_damage:
            raise InputError(f"the cached {product} cannot be read ({error!r}).") from None
        if folder.exists():  # else another process has deleted it
            _delete(folder)
            text = f"the cached {product} is damaged and is computed again ({error})."
            warnings.warn(text, stacklevel=3)
        raise Missing(key) from None


@contextlib.contextmanager
def lock(product, key):
    """Wait until no other process computes the result of `product` under `key`, and let others wait.

    The operating system releases the lock of a process that dies. Where a file system has no locks, nobody
    waits. InputError where nothing can be written to the cache.
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
        if held.is_locked:  # who waits for a file that is gone looks for a new one
            with contextlib.suppress(OSError):
                file.unlink()
        held.release()


@contextlib.contextmanager
def _writing(product):
    """The folder of a product, for its owner alone; an OSError inside becomes an `InputError`."""
    home = _home()
    try:
        make_private(home)
        make_private(home / product)
        yield home / product
    except OSError as error:
        message = f"the result {product} cannot be kept in {home} ({error.strerror or error})"
        with contextlib.suppress(OSError):
            message += f", where {shutil.disk_usage(home).free / 1e9:.2g} GB are free"
        raise InputError(
            f"{message}. Free space with `himap cache clear`, or set the variable HIMAP_CACHE to a folder "
            "that has room and can be written."
        ) from None


def save(product, key, value, *, arguments, seconds):
    """Keep `value` as the result of `product` under `key`; a complete one that is there already stays.

    `arguments`, a text, says what it was made from, `seconds` what it took. InputError, and nothing is kept,
    where it cannot be written: a full disk, a folder of somebody else, a value that is no arrays and JSON.
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
                _delete(folder)  # the rest of one
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
    """A folder for files of so many bytes that the making of the result of `product` under `key` needs.

    It goes at the end, also after an error. Where the work is interrupted or killed it stays, and the next
    call with this key has what it holds. Another process waits. InputError where there is no room.
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
                    f"{product} needs {missing / 1e9:.3g} GB of disk while it is made, and {free / 1e9:.3g} "
                    f"GB are free in {home}. Free space with `himap cache clear`, or set HIMAP_CACHE to a "
                    "folder that has room; a smaller box, or more memory, needs no disk."
                )
            yield folder
        finally:
            if not isinstance(sys.exception(), KeyboardInterrupt):
                shutil.rmtree(folder, ignore_errors=True)


def remove(product, key):
    """Delete the result of `product` under `key`; processes that have it mapped may read on."""
    _delete(_home() / product / key)


def _delete(path):
    """Delete one result, as much of it as is there, and whether it is gone."""
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
    """Whether a process works in a `workplace`; one that writes a result goes on without its folder."""
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
    """One result in the cache: its product, its arguments, its size, when and in what time it was made."""

    product: str
    arguments: str
    n_bytes: int
    created: datetime
    seconds: float
    path: Path


def cache_info():
    """The `CacheEntry` of every result in the cache, newest first; those being written are "unfinished".

    HIMAP_CACHE may name a folder that holds other things too, and links, which are not listed.
    """
    entries = []
    for path in _home().glob("*/*"):
        is_unfinished = re.fullmatch(_UNFINISHED_NAME, path.name)
        if path.is_symlink() or path.parent.is_symlink():
            continue
        with contextlib.suppress(OSError):  # another process finishes or deletes it, or it is no folder
            files = {file.name: file.lstat() for file in path.iterdir()}
            is_result = re.fullmatch(r"[0-9a-f]{32}", path.name) and files.keys() & {TREE, _NOTE}
            if not (is_unfinished or is_result):
                continue
            arguments, seconds = "", 0.0
            with contextlib.suppress(FileNotFoundError, ValueError, KeyError, TypeError):  # of any text
                note = json.loads((path / _NOTE).read_text())
                arguments, seconds = str(note["arguments"]), float(note["seconds"])
            times = [status.st_mtime for status in files.values()] or [path.stat().st_mtime]
            entries.append(
                CacheEntry(
                    product=_UNFINISHED if is_unfinished else path.parent.name,
                    arguments=arguments,
                    n_bytes=sum(status.st_size for status in files.values()),
                    created=datetime.fromtimestamp(min(max(times), time.time())),  # clocks go wrong
                    seconds=seconds,
                    path=path,
                )
            )
    return sorted(entries, key=lambda entry: entry.created, reverse=True)


def clear_cache(entries=None):
    """Delete results, of which there is a `CacheEntry` each; default all. Returns the bytes that are freed.

    A `workplace` in use stays. InputError where some cannot be deleted.
    """
    entries = cache_info() if entries is None else entries
    entries = [entry for entry in entries if entry.product != _UNFINISHED or not _in_use(entry.path)]
    kept = [entry for entry in entries if not _delete(entry.path)]
    if kept:
        raise InputError(
            f"{len(kept)} of {len(entries)} results could not be deleted, such as {kept[0].path}: can you "
            "write to it and to its folder?"
        )
    return sum(entry.n_bytes for entry in entries)
