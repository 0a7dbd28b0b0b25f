"""The numbers of a figure to play with, as its script reads them: from the CSV of the notebook, and from what
is stored of the paper's size. Nothing is measured here.

A figure has views (size and Galaxy, or noise level), a view has panels (beam, or direction), a panel has
curves: {"label", "color", "dash", "width", "y"} over one "x", with `None` where a curve has no point.
"""

import math
import re

from matplotlib.colors import to_hex

TRUTH = "HI + noise"
OWN = ": truth"  # ends the label of the truth that a curve brings
_SIGNS = {
    r"$C_\ell$": "C(ℓ)",
    r"$P(k_\nu)$": "P(k)",
    r"$k_\nu$": "k",
    r"\ell": "ℓ",
    "n_s": "nₛ",
    r"$^{-1}$": "⁻¹",
    r"$^2$": "²",
    "C_0": "C₀",
    "P_0": "P₀",
    "$": "",
}
_LINES = {"-": (), "--": (3.7, 1.6), "-.": (6.4, 1.6, 1, 1.6), ":": (1, 1.65)}  # in widths, as matplotlib


def plain(text):
    r"""A label without LaTeX.

    >>> plain(r"$C_\ell$ [mK$^2$]"), plain(r"SDecGMCA, $P(k_\nu)$ alone"), plain("$n_s$ = 5")
    ('C(ℓ) [mK²]', 'SDecGMCA, P(k) alone', 'nₛ = 5')
    """
    for sign, said in _SIGNS.items():
        text = text.replace(sign, said)
    return text.removeprefix("_")


def of_notebook(figure):
    """{panel: [(label, {x: y})]} of a `Figure`."""
    return {
        panel: [(label, dict(points)) for label, points in curves.items()]
        for panel, curves in figure.curves.items()
    }


def of_stored(row):
    """The same of a figure that is stored."""
    return {
        panel: [
            (label, dict(zip(group["x"], ys, strict=True)))
            for group in groups
            for label, ys in group["y"].items()
        ]
        for panel, groups in row["panels"].items()
    }


_OF_ENSEMBLE = re.compile(r": (\d+ %|restart \d+)$").search


def size_and_galaxy(parameters):
    """What a view is called: ``quick, synthetic Galaxy``."""
    galaxy = parameters.get("galaxy", "synthetic")
    return f"{parameters.get('preset', 'quick')}, {galaxy} Galaxy"


def medians(curves):
    """Of [(label, points)] those of ensembles by their medians alone, with the label before its remarks."""
    kept = [(label.removesuffix(": median"), points) for label, points in curves if not _OF_ENSEMBLE(label)]
    return [(re.sub(r" \(\d+ of \d+ failed\)$", "", label), points) for label, points in kept]


def view(label, panels, looks, kind=None):
    """One view of a figure.

    Parameters
    ----------
    label
        What it is called.
    panels
        {title: [(label, {x: y})]}.
    looks
        Function from the labels of a panel to {label: style}, styles as `himap.figures.styles` has them.
    kind
        Function from a title to "angular" or "frequency" where curves come with their ratio to the truth.
    """
    return {
        "label": label,
        "panels": [_panel(title, curves, looks, kind and kind(title)) for title, curves in panels.items()],
    }


def _panel(title, curves, looks, kind):
    named, shown = dict(curves), []
    xs = sorted({x for _, points in curves for x in points if x > 0})
    drawn = {label: points for label, points in curves if not label.endswith(OWN)}
    styled = looks(list(drawn))
    for label, points in drawn.items():
        one = {"label": plain(label), **_look(styled[label])}
        one["y"] = [_number(points.get(x)) for x in xs]
        if kind and label != TRUTH:
            one["ratio"] = _ratio(label, kind, named, xs)
        shown.append(one)
    return {"title": plain(title), "x": [float(f"{x:.5g}") for x in xs], "curves": shown}


def _ratio(label, kind, named, xs):
    """Over the truth, or None where the truth that this curve is divided by is not among the numbers.

    A curve that brings its own is divided by that. Else a masked sky has another one, and so had P(k) of
    SDecGMCA in figures that were stored before it was shown as an ensemble, where it ended at some l.
    """
    method, ensemble, _ = label.partition(", median of ")
    masked = any(other.partition(", median of ")[0].endswith(f"{method}, whole sky") for other in named)
    cut = kind == "frequency" and not ensemble and label.startswith(("SDecGMCA", "_SDecGMCA", "$n_s$"))
    truth = named.get(label + OWN, None if masked or cut else named[TRUTH])
    if truth is None:
        return None
    points = named[label]
    return [_number(points[x] / truth[x]) if points.get(x) and truth.get(x) else None for x in xs]


def _number(value):
    """Five digits; None for what is no number."""
    return float(f"{value:.5g}") if value is not None and math.isfinite(value) else None


def _look(style):
    """Colour, dashes in pixels and width of a style, for the script."""
    width = style.get("linewidth", 1.5)
    line = style.get("linestyle", "-")
    dash = _LINES[line] if isinstance(line, str) and line in _LINES else () if line == "none" else line[1]
    look = {"color": to_hex(style.get("color", "black")), "width": width}
    look["dash"] = [round(max(width, 1.5) * part, 1) for part in dash]
    if "marker" in style:
        look["points"] = True
    return look
