"""The folder that results are kept in: each whole or not there, and checked before it is used.

A result is a folder of its own, ``PRODUCT/KEY``, with the value as arrays and JSON
(`himap.store.arrays`), and a note of what it is and of the checksums of its files. All is written under
another name, which is then renamed, and deleted under another one: a process that is killed, or a second one
that writes the same, leaves nothing half done under the right name. While a process computes a result, others
wait for it. Arrays are mapped from disk. A folder that others can write to is refused.
"""

import contextlib
import json
import os
import re
import shutil
import time
import zlib
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from filelock import FileLock

from himap.core.errors import InputError
from himap.core.files import cache_folder, check_private, is_abandoned, make_private, own_name
from himap.store.arrays import TREE, read_value, write_value

__all__ = [
    "CacheEntry",
    "Damaged",
    "Deleted",
    "cache_folder",
    "cache_info",
    "clear_cache",
    "holds",
    "load",
    "lock",
    "remove",
    "save",
]

_NOTE, _UNFINISHED = "note.json", "unfinished"
_CHUNK = 2**24  # bytes
_DAMAGES = (FileNotFoundError, IsADirectoryError, NotADirectoryError)
_whole = set()  # files that this process wrote or found whole, as (path, time, size)


class Damaged(Exception):
    """A result on disk is not what was written; the message says why."""


class Deleted(Damaged):
    """It was whole, and another process has deleted it meanwhile."""


def holds(product, key):
    """Whether there is a result of `product` under `key`; InputError where the cache is not ours alone."""
    return (_home() / product / key / _NOTE).is_file()


def _home():
    """The folder of results, if nobody else can write there."""
    home = cache_folder()
    check_private(home)
    return home


def load(product, key):
    """The result of `product` under `key`, its arrays mapped from disk and read-only.

    The checksums of its files are compared once by every process that reads it.

    Raises
    ------
    Damaged
        It was cut short or altered since it was written; it is gone now.
    Deleted
        It is gone: another process that needs it no more has deleted it.
    InputError
        It may not be read.
    """
    folder = _home() / product / key
    try:
        note = json.loads((folder / _NOTE).read_text())
        for name, (n_bytes, checksum) in note["files"].items():
            _check(folder / name, n_bytes, checksum)
        return read_value(folder)
    except Exception as error:  # a class that has other fields now raises anything
        if isinstance(error, PermissionError):
            raise InputError(f"the cached {product} cannot be read ({error}): whose is it?") from None
        if isinstance(error, OSError | MemoryError) and not isinstance(error, _DAMAGES):
            raise  # the machine is short of something: that is no damage
        if not folder.exists():  # one is deleted under another name, so never half of it
            raise Deleted(str(error)) from None
        _delete(folder)
        raise Damaged(str(error)) from None


@contextlib.contextmanager
def lock(product, key):
    """Wait until no other process computes the result of `product` under `key`, and hold others off.

    The lock of a process that dies is released by the operating system. Where a file system has no locks,
    nobody waits.

    Raises
    ------
    InputError
        Nothing can be written to the cache.
    """
    home = _home()
    file = home / product / f"{key}.lock"
    try:
        for folder in (home, home / product):
            make_private(folder)
        file.touch()
    except OSError as error:
        raise InputError(_refused(home, product, error)) from None
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


def save(product, key, value, *, arguments, seconds):
    """Keep `value` as the result of `product` under `key`.

    Parameters
    ----------
    arguments
        Text that says what it was made from.
    seconds
        What it cost.

    Raises
    ------
    InputError
        It cannot be written: a full disk, a folder of somebody else, a value that is no arrays and JSON.
        Nothing is left of it.
    """
    home = _home()
    part = home / product / own_name(_UNFINISHED)
    try:
        for folder in (home, home / product, part):
            make_private(folder)
        _remove_abandoned(home / product)
        names = write_value(value, part)
        files = {name: [(part / name).stat().st_size, _checksum(part / name)] for name in names}
        note = {"product": product, "arguments": arguments, "seconds": seconds, "files": files}
        (part / _NOTE).write_text(json.dumps(note, indent=1))
        if _put(part, part.with_name(key)):
            _whole.update(_identity(part.with_name(key) / name) for name in names)
    except OSError as error:
        raise InputError(_refused(home, product, error)) from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


def remove(product, key):
    """Delete the result of `product` under `key`; who has it mapped may read on."""
    _delete(_home() / product / key)


