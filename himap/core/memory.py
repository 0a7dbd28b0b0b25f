"""How much memory may be used; arrays that need more are refused before they are made."""

import os
import re

import psutil

from himap.core.errors import InputError

LIMIT_VARIABLE = "HIMAP_MAX_MEMORY"
"""Environment variable with the memory that a run may use, such as 16GB; `--max-memory` sets it."""

PROCESS = 0.5e9
"""Bytes of a Python process with the packages that himap uses."""

_UNITS = {"": 1, "B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}
_LARGEST = 1e15  # bytes that somebody may mean


def memory_limit():
    """Bytes that a run may use: HIMAP_MAX_MEMORY, else what the machine has free now.

    Raises
    ------
    InputError
        HIMAP_MAX_MEMORY is no size.
    """
    text = os.environ.get(LIMIT_VARIABLE, "")
    return parse_size(text) if text else psutil.virtual_memory().available


def parse_size(text):
    """Bytes of a text such as 16GB or 500 MB.

    Raises
    ------
    InputError
        It is no size, or one that no machine has.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kMGT]?B?)\s*", text, flags=re.ASCII)
    unit = match and (match[2] if match[2].endswith("B") or not match[2] else match[2] + "B")
    size = float(match[1]) * _UNITS[unit] if match else 0
    if not 1 <= size <= _LARGEST:
        shown = text if len(text) < 40 else f"{text[:40]}..."
        raise InputError(
            "a size of memory is a number with kB, MB, GB or TB, such as 16GB, and at most "
            f"{_LARGEST / 1e12:g} TB; got {shown!r}."
        )
    return int(size)


def check_room(what, n_bytes):
    """Refuse to read `what`, a text, where the arrays that it asks for, `n_bytes` in all, do not fit.

    Raises
    ------
    InputError
        They need more than `memory_limit`.
    """
    limit = memory_limit()
    if n_bytes > limit:
        raise InputError(
            f"{what} needs about {n_bytes / 1e9:.3g} GB, and {limit / 1e9:.3g} GB may be used: take fewer "
            "channels, or a lower nside (healpy.ud_grade); a machine with more memory does too, and the "
            f"variable {LIMIT_VARIABLE} sets what may be used. If it should not be that large, the file is "
            "damaged."
        )
