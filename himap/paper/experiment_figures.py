"""Figures and tables of the experiments on transfer functions, beam errors and methods side by side.

They take tables of the experiments, DataFrames of one sky or more.
"""

from itertools import cycle

import numpy as np

from himap.core.errors import InputError
from himap.figures import plotting, styles
from himap.measures.diagnostics import JUDGED
from himap.paper.experiments.beam_errors import KINDS, worst_excess
from himap.paper.experiments.methods import METHOD, distances, middles

_MARKERS = "osD^v"
_THIN = {"linewidth": 0.8}
_PANELS = {"C/C0": "angular", "P/P0": "frequency"}
_BAND_GAP = 0.15  # of the distance of two bands: between the points of two methods
_CLOSE = 0.01
_RANGE = (16, 84)  # percentiles over skies: what is shaded
_WIDTH = 9.3  # inches, of all columns


def transfer_figure(tables):
    """Means over skies in each band, uncorrected and corrected by transfer functions.

    `tables` is {title: table of `himap.paper.experiments.transfer`}; each has a panel for C_l and one for
    P(k).
    """
    panels = []
    for title, table in tables.items():
        for name, kind in _PANELS.items():
            own = table[table["band"].str.startswith(name)]
            if len(own):
                panels.append(_transfer_panel(own, title, styles.AXES[kind]))
    return plotting.lines(panels, size=(5.2, 3.4))


def _transfer_panel(table, title, axes):
    bands = table["band"].unique().tolist()
    methods = table.groupby(["method", "n_sources"], sort=False)
    ends = [-0.5, len(bands) - 0.5]
    curves = [(ends, [at, at], {"color": "0.75"} | _THIN) for at in (1 - _CLOSE, 1 + _CLOSE)]
    curves.append((ends, [1, 1], {"color": "black"} | _THIN))
    points = []
    for n, ((name, n_sources), own) in enumerate(methods):
        at = np.arange(len(bands)) + (n - (len(methods) - 1) / 2) * _BAND_GAP
        by_band = own.groupby("band")
        means = by_band[["uncorrected", "corrected"]].mean().reindex(bands)
        scatters = by_band["corrected"].std().fillna(0).reindex(bands)
        colour = styles.METHOD_STYLES.get(name, {"color": "0.35"})["color"]
        look = {"color": colour, "marker": _MARKERS[n % len(_MARKERS)]}
        label = styles.numbered(name, n_sources)
        open_look = look | {"fillstyle": "none", "label": f"_{label}, uncorrected"}
        points.append((at, means["uncorrected"].to_numpy(), open_look))
        points.append((at, means["corrected"].to_numpy(), look | {"label": label}))
        for x, mean, scatter in zip(at, means["corrected"], scatters, strict=True):
            bar = {"color": colour, "label": f"_{label}, one standard deviation"}
            curves.append(([x, x], [mean - scatter, mean + scatter], bar))
    return {
        "title": title,
        "curves": curves,
        "points": points,
        "xlim": ends,
        "ylim": (0.8, 1.2),
        "xticks": range(len(bands)),
        "xticklabels": [band.partition(", ")[2].removeprefix("k ") for band in bands],
        "xlabel": axes["xlabel"],
        "ylabel": axes["ratio_label"],
        "legend": {"ncols": 2},
    }


def beam_errors_figure(table, *, kinds=None, columns=2):
    """Foreground residual by the error of the assumed beam: one panel for each kind, one curve a method.

    Parameters
    ----------
    table
        Of `himap.paper.experiments.beam_errors`.
    kinds
        Which, in which order; all that the table has, but for other beams, unless given.
    columns
        Of panels.
    """
    excess = worst_excess(table)
    wrong = {kind for *_, kind, error in excess if error}
    kinds = [kind for kind in KINDS if kind in wrong and kind != "beam"] if kinds is None else kinds
    looks = styles.of_methods(dict.fromkeys(key[:2] for key in excess))
    panels = [_beam_errors_panel(excess, looks, kind) for kind in kinds]
    return plotting.lines(panels, columns=min(columns, len(panels)), size=(4.6, 3.4), legend_above=True)


