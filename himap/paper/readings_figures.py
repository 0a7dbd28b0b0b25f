"""Figures of the outcomes of readings of SDecGMCA."""

import numpy as np
import pandas as pd

from himap.figures import plotting, styles
from himap.figures.planes import marks
from himap.paper.claims import CLAIMS
from himap.paper.readings import BANDS, CURVES, readings
from himap.paper.readings_table import MARKS, robustness
from himap.removal.sdecgmca.readings import READINGS

_FAR = (1e-3, 1e3)  # largest range of axes of ratios
_GAP = 0.8  # between named and other readings, in rows
_COLUMNS = 5
_LOGARITHMIC = 10  # ratio of largest to smallest value above which an axis is logarithmic
_LOOKS = dict(zip(READINGS, styles.sequence(list(READINGS)), strict=True))


def claims_figure(outcomes):
    """Claims by readings, {label: `Outcome`}: verdicts, claims grouped by their robustness."""
    known = readings()

    def verdicts(claim):
        entries = [one.entries.get(claim) for one in outcomes.values()]
        return [[one.verdict] if one else [] for one in entries]

    groups = {
        name: {f"{CLAIMS[claim].statement}  {claim}": verdicts(claim) for claim in claims}
        for name, claims in robustness(outcomes).items()
        if claims
    }
    n_named = sum(label in READINGS for label in outcomes)
    return marks(groups, [known[label].title for label in outcomes], MARKS, breaks=(1, n_named))


def bands_figure(outcomes):
    """C/C0 and P/P0 in bands, and the bump: a row for each reading, a point for each sky and restart.

    A ratio that is wrong by more than a factor of a thousand is drawn at the edge.
    """
    titles = {band: f"${band[0]}/{band[2]}_0$, {band.partition(', ')[2]}" for band in BANDS}
    titles["bump"] = "$P/P_0$, bump"
    order = sorted(outcomes, key=lambda label: label not in READINGS)  # named readings come first
    numbers = pd.concat({label: outcomes[label].numbers for label in order}, names=["reading"])
    n_named = sum(label in READINGS for label in outcomes)
    places = {label: n + (_GAP if 0 < n_named <= n else 0) for n, label in enumerate(order)}
    ends = max(places.values()) + 0.7, -0.7
    # Coarse maps end before the last bands.
    there = [band for band in titles if band in numbers and numbers[band].notna().any()]
    known, panels = readings(), []
    for n, band in enumerate(there):
        values = numbers[band].dropna().clip(*_FAR)
        wide = values.max() > _LOGARITHMIC * values.min()
        panel = {
            "curves": [([1, 1], ends[::-1], {"color": "black", "linewidth": 0.8})],
            "points": list(_points(values, places, shown=n == min(7, len(there) - 1))),
            "title": titles[band],
            "xscale": "log" if wide else "linear",
            "ylim": ends,
            "yticks": list(places.values()),
            "yticklabels": [known[label].title if n % _COLUMNS == 0 else "" for label in places],
            "legend": {"loc": "upper center", "bbox_to_anchor": (0.5, -0.08)},
        }
        panels.append(panel)
    return plotting.lines(panels, columns=_COLUMNS, size=(2.5, 4.9))


def _points(values, places, *, shown):
    """(x, y, style) for every seed and restart; if `shown`, seeds are in the legend."""
    seeds = values.index.unique("seed").tolist()
    for (seed, restart), several in values.groupby(["seed", "restart"], sort=False):
        n, label = seeds.index(seed), f"seed {seed}"
        look = {
            "label": label if shown and not restart else f"_{label}, restart {restart}",
            "color": styles.COLOURS[n % len(styles.COLOURS)],
            "marker": "o",
            "markersize": 3.5,
            "alpha": 0.8,
        }
        y = several.index.get_level_values("reading").map(places) + 0.3 * (n - (len(seeds) - 1) / 2)
        yield several.to_numpy(), y.to_numpy(), look


def curves_figure(outcomes):
    """C/C0(l) and P/P0(k) of the named readings, two panels for each sky.

    Median and 16 to 84 % band of the restarts.
    """
    named = {label: outcomes[label].curves for label in READINGS if label in outcomes}
    rows = pd.concat(named, names=["label"]).reset_index("label")
    panels = []
    for seed in rows["seed"].unique():
        directions = ("angular", "across the sky"), ("frequency", "along the line of sight")
        for curve, (kind, across) in zip(CURVES, directions, strict=True):
            shown, curves = rows[(rows["seed"] == seed) & (rows["quantity"] == curve)], []
            for label, several in shown.groupby("label", sort=False):
                ys = several.pivot(index="restart", columns="x", values="value")
                ranges = np.percentile(ys, [50, 16, 84], axis=0)
                curves.append((ys.columns.to_numpy(), *ranges, _LOOKS[label]))
            panels.append(
                {
                    "curves": curves,
                    "title": f"seed {seed}, {across}",
                    "xlabel": styles.AXES[kind]["xlabel"],
                    "ylabel": styles.AXES[kind]["ratio_label"],
                }
            )
    return plotting.ratios(panels, columns=2, size=(5, 3.4))


def code_figure(compared, iterations):
    """Distance of A from that of the authors' code after some `iterations`, and the effect of rounding.

    `compared` are {variant: (differences, effects of a change of the start)}, from `AuthorsCode.compared`.
    """
    looks = [look | {"marker": "o", "markersize": 3} for look in styles.sequence(list(compared))]
    titles = "from the authors' code", "by a change of the start"
    panels = [
        {
            "curves": [
                (iterations, pair[n], look) for pair, look in zip(compared.values(), looks, strict=True)
            ],
            "title": title,
            "xlabel": "iterations",
            "ylabel": r"largest $|\Delta \mathbf{A}|$",
            "yscale": "log",
            "ylim": (1e-14, 3),
        }
        for n, title in enumerate(titles)
    ]
    return plotting.lines(panels, size=(4.6, 3.2))
