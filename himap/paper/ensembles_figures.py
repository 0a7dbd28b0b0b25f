"""Figures of SDecGMCA as an ensemble, from tables of `himap.paper.ensembles`."""

import numpy as np

from himap.figures import plotting, styles
from himap.paper.ensembles import MEASURES, curves

_MEMBERS = {"linewidth": 0.6, "alpha": 0.45}
_TRUTH = {"label": "_truth", "color": "0.5", "linewidth": 0.8}
_AXES = {
    "angle": {
        "ylabel": "sine of the largest angle",
        "yscale": "log",
        "ylim": (1e-11, 2),
    },
    "condition": {"ylabel": r"condition number of $\mathbf{A}$", "yscale": "log"},
}
_TITLES = {
    "C/C0, 2 to 9": r"$C/C_0$, $2 \leq \ell \leq 9$",
    "C/C0, 10 to 64": r"$C/C_0$, $10 \leq \ell \leq 64$",
    "P/P0, k < 0.03": r"$P/P_0$, $k < 0.03$",
    "P/P0, 0.03 to 0.1": r"$P/P_0$, $0.03 < k < 0.1$",
    "bump": r"$P/P_0$ at the ripple",
    "flagged": "flagged fraction of the sky",
    "condition": r"condition number of $\mathbf{A}$ $/\,10^5$",
}


def growth_figure(ensembles):
    """Distance of A from that of the plain start, by iteration: a panel for each of {title: rows}.

    Thin lines are restarts, the thick one is their median.
    """
    look = [{"color": styles.BLUE, "label": "median", "linewidth": 1.8}]
    panels = [_panel("angle", {title: rows}, look) | {"title": title} for title, rows in ensembles.items()]
    return plotting.lines(panels, size=(4.4, 2.9), legend_above=True)


def variants_figure(variants):
    """The same and the condition number of A, for {variant: rows}: thin lines are restarts."""
    looks = styles.sequence(list(variants))
    panels = [_panel(quantity, variants, looks) for quantity in _AXES]
    return plotting.lines(panels, size=(4.6, 3.4), legend_above=True)


def _panel(quantity, variants, looks):
    """A quantity by iteration: members as a bundle, and medians."""
    thin = {"color": looks[0]["color"], "linewidth": 1, "label": "restarts"}
    bundles, medians = [], [([], [], thin)]  # one entry for the legend
    for (name, rows), look in zip(variants.items(), looks, strict=True):
        table = curves(rows, quantity)
        x = table.columns.to_numpy()
        style = {"color": look["color"], "label": f"_{name}, restarts"} | _MEMBERS
        bundles.append((x, table.to_numpy(), style))
        medians.append((x, table.median().to_numpy(), look))
    return {"bundles": bundles, "curves": medians, "xlabel": "iteration"} | _AXES[quantity]


def distributions_figure(ensembles, floors):
    """Distribution functions of results of the last S, and of the last condition number.

    `ensembles` are {label: rows}, the first with solid lines, the second with dashed ones; `floors` are
    {floor of the last S: its label}.
    """
    panels = []
    for quantity in (*MEASURES, "condition"):
        drawn, unit = [], 1e5 if quantity == "condition" else 1
        for (label, rows), line in zip(ensembles.items(), ("-", "--"), strict=True):
            table = curves(rows, quantity)
            names = floors if quantity != "condition" else {table.columns[-1]: ""}
            for (x, name), colour in zip(names.items(), (styles.VERMILION, styles.BLUE), strict=False):
                colour = colour if name else "black"
                look = {"color": colour, "linestyle": line, "label": ", ".join(filter(None, (label, name)))}
                values = np.sort(table[x].to_numpy() / unit)
                shares = np.arange(len(values) + 1) / len(values)
                drawn.append((np.repeat(values, 2), np.repeat(shares, 2)[1:-1], look))
        if "/" in quantity or quantity == "bump":
            drawn.append(([1, 1], [0, 1], _TRUTH))
        panel = {"curves": drawn, "title": _TITLES[quantity], "xscale": "log"}
        panels.append(panel | ({} if len(panels) % 4 else {"ylabel": "share of the restarts"}))
    return plotting.lines(panels, columns=4, size=(2.5, 2.6), legend_above=True)
