"""The table format: aligned text on a terminal, HTML in notebooks and reports, Markdown in the book.

`tabulate` writes text and Markdown. Its HTML pads cells to the width of their column, so a number that
changes within its tolerance would change the text of the others.
"""

import html
from itertools import chain, repeat

from tabulate import tabulate

_SIDES = {"l": "left", "r": "right"}


class HTML(str):
    """The text of a cell that is HTML already, such as a link, and is not escaped."""


class Table:
    """Texts in rows and columns, to print or for the end of a notebook cell, with a note, a line below.

    The header has a text for each column, or none. Rows are sequences of cells, shown as `str` has them; the
    first names its row; in HTML everything except `HTML` is escaped. Columns are aligned by the letters of
    `align`, "l" (left) or "r" (right), further ones left. Right-aligned cells are numbers, in which HTML does
    not break lines.

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
        """The table in a box of class "himap-table", which scrolls if the page is narrow."""
        note = f"<small>{_escaped(self.note)}</small>" if self.note else ""
        rows = [_row(cells, self._align) for cells in self.rows]
        if self.header:
            rows.insert(0, f"<thead>{_row(self.header, self._align if rows else (), 'col')}</thead>")
        lines = "\n".join(rows)
        return f'<div class="himap-table"><table>\n{lines}\n</table>{note}</div>'

    _repr_html_ = html

    def markdown(self):
        """The lines of a table in a page, whose cells are Markdown; bars in cells are escaped."""
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


def _row(cells, sides, scope="row"):
    """A row of HTML whose first cell heads it, or of the header, whose cells head a "col" each."""
    row = ""
    for cell, side in zip(cells, chain(sides, repeat("left")), strict=False):
        tag, heads = ("th", f' scope="{scope}"') if scope else ("td", "")
        nowrap = "" if scope or side == "left" else "; white-space:nowrap"
        style = f"text-align:{side}; vertical-align:top{nowrap}"  # above a notebook's own
        row += f'<{tag}{heads} style="{style}">{_escaped(cell).strip()}</{tag}>'
        scope = "" if scope == "row" else scope
    return f"<tr>{row}</tr>"
