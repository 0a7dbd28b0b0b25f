"""Settings, axes, ticks and labels that all figures share.

The axis of ratios is linear near 1, so that 5 % is visible, and logarithmic far from it: a ratio r is drawn
at asinh(ln(r) / w), w = `NEAR`. This is linear in r - 1 where that is smaller than w, and the logarithm of
the logarithm beyond, so a factor of ten million still fits. A ratio and its inverse are equally far from 1.
"""

import functools

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import NullLocator

NEAR = 0.1
"""Relative distance from 1 within which the axis of ratios is linear."""

PICTURES = {"figure.dpi": 110, "font.size": 10, "figure.constrained_layout.use": True}
"""Matplotlib settings for pictures."""

CURVES = PICTURES | {
    "figure.dpi": 150,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}
"""Matplotlib settings for curves."""

_GAP = 0.075  # between labels at the ends of curves, in units of the height of the axes
_LEAST = 1e-4  # smaller ratios are drawn at this value
_RATIOS = (1, 10, 0.1, 1.1, 0.9, 1.2, 0.8, 2, 0.5, 100, 0.01, 1e4, 1e6, 1.5, 1e3, 0.3, 5, 1e8, 0.95, 1.05)
_DECADE = (1, 2, 5, 3, 7, 1.5, 1.2, 8, 1.1, 9, 4, 6)  # the best first


def drawn(settings):
    """Decorate functions that draw a figure: use these settings, then close the figure in pyplot.

    So a notebook shows it once, when it is returned.
    """

    def decorate(function):
        @functools.wraps(function)
        def draw(*args, **kwargs):
            with plt.rc_context(settings):
                figure = function(*args, **kwargs)
            plt.close(figure)
            return figure

        return draw

    return decorate


def subplots(n, columns, size, *, room=0, **options):
    """A figure with `n` panels of this size, inches, in `columns`, with `room` above; and their axes."""
    rows = -(-n // columns)
    figsize = (size[0] * columns, room + size[1] * rows)
    figure, grid = plt.subplots(rows, columns, figsize=figsize, squeeze=False, **options)
    for axes in grid.flat[n:]:
        axes.set_visible(False)
    return figure, grid.flat[:n]


def forward(ratio):
    """Positions of ratios on their axis."""
    return np.arcsinh(np.log(np.maximum(ratio, _LEAST)) / NEAR)


def backward(place):
    """Ratios at positions on their axis."""
    return np.exp(NEAR * np.sinh(place))


def ratio_limits(ratios, least=0.2):
    """Limits (low, high) of an axis that shows all `ratios`, and `least` on either side of 1."""
    values = np.concatenate([[1.0], *map(np.ravel, ratios)])
    values = values[np.isfinite(values)]
    low, high = forward(np.min(values)), forward(np.max(values))
    room = 0.02 * (high - low)
    return min(1 - least, float(backward(low - room))), max(1 + least, float(backward(high + room)))


def set_ratio_axis(axes, limits):
    """Make the y axis one of ratios."""
    axes.set_yscale("function", functions=(forward, backward))
    axes.set_ylim(limits)
    axes.yaxis.set_ticks(ratio_ticks(*limits), minor=False)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())


def ratio_ticks(low, high):
    """Ratios to label on an axis from `low` to `high`, as many as fit, ascending."""
    return _apart(_RATIOS, low, high, forward, 0.06)


def decade_ticks(low, high):
    """Numbers to label on a logarithmic axis, powers of ten first, as many as fit, ascending."""
    return _apart(np.multiply.outer(_DECADE, _decades(low, high)).ravel(), low, high, np.log, 0.17)


def _apart(wanted, low, high, scale, share):
    """Those of `wanted`, in order of priority, that are separated by a share of the axis."""
    kept, room = [], share * (scale(high) - scale(low))
    for tick in wanted:
        if low <= tick <= high and all(abs(scale(tick) - scale(other)) >= room for other in kept):
            kept.append(tick)
    return sorted(kept)


def _decades(low, high):
    return 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)


def set_plain_ticks(axis, low, high):
    """Ticks at 1, 2, 5 of each decade, or 1, 3 over more than a factor of 100, as plain numbers."""
    ticks = np.multiply.outer(_decades(low, high), (1, 2, 5) if high < 200 * low else (1, 3)).ravel()
    axis.set_ticks(ticks[(ticks >= low) & (ticks <= high)], minor=False)
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")


def legend_above_all(figure):
    """One legend of the curves of all panels, above them."""
    handles = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if handles:
        rows = -(-len(handles) // 4)
        columns = -(-len(handles) // rows)
        figure.legend(handles=list(handles.values()), loc="outside upper center", ncols=columns)


def label_ends(axes):
    """Write the label of every line of `axes` at its right end, instead of a legend.

    Labels that would overlap are moved apart, with a thin line from each to its curve. A leading "_", which
    keeps a label out of the legend, is not written.
    """
    lines = sorted(axes.get_lines(), key=lambda line: line.get_ydata()[-1])
    to_axes = axes.transData + axes.transAxes.inverted()
    ends = [to_axes.transform((line.get_xdata()[-1], line.get_ydata()[-1])) for line in lines]
    places = [y for _, y in ends]
    for n in range(1, len(places)):  # up, and then down again
        places[n] = max(places[n], places[n - 1] + _GAP)
    top = 1.0
    for n in reversed(range(len(places))):
        places[n] = min(places[n], top)
        top = places[n] - _GAP
    for line, (x, y), place in zip(lines, ends, places, strict=True):
        axes.annotate(
            line.get_label().removeprefix("_"),
            (x, y),
            (1.08, place),
            xycoords="axes fraction",
            textcoords="axes fraction",
            va="center",
            fontsize=8,
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.6, "relpos": (0, 0.5)},
        )
