"""Numbers with a stated tolerance: how notebooks show them and how tests compare them.

A notebook shows each of its numbers as ``value ± tolerance``. The tolerance is how far the number may differ
on another machine before somebody should check; it is not an error bar. Numbers in prose have no tolerance,
but also come from the notebook: see `quote`.

A number from one run of a chaotic method is marked by `one_run`. It differs on another machine, so only
its name, unit and form are compared.
"""

import math
import re
from collections import Counter
from itertools import count

import numpy as np

from himap.core.errors import InputError
from himap.figures.tables import Table

_RECORD = "application/papermill.record/"  # prefix of MyST-NB's glue for hidden types of output

QUOTED = (_RECORD + "text/plain", _RECORD + "text/x-tolerance")
"""Types of output of a number for prose: the text, and, if it has a tolerance, the number with it."""

_SIGN = "†"

NOT_COMPARED = f"{_SIGN} one run, not compared"
"""The line below numbers of which some are marked by `one_run`; these end with the first sign of the line."""

OF_RESTARTS = f"{_SIGN} median (16–84 %) of restarts, not compared"
"""The same if some are marked by `of_restarts`."""

_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_WITH_TOLERANCE = re.compile(rf"({_NUMBER}) ± ({_NUMBER})")
_MARKED = re.compile(rf"([^ \n<>|]+){_SIGN}")
_JOINT = "\N{NO-BREAK SPACE}"
_ROUNDED = rf"(?:–|-?\d(?:[\d,]*\d)?(?:\.\d+)?(?:{_JOINT}×{_JOINT}10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?)"
_ENDS = rf"(?:{_JOINT}\({_ROUNDED}(?:–|{_JOINT}to{_JOINT}){_ROUNDED}\))?"  # of a median
_FORMATTED = re.compile(rf"{_ROUNDED}(?:(?:,|{_JOINT}and|{_JOINT}of){_JOINT}{_ROUNDED})*{_ENDS}")


class Marked(tuple):
    """An entry of `one_run` or `of_restarts`: (value, tolerance), (value, tolerance, unit) or (text, None).

    `note` is the text that explains its sign; for several restarts, `ends` are the 16 and 84 % values.
    """

    note, ends = NOT_COMPARED, None


def one_run(entry):
    """Mark a number, or all in a dictionary, as from one run of a chaotic method such as SDecGMCA.

    An entry is as in `show`, or a text, such as a verdict or a "–" if a run may have no such number, or a
    dictionary of these. It is shown to the digits that its tolerance allows, with the sign explained by
    `NOT_COMPARED`. It is still a tuple, so code that takes the value from an entry need not change.
    See `agree` for what tests still compare.

    >>> show(one_run({"C/C0": (0.9784, 0.01), "settled": "yes"}) | {"channels": 125})
    C/C0: 0.98†
    settled: yes†
    channels: 125
    † one run, not compared
    """
    return of_restarts([entry])


def of_restarts(entries):
    """Median and 16 to 84 % range over runs of a chaotic method, marked like `one_run`.

    Entries are as in `show`, one for each run: numbers with a tolerance, replaced by their median; texts,
    which are counted; or dictionaries of these. For a single run the result is that of `one_run`.

    >>> runs = [{"C/C0": (value, 0.01), "settled": "no"} for value in (0.97, 0.98, 1.07)]
    >>> show(of_restarts(runs))
    C/C0: 0.98\N{NO-BREAK SPACE}(0.97–1.04)†
    settled: no†
    † median (16–84 %) of restarts, not compared
    """
    first = entries[0]
    if isinstance(first, dict):
        return {name: of_restarts([entry[name] for entry in entries]) for name in first}
    if len(entries) == 1:
        return Marked(first if isinstance(first, tuple) else (first, None))
    if isinstance(first, tuple):
        values, tolerances = (np.array([entry[n] for entry in entries], dtype=float) for n in (0, 1))
        low, median, high = map(float, np.percentile(values, (16, 50, 84)))
        found = Marked((median, float(np.median(tolerances)), *first[2:]))
        found.ends = low, high
    else:
        counts = Counter(map(str, entries))
        texts = [f"{number} {text}" for text, number in counts.items()]
        found = Marked((", ".join(texts) if len(counts) > 1 else str(first), None))
    found.note = OF_RESTARTS
    return found


