"""What a run will hold in memory, estimated before it starts.

Everything large is float32: boxes of cells while HI is made, cubes of (n_channels, n_pix) afterwards. The
counts are those of the code. tests/test_memory.py holds the light cone against a measured peak; observing and
cleaning are what processes took at the paper's size.
"""

from himap.core.errors import InputError
from himap.core.memory import LIMIT_VARIABLE, memory_limit, parse_size
from himap.core.memory import PROCESS as _PROCESS

__all__ = ["LIMIT_VARIABLE", "check_memory", "estimate", "memory_limit", "parse_size"]

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
