"""How much memory may be used; what needs more is refused before it starts.

Everything large is float32: boxes of cells while HI is made, cubes of (n_channels, n_pix) afterwards. The
counts are those of the code. tests/test_memory.py compares the light cone with a measured peak; observing and
cleaning are what processes took at the paper's size.
"""

import os
import re
import signal
from contextlib import suppress
from pathlib import Path

import psutil

from himap.core.errors import InputError
from himap.core.survey import NESTED_CELLS

LIMIT_VARIABLE = "HIMAP_MAX_MEMORY"
"""Environment variable with the memory that a run may use, such as 16GB; `--max-memory` sets it."""

PROCESS = 0.5e9
"""Bytes of a Python process with the packages that himap uses."""

_UNITS = {"": 1, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}
_LARGEST = 1e15  # bytes that somebody may mean
_BOXES = 2  # of cells, while HI is made
_KILLS = Path("/proc/vmstat")  # where Linux counts the processes that it ended for want of memory
_COLUMNS = 7e9  # bytes of what is transformed at once, and of its transform
_CUBES = {"observing": 5, "cleaning": 3.5}  # held at once by one process, those of mapped files too


def memory_limit():
    """Bytes that a run may use: HIMAP_MAX_MEMORY, as `parse_size` reads it, else what is free now."""
    text = os.environ.get(LIMIT_VARIABLE, "")
    return parse_size(text) if text else psutil.virtual_memory().available


def parse_size(text):
    """Bytes of a text such as 16GB or 500 MB; InputError for no size, or one that no machine has."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kMGT]?)B?\s*", text, flags=re.ASCII)
    size = float(match[1]) * _UNITS[match[2]] if match else 0
    if not 1 <= size <= _LARGEST:
        raise InputError(
            "a size of memory is a number with kB, MB, GB or TB, such as 16GB, and at most "
            f"{_LARGEST / 1e12:g} TB; got {text!r}."
        )
    return int(size)


def check_room(what, n_bytes):
    """InputError before `what`, a text, is read, where its arrays need more bytes than `memory_limit`."""
    limit = memory_limit()
    if n_bytes > limit:
        raise InputError(
            f"{what} needs about {n_bytes / 1e9:.3g} GB, and {limit / 1e9:.3g} GB may be used: take fewer "
            "channels, or a lower nside (healpy.ud_grade); a machine with more memory does too, and the "
            f"variable {LIMIT_VARIABLE} sets what may be used. If it should not be that large, the file is "
            "damaged."
        )


def memory_kills():
    """How many processes Linux has ended for want of memory since it started; 0 where it does not say."""
    with suppress(OSError, TypeError):
        return int(re.search(r"^oom_kill (\d+)$", _KILLS.read_text(), re.M)[1])
    return 0


def cause_of_death(codes, kills):
    """How processes ended: their exit codes or signals (negative), and memory only if it ran out.

    `kills` is what `memory_kills` gave before they started.
    """
    names = []
    for code in sorted(set(codes)):
        names.append(f"exit code {code}" if code >= 0 else f"signal {-code}")
        with suppress(ValueError):  # a signal without a name
            names[-1] += f" ({signal.Signals(-code).name})"
    out_of_memory = -signal.SIGKILL in codes and memory_kills() > kills
    return (" or ".join(names) or "an unknown cause") + ", because memory ran out" * out_of_memory


def estimate(survey, *, jobs=1, in_files=False):
    """Peak memory by step, {step: bytes}, of a run with `jobs` processes that clean at once.

    The HI box is in memory, or `in_files`: then memory holds the columns that are transformed at once, and
    the modes of a smaller box.
    """
    cube = 4 * survey.n_channels * survey.n_pix
    light_cone = _BOXES * 4 * survey.box_cells**3 + cube
    if in_files:
        in_columns = max(_COLUMNS + 4 * min(survey.box_cells, NESTED_CELLS) ** 3, cube)
        light_cone = min(light_cone, in_columns)  # a small box needs less than its columns may
    return {
        "HI light cone": PROCESS + light_cone,
        "observing": PROCESS + _CUBES["observing"] * cube,
        "cleaning": jobs * (PROCESS + _CUBES["cleaning"] * cube),
    }


def fitting(survey, step):
    """How many processes that do a step of `estimate` fit into `memory_limit`, 1 or more."""
    return max(1, int(memory_limit() // estimate(survey)[step]))


def check_memory(survey, step, *, jobs=1, in_files=False):
    """InputError, before it starts, for a step of `estimate`, whose options these are, that will not fit."""
    limit, needed = memory_limit(), estimate(survey, jobs=jobs, in_files=in_files)[step]
    if needed > limit:
        if step == "cleaning" and jobs > 1:
            way_out = "fewer --jobs need less"
        else:
            way_out = f"a smaller {'box_cells, ' * (step == 'HI light cone')}nside or n_channels needs less"
        raise InputError(
            f"{step} needs about {needed / 1e9:.3g} GB at nside {survey.nside}, {survey.n_channels} "
            f"channels, {survey.box_cells}^3 cells{f' and {jobs} jobs' if jobs > 1 else ''}, and "
            f"{limit / 1e9:.3g} GB may be used: {way_out}; so does a machine with more memory, and "
            f"--max-memory (the variable {LIMIT_VARIABLE}) sets what may be used."
        )
