"""Progress of long work: a bar on a terminal, occasional lines in a log, nothing in a notebook.

A bar is drawn only where a person can see it: on standard error if that is a terminal, or on the
terminal given by the variable HIMAP_TERMINAL, which `himap run` sets for its kernels. So the bar of a
notebook's work appears in the terminal and never in the notebook. A command whose standard error is not a
terminal writes lines there (`in_lines`).
"""

import atexit
import os
import sys
from functools import lru_cache

from tqdm import tqdm

TERMINAL_VARIABLE = "HIMAP_TERMINAL"
"""Environment variable with the path of the terminal to draw on."""

_DELAY = 1.0  # s: shorter work has no bar
_EVERY = 10.0  # s between lines
_LINE = "{desc}: {n_fmt} of {total_fmt}, {elapsed} passed, {remaining} remain"

in_lines = False
"""Whether to write a line every 10 s to standard error if no terminal shows a bar, as commands do."""


def progress(iterable=None, description="", *, total=None):
    """`iterable`, with a bar and the remaining time while it is consumed.

    Without `iterable` it is a context manager for work that counts its own steps::

        with progress(description="channels", total=500) as bar:
            ...
            bar.update()

    The `description`, a word or two, is shown before the bar; `total` is the number of steps if `iterable`
    has no length.
    """
    if sys.stderr is not None and sys.stderr.isatty():
        terminal, line = sys.stderr, 0
    else:  # one line below the bar of the process that watches the notebook
        terminal, line = _open_terminal(os.environ.get(TERMINAL_VARIABLE, "")), 1
    options = {"delay": _DELAY, "position": line, "dynamic_ncols": True, "disable": terminal is None}
    if terminal is None and sys.stderr is not None and in_lines:
        terminal = _Lines(sys.stderr)
        options = {"delay": _EVERY, "mininterval": _EVERY, "position": 0, "bar_format": _LINE}
    return _Bar(iterable, desc=description, total=total, file=terminal, leave=False, **options)


class _Lines:
    """A file that receives each state of a bar as a line."""

    def __init__(self, file):
        self._file = file

    def write(self, text):
        if line := text.strip():
            self._file.write(f"{line}\n")


class _Bar(tqdm):
    """A bar without tqdm's monitor thread, which occasionally warns if other bars start or end meanwhile."""

    monitor_interval = 0


@lru_cache(maxsize=4)
def _open_terminal(path):
    """The terminal at `path`, open for writing; None if it no longer exists."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_NOCTTY)
    except OSError:
        return None
    if not os.isatty(descriptor):
        os.close(descriptor)
        return None
    terminal = os.fdopen(descriptor, "w")
    atexit.register(terminal.close)
    return terminal
