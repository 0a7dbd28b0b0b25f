"""The folder that results are kept in: each whole or not there, and checked before it is used.

A result is a folder of its own, ``PRODUCT/KEY``, with the value as arrays and JSON
(`himap.products.arrays`), and a note of what it is and of the checksums of its files. All is written under
another name, which is then renamed: a process that is killed, or a second one that writes the same, leaves
nothing half done under the right name. Arrays are mapped from disk.
"""

import contextlib
import json
import os
import re
import shutil
import socket
import uuid
import zlib
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import platformdirs
import psutil

from himap.errors import InputError
from himap.products.arrays import TREE, read_value, write_value

__all__ = [
    "CacheEntry",
    "Damaged",
    "cache_folder",
    "cache_info",
    "clear_cache",
    "holds",
    "load",
    "remove",
    "save",
]

_NOTE, _UNFINISHED = "note.json", "unfinished"
_CHUNK = 2**24  # bytes
_whole = set()  # files that this process wrote or found whole, as (path, time, size)


class Damaged(Exception):
    """A result on disk is not what was written; the message says why."""


def cache_folder():
    """The folder named by the variable HIMAP_CACHE, else ``himap`` in the user's cache folder."""
    folder = os.environ.get("HIMAP_CACHE")
    return (
        Path(os.path.expanduser(folder)) if folder else platformdirs.user_cache_path("himap", appauthor=False)
    )


def holds(product, key):
    """Whether there is a result of `product` under `key`."""
    return (cache_folder() / product / key / _NOTE).is_file()


def load(product, key):
    """The result of `product` under `key`, its arrays mapped from disk and read-only.

    The checksums of its files are compared once by every process that reads it.

    Raises
    ------
    Damaged
        It was cut short or altered since it was written, or cannot be read; it is gone now.
    """
    folder = cache_folder() / product / key
    try:
        note = json.loads((folder / _NOTE).read_text())
        for name, (n_bytes, checksum) in note["files"].items():
            _check(folder / name, n_bytes, checksum)
        return read_value(folder)
    except Exception as error:  # a class that has other fields now raises anything
        if isinstance(error, OSError | MemoryError) and not isinstance(error, FileNotFoundError):
            raise  # the machine is short of something, or may not read it: that is no damage
        shutil.rmtree(folder, ignore_errors=True)
        raise Damaged(str(error)) from None


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
    home = cache_folder()
    part = home / product / f"{_UNFINISHED}-{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    try:
        part.mkdir(parents=True)
        _remove_abandoned(home / product)
        names = write_value(value, part)
        files = {name: [(part / name).stat().st_size, _checksum(part / name)] for name in names}
        note = {"product": product, "arguments": arguments, "seconds": seconds, "files": files}
        (part / _NOTE).write_text(json.dumps(note, indent=1))
        with contextlib.suppress(FileExistsError):
            _rename(part, part.with_name(key))
            _whole.update(_identity(part.with_name(key) / name) for name in names)
    except OSError as error:
        raise InputError(_refused(home, product, error)) from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


def remove(product, key):
    """Delete the result of `product` under `key`; who has it mapped may read on."""
    shutil.rmtree(cache_folder() / product / key, ignore_errors=True)


def _rename(part, path):
    """Rename a folder; what another process has put there meanwhile stays."""
    try:
        part.rename(path)
    except OSError:
        if not path.exists():
            raise
        raise FileExistsError from None


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
    for path in folder.glob(f"{_UNFINISHED}-{socket.gethostname()}-*"):
        if not psutil.pid_exists(int(path.name.split("-")[-2])):
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
    for path in filter(_is_ours, cache_folder().glob("*/*")):
        with contextlib.suppress(OSError):  # another process finishes or deletes it
            entries.append(_entry(path))
    return sorted(entries, key=lambda entry: entry.created, reverse=True)


def _is_ours(path):
    """Whether himap made this folder; HIMAP_CACHE may name one that holds other things too."""
    if re.fullmatch(rf"{_UNFINISHED}-.+-\d+-[0-9a-f]{{8}}", path.name):
        return path.is_dir()
    known = (path / name for name in (TREE, _NOTE))  # an earlier himap had other values beside its note
    return bool(re.fullmatch(r"[0-9a-f]{32}", path.name)) and any(file.is_file() for file in known)


def _entry(path):
    try:
        note = json.loads((path / _NOTE).read_text())
    except (OSError, ValueError):
        note = {}
    files = [file.stat() for file in path.iterdir()]
    return CacheEntry(
        product=note.get("product", _UNFINISHED),
        arguments=note.get("arguments", ""),
        n_bytes=sum(stat.st_size for stat in files),
        created=datetime.fromtimestamp(max((stat.st_mtime for stat in files), default=path.stat().st_mtime)),
        seconds=note.get("seconds", 0.0),
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
        A product of which the cache holds nothing; the message lists what it holds.
    """
    entries = cache_info()
    unknown = set(products) - {entry.product for entry in entries}
    if unknown:
        names = ", ".join(sorted({entry.product for entry in entries})) or "nothing"
        raise InputError(f"the cache holds no {', '.join(sorted(unknown))}; it holds {names}.")
    doomed = [entry for entry in entries if not products or entry.product in products]
    doomed = [entry for entry in doomed if wanted is None or wanted(entry)]
    for entry in doomed:
        shutil.rmtree(entry.path, ignore_errors=True)
    return sum(entry.n_bytes for entry in doomed)
