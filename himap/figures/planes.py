"""Figures of images in the plane: maps in their own projection, and power over two wavenumbers.

Colours are those of cividis, which is monotonic in lightness.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import MaxNLocator, NullLocator

from himap.figures.data import with_image

_RC = {"figure.dpi": 110, "font.size": 10, "figure.constrained_layout.use": True}
_NAMES = {"RA": "RA", "DEC": "Dec", "GLON": "Galactic longitude", "GLAT": "Galactic latitude"}
_BLANK = "0.85"  # grey of what has no value
_PERCENTILES = (2, 98)
_ROUND = (1, 2, 5, 3, 7, 1.5, 1.2, 8, 1.1, 9, 4, 6)  # where ticks may stand in a decade, the best first
_APART = 0.17  # of an axis: two numbers beside each other


def sky_images(maps, celestial, *, span, unit="mK"):
    """A figure of images in their projection, with the lines of their coordinates.

    Parameters
    ----------
    maps
        {title: (n_y, n_x)}, NaN where there is no value.
    celestial
        `astropy.wcs.WCS` of the two axes.
    span
        {title: (low, high)} of the colours.
    unit
        Of the maps.
    """
    with plt.rc_context(_RC):
        figure = plt.figure(figsize=(4.6 * len(maps), 4.4))
        for n, (title, pixels) in enumerate(maps.items(), start=1):
            axes = figure.add_subplot(1, len(maps), n, projection=celestial)
            axes.set_facecolor(_BLANK)
            low, high = span[title]
            shown = axes.imshow(
                pixels, origin="lower", norm=Normalize(low, high), cmap="cividis", interpolation="nearest"
            )
            axes.coords.grid(color="white", alpha=0.35, linestyle=":")
            for coordinate, ctype in zip(axes.coords, celestial.wcs.ctype, strict=True):
                name = ctype.split("-")[0]
                coordinate.set_axislabel(_NAMES.get(name, name))
                coordinate.set_ticklabel(size=8.5, exclude_overlapping=True)
            axes.set_title(f"{title} [{unit}]", fontsize=10)
            bar = figure.colorbar(shown, ax=axes, location="bottom", shrink=0.8, extend="both")
            bar.locator = MaxNLocator(4)
    plt.close(figure)
    n_y, n_x = next(iter(maps.values())).shape
    return with_image(
        figure, np.stack(list(maps.values())), x=np.arange(n_x), y=np.arange(n_y), unit=[unit] * len(maps)
    )


def power_planes(planes, *, x, y, xlabel, ylabel, unit, ratio=None):
    """A figure of power over two wavenumbers on logarithmic axes, and of a ratio beside it.

    Parameters
    ----------
    planes
        {title: (n_y, n_x)}, above zero, NaN where there is no value; all on one scale of colours.
    x, y
        Edges of the cells, one more than these.
    xlabel, ylabel
        With their units.
    unit
        Of the power.
    ratio
        (title, (n_y, n_x)); its colours go as far above 1 as below.
    """
    values = np.concatenate([plane[plane > 0] for plane in planes.values()])
    low, high = np.percentile(values, _PERCENTILES) if len(values) else (1, 10)
    norm = LogNorm(low, max(high, 1.01 * low))
    drawn = [(title, plane, norm, unit) for title, plane in planes.items()]
    if ratio is not None:
        drawn.append((*ratio, _around_one(ratio[1]), "ratio"))
    with plt.rc_context(_RC):
        figure, panels = plt.subplots(
            1, len(drawn), figsize=(max(4.2, 3.4 * len(drawn)), 3.9), sharey=True, squeeze=False
        )
        for axes, (title, plane, colours, text) in zip(panels.flat, drawn, strict=True):
            axes.set_facecolor(_BLANK)
            shown = axes.pcolormesh(x, y, np.ma.masked_invalid(plane), norm=colours, cmap="cividis")
            axes.set(xscale="log", yscale="log", xlabel=xlabel, title=title)
            bar = figure.colorbar(shown, ax=axes, location="bottom", label=text, extend="both")
            spans = ((axes.xaxis, x), (axes.yaxis, y), (bar.ax.xaxis, (colours.vmin, colours.vmax)))
            for axis, values in spans:
                axis.set_ticks(_ticks(values[0], values[-1]))
                axis.set_major_formatter("{x:g}")
                axis.set_minor_locator(NullLocator())
        panels[0, 0].set_ylabel(ylabel)
    plt.close(figure)
    return with_image(
        figure, np.stack([plane for _, plane, *_ in drawn]), x=x, y=y, unit=[text for *_, text in drawn]
    )


def _ticks(low, high):
    """Plain numbers from `low` to `high`, powers of ten first, as many as stand apart in the logarithm."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    kept = []
    for tick in np.multiply.outer(_ROUND, decades).ravel():
        apart = [abs(np.log(tick / other)) for other in kept]
        if low <= tick <= high and min(apart, default=np.inf) >= _APART * np.log(high / low):
            kept.append(tick)
    return sorted(kept)


def _around_one(ratio):
    """Colours that are even about 1, in the logarithm, and show nearly all of a ratio."""
    known = np.abs(np.log(ratio[ratio > 0]))
    far = np.exp(np.percentile(known, _PERCENTILES[1])) if len(known) else 1
    far = float(np.clip(far, 1.1, 100))
    return LogNorm(1 / far, far)
