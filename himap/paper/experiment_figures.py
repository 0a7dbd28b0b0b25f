"""Figures and tables of the experiments on transfer functions, beam errors and methods side by side.

The input are tables of the experiments, DataFrames of one sky or more.
"""

from itertools import cycle

import numpy as np

from himap.core.errors import InputError
from himap.figures import plotting, styles
from himap.paper.experiments.beam_errors import KINDS, worst_excess
from himap.paper.experiments.methods import METHOD, distances, middles

_THIN = {"linewidth": 0.8}
_PANELS = {"C/C0": "angular", "P/P0": "frequency"}
_BAND_GAP = 0.15  # between the points of two methods, in units of the distance of two bands
_CLOSE = 0.01
_REACH, _ROOM = 0.2, 0.02  # of an axis of power ratios: smallest extent about 1, and margin beyond points
_BANDS = (50, 16, 84)  # percentiles over skies: the line, and the shaded range
_WIDTH = 9.3  # inches, of all columns


def transfer_figure(tables):
    """Means over skies in each band, uncorrected and corrected by transfer functions.

    Axes include 1 by `_REACH` on either side and all corrected values; uncorrected means may be outside.
    `tables` are {title: table of `himap.paper.experiments.transfer`}; each has a panel for C_l and one for
    P(k).
    """
    panels = []
    for title, table in tables.items():
        for name, kind in _PANELS.items():
            shown = table[table["band"].str.startswith(name)]
            if len(shown):
                panels.append(_transfer_panel(shown) | {"title": title, **_labels(kind)})
    return plotting.lines(panels, size=(5.2, 3.4))


def _labels(kind):
    return {"xlabel": styles.AXES[kind]["xlabel"], "ylabel": styles.AXES[kind]["ratio_label"]}


def _transfer_panel(table):
    bands = table["band"].unique().tolist()
    methods = table.groupby(["method", "n_sources"], sort=False)
    ends = [-0.5, len(bands) - 0.5]
    curves = [(ends, [at, at], {"color": "0.75"} | _THIN) for at in (1 - _CLOSE, 1 + _CLOSE)]
    curves.append((ends, [1, 1], {"color": "black"} | _THIN))
    points, reached = [], [1 - _REACH, 1 + _REACH]
    for n, (((name, n_sources), rows), marker) in enumerate(zip(methods, cycle("osD^v"), strict=False)):
        at = np.arange(len(bands)) + (n - (len(methods) - 1) / 2) * _BAND_GAP
        by_band = rows.groupby("band")
        before, after = (by_band[one].mean().reindex(bands) for one in ("uncorrected", "corrected"))
        error = by_band["corrected"].sem().fillna(0).reindex(bands)
        colour = styles.METHOD_STYLES.get(name, {"color": "0.35"})["color"]
        look, label = {"color": colour, "marker": marker}, styles.numbered(name, n_sources)
        hollow = look | {"fillstyle": "none", "label": f"_{label}, uncorrected"}
        points += [(at, before.to_numpy(), hollow), (at, after.to_numpy(), look | {"label": label})]
        reached += [*(after - error - _ROOM), *(after + error + _ROOM)]
        bar = {"color": colour, "label": f"_{label}, standard error"}
        curves += [
            ([x, x], list(pair), bar) for x, *pair in zip(at, after - error, after + error, strict=True)
        ]
    reached = np.array(reached)[np.isfinite(reached)]
    return {
        "curves": curves,
        "points": points,
        "xlim": ends,
        "ylim": (reached.min(), reached.max()),
        "xticks": range(len(bands)),
        "xticklabels": [band.partition(", ")[2].removeprefix("k ") for band in bands],
        "legend": {"ncols": 2},
    }


