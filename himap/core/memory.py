"""How much memory may be used; work that needs more is refused before it starts.

Everything large is float32: boxes of cells while HI is simulated, then cubes of (n_channels, n_pix). The
counts follow from the code. tests/test_memory.py compares the light cone with a measured peak; observing
and cleaning were measured at the paper's size.
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
"""Bytes of a Python process with the packages imported by himap."""

_UNITS = {"": 1, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}
_LARGEST = 1e15  # largest plausible number of bytes
_BOXES = 2  # of cells, while HI is simulated
_KILLS = Path("/proc/vmstat")  # where Linux counts processes killed because memory ran out
_COLUMNS = 7e9  # bytes of the columns transformed at once, and of their transform
_CUBES = {"observing": 5, "cleaning": 3.5}  # held at once by one process, including mapped files


def memory_limit():
    """Bytes that a run may use: HIMAP_MAX_MEMORY, as `parse_size` reads it, else the free memory."""
    text = os.environ.get(LIMIT_VARIABLE, "")
    return parse_size(text) if text else psutil.virtual_memory().available


def parse_size(text):
    """Bytes of a text such as 16GB or 500 MB; InputError if it is no size, or more than any machine has."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kMGT]?)B?\s*", text, flags=re.ASCII)
    size = float(match[1]) * _UNITS[match[2]] if match else 0
    if not 1 <= size <= _LARGEST:
        raise InputError(
            "a size of memory is a number with kB, MB, GB or TB, such as 16GB, and at most "
            f"{_LARGEST / 1e12:g} TB; got {text!r}."
        )
    return int(size)


def check_room(what, n_bytes):
    """Raise InputError before `what`, a text, is read, if its arrays need more than `memory_limit`."""
    limit = memory_limit()
    if n_bytes > limit:
        raise InputError(
            f"{what} needs about {n_bytes / 1e9:.3g} GB, and {limit / 1e9:.3g} GB may be used: take fewer "
            "channels, or a lower nside (healpy.ud_grade); a machine with more memory also helps, and the "
            f"variable {LIMIT_VARIABLE} sets what may be used. If it should not be that large, the file is "
            "damaged."
        )


def memory_kills():
    """Number of processes that Linux has killed for lack of memory since it started; 0 if unknown."""
    with suppress(OSError, TypeError):
        return int(re.search(r"^oom_kill (\d+)$", _KILLS.read_text(), re.M)[1])
    return 0


def cause_of_death(codes, kills):
    """Describe how processes ended: exit codes or signals (negative), and memory only if it ran out.

    `kills` is the result of `memory_kills` before they started.
    """
    names = []
    for code in sorted(set(codes)):
        names.append(f"exit code {code}" if code >= 0 else f"signal {-code}")
        with suppress(ValueError):  # a signal without a name
            names[-1] += f" ({signal.Signals(-code).name})"
    out_of_memory = -signal.SIGKILL in codes and memory_kills() > kills
    return (" or ".join(names) or "an unknown cause") + ", because memory ran out" * out_of_memory


def estimate(survey, *, jobs=1, in_files=False):
    """Peak memory by step, {step: bytes}, of a run with `jobs` processes that clean in parallel.

    The HI box is in memory, or `in_files`: then memory holds only the columns transformed at once, and the
    modes of a smaller box.
    """
    cube = 4 * survey.n_channels * survey.n_pix
    light_cone = _BOXES * 4 * survey.box_cells**3 + cube
    if in_files:
        in_columns = max(_COLUMNS + 4 * min(survey.box_cells, NESTED_CELLS) ** 3, cube)
        light_cone = min(light_cone, in_columns)  # a small box needs less than the limit for columns
    return {
        "HI light cone": PROCESS + light_cone,
        "observing": PROCESS + _CUBES["observing"] * cube,
        "cleaning": jobs * (PROCESS + _CUBES["cleaning"] * cube),
    }


def fitting(survey, step):
    """Number of processes that fit into `memory_limit` for a step of `estimate`, at least 1."""
    return max(1, int(memory_limit() // estimate(survey)[step]))


def check_memory(survey, step, *, jobs=1, in_files=False):
    """Raise InputError before a step of `estimate`, with the same options, if it does not fit into memory."""
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
