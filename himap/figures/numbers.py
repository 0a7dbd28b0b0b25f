"""Numbers with a stated tolerance: how notebooks show them and how tests compare them.

A notebook shows each of its numbers as ``value ± tolerance``. The tolerance says how far the number
may move on another machine before somebody should look; it is not an error bar.
"""

import math
import re

from himap.errors import InputError
from himap.figures.tables import Table

__all__ = ["agree", "show", "show_table"]

_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
_WITH_TOLERANCE = re.compile(rf"({_NUMBER}) ± ({_NUMBER})")


def show(numbers):
    """A table of numbers with their tolerance, to end a notebook cell with.

    Parameters
    ----------
    numbers
        {name: (value, tolerance)} or {name: (value, tolerance, unit)}, tolerance > 0 in the unit of
        the value; {name: value} for what must come out the same everywhere, such as a count.

    Raises
    ------
    InputError
        Something else, or a tolerance that is no positive number.

    >>> show({"C/C0, 10 < l < 128": (0.98712, 0.01), "noise": (0.0331, 0.0002, "mK"), "channels": 125})
    C/C0, 10 < l < 128: 0.987 ± 0.010
    noise: 0.03310 ± 0.00020 mK
    channels: 125
    """
    return _Numbers([], [_row(name, entry) for name, entry in numbers.items()], align="lr")


def show_table(rows):
    """A table with a column for each quantity, to end a notebook cell with.

    Parameters
    ----------
    rows
        {name: {column: entry}}, entries as in `show`. A row may lack columns.

    Raises
    ------
    InputError
        As `show`.
    """
    columns = list(dict.fromkeys(column for entries in rows.values() for column in entries))
    cells = []
    for name, entries in rows.items():
        numbers = {key: _row(f"{name}, {key}", entry)[1:] for key, entry in entries.items()}
        cells.append([name, *(" ".join(numbers.get(column, ())).strip() for column in columns)])
    return Table(["", *columns], cells, align="l" + "r" * len(columns))


class _Numbers(Table):
    """What `show` returns: a table in a notebook, one line for each number elsewhere."""

    def __repr__(self):
        return "\n".join(f"{name}: {number} {unit}".rstrip() for name, number, unit in self.rows)


def agree(text, reference):
    """Whether two texts are the same but for numbers within the tolerance stated behind them.

    Where both say ``value ± tolerance`` the values may differ by the tolerance of the reference. A tolerance
    that is a share of its value moves with it, and may itself differ by a tenth. All the rest, numbers
    without a tolerance included, must be equal.
    """
    if _WITH_TOLERANCE.sub("±", text) != _WITH_TOLERANCE.sub("±", reference):
        return False
    pairs = zip(_WITH_TOLERANCE.findall(text), _WITH_TOLERANCE.findall(reference), strict=True)
    return all(
        _near(tolerance, stated, 0.1 * float(stated)) and _near(value, expected, float(stated))
        for (value, tolerance), (expected, stated) in pairs
    )


def _near(text, reference, most):
    return abs(float(text) - float(reference)) <= most * (1 + 1e-9)


def _row(name, entry):
    if not isinstance(entry, tuple):
        return name, str(entry), ""
    if len(entry) not in (2, 3):
        raise InputError(f"{name}: expected (value, tolerance) or (value, tolerance, unit), got {entry!r}.")
    value, tolerance, unit = (*entry, "")[:3]
    try:
        value, tolerance = float(value), float(tolerance)
    except (TypeError, ValueError):
        raise InputError(f"{name}: value and tolerance must be numbers, got {entry!r}.") from None
    if not 0 < tolerance < math.inf:
        raise InputError(f"{name}: the tolerance must be a number above 0, got {tolerance}.")
    return name, _format(value, tolerance), unit


def _format(value, tolerance):
    """`value` to the second digit of the tolerance, which shows the tolerance itself to two digits."""
    if not math.isfinite(value):
        return f"{value} ± {tolerance:.1e}"
    exponent = math.floor(math.log10(float(f"{tolerance:.1e}")))
    if exponent < -5 or exponent > 5:
        size = math.floor(math.log10(abs(value))) if value else exponent
        return f"{value:.{max(size - exponent + 1, 1)}e} ± {tolerance:.1e}"
    decimals = max(1 - exponent, 0)
    return f"{value:.{decimals}f} ± {tolerance:.{decimals}f}"