def beam_errors_figure(table):
    """Foreground residual by the error of the assumed beam: one panel for each kind, one curve per method.

    `table` is from `himap.paper.experiments.beam_errors`; other beams are omitted. InputError for a table
    without errors.
    """
    excess = worst_excess(table)
    tried = {kind: sorted({key[3] for key in excess if key[2] == kind and key[3]}) for kind in KINDS}
    looks = styles.of_methods(dict.fromkeys(key[:2] for key in excess))
    panels = []
    for kind, errors in tried.items():
        if kind == "beam" or not errors:
            continue
        ends = [errors[0] / 1.5, errors[-1] * 1.5]
        curves = [(ends, [_CLOSE, _CLOSE], {"color": "0.75"} | _THIN)]
        for (method, look), marker in zip(looks.items(), cycle("os^Dv"), strict=False):
            blind = excess.get((*method, "none", 0.0))
            if blind is None:
                values = [excess.get((*method, kind, error), np.nan) for error in errors]
                curves.append((errors, values, look | {"marker": marker, "markersize": 4}))
            else:
                curves.append((ends, [blind, blind], look | {"marker": "", "linewidth": 1}))
        panel = {"curves": curves, "xlim": ends, "xscale": "log", "xlabel": KINDS[kind]}
        panel |= {"ylim": (1e-3, 1e2), "yscale": "log", "ylabel": "foreground residual / (HI + noise)"}
        panels.append(panel)
    if not panels:
        raise InputError(
            "the table has no error of the beam: it needs one, such as {'width': [0.01]}, and a method that "
            "uses the beam."
        )
    return plotting.lines(panels, columns=min(2, len(panels)), size=(4.6, 3.4), legend_above=True)


def methods_figure(tables, kind, *, corrected=False):
    """C/C0 or P/P0, median over skies and the range of 16 to 84 %; a panel for each table and beam.

    `tables` are {title: table of `himap.paper.experiments.methods`}, and `kind` is "angular" or "frequency".
    If `corrected`, curves are divided by the transfer function, for methods that have one; InputError if none
    has.
    """
    panels = []
    for title, table in tables.items():
        labels = labels_of(table)
        looks = styles.of_methods(dict.fromkeys(labels.values()))
        shown = table[(table["kind"] == kind) & (table["corrected"] == corrected)]
        for beam, through in shown.groupby("beam", sort=False):
            curves = []
            for key, rows in through.groupby(METHOD, sort=False):
                ratios = rows.pivot(index="low", columns="seed", values="ratio").to_numpy()
                x = middles(rows[rows["seed"] == rows["seed"].iloc[0]]).to_numpy()
                curves.append((x, *np.percentile(ratios, _BANDS, axis=1), looks[labels[key[:3]]]))
            texts = [title, beam if table["beam"].nunique() > 1 else ""]
            panels.append({"title": ", ".join(filter(None, texts)), "curves": curves, **_labels(kind)})
    if not panels:
        raise InputError("the records have no such curves: nothing was corrected.")
    columns = min(3, len(panels))
    for n, panel in enumerate(panels):
        if n % columns:
            del panel["ylabel"]
    return plotting.ratios(panels, columns=columns, size=(_WIDTH / columns, 2.9 if columns == 3 else 3.8))


def labels_of(table):
    """{(beam, method, n_sources): (method, its number as a text)}; such as "3/4/5" where beams differ."""
    labels = {}
    for method, rows in table[METHOD[:3]].drop_duplicates().groupby("method", sort=False):
        by_beam = rows.groupby("beam", sort=False)["n_sources"].agg(list)
        for place in range(by_beam.map(len).max()):  # a beam with fewer repeats its last
            numbers = by_beam.map(lambda several, place=place: several[min(place, len(several) - 1)])
            texts = [str(n_sources or "") for n_sources in numbers]
            text = texts[0] if len(set(texts)) == 1 else "/".join(texts)
            for beam, n_sources in numbers.items():
                labels.setdefault((beam, method, n_sources), (method, text))
    return labels


def signed(value):
    """Format a distance (`himap.paper.experiments.methods.distances`) in percent."""
    if np.isnan(value):
        return "–"
    digits = 0 if abs(100 * value) >= 10 else 1
    return f"{100 * value:+.{digits}f}\N{NO-BREAK SPACE}%".replace("-", "−")


def methods_table(tables):
    """(header, rows) of texts: the `distances` of each method with each beam, uncorrected and corrected."""
    labels, by_key = labels_of(tables[0]), distances(tables)
    beams = list(dict.fromkeys(beam for beam, *_ in labels))
    rows = []
    for method, text in dict.fromkeys(labels.values()):
        numbers = [int(number or 0) for number in text.split("/")]
        pairs = list(zip(beams, numbers * len(beams) if len(numbers) == 1 else numbers, strict=True))
        cells = [
            signed(by_key.get((beam, method, n, corrected), np.nan))
            for corrected in (False, True)
            for beam, n in pairs
        ]
        rows.append((styles.numbered(method, text), *cells))
    return ["method", *beams, *(f"{beam}, corrected" for beam in beams)], rows
