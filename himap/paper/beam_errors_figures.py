"""Figures of what it costs a method to be told a wrong beam."""

import numpy as np

from himap.figures import plotting, styles
from himap.paper.beam_errors import KINDS, by_error, most_excess

__all__ = ["errors_figure"]

_MARKERS = "os^Dv"
_LIMITS = (1e-3, 1e2)
_FEW = 0.01


def errors_figure(rows, *, kinds=None, columns=2):
    """What is left of foreground by the error of the beam: one panel for each kind, one curve a method.

    Parameters
    ----------
    rows
        `himap.paper.beam_errors.BeamError`, of one sky or more.
    kinds
        Which, in which order; all that the rows have, but for other beams, unless given.
    columns
        Of panels.
    """
    found = {key: most_excess(means) for key, means in by_error(rows).items()}
    wrong = {kind for *_, kind, error in found if error}
    kinds = [kind for kind in KINDS if kind in wrong and kind != "beam"] if kinds is None else kinds
    looks = _looks(dict.fromkeys(key[:2] for key in found))
    panels = [_panel(found, looks, kind) for kind in kinds]
    return plotting.lines(panels, columns=min(columns, len(panels)), size=(4.6, 3.4), legend_above=True)


def _looks(methods):
    """{method: style}, with a marker each."""
    looks = styles.of_methods(methods)
    return {
        key: look | {"marker": _MARKERS[n % len(_MARKERS)]} for n, (key, look) in enumerate(looks.items())
    }


def _panel(found, looks, kind):
    errors = sorted({error for *_, name, error in found if name == kind and error})
    ends = [errors[0] / 1.5, errors[-1] * 1.5]
    curves = [(ends, [_FEW, _FEW], {"color": "0.75", "linewidth": 0.8})]
    for method, look in looks.items():
        blind = found.get((*method, "none", 0.0))
        if blind is None:
            values = [found.get((*method, kind, error), np.nan) for error in errors]
            curves.append((errors, values, look | {"markersize": 4}))
        else:
            curves.append((ends, [blind, blind], look | {"marker": "", "linewidth": 1}))
    return {
        "curves": curves,
        "xscale": "log",
        "yscale": "log",
        "xlim": ends,
        "ylim": _LIMITS,
        "xlabel": KINDS[kind],
        "ylabel": "foreground left / (HI + noise)",
    }
