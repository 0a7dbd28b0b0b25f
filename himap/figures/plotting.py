"""Figures. Beside `himap.figures.marks` the only module that draws; every function returns its figure.

Figures carry their numbers (`himap.figures.data`): a notebook that shows one keeps them beside the picture.

Colours and lines are those of `himap.figures.styles`; maps use cividis, which is monotonic in lightness.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, MaxNLocator, NullLocator

from himap.figures import ratio_scale
from himap.figures.curve_names import legend_above_all
from himap.figures.data import with_curves, with_image, with_maps
from himap.maps import sphere

_TRUTH = {"label": "HI + noise", "color": "black", "linestyle": "-", "linewidth": 1.8}
_WIDTH = 9.2  # inches of a figure as wide as a page, where 10 points are as large as text
_PERCENTILES = (0, 5, 50, 95, 100)  # of a bundle of curves: what is kept of its numbers
_RC = {
    "figure.dpi": 150,
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def _mollweide(n_columns=720):
    """Longitude and latitude, deg, of a Mollweide image, Galactic centre in the middle, l to the left."""
    x, y = np.meshgrid(np.linspace(-2, 2, n_columns), np.linspace(-1, 1, n_columns // 2))
    with np.errstate(invalid="ignore"):
        theta = np.arcsin(y)
        lat = np.arcsin((2 * theta + np.sin(2 * theta)) / np.pi)
        lon = -np.pi * x / (2 * np.cos(theta))
    lon[np.abs(lon) > np.pi] = np.nan
    return np.rad2deg(lon), np.rad2deg(lat)


def sky_map(axes, pixels, *, title, unit, log=False, limits=None, span=None, diverging=False):
    """Draw one map (n_pix,) in Mollweide projection on `axes`; returns the image.

    Colours go from one percentile of the map to another, `limits`, (1, 99) unless given, or over `span`, in
    the unit of the map; `log` for logarithmic colours, `diverging` for those of errors: even about 0, which
    is white.
    """
    lon, lat = _mollweide()
    inside = np.isfinite(lon)
    image = np.full(lon.shape, np.nan)
    image[inside] = pixels[sphere.pixel_at(sphere.nside_of(pixels), lon[inside], lat[inside])]
    low, high = np.percentile(pixels, limits or (1, 99)) if span is None else span
    if diverging:
        high = max(abs(low), abs(high))
        low = -high
    norm = LogNorm(low, high) if log else Normalize(low, high)
    colours = "RdBu_r" if diverging else "cividis"
    shown = axes.imshow(image, origin="lower", extent=(-2, 2, -1, 1), norm=norm, cmap=colours)
    angle = np.linspace(0, 2 * np.pi, 400)
    axes.plot(2 * np.cos(angle), np.sin(angle), color="black", linewidth=0.8, clip_on=False)
    axes.set_axis_off()
    axes.set_title(f"{title} [{unit}]" if unit else title, fontsize=10)
    bar = axes.figure.colorbar(shown, ax=axes, location="bottom", shrink=0.7, pad=0.02, extend="both")
    if log:
        bar.locator = _locator(low, high)
        bar.formatter = LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf))  # labels all of them
    else:
        bar.locator = MaxNLocator(4)  # more would run into each other
    bar.minorticks_off()
    return shown


def _locator(low, high):
    """Where the ticks of a logarithmic bar stand, so that two or more fall on it."""
    if high < 3 * low:
        return MaxNLocator(4)
    many = (1,) if high > 100 * low else (1, 2, 5) if high > 5 * low else range(1, 10)
    return LogLocator(subs=many, numticks=6)


def sky_maps(maps, *, columns=2, unit="mK", log=False, limits=None, span=None, diverging=False):
    """A figure of several maps, {title: (n_pix,)}; each has its own colour bar.

    `unit`, `log`, `limits`, `span` and `diverging` as in `sky_map`, or dicts by title.
    """
    columns = min(columns, len(maps))
    rows = -(-len(maps) // columns)
    with plt.rc_context(_RC):
        figure, panels = plt.subplots(
            rows, columns, figsize=(4.6 * columns, 2.9 * rows), dpi=80, squeeze=False
        )
        for axes in panels.flat[len(maps) :]:
            axes.set_visible(False)
        for axes, (title, pixels) in zip(panels.flat, maps.items(), strict=False):
            options = {"unit": unit, "log": log, "limits": limits, "span": span, "diverging": diverging}
            chosen = {key: v.get(title) if isinstance(v, dict) else v for key, v in options.items()}
            sky_map(axes, pixels, title=title, **chosen)
    units = [unit.get(title) if isinstance(unit, dict) else unit for title in maps]
    return with_maps(_finished(figure), maps, [text or "" for text in units])


def spectrum(panels, *, band=0.1):
    """Spectra on logarithmic axes with their ratios below each, as in the paper's Figs. 1 and 2.

    Ratios are on the axis of `himap.figures.ratio_scale`, the same in all panels, and none is cut off.

    Parameters
    ----------
    panels
        A list of dicts: "title"; "xlabel", "ylabel", "ratio_label"; "true", a spectrum (x, y); "curves", a
        list of (style, x, recovered, true) with styles of `himap.figures.styles`, spectra (n,); optional
        "x_limits". Curves of one label are the same in all panels: where they are many, one legend stands
        above.
    band
        Half width of the grey band around 1.
    """
    one_scale = len({panel["ylabel"] for panel in panels}) == 1
    many_curves = max(len(panel["curves"]) for panel in panels) > 2
    limits = ratio_scale.limits_of(
        [ratio for panel in panels for *_, ratio in _ratios(panel)], least=2 * band
    )
    with plt.rc_context(_RC):
        figure, grid = plt.subplots(
            2,
            len(panels),
            figsize=(_WIDTH, 6.2),
            sharex="col",
            sharey="row" if one_scale else "none",
            squeeze=False,
        )
        for (top, bottom), panel in zip(grid.T, panels, strict=True):
            _spectrum_panel(top, bottom, panel, limits, band)
            if not many_curves:
                top.legend()
            if panel is panels[0] or not one_scale:
                top.set_ylabel(panel["ylabel"])
                bottom.set_ylabel(panel["ratio_label"])
        if many_curves:  # many curves leave no room inside the panels
            handles = grid[0, -1].get_legend_handles_labels()[0]
            rows = -(-len(handles) // 4)
            figure.legend(handles=handles, loc="outside upper center", ncols=-(-len(handles) // rows))
    points = []
    for panel in panels:
        points.append((panel["title"], _TRUTH["label"], *panel["true"]))
        for style, at, recovered, true in panel["curves"]:
            points.append((panel["title"], style["label"], at, recovered))
            if len(true) != len(panel["true"][1]) or not np.array_equal(true, panel["true"][1]):
                points.append((panel["title"], f"{style['label']}: truth", at, true))
    return with_curves(_finished(figure), points)


def _ratios(panel):
    """[(style, x, ratio)] of the curves of a panel of `spectrum`, where they are shown."""
    return [
        (style, x[_shown(panel, x)], (recovered / true)[_shown(panel, x)])
        for style, x, recovered, true in panel["curves"]
    ]


def _shown(panel, x):
    """Which of `x` a panel of `spectrum` shows."""
    low, high = panel.get("x_limits", (0, np.inf))
    return (x > 0) & (x >= low) & (x <= high)


def _spectrum_panel(top, bottom, panel, limits, band):
    """One spectrum and its ratio."""
    x, y = (values[_shown(panel, panel["true"][0])] for values in panel["true"])
    top.loglog(x, y, **_TRUTH)
    for style, at, recovered, _ in panel["curves"]:
        inside = _shown(panel, at)
        top.plot(at[inside], recovered[inside], **style)
    top.set_title(panel["title"])
    bottom.axhspan(1 - band, 1 + band, color="0.9", zorder=0)
    bottom.axhline(1, color="black", linewidth=0.8)
    for style, at, ratio in _ratios(panel):
        bottom.plot(at, ratio, **style)
    bottom.set(xlabel=panel["xlabel"], xscale="log")
    _ratio_axis(bottom, limits)
    _plain_ticks(bottom.xaxis, x)


def _plain_ticks(axis, values):
    """Ticks at 1, 2, 5 of each decade, or 1, 3 over more than a hundredfold, as plain numbers."""
    low, high = values[0], values[-1]
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.multiply.outer(decades, (1, 2, 5) if high < 200 * low else (1, 3)).ravel()
    axis.set_ticks(ticks[(ticks >= low) & (ticks <= high)], minor=False)
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")


def lines(panels, *, columns=2, size=(4.6, 3.4), legend_above=False):
    """A figure of line plots, one for each panel.

    Parameters
    ----------
    panels
        A list of dicts: "curves", a list of (x, y, style); optional "points", the same, drawn as
        markers, "bundles", a list of (x, ys, style) with ys (n_curves, n_x), each of them one curve of many
        that lie below the others, and "legend", its keywords; and anything `Axes.set` takes: title, xlabel,
        xscale, xlim... Of a bundle, the numbers that a figure carries are percentiles over its curves. A
        label that begins with "_" is not in the legend.
    legend_above
        Whether one legend of all panels stands above them; curves of one label are the same in all.
    """
    rows = -(-len(panels) // columns)
    with plt.rc_context(_RC):
        figure, grid = plt.subplots(rows, columns, figsize=(size[0] * columns, size[1] * rows), squeeze=False)
        for axes in grid.flat[len(panels) :]:
            axes.set_visible(False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            drawn = ("curves", "points", "bundles", "legend")
            settings = {key: value for key, value in panel.items() if key not in drawn}
            for bundle in panel.get("bundles", []):
                _draw_bundle(axes, *bundle)
            for x, y, style in panel["curves"]:
                axes.plot(x, y, **style)
            for x, y, style in panel.get("points", []):
                axes.plot(x, y, **({"linestyle": "none", "marker": "o", "markersize": 4} | style))
            axes.set(**settings)
            low, high = axes.get_xlim()
            # Powers of ten alone would be too few.
            if axes.get_xscale() == "log" and high < 200 * low and "xticks" not in panel:
                _plain_ticks(axes.xaxis, (low, high))
            if axes.get_legend_handles_labels()[1] and not legend_above:
                axes.legend(**({"fontsize": 8.5} | panel.get("legend", {})))
        if legend_above:
            legend_above_all(figure)
    points = [
        (panel.get("title", ""), style.get("label", "").removeprefix("_"), x, y)
        for panel in panels
        for x, y, style in [*panel["curves"], *panel.get("points", []), *_percentiles(panel)]
    ]
    return with_curves(_finished(figure), points)


def ratios(panels, *, columns=3, size=(3.1, 2.9)):
    """A figure of ratios to the truth with the range over skies, on the axis of `himap.figures.ratio_scale`.

    Parameters
    ----------
    panels
        A list of dicts: "curves", a list of (x, mean, low, high, style), arrays (n,); and anything
        `Axes.set` takes. Curves of one label are the same in all panels; one legend stands above.
    columns, size
        Of panels, which share the axis of ratios.
    """
    rows = -(-len(panels) // columns)
    drawn = [one for panel in panels for _, *curves, _ in panel["curves"] for one in curves]
    limits = ratio_scale.limits_of(drawn)
    with plt.rc_context(_RC):
        figure, grid = plt.subplots(
            rows, columns, figsize=(size[0] * columns, 0.5 + size[1] * rows), sharey=True, squeeze=False
        )
        for axes in grid.flat[len(panels) :]:
            axes.set_visible(False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            axes.axhspan(0.9, 1.1, color="0.93", zorder=0)
            axes.axhline(1, color="black", linewidth=0.8)
            for x, mean, low, high, style in panel["curves"]:
                axes.fill_between(x, low, high, color=style["color"], alpha=0.18, linewidth=0)
                axes.plot(x, mean, **style)
            axes.set(xscale="log", **{key: value for key, value in panel.items() if key != "curves"})
            _plain_ticks(axes.xaxis, axes.get_xlim())
            _ratio_axis(axes, limits)
        legend_above_all(figure)
    points = [
        (panel.get("title", ""), f"{style['label']}, {name}", x, y)
        for panel in panels
        for x, mean, low, high, style in panel["curves"]
        for name, y in (("mean", mean), ("low", low), ("high", high))
    ]
    return with_curves(_finished(figure), points)


def _ratio_axis(axes, limits):
    """Make the y axis one of ratios."""
    axes.set_yscale("function", functions=(ratio_scale.forward, ratio_scale.backward))
    axes.set_ylim(limits)
    axes.yaxis.set_ticks(ratio_scale.ticks(*limits), minor=False)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())


def _draw_bundle(axes, x, ys, style):
    """Curves as one picture, so that thousands weigh no more than a few; the legend has one, not faint."""
    points = np.stack([np.broadcast_to(x, np.shape(ys)), ys], axis=-1)
    look = {key: value for key, value in style.items() if key != "label"}
    axes.add_collection(LineCollection(points, rasterized=True, zorder=1.5, **look))
    axes.plot([], [], **style | {"alpha": 1, "linewidth": 1})


def _percentiles(panel):
    """(x, y, style) of percentiles over the curves of each bundle."""
    return [
        (x, values, {"label": f"{style.get('label', '')}: {percent} %"})
        for x, ys, style in panel.get("bundles", [])
        if len(ys)
        for percent, values in zip(_PERCENTILES, np.percentile(ys, _PERCENTILES, axis=0), strict=True)
    ]


def image(values, *, x, y, xlabel, ylabel, unit, title="", limits=(1, 99)):
    """A picture of `values` (n_y, n_x) over ascending, evenly spaced `x` and `y`."""
    with plt.rc_context(_RC | {"axes.grid": False}):
        figure, axes = plt.subplots(figsize=(_WIDTH, 3.2), dpi=90)  # a picture of its own, heavy when fine
        low, high = np.percentile(values, limits)
        extent = (x[0], x[-1], y[0], y[-1])
        shown = axes.imshow(
            values, origin="lower", aspect="auto", extent=extent, vmin=low, vmax=high, cmap="cividis"
        )
        axes.set(xlabel=xlabel, ylabel=ylabel, title=title)
        figure.colorbar(shown, label=unit, extend="both")
    return with_image(_finished(figure), values, x=x, y=y, unit=unit)


def _finished(figure):
    """The figure, out of pyplot's hands: a notebook shows it once, where it is returned."""
    plt.close(figure)
    return figure


def stamp(figure, provenance):
    """Write where the figure comes from under it, in small print; returns the figure."""
    size = np.clip(0.8 * figure.get_figwidth(), 6, 9)  # wide figures are shown scaled down
    figure.supxlabel(str(provenance), fontsize=size, color="0.35")
    return figure


def save(figure, path, *, dpi=150):
    """Write `figure` as a file, format by its ending."""
    figure.savefig(path, dpi=dpi)
