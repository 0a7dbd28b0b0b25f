"""What mocks say of a cleaned cube: its corrected spectra as figure, table and file."""

import numpy as np

from himap.cubes import page
from himap.figures import plotting, styles
from himap.figures.tables import Table
from himap.measures.diagnostics import bands

HEADER = ("band", "comes back", "error bar", "left / truth", "corrected / truth")
"""Columns of `corrected_rows`; the last two where there is a truth."""

_COLUMNS = "spectrum,x,left,transfer_function,corrected,sigma,truth"


def corrected_rows(found, truth=None):
    """A line of texts for each band of l and k, a list of tuples; see `HEADER`.

    Parameters
    ----------
    found
        What `himap.cubes.transfer.correct` gives.
    truth
        The `Comparison` with the truth, if there is one.
    """
    true = _true(found, truth)
    rows = []
    for name, (kind, inside) in bands(found["angular"].x, found["frequency"].x).items():
        one = found[kind]
        (sigma,) = one.sigma([inside / inside.sum()])
        spread = f"{sigma:.2%}" if np.isfinite(sigma) else "needs two mocks"
        row = [plain_band(name), f"{one.share[inside].mean():.4f}", spread]
        if truth is not None:
            ratios = (np.mean(power[inside] / true[kind][inside]) for power in (one.left, one.corrected))
            row += [f"{ratio:.4f}" for ratio in ratios]
        rows.append(tuple(row))
    return rows


def plain_band(name):
    """The name of a band of ratios as that of a band of the spectrum."""
    ratio, _, where = name.partition(", ")
    return f"C(l), l {where}" if ratio == "C/C0" else f"P(k), k {where.removeprefix('k ')}"


def _true(found, truth):
    """{kind: the truth's spectrum where the corrected one is}, NaN where it is not known."""
    if truth is None:
        return {kind: np.full(len(one.x), np.nan) for kind, one in found.items()}
    known = {"angular": (truth.degrees, truth.true_angular), "frequency": (truth.k, truth.true_frequency)}
    return {kind: np.interp(one.x, *known[kind], left=np.nan, right=np.nan) for kind, one in found.items()}


def corrected_figure(found, truth=None):
    """Both spectra as they are left and corrected, and the transfer functions below.

    Parameters as in `corrected_rows`.
    """
    true, panels = _true(found, truth), []
    for kind, one in found.items():
        bars = one.sigma(np.eye(len(one.x)))
        curves = [
            (one.x, one.left, {"label": "as it is left", "color": styles.ORANGE, "linestyle": "--"}),
            (one.x, one.corrected, {"label": "corrected", "color": styles.INDIGO}),
        ]
        edges = ((one.corrected * (1 + sign * bars)) for sign in (-1, 1))
        thin = {"color": styles.INDIGO, "linewidth": 0.5, "label": "_error bar"}
        curves += [(one.x, edge, thin) for edge in edges if np.isfinite(edge).all()]
        if truth is not None:
            curves.append((one.x, true[kind], {"label": "truth", "color": "black", "linestyle": ":"}))
        labels = {name: styles.AXES[kind][name] for name in ("xlabel", "ylabel")}
        panels.append(labels | {"curves": curves, "xscale": "log", "yscale": "log"})
    for kind, one in found.items():
        labels = {"xlabel": styles.AXES[kind]["xlabel"], "ylabel": "share that comes back"}
        curves = [(one.x, one.share, {"color": styles.BLUE})]
        panels.append(labels | {"curves": curves, "xscale": "log", "ylim": (0, 1.1)})
    return plotting.lines(panels, size=(4.6, 3))


def corrected_part(found, n_mocks, truth=None):
    """The part of a page on it, a list of HTML."""
    text = (
        f"Each of {n_mocks} mocks was put into the cube and cleaned with it. The spectra are divided by the "
        "share of its power that comes back; thin lines are one error bar, from mocks that are corrected by "
        "each other. They know nothing of foreground that is left: where too few sources are removed, the "
        "corrected spectrum is too high. Where more are removed than the foreground has, its scatter grows."
    )
    table = Table(HEADER if truth is not None else HEADER[:3], corrected_rows(found, truth), align="lrrrr")
    picture, alt = corrected_figure(found, truth), "Corrected spectra and transfer functions"
    return [*page.section("Corrected for what was lost", picture, alt, text), table.html()]


def write_spectra(found, path, truth=None):
    """Write both spectra as CSV, one l or k a line; NaN where something is not known.

    Columns: ``spectrum`` (angular or frequency), ``x`` (l, or k in 1/MHz), ``left`` (mK^2, or mK^2 MHz),
    ``transfer_function``, ``corrected``, ``sigma`` (relative) and ``truth``.
    """
    true = _true(found, truth)
    with open(path, "w", encoding="utf-8") as file:
        print(_COLUMNS, file=file)
        for kind, one in found.items():
            columns = (one.x, one.left, one.share, one.corrected, one.sigma(np.eye(len(one.x))), true[kind])
            for row in np.transpose(columns):
                print(kind, *(f"{value:.8g}" for value in row), sep=",", file=file)
