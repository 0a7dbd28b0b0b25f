"""What names the curves of a figure: one legend above all its panels, or labels at their ends."""


def legend_above_all(figure):
    """One legend of the curves of all panels, above them."""
    handles = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if handles:
        figure.legend(handles=list(handles.values()), loc="outside upper center", ncols=min(4, len(handles)))


def label_ends(axes, *, gap=0.075):
    """Write the label of every line of `axes` beside its right end, instead of a legend.

    Labels that would lie on each other move apart, by `gap` of the height of the axes or more, and a thin
    line leads from each to its curve. A "_" before a label is not written.
    """
    lines = sorted(axes.get_lines(), key=lambda line: line.get_ydata()[-1])
    to_axes = axes.transData + axes.transAxes.inverted()
    ends = [to_axes.transform((line.get_xdata()[-1], line.get_ydata()[-1])) for line in lines]
    for line, (x, y), place in zip(lines, ends, _apart([y for _, y in ends], gap), strict=True):
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


def _apart(heights, gap):
    """Ascending `heights` moved up and then down, until neighbours are `gap` apart and none is above 1."""
    places = list(heights)
    for n in range(1, len(places)):
        places[n] = max(places[n], places[n - 1] + gap)
    top = 1.0
    for n in reversed(range(len(places))):
        places[n] = min(places[n], top)
        top = places[n] - gap
    return places
