"""The numbers of a figure to play with, as its script reads them: from the CSV of the notebook, and from what
is stored of the paper's size. Nothing is measured here.

A figure has views (size and Galaxy, or noise level), a view has panels (beam, or direction), a panel has
curves: {"label", "color", "dash", "width", "y"} over one "x", with `None` where a curve has no point. Where a
curve has several points at one x, this x is as often in "x", and others repeat their last point there. An
ensemble is one curve, its median, with a "spread": the ends of its band, and its members. "ratio" and
"ratio_spread" are the same over the truth.
"""

import math
import re
from collections import Counter

import numpy as np
from matplotlib.colors import to_hex

TRUTH = "HI + noise"
_BAND = ("16 %", "84 %")
_PARTS = re.compile(r"(?P<name>.*?)(?P<own>: truth)?(?:: (?P<part>\d+ %|median|restart \d+))?")
"""Of a label: the truth that a curve brings ends with OWN, parts of an ensemble with what they are."""
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
    return text


def of_notebook(figure):
    """{panel: [(label, [(x, y)])]} of a `Figure`."""
    return {panel: list(curves.items()) for panel, curves in figure.curves.items()}


def of_stored(row):
    """The same of a figure that is stored."""
    return {
        panel: [
            (label, list(zip(group["x"], ys, strict=True)))
            for group in groups
            for label, ys in group["y"].items()
        ]
        for panel, groups in row["panels"].items()
    }


def medians(curves):
    """Of [(label, points)] those of ensembles by their medians alone, with the label before its remarks."""
    return [
        (re.sub(r" \(\d+ of \d+ failed\)", "", label).removesuffix(": median"), points)
        for label, points in curves
        if _parts(label)[2] in (None, "median")
    ]


def view(label, panels, looks, with_ratios=False):
    """One view of a figure, of panels {title: [(label, [(x, y)])]}, with ratios to the truth or not.

    The function `looks` is from the labels of a panel to {label: style}, as `himap.figures.styles` has them.
    """
    shown = [_panel(title, curves, looks, with_ratios) for title, curves in panels.items()]
    return {"label": label, "panels": shown}


def _panel(title, curves, looks, with_ratios):
    several, shown, times = {}, [], Counter()
    for label, points in curves:
        name, is_truth, part = _parts(label)
        several.setdefault(name, {})[is_truth, part] = points
        times |= Counter(x for x, _ in points if x > 0)
    xs = sorted(times.elements())
    styled = looks(list(several))
    for name, parts in several.items():
        one = {"label": plain(name), **_look(styled[name])}
        one["y"], one["spread"] = _values(parts, xs)
        if with_ratios and name != TRUTH:
            one["ratio"], one["ratio_spread"] = _values(parts, xs, several[TRUTH][False, None])
        shown.append(one)
    return {"title": plain(title), "x": [float(f"{x:.5g}") for x in xs], "curves": shown}


def _parts(label):
    """Name of a curve, whether this is the truth that it brings, and which part of an ensemble or None."""
    found = _PARTS.fullmatch(label)
    return found["name"], bool(found["own"]), found["part"]


def _values(parts, xs, truth=None):
    """A curve or the median of an ensemble at some x, and the spread [low, high, *members], or none.

    Of {(is_truth, part): [(x, y)]}. Where `truth` is given, each over the truth that it brings, or over that.
    """
    found = {}
    for (is_truth, part), points in parts.items():
        if not is_truth:
            below = parts.get((True, part), truth)
            found[part] = _at(points, xs) if truth is None else _at(points, xs) / _at(below, xs)
    members = [ys for part, ys in found.items() if part and part.startswith("restart")]
    if members and truth is not None:  # not the ratios of percentiles
        percentiles = np.percentile(members, [float(part.partition(" ")[0]) for part in _BAND], axis=0)
        found |= dict(zip(_BAND, percentiles, strict=True)) | {"median": np.median(members, axis=0)}
    spread = [*(found[part] for part in _BAND), *members] if members else []
    middle = found["median"] if members else found[None]
    return [*map(_number, middle)], [[*map(_number, ys)] for ys in spread]


def _at(points, xs):
    """Values at ascending `xs`: of one that is there more than once, those of its points in turn."""
    found = {}
    for x, y in points:
        found.setdefault(x, []).append(y)
    turns = np.arange(len(xs)) - np.searchsorted(xs, xs)
    several = (found.get(x, [math.nan]) for x in xs)
    return np.array([ys[min(turn, len(ys) - 1)] for turn, ys in zip(turns, several, strict=True)])


def _number(value):
    """Five digits; None for what is no number."""
    return float(f"{value:.5g}") if math.isfinite(value) else None


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