class _Numbers(Table):
    """Result of `show`: a table in a notebook, one line for each number elsewhere."""

    def __repr__(self):
        lines = [f"{name}: {number} {unit}".rstrip() for name, number, unit in self.rows]
        return "\n".join([*lines, *filter(None, [self.note])])


def show(numbers):
    """A table of numbers with their tolerance, for the end of a notebook cell.

    Entries are {name: (value, tolerance)} or {name: (value, tolerance, unit)}, tolerance > 0 in the unit of
    the value; {name: value} for values that must be equal everywhere, such as a count; or results of
    `one_run`. InputError for anything else.

    >>> show({"C/C0, 10 < l < 128": (0.98712, 0.01), "noise": (0.0331, 0.0002, "mK"), "channels": 125})
    C/C0, 10 < l < 128: 0.987 ± 0.010
    noise: 0.03310 ± 0.00020 mK
    channels: 125
    """
    rows = [(name, *_cell(name, entry)) for name, entry in numbers.items()]
    return _Numbers([], rows, align="lr", note=_note(numbers.values()))


class _Parts:
    """Several tables, one below the other, as one output."""

    def __init__(self, tables):
        self.tables = tables

    def __repr__(self):
        return "\n\n".join(map(repr, self.tables))

    def _repr_html_(self):
        return "\n".join(table.html() for table in self.tables)


def show_table(rows, *, head="", columns=None):
    """A table with a column for each quantity, for the end of a notebook cell.

    Parameters
    ----------
    rows
        {name: {column: entry}}, entries as in `show`. Rows may lack columns.
    head
        Header of the names.
    columns
        Number of columns that fit on the page; wider tables are split. None for one table.
    """
    names = list(dict.fromkeys(name for entries in rows.values() for name in entries))
    step = columns or len(names) or 1
    tables = []
    for start in range(0, len(names) or 1, step):
        some, cells = names[start : start + step], []
        for row, entries in rows.items():
            numbers = (_cell(f"{row}, {name}", entries.get(name, "")) for name in some)
            cells.append([row, *(" ".join(number).strip() for number in numbers)])
        tables.append(Table([head, *some], cells, align="l" + "r" * len(some)))
    tables[-1].note = _note(entry for entries in rows.values() for entry in entries.values())
    return tables[0] if len(tables) == 1 else _Parts(tables)


def quote(**numbers):
    """Store numbers for the prose of the notebook and of other pages; the cell does not show them.

    Prose uses ``{glue:text}`name``` in the same notebook, and on other pages, with a relative path,
    ``{glue:text}`../notebooks/04_pca.ipynb::name:s```. It shows the value only, to the digits that the
    tolerance allows, with its unit. Names begin with the topic of the notebook and are unique in the book.

    Entries and errors are as in `show`.
    """
    from IPython import get_ipython  # slow, and most callers of this module do not need it

    text, with_tolerance = QUOTED
    cells = {name: " ".join(_cell(name, entry)).rstrip() for name, entry in numbers.items()}
    if (shell := get_ipython()) is not None:  # outside of IPython nothing stores them
        for name, entry in numbers.items():
            # The repr of the text, as MyST-NB evaluates what it pastes.
            bundle = {text: repr(quoted(entry))}
            bundle |= {with_tolerance: cells[name]} if isinstance(entry, tuple) else {}
            kept = {"scrapbook": {"name": name, "mime_prefix": _RECORD}}
            shell.display_pub.publish(bundle, metadata=kept)


def quoted(entry):
    """The text shown in prose for an entry of `quote`.

    >>> quoted((0.9573, 0.005)), quoted((12345, 100, "K")), quoted((1.814e8, 2e7)), quoted(27)
    ('0.957', '12,300\N{NO-BREAK SPACE}K', '1.8 × 10⁸', '27')
    """
    number, _, unit = _parsed("quoted", entry)
    return f"{number}{_JOINT}{unit}" if unit else number


def agree(text, reference):
    """Whether two texts are equal, except for differences of numbers within their stated tolerance.

    If both have ``value ± tolerance``, values may differ by the tolerance of the reference. A tolerance that
    is a fraction of its value changes with it, and may itself differ by a tenth.

    Entries marked by `one_run` are compared in form only: at the same position both have numbers (one, with a
    range as in "0.98 (0.97–1.04)" or without, several as in "4 and 5", "1 of 4" and "906, 1394", or a "–" for
    no number in this run), or both have a text; the number of spaces that align them is ignored. NaN and
    infinity are no numbers here: each is equal only to itself.

    Everything else, including numbers without a tolerance, must be equal.
    """
    text, reference = _by_form(text), _by_form(reference)
    if _WITH_TOLERANCE.sub("±", text) != _WITH_TOLERANCE.sub("±", reference):
        return False
    pairs = zip(_WITH_TOLERANCE.findall(text), _WITH_TOLERANCE.findall(reference), strict=True)
    return all(
        abs(float(one) - float(other)) <= share * float(stated) * (1 + 1e-9)
        for (value, tolerance), (expected, stated) in pairs
        for one, other, share in ((tolerance, stated, 0.1), (value, expected, 1))
    )