def _put(part, path):
    """Rename a folder, and whether that was done: a whole result that is there already stays."""
    while True:
        try:
            part.rename(path)
            return True
        except OSError:
            if (path / _NOTE).is_file():
                return False
            if not (os.path.lexists(path) and _delete(path)):  # what is left of one goes
                raise


def _delete(path):
    """Delete one result, as much of it as is there, and whether it is gone."""
    try:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path.rename(path.with_name(own_name(_UNFINISHED))))
        else:
            path.unlink()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return True


def _refused(home, product, error):
    message = f"the result {product} cannot be kept in {home} ({error.strerror or error})"
    with contextlib.suppress(OSError):
        message += f", where {shutil.disk_usage(home).free / 1e9:.2g} GB are free"
    return (
        f"{message}. Free space with `himap cache clear`, or set the variable HIMAP_CACHE to a folder that "
        "has room and can be written."
    )


def _check(file, n_bytes, checksum):
    """Raise where a file is not the one that was written."""
    identity = _identity(file)
    if identity in _whole:
        return
    if identity[-1] != n_bytes:
        raise ValueError(f"it has {identity[-1]} of {n_bytes} bytes")
    if _checksum(file) != checksum:
        raise ValueError("its checksum is another than when it was written")
    _whole.add(identity)


def _identity(file):
    status = file.stat()
    return str(file), status.st_mtime_ns, status.st_size


def _checksum(file):
    value = 0
    with open(file, "rb") as content:
        while chunk := content.read(_CHUNK):
            value = zlib.crc32(chunk, value)
    return value


def _remove_abandoned(folder):
    """Delete what writers on this machine that are no more left unfinished."""
    for path in filter(is_abandoned, folder.glob(f"{_UNFINISHED}-*")):
        shutil.rmtree(path, ignore_errors=True)


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
    """The `CacheEntry` of every result in the cache, newest first; those being written are "unfinished"."""
    entries = []
    for path in filter(_is_ours, _home().glob("*/*")):
        with contextlib.suppress(OSError):  # another process finishes or deletes it
            entries.append(_entry(path))
    return sorted(entries, key=lambda entry: entry.created, reverse=True)


def _is_ours(path):
    """Whether himap made this folder; HIMAP_CACHE may name one that holds other things too, and links."""
    if path.is_symlink() or path.parent.is_symlink():
        return False
    if re.fullmatch(rf"{_UNFINISHED}-.+-\d+-[0-9a-f]{{8}}", path.name):
        return path.is_dir()
    known = (path / name for name in (TREE, _NOTE))  # an earlier himap had other values beside its note
    return bool(re.fullmatch(r"[0-9a-f]{32}", path.name)) and any(file.is_file() for file in known)


def _entry(path):
    try:
        note = json.loads((path / _NOTE).read_text())
        product, arguments = str(note["product"]), str(note.get("arguments", ""))
        seconds = float(note.get("seconds", 0))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        product, arguments, seconds = _UNFINISHED, "", 0.0
    product = _UNFINISHED if path.name.startswith(_UNFINISHED) else product
    files = [file.lstat() for file in path.iterdir()]
    last = max((status.st_mtime for status in files), default=path.stat().st_mtime)
    return CacheEntry(
        product=product,
        arguments=arguments,
        n_bytes=sum(status.st_size for status in files),
        created=datetime.fromtimestamp(min(last, time.time())),  # clocks go wrong
        seconds=seconds,
        path=path,
    )


def clear_cache(products=(), *, wanted=None):
    """Delete results.

    Parameters
    ----------
    products
        Names (`CacheEntry.product`) of which; default all.
    wanted
        Called with each `CacheEntry` of them: whether it goes; default all.

    Returns
    -------
    int
        Bytes freed.

    Raises
    ------
    InputError
        A product of which the cache holds nothing, and the message lists what it holds; or what cannot be
        deleted.
    """
    entries = cache_info()
    unknown = set(products) - {entry.product for entry in entries}
    if unknown:
        names = ", ".join(sorted({entry.product for entry in entries})) or "nothing"
        raise InputError(f"the cache holds no {', '.join(sorted(unknown))}; it holds {names}.")
    doomed = [entry for entry in entries if not products or entry.product in products]
    doomed = [entry for entry in doomed if wanted is None or wanted(entry)]
    kept = [entry for entry in doomed if not _delete(entry.path)]
    if kept:
        raise InputError(
            f"{len(kept)} of {len(doomed)} results could not be deleted, such as {kept[0].path}: can you "
            "write to it and to its folder?"
        )
    return sum(entry.n_bytes for entry in doomed)
