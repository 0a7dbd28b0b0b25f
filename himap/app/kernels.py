"""What the kernel of a notebook finds around it."""

import contextlib
import logging
import os
import sys
from pathlib import Path

from himap.core.files import run_folder
from himap.core.progress import TERMINAL_VARIABLE

_PACKAGE = Path(__file__).resolve().parents[1]


def terminal():
    """Path of the terminal that a person watches, or None."""
    with contextlib.suppress(OSError, AttributeError):
        return os.ttyname(sys.stderr.fileno())
    return None


@contextlib.contextmanager
def kernel_environment(terminal):
    """What a kernel started inside finds: this himap, the terminal for its bars, and no chatter.

    Neither modules in the current folder nor what a user lets IPython do at each start come into it.
    """
    # A kernel takes the first of them off where that is the current folder: so the first one is nowhere.
    nowhere = run_folder() / "nowhere"
    paths = [str(nowhere), str(_PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    changes = {
        "PYTHONPATH": os.pathsep.join(paths),
        "PYTHONSAFEPATH": "1",
        "IPYTHONDIR": str(run_folder() / "ipython"),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "JUPYTER_PLATFORM_DIRS": "1",
    }
    home = Path.home()
    if not (home.is_dir() and os.access(home, os.W_OK)):  # matplotlib would say so in the notebook
        changes["MPLCONFIGDIR"] = os.environ.get("MPLCONFIGDIR", str(run_folder() / "matplotlib"))
    if terminal:
        changes[TERMINAL_VARIABLE] = terminal
    logging.getLogger("papermill").setLevel(logging.ERROR)
    with changed_environment(changes):
        yield


@contextlib.contextmanager
def changed_environment(changes):
    """Environment variables {name: text}, as they were again afterwards."""
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.__setitem__(name, value)
