"""The one table: aligned text on a terminal, HTML in notebooks and reports, Markdown in the book's pages.

`tabulate` writes all three. The rows of the HTML are written here: in its own, cells are as wide as their
column, so that one number that moves within its tolerance would change the text of the others.
"""

import html
from functools import partial
from itertools import zip_longest

from tabulate import TableFormat, tabulate

_SIDES = {"l": "left", "r": "right"}


class HTML(str):
    """The text of a cell that is HTML already, such as a link, and is not escaped."""


class Table:
    """Texts in rows and columns, to print or to end a notebook cell with.

    Parameters
    ----------
    header
        A text for each column; an empty one for a table without header.
    rows
        Sequences of cells, shown as `str` has them; the first names its row. In HTML all that is not `HTML`
        is escaped.
    align
        "l" (left) or "r" (right) for each column; "l" for those beyond. What is aligned right is a number,
        and no line of HTML breaks in it.
    note
        A line under the table.

    >>> Table(["method", "n"], [["PCA", 4], ["SDecGMCA", 5]], align="lr")
    method    n
    PCA       4
    SDecGMCA  5
    """

    def __init__(self, header, rows, *, align="", note=""):
        self.header, self.rows, self.note = list(header), [list(row) for row in rows], note
        self._align = [_SIDES[letter] for letter in align]

    def __repr__(self):
        return "\n".join(filter(None, [self._written("plain", str), self.note]))

    def html(self):
        """The table within a box of class "himap-table", which scrolls where the page is narrow."""
        note = f"<small>{_escaped(self.note)}</small>" if self.note else ""
        return f'<div class="himap-table"><table>\n{self._written(_FORMAT, _escaped)}\n</table>{note}</div>'

    _repr_html_ = html

    def markdown(self):
        """The lines of a table in a page, whose cells are Markdown; a bar in a cell stays one."""
        lines = self._written("pipe", lambda cell: str(cell).replace("|", r"\|")).splitlines()
        return [*lines, "", self.note] if self.note else lines

    def _written(self, style, text):
        head, *body = [[text(cell) for cell in row] for row in (self.header, *self.rows)]
        if style == "plain" and head:  # as a header it would make its columns wider than they need be
            head, body = [], [head, *body]
        sides = self._align if body else None  # tabulate 0.9 has none to give to a table without rows
        return tabulate(body, head, style, disable_numparse=True, colalign=sides)


def _escaped(cell):
    return cell if isinstance(cell, HTML) else html.escape(str(cell))


def _row(cells, widths, sides, head=False):
    """A row, as `tabulate` asks for it: the header with `head`, else with a first cell that heads it."""
    row = ""
    for n, (cell, side) in enumerate(zip_longest(cells, sides, fillvalue="left")):
        scope = "col" if head else "row" if n == 0 else ""
        tag, heads = ("th", f' scope="{scope}"') if scope else ("td", "")
        nowrap = "" if scope or side == "left" else "; white-space:nowrap"
        style = f"text-align:{side}; vertical-align:top{nowrap}"  # above a notebook's own
        row += f'<{tag}{heads} style="{style}">{cell.strip()}</{tag}>'
    return f"<thead><tr>{row}</tr></thead>" if head else f"<tr>{row}</tr>"


_FORMAT = TableFormat(
    lineabove=None,
    linebelowheader=None,
    linebetweenrows=None,
    linebelow=None,
    headerrow=partial(_row, head=True),
    datarow=_row,
    padding=0,
    with_header_hide=None,
)