def _by_form(text):
    """Replace what `one_run` marked by its form."""

    def form(marked):
        if marked[1] in ("nan", "inf", "-inf"):
            return marked[0]
        return f"{'number' if _FORMATTED.fullmatch(marked[1]) else 'text'}{_SIGN}"

    return re.sub(" +", " ", _MARKED.sub(form, text)) if _SIGN in text else text


def _note(entries):
    notes = {entry.note for entry in entries if isinstance(entry, Marked)}
    return OF_RESTARTS if OF_RESTARTS in notes else NOT_COMPARED if notes else ""


def _cell(name, entry):
    """The number, to the second digit of its tolerance and with that, and the unit of an entry, as texts."""
    number, tolerance, unit = _parsed(name, entry)
    if isinstance(entry, Marked):
        return f"{number.replace(' ', _JOINT)}{_SIGN}", unit  # so that `agree` sees where it begins
    if tolerance is None:
        return number, unit
    value = float(entry[0])
    if not math.isfinite(value):
        return f"{value} ± {tolerance:.1e}", unit
    exponent = _exponent(tolerance)
    if exponent < -5 or exponent > 5:
        size = math.floor(math.log10(abs(value))) if value else exponent
        decimals, kind, stated = max(size - exponent + 1, 1), "e", f"{tolerance:.1e}"
    else:
        decimals, kind = max(1 - exponent, 0), "f"
        stated = f"{tolerance:.{decimals}f}"
    # More digits where rounding these by `_rounded` would differ from rounding the value.
    rounded = _rounded(value, tolerance)
    texts = (f"{value:.{n}{kind}}" for n in count(decimals))
    text = next(text for text in texts if _rounded(float(text), tolerance) == rounded)
    return f"{text} ± {stated}", unit


def _parsed(name, entry):
    """Return (number to the digits that its tolerance allows, tolerance or None, unit) of an entry."""
    if not isinstance(entry, tuple):
        return str(entry), None, ""
    if isinstance(entry, Marked) and entry[1:] == (None,):
        return str(entry[0]), None, ""
    if len(entry) not in (2, 3):
        raise InputError(f"{name}: expected (value, tolerance) or (value, tolerance, unit), got {entry!r}.")
    value, tolerance, unit = (*entry, "")[:3]
    try:
        value, tolerance = float(value), float(tolerance)
    except (TypeError, ValueError):
        raise InputError(f"{name}: value and tolerance must be numbers, got {entry!r}.") from None
    if not 0 < tolerance < math.inf:
        raise InputError(f"{name}: the tolerance must be a number above 0, got {tolerance}.")
    number = _rounded(value, tolerance)
    if getattr(entry, "ends", None) and math.isfinite(value):
        # To as many digits as the median, and at least two.
        size = max(abs(value), 10 * tolerance)
        low, high = (_rounded(end, tolerance * max(1, abs(end) / size)) for end in entry.ends)
        number += f" ({low}{' to ' if low[0] == '-' or high[0] == '-' else '–'}{high})"
    return number, tolerance, unit


def _rounded(value, tolerance):
    """Round `value` to the first digit of the tolerance; use powers of ten instead of many zeros."""
    if not math.isfinite(value):
        return str(value)
    last = _exponent(tolerance)
    value = round(value, -last) or 0.0  # no negative zero
    if not value or (last >= -5 and abs(value) < 1e7):
        decimals = min(max(-last, 0), 5)
        return f"{value:,.{decimals}f}" if abs(value) >= 1e4 else f"{value:.{decimals}f}"
    size = _exponent(value, 12)
    return f"{value / 10.0**size:.{size - last}f} × 10{str(size).translate(_SUPERSCRIPTS)}"


def _exponent(value, decimals=1):
    """Exponent of ten of `value` rounded to this number of decimals of its mantissa."""
    return int(f"{value:.{decimals}e}".partition("e")[2])