def _beam_errors_panel(excess, looks, kind):
    errors = sorted({error for *_, name, error in excess if name == kind and error})
    ends = [errors[0] / 1.5, errors[-1] * 1.5]
    curves = [(ends, [_CLOSE, _CLOSE], {"color": "0.75"} | _THIN)]
    for (method, look), marker in zip(looks.items(), cycle("os^Dv"), strict=False):
        blind = excess.get((*method, "none", 0.0))
        if blind is None:
            values = [excess.get((*method, kind, error), np.nan) for error in errors]
            curves.append((errors, values, look | {"marker": marker, "markersize": 4}))
        else:
            curves.append((ends, [blind, blind], look | {"marker": "", "linewidth": 1}))
    return {
        "curves": curves,
        "xscale": "log",
        "yscale": "log",
        "xlim": ends,
        "ylim": (1e-3, 1e2),
        "xlabel": KINDS[kind],
        "ylabel": "foreground residual / (HI + noise)",
    }


def methods_figure(tables, kind, *, corrected=False, methods=None, columns=3):
    """C/C0 or P/P0, mean over skies and the range of 16 to 84 %; a panel for each table and beam.

    Parameters
    ----------
    tables
        {title: table of `himap.paper.experiments.methods`}.
    kind
        "angular" or "frequency".
    corrected
        Whether the curves are those over the transfer function, of the methods that have one.
    methods
        Names of those that are drawn; all unless given.
    columns
        Of panels.

    Raises
    ------
    InputError
        There are no such curves.
    """
    axes = styles.AXES[kind]
    panels = []
    for title, table in tables.items():
        labels = labels_of(table)
        looks = styles.of_methods(dict.fromkeys(labels.values()))
        beams = table["beam"].unique()
        shown = table[(table["kind"] == kind) & (table["corrected"] == corrected)]
        if methods is not None:
            shown = shown[shown["method"].isin(methods)]
        for beam, through in shown.groupby("beam", sort=False):
            curves = [
                _mean_and_range(own, looks[labels[key[:3]]])
                for key, own in through.groupby(METHOD, sort=False)
            ]
            texts = [text for text in (title, beam if len(beams) > 1 else "") if text]
            panels.append({"title": ", ".join(texts), "curves": curves, "xlabel": axes["xlabel"]})
    if not panels:
        raise InputError(
            "the records have no such curves: nothing was corrected, or by none of these methods."
        )
    columns = min(columns, len(panels))
    for first in panels[::columns]:
        first["ylabel"] = axes["ratio_label"]
    return plotting.ratios(panels, columns=columns, size=(_WIDTH / columns, 2.9 if columns == 3 else 3.8))


def _mean_and_range(own, look):
    """(x, mean, low, high, style) of the curves of one method on all skies."""
    ratios = own.pivot(index="low", columns="seed", values="ratio").to_numpy()
    low, high = np.percentile(ratios, _RANGE, axis=1)
    x = middles(own[own["seed"] == own["seed"].iloc[0]]).to_numpy()
    return x, ratios.mean(axis=1), low, high, look


def labels_of(table):
    """{(beam, method, n_sources): (method, its number as a text)}; such as "3/4/5" where beams differ."""
    numbers = {}
    for beam, method, n_sources in table[METHOD[:3]].drop_duplicates().itertuples(index=False):
        numbers.setdefault(method, {}).setdefault(beam, []).append(n_sources)
    labels = {}
    for method, by_beam in numbers.items():
        for place in range(max(map(len, by_beam.values()))):  # a beam with fewer repeats its last
            several = {beam: own[min(place, len(own) - 1)] for beam, own in by_beam.items()}
            texts = [str(n_sources or "") for n_sources in several.values()]
            text = texts[0] if len(set(texts)) == 1 else "/".join(texts)
            for beam, n_sources in several.items():
                labels.setdefault((beam, method, n_sources), (method, text))
    return labels


def signed(value):
    """A distance (`himap.paper.experiments.methods.distances`) as a text, in percent."""
    if np.isnan(value):
        return "–"
    percent = 100 * value
    digits = 0 if abs(percent) >= 10 else 1
    return f"{percent:+.{digits}f}\N{NO-BREAK SPACE}%".replace("-", "−")


def methods_table(tables, *, of=JUDGED):
    """(header, rows) of texts: the `distances` of each method through each beam, as it is and corrected."""
    labels, found = labels_of(tables[0]), distances(tables, of)
    beams = list(dict.fromkeys(beam for beam, *_ in labels))
    rows = []
    for method, text in dict.fromkeys(labels.values()):
        numbers = [int(number or 0) for number in text.split("/")]
        pairs = list(zip(beams, numbers * len(beams) if len(numbers) == 1 else numbers, strict=True))
        cells = [
            signed(found.get((beam, method, n, corrected), np.nan))
            for corrected in (False, True)
            for beam, n in pairs
        ]
        rows.append((styles.numbered(method, text), *cells))
    return ["method", *beams, *(f"{beam}, corrected" for beam in beams)], rows
