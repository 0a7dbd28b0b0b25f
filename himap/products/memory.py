"""What a run will hold in memory, estimated before it starts.

Everything large is float32: boxes of cells while HI is made, cubes of (n_channels, n_pix) afterwards. The
counts are those of the code. tests/test_memory.py holds the light cone against a measured peak; observing and
cleaning are what processes took at the paper's size.
"""

import os
import re

import psutil

from himap.errors import InputError

__all__ = ["LIMIT_VARIABLE", "check_memory", "estimate", "memory_limit", "parse_size"]

LIMIT_VARIABLE = "HIMAP_MAX_MEMORY"
"""Environment variable with the memory that a run may use, such as 16GB; `--max-memory` sets it."""

_UNITS = {"": 1, "B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}
_LARGEST = 1e15  # bytes that somebody may mean
_PROCESS = 0.5e9  # bytes of a Python process with the packages that himap uses
_BOXES = 3  # of cells, at most, while HI is made
_CUBES = {"observing": 5, "cleaning": 4}  # held at once by one process


def estimate(survey, *, jobs=1):
    """Peak memory by step, {step: bytes}, of a run with `jobs` processes that clean at once."""
    box = 4 * survey.box_cells**3
    cube = 4 * survey.n_channels * survey.n_pix
    return {
        "HI light cone": _PROCESS + max(_BOXES * box, (_BOXES - 1) * box + cube),
        "observing": _PROCESS + _CUBES["observing"] * cube,
        "cleaning": jobs * (_PROCESS + _CUBES["cleaning"] * cube),
    }


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


def check_memory(survey, *, jobs=1, steps=None):
    """Refuse a run that will not fit, before it starts.

    Parameters
    ----------
    survey
        The `Survey`.
    jobs
        Processes that clean at once.
    steps
        Which steps of `estimate`; default all.

    Raises
    ------
    InputError
        A step needs more than `memory_limit`; the message says what would fit.
    """
    limit = memory_limit()
    needs = estimate(survey, jobs=jobs)
    step, need = max(((step, needs[step]) for step in steps or needs), key=lambda item: item[1])
    if need <= limit:
        return
    if step == "HI light cone":
        cells = survey.box_cells
        while cells > 1 and _PROCESS + _BOXES * 4 * cells**3 > limit:
            cells //= 2
        way_out = f"box_cells={cells} fits"
    elif step == "cleaning" and jobs > 1:
        way_out = "fewer --jobs need less"
    else:
        way_out = "a smaller nside or n_channels needs less"
    raise InputError(
        f"{step} needs about {need / 1e9:.3g} GB at nside {survey.nside}, {survey.n_channels} channels and "
        f"{survey.box_cells}^3 cells{f' with {jobs} jobs' if jobs > 1 else ''}, and {limit / 1e9:.3g} GB may "
        f"be used: {way_out}; so does a machine with more memory, and --max-memory (the variable "
        f"{LIMIT_VARIABLE}) sets what may be used."
    )
