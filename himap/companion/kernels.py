"""What the kernel of a notebook finds around it."""

import atexit
import contextlib
import logging
import os
import shutil
import sys
import tempfile
from functools import cache
from pathlib import Path

from himap.errors import InputError
from himap.folders import is_abandoned, own_name
from himap.progress import TERMINAL_VARIABLE

__all__ = ["changed_environment", "kernel_environment", "run_folder", "terminal"]

_PACKAGE = Path(__file__).resolve().parents[1]
_PREFIX = "himap"
_LONGEST = 60  # bytes of a folder that leaves room for the names of sockets


def terminal():
    """Path of the terminal that a person watches, or None."""
    with contextlib.suppress(OSError, AttributeError):
        return os.ttyname(sys.stderr.fileno())
    return None


@cache
def run_folder():
    """A folder for what kernels need, until this process ends; what killed ones left of theirs goes.

    Raises
    ------
    InputError
        No folder for temporary files can be written to.
    """
    for home in _temporary_folders():
        with contextlib.suppress(OSError):
            for left in filter(is_abandoned, home.glob(f"{_PREFIX}-*")):
                shutil.rmtree(left, ignore_errors=True)
            folder = home / own_name(_PREFIX)
            folder.mkdir(mode=0o700)
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
            return folder
    raise InputError("no folder for temporary files can be written to; name one with the variable TMPDIR.")


def _temporary_folders():
    """The system's, after a shorter one where its name leaves no room for those of sockets."""
    with contextlib.suppress(FileNotFoundError):
        chosen = Path(tempfile.gettempdir())
        return [chosen] if len(os.fsencode(chosen)) < _LONGEST else [Path("/tmp"), chosen]
    return []


@contextlib.contextmanager
def kernel_environment(terminal):
    """What a kernel started inside finds: this himap, the terminal for its bars, and no chatter.

    Neither modules in the current folder nor what a user lets IPython do at each start come into it.
    """
    paths = [str(_PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    changes = {
        "PYTHONPATH": os.pathsep.join(paths),
        "PYTHONSAFEPATH": "1",
        "IPYTHONDIR": str(run_folder() / "ipython"),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "JUPYTER_PLATFORM_DIRS": "1",
    }
    if not os.access(Path.home() / ".", os.W_OK):  # matplotlib would say so in the notebook
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
