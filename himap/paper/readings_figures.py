"""Figures of what the readings of SDecGMCA lead to."""

import numpy as np

from himap.figures import plotting, styles
from himap.figures.planes import marks
from himap.paper.claims import CLAIMS
from himap.paper.readings import BANDS, CURVES, readings
from himap.paper.readings_table import MARKS, robustness
from himap.removal.sdecgmca.readings import READINGS

_FAR = (1e-3, 1e3)  # where axes of ratios end at the latest
_GAP = 0.8  # between the readings with a name and the others, in rows
_COLUMNS = 5
_TRUTH = {"label": "_truth", "color": "0.5", "linewidth": 0.8}
_EDGES = (0.4, 2.2)  # of ratios that are shown as curves: a few per cent can be seen
_LOGARITHMIC = 10  # largest over least value from which an axis is logarithmic
_LOOKS = {
    name: {"color": colour, "linestyle": line}
    for name, colour, line in zip(
        READINGS,
        (styles.BLUE, styles.VERMILION, styles.GREEN, styles.PURPLE),
        ("-", "--", "-.", ":"),
        strict=True,
    )
}


def claims_figure(outcomes):
    """Claims by readings, {label: `Outcome`}: verdicts of all seeds, claims grouped by where they stand."""
    known = readings()
    groups = {
        name: {_named(claim): [_verdicts(one, claim) for one in outcomes.values()] for claim in claims}
        for name, claims in robustness(outcomes).items()
        if claims
    }
    n_named = sum(label in READINGS for label in outcomes)
    return marks(groups, [known[label].title for label in outcomes], MARKS, breaks=(1, n_named))


def _named(claim):
    return f"{CLAIMS[claim].number}  {claim}"


def _verdicts(outcome, claim):
    entry = outcome.entries.get(claim)
    return [finding.verdict for finding in entry.findings.values()] if entry else []


def bands_figure(outcomes):
    """C/C0 and P/P0 in bands, and the bump: a row for each reading, a point for each sky and noise level.

    What is wrong by more than a factor of a thousand stands where that is, at the edge.
    """
    quantities = {_title(band): band for band in BANDS} | {"$P/P_0$, bump": "bump"}
    known, places = readings(), _places(outcomes)
    panels = []
    # Coarse maps end before the last bands.
    every = [run for one in outcomes.values() for run in one.runs]
    there = {
        title: band
        for title, band in quantities.items()
        if np.isfinite([run.numbers.get(band, np.nan) for run in every]).any()
    }
    for n, (title, band) in enumerate(there.items()):
        points = list(_points(outcomes, places, band, shown=n == min(7, len(there) - 1)))
        values = np.concatenate([x for x, _, _ in points])
        panel = {
            "curves": [([1, 1], [-0.7, max(places.values()) + 0.7], {"color": "black", "linewidth": 0.8})],
            "points": points,
            "title": title,
            "xscale": _scale(values),
            "ylim": (max(places.values()) + 0.7, -0.7),
            "yticks": list(places.values()),
            "yticklabels": [known[label].title if n % _COLUMNS == 0 else "" for label in places],
            "legend": {"loc": "upper center", "bbox_to_anchor": (0.5, -0.08)},
        }
        panels.append(panel)
    return plotting.lines(panels, columns=_COLUMNS, size=(2.5, 4.9))


def _places(outcomes):
    """{label: its row}; those with a name come first."""
    named = [label for label in outcomes if label in READINGS]
    others = [label for label in outcomes if label not in READINGS]
    return dict(zip(named, range(len(named)), strict=True)) | {
        label: len(named) + _GAP * bool(named) + n for n, label in enumerate(others)
    }


def _points(outcomes, places, band, *, shown):
    """(x, y, style) of every seed and noise level; with `shown` they are in the legend."""
    runs = {(run.seed, run.noise_level): None for one in outcomes.values() for run in one.runs}
    seeds = list(dict.fromkeys(seed for seed, _ in runs))
    for seed, level in runs:
        several = {
            label: [run for run in one.runs if (run.seed, run.noise_level) == (seed, level)]
            for label, one in outcomes.items()
        }
        pairs = [
            (run.numbers.get(band, np.nan), places[label])
            for label, found in several.items()
            for run in found
        ]
        pairs = np.array([(np.clip(x, *_FAR), y) for x, y in pairs if np.isfinite(x)]).reshape(-1, 2)
        shift = 0.3 * (seeds.index(seed) - (len(seeds) - 1) / 2)
        label = f"seed {seed}" + (f", noise × {level:g}" if level != 1 else "")
        yield (
            pairs[:, 0],
            pairs[:, 1] + shift,
            {
                "label": label if shown else f"_{label}",
                "color": styles.COLOURS[seeds.index(seed) % len(styles.COLOURS)],
                "marker": "o" if level == 1 else "<" if level < 1 else ">",
                "markersize": 3.5,
                "alpha": 0.8,
            },
        )


def _title(band):
    """A band with its ratio as a formula."""
    ratio, _, ends = band.partition(", ")
    return f"${ratio[0]}/{ratio[2]}_0$, {ends}"


def _scale(values):
    """Logarithmic over more than a factor of ten."""
    there = values[values > 0]
    return "log" if len(there) and there.max() > _LOGARITHMIC * there.min() else "linear"


def curves_figure(outcomes):
    """C/C0(l) and P/P0(k) of the readings with a name, two panels for each sky.

    Lines are at the noise level of the survey, thin ones at those beside it. What is wrong by more than the
    panels show leaves them.
    """
    named = {label: outcomes[label] for label in READINGS if label in outcomes}
    seeds = list(dict.fromkeys(run.seed for one in named.values() for run in one.runs))
    panels = []
    for seed in seeds:
        runs = [(label, run) for label, one in named.items() for run in one.runs if run.seed == seed]
        for kind, curve, across in zip(
            ("angular", "frequency"), CURVES, ("across the sky", "along the line of sight"), strict=True
        ):
            curves = [(*run.curves[curve], _look(label, run.noise_level)) for label, run in runs]
            ends = [min(x[0] for x, _, _ in curves), max(x[-1] for x, _, _ in curves)]
            panels.append(
                {
                    "curves": [(ends, [1, 1], _TRUTH), *curves],
                    "title": f"seed {seed}, {across}",
                    "xlabel": styles.AXES[kind]["xlabel"],
                    "ylabel": styles.AXES[kind]["ratio_label"],
                    "xscale": "log",
                    "ylim": _EDGES,
                }
            )
    return plotting.lines(panels, size=(5, 3.6), legend_above=True)


def _look(label, level):
    if level == 1:
        return _LOOKS[label] | {"label": label, "linewidth": 1.8}
    return _LOOKS[label] | {"label": f"_{label}, noise × {level:g}", "linewidth": 0.7}


def code_figure(compared, iterations):
    """How far A is from that of the authors' code, and what rounding does: two panels.

    Parameters
    ----------
    compared
        {variant: (differences, what a change of the start makes)}, as `AuthorsCode.compared` has them.
    iterations
        After which.
    """
    looks = styles.sequence(list(compared))
    common = {"xlabel": "iterations", "yscale": "log", "ylim": (1e-14, 3)}
    titles = "from the authors' code", "by a change of the start"
    panels = [
        common
        | {
            "curves": [
                (iterations, pair[n], look | {"marker": "o", "markersize": 3})
                for pair, look in zip(compared.values(), looks, strict=True)
            ],
            "title": title,
            "ylabel": r"largest $|\Delta \mathbf{A}|$",
        }
        for n, title in enumerate(titles)
    ]
    return plotting.lines(panels, size=(4.6, 3.2))
