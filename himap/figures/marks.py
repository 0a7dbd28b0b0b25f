"""Marks: a table of signs for the eye to find patterns in."""

import matplotlib.pyplot as plt
from matplotlib.patches import Rectangle

from himap.figures.data import with_curves

_CELL = (0.36, 0.2)  # width and height, inches
_SIDES = (3.1, 2.1)  # what the names of rows and columns take


def marks(groups, columns, looks, *, breaks=()):
    """A figure of marks, names of rows at the left and of columns above.

    Parameters
    ----------
    groups
        {name of a group: {row: [marks of a column, for each column]}}. Marks of a cell are a list, such as
        one for each realisation: a cell whose marks are not all the same is divided; an empty one stays
        empty.
    columns
        Their names.
    looks
        {mark: (sign, colour, colour of the sign)}, in the order of the legend.
    breaks
        Numbers of columns before which there is a line.

    Returns
    -------
    matplotlib.figure.Figure
        It carries, for each row and column, the number of each mark in `looks`, from 0.
    """
    n_rows = sum(len(rows) + 1 for rows in groups.values())
    size = (_SIDES[0] + _CELL[0] * len(columns), _SIDES[1] + _CELL[1] * n_rows)
    with plt.rc_context({"figure.dpi": 110, "figure.constrained_layout.use": True}):
        figure, axes = plt.subplots(figsize=size)
        names, place, points = {}, 0, []
        for group, rows in groups.items():
            axes.text(-0.1, place + 0.55, group, ha="right", va="center", fontsize=8.5, weight="bold")
            place += 1
            for row, cells in rows.items():
                names[place + 0.5] = row
                for n, cell in enumerate(cells):
                    _draw(axes, n, place, cell, looks)
                    points.append((row, columns[n], range(len(cell)), [list(looks).index(x) for x in cell]))
                place += 1
        for n in breaks:
            axes.axvline(n, color="black", linewidth=1.2)
        _finish(axes, names, columns, place)
        handles = [
            Rectangle((0, 0), 1, 1, facecolor=colour, edgecolor="0.6", label=f"{sign} {mark}")
            for mark, (sign, colour, _) in looks.items()
        ]
        beside = {"loc": "lower right", "bbox_to_anchor": (-0.02, 1.02)}  # the names of the columns
        axes.legend(handles=handles, frameon=False, fontsize=9, **beside)
    plt.close(figure)
    return with_curves(figure, points)


def _draw(axes, column, row, cell, looks):
    """One cell; a mark for all of them where they are the same, else one beside the other."""
    shown = cell[:1] if len(set(cell)) == 1 else cell
    for n, mark in enumerate(shown):
        sign, colour, ink = looks[mark]
        width = 1 / len(shown)
        corner = (column + n * width, row)
        axes.add_patch(Rectangle(corner, width, 1, facecolor=colour, edgecolor="white", linewidth=0.6))
        middle = (column + (n + 0.5) * width, row + 0.52)
        axes.text(*middle, sign, color=ink, ha="center", va="center", fontsize=8)


def _finish(axes, names, columns, n_rows):
    axes.set(xlim=(0, len(columns)), ylim=(n_rows, 0))
    axes.set_yticks(list(names), labels=list(names.values()), fontsize=7.5)
    axes.xaxis.tick_top()
    axes.set_xticks([n + 0.5 for n in range(len(columns))])
    axes.set_xticklabels(columns, rotation=60, ha="left", rotation_mode="anchor", fontsize=8)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
