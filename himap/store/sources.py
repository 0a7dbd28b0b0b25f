"""Source files as they are, and as this process loaded them."""

import os
from functools import lru_cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""The folder of himap."""


def read(file, *, loaded=False):
    """The text of a source file, as it is now or as this process loaded it."""
    if not loaded:
        return _now(file)[0]
    note([file])
    return _LOADED[file][0]


def note(files):
    """Note that files are loaded now; those of himap are from the beginning."""
    _LOADED.update({file: _now(file) for file in files if file not in _LOADED})


def is_unchanged(file):
    """Whether a file has the time and size that it had when it was loaded."""
    try:
        status = os.stat(file)
    except FileNotFoundError:
        return False
    return _LOADED[file][1:] == (status.st_mtime_ns, status.st_size)


def version(files):
    """What changes when one of some files does."""
    return frozenset((file, file.stat().st_mtime_ns) for file in files if file.exists())


def _now(file):
    status = file.stat()
    return _text(file, status.st_mtime_ns, status.st_size), status.st_mtime_ns, status.st_size


@lru_cache(maxsize=1024)
def _text(file, mtime, size):
    return file.read_text(encoding="utf-8")


_LOADED = {file: _now(file) for file in ROOT.rglob("*.py")}
