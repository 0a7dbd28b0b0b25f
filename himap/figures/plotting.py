"""Figures of curves and maps; every function returns its figure.

Figures include their numbers (`himap.figures.data`), so a notebook stores them with the picture.

Colours and lines are those of `himap.figures.styles`; maps use cividis, which is monotonic in lightness.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, MaxNLocator

from himap.figures.axes import (
    CURVES,
    drawn,
    legend_above_all,
    ratio_limits,
    set_plain_ticks,
    set_ratio_axis,
    subplots,
)
from himap.figures.data import panel_names, with_curves, with_image, with_maps
from himap.figures.styles import AXES
from himap.maps import sphere

_TRUTH = {"label": "HI + noise", "color": "black", "linestyle": "-", "linewidth": 1.8}
_WIDTH = 9.2  # inches: full page width, at which 10 points match the text
_BAND = 0.1  # half width of the grey band around a ratio of 1
_BANDS = (16, 50, 84)  # percentiles drawn for an ensemble
_PERCENTILES = (0, 5, 50, 95, 100)  # percentiles stored for a bundle of curves
_N_ROWS = 160  # number of rows of a picture of a part of the sky


def mollweide(n_columns=720):
    """Longitude and latitude, deg, of a Mollweide image, Galactic centre in the middle, l to the left."""
    x, y = np.meshgrid(np.linspace(-2, 2, n_columns), np.linspace(-1, 1, n_columns // 2))
    with np.errstate(invalid="ignore"):
        theta = np.arcsin(y)
        lat = np.arcsin((2 * theta + np.sin(2 * theta)) / np.pi)
        lon = -np.pi * x / (2 * np.cos(theta))
    lon[np.abs(lon) > np.pi] = np.nan
    return np.rad2deg(lon), np.rad2deg(lat)


@drawn(CURVES | {"axes.grid": False})
def sky_maps(maps, *, box=None, columns=2, unit="mK", log=False, limits=None, span=None, diverging=False):
    """A figure of maps, {title: (n_pix,)}; each has a colour bar.

    Parameters
    ----------
    maps
        Galactic, RING; NaN where there is no value.
    box
        The part to show: (lowest, highest) right ascension and (lowest, highest) declination, deg; the former
        may be negative, or more than 360. None for the full sky, in Mollweide projection.
    columns
        Number of columns of maps.
    unit, log, limits, span, diverging
        One value for all maps, or {title: value}. Colours range between two percentiles of the map, `limits`,
        default (1, 99), or over `span`, in the unit of the map; `log` for logarithmic colours, `diverging`
        for errors: linear about 0, which is white.
    """
    options = {"unit": unit, "log": log, "limits": limits, "span": span, "diverging": diverging}
    chosen = [
        {key: each.get(title) if isinstance(each, dict) else each for key, each in options.items()}
        for title in maps
    ]
    if box is None:
        view, room, dpi = (*mollweide(), {"extent": (-2, 2, -1, 1), "pad": 0.02}), 0.6, 80
    else:
        from astropy.coordinates import SkyCoord  # slow, and most figures do not need it

        (left, right), (low, high) = box
        aspect = 1 / np.cos(np.deg2rad((low + high) / 2))  # a degree of declination over one of RA
        n_columns = int(_N_ROWS * (right - left) / aspect / (high - low))
        x, y = (np.arange(n) + 0.5 for n in (n_columns, _N_ROWS))
        ra, dec = np.meshgrid(right - (right - left) * x / n_columns, low + (high - low) * y / _N_ROWS)
        places = SkyCoord(np.mod(ra, 360), dec, unit="deg").galactic
        frame = {"extent": (right, left, low, high), "aspect": aspect, "pad": 0.03}
        view, room, dpi = (places.l.deg, places.b.deg, frame), 1.2, 100
    height = room + 4.6 * view[0].shape[0] / view[0].shape[1]
    figure, grid = subplots(len(maps), min(columns, len(maps)), (4.6, height), dpi=dpi)
    for axes, (title, pixels), look in zip(grid, maps.items(), chosen, strict=True):
        _draw_sky(axes, pixels, title, view, **look)
        if box is None:
            angle = np.linspace(0, 2 * np.pi, 400)
            axes.plot(2 * np.cos(angle), np.sin(angle), color="black", linewidth=0.8, clip_on=False)
            axes.set_axis_off()
        else:
            axes.set(xlabel="right ascension [deg]", ylabel="declination [deg]")
            axes.xaxis.set_major_formatter(lambda x, _: f"{x % 360:g}")
    return with_maps(figure, maps, [look["unit"] or "" for look in chosen])


def _draw_sky(axes, pixels, title, view, *, unit, log, limits, span, diverging):
    lon, lat, frame = view
    inside = np.isfinite(lon)
    image = np.full(lon.shape, np.nan)
    image[inside] = pixels[sphere.pixel_at(sphere.nside_of(pixels), lon[inside], lat[inside])]
    low, high = np.nanpercentile(pixels, limits or (1, 99)) if span is None else span
    bar = show_map(axes, image, title, unit, (low, high), log=log, diverging=diverging, **frame)
    bar.locator = MaxNLocator(4)  # more would overlap
    if log:
        if high >= 3 * low:  # two or more ticks are on the bar
            many = (1,) if high > 100 * low else (1, 2, 5) if high > 5 * low else range(1, 10)
            bar.locator = LogLocator(subs=many, numticks=6)
        bar.formatter = LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf))  # labels all ticks
    bar.minorticks_off()


def show_map(axes, image, title, unit, span, *, log=False, diverging=False, pad=None, shrink=0.7, **options):
    """Draw an image with colours over a `span`, with a title and a colour bar below; return the bar."""
    far = max(map(abs, span))
    norm = LogNorm(*span) if log else Normalize(-far, far) if diverging else Normalize(*span)
    colours = "RdBu_r" if diverging else "cividis"
    shown = axes.imshow(image, origin="lower", norm=norm, cmap=colours, **options)
    axes.set_title(f"{title} [{unit}]" if unit else title, fontsize=10)
    room = {"shrink": shrink} if pad is None else {"shrink": shrink, "pad": pad}
    return axes.figure.colorbar(shown, ax=axes, location="bottom", extend="both", **room)


@drawn(CURVES)
def spectrum(panels):
    """Spectra on logarithmic axes with their ratios below each, as in the paper's Figs. 1 and 2.

    Ratios use the axis of `himap.figures.axes`, the same in all panels, and none is cut off.

    Parameters
    ----------
    panels
        A list of dicts: "title"; "xlabel", "ylabel", "ratio_label"; "true", a spectrum (x, y); "curves", a
        list of (style, x, recovered, true) with styles of `himap.figures.styles` and spectra (n,), or
        (n_members, n) for an ensemble, drawn as in `lines`. Curves with one label are the same in all
        panels; if there are many panels or curves, one legend is above all.
    """
    one_scale = len({panel["ylabel"] for panel in panels}) == 1
    many = len(panels) > 2 or max(len(panel["curves"]) for panel in panels) > 2
    share = {"sharex": "col", "sharey": "row" if one_scale else "none"}
    figure, grid = plt.subplots(2, len(panels), figsize=(_WIDTH, 6.2), squeeze=False, **share)
    points, drawn_ratios = [], []
    for (top, bottom), name, panel in zip(grid.T, panel_names(panels), panels, strict=True):
        x, y = (values[panel["true"][0] > 0] for values in panel["true"])
        top.loglog(x, y, **_TRUTH)
        _mark_one(bottom, "0.9")
        points.append((name, _TRUTH["label"], *panel["true"]))
        for style, at, recovered, true in panel["curves"]:
            points += _points(name, at, recovered, style)
            if not np.array_equal(np.atleast_2d(true)[0], panel["true"][1]):
                points += _points(name, at, true, style | {"label": f"{style['label']}: truth"})
            drawn_ratios.append((recovered / true)[..., at > 0])
            _draw_curve(top, at[at > 0], recovered[..., at > 0], style)
            _draw_curve(bottom, at[at > 0], drawn_ratios[-1], style)
        top.set_title(panel["title"])
        bottom.set(xlabel=panel["xlabel"], xscale="log")
        set_plain_ticks(bottom.xaxis, x[0], x[-1])
        if not many:
            top.legend()
        if panel is panels[0] or not one_scale:
            top.set_ylabel(panel["ylabel"])
            bottom.set_ylabel(panel["ratio_label"])
    limits = ratio_limits(drawn_ratios, least=2 * _BAND)
    for bottom in grid[1]:
        set_ratio_axis(bottom, limits)
    if many:  # no room inside the panels
        legend_above_all(figure)
    return with_curves(figure, points)


def _mark_one(axes, grey):
    """Draw a grey band and a line at a ratio of 1."""
    axes.axhspan(1 - _BAND, 1 + _BAND, color=grey, zorder=0)
    axes.axhline(1, color="black", linewidth=0.8)


def comparison_panel(kind, curves, *, title="", true=None):
    """A panel of `spectrum` for cleaned cubes and the truth; `kind` is "angular" or "frequency".

    The curves are [(style, `Comparison`)], or [(style, [`Comparison`, ...])] for ensembles. The truth is that
    of the `Comparison` `true`, by default of the first curve.
    """
    x, shown = {"angular": "degrees", "frequency": "k"}[kind], []
    truth = np.ravel(curves[0][1])[0] if true is None else true
    for style, members in curves:
        members = np.ravel(members)
        at = min((getattr(one, x) for one in members), key=len)  # masks differ, and so do bins of l
        spectra = [
            np.array([np.interp(at, getattr(one, x), getattr(one, y)) for one in members])
            for y in (kind, f"true_{kind}")
        ]
        shown.append((style, at, *(one[0] if len(members) == 1 else one for one in spectra)))
    true = getattr(truth, x), getattr(truth, f"true_{kind}")
    return AXES[kind] | {"title": title, "true": true, "curves": shown}


@drawn(CURVES)
def lines(panels, *, columns=2, size=(4.6, 3.4), legend_above=False):
    """A figure of line plots, one for each panel.

    Parameters
    ----------
    panels
        A list of dicts: "curves", a list of (x, y, style), where y (n_members, n) is an ensemble, drawn as
        median and 16 to 84 % band, with thin lines for members; optional "points", a list of (x, y, style)
        with y (n,), drawn as markers; "bundles", a list of (x, ys, style) with ys (n_curves, n_x), many
        curves drawn below the others; "legend", its keywords; and anything that `Axes.set` accepts: title,
        xlabel, xscale, xlim... For a bundle, the figure stores percentiles over its curves. A label that
        begins with "_" is not in the legend.
    columns, size
        Number of columns, and size of a panel, inches.
    legend_above
        Whether all panels share one legend above them; curves with one label are the same in all.
    """
    figure, grid = subplots(len(panels), columns, size)
    points = []
    for axes, name, panel in zip(grid, panel_names(panels), panels, strict=True):
        curves, markers, bundles = (panel.get(key, []) for key in ("curves", "points", "bundles"))
        for x, ys, style in bundles:  # rasterised: thousands of curves need no more space than a few
            pairs = np.stack([np.broadcast_to(x, np.shape(ys)), ys], axis=-1)
            look = {key: value for key, value in style.items() if key != "label"}
            axes.add_collection(LineCollection(pairs, rasterized=True, zorder=1.5, **look))
            axes.plot([], [], **style | {"alpha": 1, "linewidth": 1})  # for the legend, not faint
        for x, y, style in curves:
            _draw_curve(axes, x, y, style)
        for x, y, style in markers:
            axes.plot(x, y, **({"linestyle": "none", "marker": "o", "markersize": 4} | style))
        drawn_already = ("curves", "points", "bundles", "legend")
        axes.set(**{key: value for key, value in panel.items() if key not in drawn_already})
        low, high = axes.get_xlim()
        # Powers of ten only would be too few.
        if axes.get_xscale() == "log" and high < 200 * low and "xticks" not in panel:
            set_plain_ticks(axes.xaxis, low, high)
        if axes.get_legend_handles_labels()[1] and not legend_above:
            axes.legend(**({"fontsize": 8.5} | panel.get("legend", {})))
        for x, y, style in [*curves, *markers]:
            points += _points(name, x, y, style)
        for x, ys, style in bundles:
            kept = np.percentile(ys, _PERCENTILES, axis=0) if len(ys) else ()
            for percent, values in zip(_PERCENTILES, kept, strict=False):
                points += _points(name, x, values, {"label": f"{style.get('label', '')}: {percent} %"})
    if legend_above:
        legend_above_all(figure)
    return with_curves(figure, points)


def _draw_curve(axes, x, y, style):
    """Draw a curve, or for an ensemble (n_members, n) its median and band above its members."""
    if np.ndim(y) == 2:
        color = style["color"]
        low, middle, high = np.percentile(y, _BANDS, axis=0)
        axes.plot(x, np.transpose(y), color=color, linewidth=0.5, alpha=0.5, zorder=1.6)
        axes.fill_between(x, low, high, color=color, alpha=0.25, linewidth=0, zorder=1.7)
        y = middle
    axes.plot(x, y, **style)


def _points(panel, x, y, style):
    """[(name of the panel, label, x, y)] of a curve, or of the median, band and members of an ensemble."""
    label = style.get("label", "").removeprefix("_")
    if np.ndim(y) < 2:
        return [(panel, label, x, y)]
    named = zip(("16 %", "median", "84 %"), np.percentile(y, _BANDS, axis=0), strict=True)
    members = [(f"restart {k}", values) for k, values in enumerate(y)]
    return [(panel, f"{label}: {name}", x, values) for name, values in [*named, *members]]


@drawn(CURVES)
def ratios(panels, *, columns=3, size=(3.1, 2.9)):
    """A figure of ratios to the truth with the range over skies, on the axis of `himap.figures.axes`.

    Panels are dicts: "curves", a list of (x, middle, low, high, style), arrays (n,); and anything that
    `Axes.set` accepts. They share the axis of ratios and a legend above, so curves with one label are the
    same in all; the size of each is in inches.
    """
    limits = ratio_limits([one for panel in panels for _, *three, _ in panel["curves"] for one in three])
    figure, grid = subplots(len(panels), columns, size, room=0.5, sharey=True)
    points = []
    for axes, name, panel in zip(grid, panel_names(panels), panels, strict=True):
        _mark_one(axes, "0.93")
        for x, middle, low, high, style in panel["curves"]:
            axes.fill_between(x, low, high, color=style["color"], alpha=0.18, linewidth=0)
            axes.plot(x, middle, **style)
            for which, y in (("middle", middle), ("low", low), ("high", high)):
                points.append((name, f"{style['label']}, {which}", x, y))
        axes.set(xscale="log", **{key: value for key, value in panel.items() if key != "curves"})
        set_plain_ticks(axes.xaxis, *axes.get_xlim())
        set_ratio_axis(axes, limits)
    legend_above_all(figure)
    return with_curves(figure, points)


@drawn(CURVES | {"axes.grid": False})
def image(values, *, x, y, xlabel, ylabel, unit, limits=(1, 99)):
    """A picture of `values` (n_y, n_x) over pixel centres `x` and `y`, ascending and evenly spaced."""
    figure, axes = plt.subplots(figsize=(_WIDTH, 3.2), dpi=90)  # a high resolution would make a large picture
    low, high = np.percentile(values, limits)
    extent = [end for at in (x, y) for end in (1.5 * at[0] - 0.5 * at[1], 1.5 * at[-1] - 0.5 * at[-2])]
    look = {"origin": "lower", "aspect": "auto", "extent": extent, "cmap": "cividis"}
    shown = axes.imshow(values, vmin=low, vmax=high, **look)
    axes.set(xlabel=xlabel, ylabel=ylabel)
    figure.colorbar(shown, label=unit, extend="both")
    return with_image(figure, values, x=x, y=y, unit=unit)


def stamp(figure, provenance):
    """Write the provenance of the figure below it, in small print; return the figure."""
    size = np.clip(0.8 * figure.get_figwidth(), 6, 9)  # wide figures are scaled down on pages
    figure.supxlabel(str(provenance), fontsize=size, color="0.35")
    return figure
