"""Figures of what transfer functions correct."""

import numpy as np

from himap.figures import plotting, styles
from himap.paper.corrections import grouped

__all__ = ["record_figure"]

_APART = 0.15  # of the distance of two bands: what stands between the points of two methods
_LIMITS = (0.8, 1.2)
_CLOSE = 0.01
_MARKERS = "osD^v"
_KINDS = {"C/C0": "angular", "P/P0": "frequency"}


def record_figure(records):
    """Means over skies of each band, as methods leave it and corrected.

    Parameters
    ----------
    records
        {title: rows of `himap.paper.corrections.Correction`}; each has a panel for C_l and one for P(k).
    """
    panels = []
    for title, rows in records.items():
        found = grouped(rows)
        for kind in _KINDS:
            bands = list(dict.fromkeys(band for _, _, band in found if band.startswith(kind)))
            if bands:
                panels.append(_panel(found, bands, kind, title))
    return plotting.lines(panels, size=(5.2, 3.4))


def _panel(found, bands, kind, title):
    methods = list(dict.fromkeys(key[:2] for key in found))
    ends = [-0.5, len(bands) - 0.5]
    frame = [(ends, [at, at], {"color": "0.75", "linewidth": 0.8}) for at in (1 - _CLOSE, 1 + _CLOSE)]
    curves, points = [*frame, (ends, [1, 1], {"color": "black", "linewidth": 0.8})], []
    for n, (name, n_sources) in enumerate(methods):
        at = np.arange(len(bands)) + (n - (len(methods) - 1) / 2) * _APART
        several = [found.get((name, n_sources, band), []) for band in bands]
        style = styles.METHOD_STYLES.get(name, {"color": "0.35"})
        look = {"color": style["color"], "marker": _MARKERS[n % len(_MARKERS)]}
        left, corrected, scatter = np.transpose([_moments(rows) for rows in several])
        label = styles.numbered(name, n_sources)
        points.append((at, left, look | {"fillstyle": "none", "label": "_" + label + ", left"}))
        points.append((at, corrected, look | {"label": label}))
        for x, mean, width in zip(at, corrected, scatter, strict=True):
            bar = {"color": style["color"], "label": f"_{label}, one standard deviation"}
            curves.append(([x, x], [mean - width, mean + width], bar))
    axes = styles.AXES[_KINDS[kind]]
    return {
        "title": title,
        "curves": curves,
        "points": points,
        "xlim": ends,
        "ylim": _LIMITS,
        "xticks": range(len(bands)),
        "xticklabels": [band.partition(", ")[2].removeprefix("k ") for band in bands],
        "xlabel": axes["xlabel"],
        "ylabel": axes["ratio_label"],
        "legend": {"ncols": 2},
    }


def _moments(rows):
    """Mean as it is left, mean as corrected, and scatter of the latter, of one band over skies."""
    if not rows:
        return (np.nan,) * 3
    corrected = [row.corrected for row in rows]
    scatter = np.std(corrected, ddof=1) if len(rows) > 1 else 0
    return np.mean([row.raw for row in rows]), np.mean(corrected), scatter
