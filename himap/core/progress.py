"""Progress of long work, on a terminal or nowhere.

A bar is drawn only where a person can watch it: on standard error if that is a terminal, or on the
terminal named by the variable HIMAP_TERMINAL, which `himap run` sets for the kernels it starts. So
the bar of a notebook's work shows in the terminal and never lands in the notebook.
"""

import atexit
import os
import sys
from functools import lru_cache

from tqdm import tqdm

TERMINAL_VARIABLE = "HIMAP_TERMINAL"
"""Environment variable with the path of the terminal to draw on."""

_DELAY = 1.0  # s: what is done before needs no bar


def progress(iterable=None, description="", *, total=None):
    """`iterable`, with a bar and the time left while it is consumed.

    Without `iterable` it is a context manager for work that counts its own steps::

        with progress(description="channels", total=500) as bar:
            ...
            bar.update()

    Parameters
    ----------
    iterable
        What to loop over.
    description
        A word or two in front of the bar.
    total
        Number of steps, where `iterable` has no length.
    """
    if sys.stderr is not None and sys.stderr.isatty():
        terminal, line = sys.stderr, 0
    else:  # one line below the bar of the process that watches the notebook
        terminal, line = _open_terminal(os.environ.get(TERMINAL_VARIABLE, "")), 1
    return _Bar(
        iterable,
        desc=description,
        total=total,
        file=terminal,
        disable=terminal is None,
        delay=_DELAY,
        position=line,
        leave=False,
        dynamic_ncols=True,
    )


class _Bar(tqdm):
    """A bar that no thread watches: tqdm's warns, now and then, when other bars begin and end as it looks."""

    monitor_interval = 0


@lru_cache(maxsize=4)
def _open_terminal(path):
    """The terminal at `path`, open for writing; None if there is none any more."""
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
