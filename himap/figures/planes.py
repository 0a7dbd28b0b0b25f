"""Figures of images in their projection, of power over two wavenumbers, and of marks in a table.

Colours of images are those of cividis, which is monotonic in lightness.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator, NullLocator

from himap.figures.axes import PICTURES, decade_ticks, drawn, subplots
from himap.figures.data import with_curves, with_image
from himap.figures.plotting import show_map

_NAMES = {"RA": "RA", "DEC": "Dec", "GLON": "Galactic longitude", "GLAT": "Galactic latitude"}
_BLANK = "0.85"  # grey for missing values
_PERCENTILES = (2, 98)
_CELL = (0.36, 0.2)  # width and height of a mark, inches
_SIDES = (3.1, 2.1)  # inches for the names of rows and columns


@drawn(PICTURES)
def sky_images(maps, celestial, *, span):
    """A figure of images in their projection, with grid lines of their coordinates.

    `maps` are {title: (n_y, n_x)}, mK, NaN where there is no value; `celestial` is the `astropy.wcs.WCS` of
    the two axes, and `span` the range of the colours, {title: (low, high)}.
    """
    figure = plt.figure(figsize=(4.6 * len(maps), 4.4))
    for n, (title, pixels) in enumerate(maps.items(), start=1):
        axes = figure.add_subplot(1, len(maps), n, projection=celestial)
        axes.set_facecolor(_BLANK)
        bar = show_map(axes, pixels, title, "mK", span[title], shrink=0.8, interpolation="nearest")
        bar.locator = MaxNLocator(4)
        axes.coords.grid(color="white", alpha=0.35, linestyle=":")
        for coordinate, ctype in zip(axes.coords, celestial.wcs.ctype, strict=True):
            name = ctype.split("-")[0]
            coordinate.set_axislabel(_NAMES.get(name, name))
            coordinate.set_ticklabel(size=8.5, exclude_overlapping=True)
    values = np.stack(list(maps.values()))
    x, y = (np.arange(n) for n in values.shape[:0:-1])
    return with_image(figure, values, x=x, y=y, unit=["mK"] * len(maps))


@drawn(PICTURES)
def power_planes(planes, *, x, y, xlabel, ylabel, unit, ratio=None):
    """A figure of power by two wavenumbers on logarithmic axes, and of a ratio.

    `planes` are {title: (n_y, n_x)}, positive, in `unit`, NaN where there is no value, all on one colour
    scale; `x` and `y` are the edges of the cells, one more than cells. `ratio` is (title, (n_y, n_x)); its
    colours extend as far above 1 as below.
    """
    values = np.concatenate([plane[plane > 0] for plane in planes.values()])
    low, high = np.percentile(values, _PERCENTILES) if len(values) else (1, 10)
    norm = LogNorm(low, max(high, 1.01 * low))
    drawings = [(title, plane, norm, unit) for title, plane in planes.items()]
    if ratio is not None:
        distances = np.abs(np.log(ratio[1][ratio[1] > 0]))
        far = np.exp(np.percentile(distances, _PERCENTILES[1])) if len(distances) else 1
        far = float(np.clip(far, 1.1, 100))  # includes nearly all ratios
        drawings.append((*ratio, LogNorm(1 / far, far), "ratio"))
    size = (max(4.2, 3.4 * len(drawings)) / len(drawings), 3.9)
    figure, grid = subplots(len(drawings), len(drawings), size, sharey=True)
    for axes, (title, plane, colours, text) in zip(grid, drawings, strict=True):
        axes.set_facecolor(_BLANK)
        shown = axes.pcolormesh(x, y, np.ma.masked_invalid(plane), norm=colours, cmap="cividis")
        axes.set(xscale="log", yscale="log", xlabel=xlabel, title=title)
        bar = figure.colorbar(shown, ax=axes, location="bottom", label=text, extend="both")
        spans = ((axes.xaxis, x), (axes.yaxis, y), (bar.ax.xaxis, (colours.vmin, colours.vmax)))
        for axis, ends in spans:
            axis.set_ticks(decade_ticks(ends[0], ends[-1]))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_locator(NullLocator())
    grid[0].set_ylabel(ylabel)
    _, stacked, _, units = zip(*drawings, strict=True)
    return with_image(figure, np.stack(stacked), x=x, y=y, unit=list(units))


@drawn(PICTURES)
def marks(groups, columns, looks, *, breaks=()):
    """A figure of a table of signs, with names of rows on the left and names of columns above.

    It contains, for each row and column, the number of each mark in `looks`, counted from 0.

    Parameters
    ----------
    groups
        {name of a group: {row: [marks of a column, for each column]}}. Marks of a cell are a list, for
        example one for each realisation: a cell with different marks is divided; one without marks stays
        empty.
    looks
        {mark: (sign, colour, colour of the sign)}, in the order of the legend.
    breaks
        Indices of columns before which a line is drawn.
    """
    n_rows = sum(len(rows) + 1 for rows in groups.values())
    size = (_SIDES[0] + _CELL[0] * len(columns), _SIDES[1] + _CELL[1] * n_rows)
    figure, axes = plt.subplots(figsize=size)
    names, place, points = {}, 0, []
    for group, rows in groups.items():
        axes.text(-0.1, place + 0.55, group, ha="right", va="center", fontsize=8.5, weight="bold")
        place += 1
        for row, cells in rows.items():
            names[place + 0.5] = row
            for n, cell in enumerate(cells):
                shown = cell[:1] if len(set(cell)) == 1 else cell
                for part, mark in enumerate(shown):
                    sign, colour, ink = looks[mark]
                    left, width = n + part / len(shown), 1 / len(shown)
                    box = {"facecolor": colour, "edgecolor": "white", "linewidth": 0.6}
                    axes.add_patch(Rectangle((left, place), width, 1, **box))
                    middle = left + width / 2, place + 0.52
                    axes.text(*middle, sign, color=ink, ha="center", va="center", fontsize=8)
                points.append((row, columns[n], range(len(cell)), [list(looks).index(x) for x in cell]))
            place += 1
    for n in breaks:
        axes.axvline(n, color="black", linewidth=1.2)
    axes.set(xlim=(0, len(columns)), ylim=(place, 0))
    axes.set_yticks(list(names), labels=list(names.values()), fontsize=7.5)
    axes.xaxis.tick_top()
    axes.set_xticks(np.arange(len(columns)) + 0.5)
    axes.set_xticklabels(columns, rotation=60, ha="left", rotation_mode="anchor", fontsize=8)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    handles = [
        Rectangle((0, 0), 1, 1, facecolor=colour, edgecolor="0.6", label=f"{sign} {mark}")
        for mark, (sign, colour, _) in looks.items()
    ]
    corner = {"loc": "lower right", "bbox_to_anchor": (-0.02, 1.02)}  # left of the names of the columns
    axes.legend(handles=handles, frameon=False, fontsize=9, **corner)
    return with_curves(figure, points)
