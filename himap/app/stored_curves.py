"""Curves of the stored figures of the paper, to draw them once more."""

import numpy as np

from himap.app.stored import stored_figure
from himap.figures import styles

_TRUTH = "HI + noise"
_TOP = 200  # the largest l that is shown


def stored_curves(folder, figure, results=None):
    """The curves of one stored figure, {panel: {label: (x, y)}}.

    Parameters
    ----------
    folder
        Name in the folder of results, such as "paper_templates".
    figure
        Name of the figure, such as "fig-results-angular".
    results
        As the folder of `himap.app.stored.read_stored`.

    Raises
    ------
    InputError
        No such folder or figure.
    """
    row = stored_figure(folder, figure, results)
    return {
        panel: {
            label: (np.array(group["x"]), np.array(y)) for group in groups for label, y in group["y"].items()
        }
        for panel, groups in row["panels"].items()
    }


def angular_ratios(curves, **settings):
    """A panel of `himap.figures.plotting.ratios`: C/C0 of all methods among some curves, 2 <= l <= 200.

    Not for P(k): a method that ends at some l is compared there with a truth that ends there, which is not
    among the curves. C_l has no such other truth.

    Parameters
    ----------
    curves
        {label: (l, C_l)} of one panel of a figure, as of `stored_curves`.
    settings
        Of the panel, such as its title.
    """
    at, true = curves[_TRUTH]
    drawn = []
    for look in styles.METHOD_STYLES.values():
        if look["label"] in curves:
            degrees, power = curves[look["label"]]
            shown = (degrees >= 2) & (degrees <= _TOP)
            ratio = (power / true[np.searchsorted(at, degrees)])[shown]
            drawn.append((degrees[shown], ratio, ratio, ratio, look))
    return {"curves": drawn, "xlabel": styles.AXES["angular"]["xlabel"]} | settings
