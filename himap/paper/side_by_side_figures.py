"""Figures of methods side by side: the paper's Figs. 1 and 2 with the range over skies."""

import numpy as np

from himap.errors import InputError
from himap.figures import plotting, styles
from himap.paper.side_by_side import grouped

__all__ = ["labels_of", "side_by_side_figure"]

_WIDTH = 9.3  # inches, of all columns
_INSIDE = (16, 84)  # percentiles over skies: what is shaded


def side_by_side_figure(records, kind, *, corrected=False, methods=None, columns=3):
    """C/C0 or P/P0, mean over skies and the range of two skies in three; a panel for each record and beam.

    Parameters
    ----------
    records
        {title: [`himap.paper.side_by_side.Curve`]}.
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
    for title, rows in records.items():
        found = grouped(rows)
        beams = list(dict.fromkeys(beam for beam, *_ in found))
        labels = labels_of(rows)
        looks = styles.of_methods(dict.fromkeys(labels.values()))
        for beam in beams:
            own = {
                key: several
                for key, several in found.items()
                if key[0] == beam and key[3:] == (corrected, kind) and (methods is None or key[1] in methods)
            }
            curves = [_curve(several, looks[labels[key[:3]]]) for key, several in own.items()]
            texts = [text for text in (title, beam if len(beams) > 1 else "") if text]
            if curves:
                panels.append({"title": ", ".join(texts), "curves": curves, "xlabel": axes["xlabel"]})
    if not panels:
        raise InputError(
            "the records have no such curves: nothing was corrected, or by none of these methods."
        )
    columns = min(columns, len(panels))
    for first in panels[::columns]:
        first["ylabel"] = axes["ratio_label"]
    return plotting.ratios(panels, columns=columns, size=(_WIDTH / columns, 2.9 if columns == 3 else 3.8))


def labels_of(rows):
    """{(beam, method, n_sources): (method, its number as a text)}; such as "3/4/5" where beams differ."""
    numbers = {}
    for beam, method, n_sources, *_ in grouped(rows):
        own = numbers.setdefault(method, {}).setdefault(beam, [])
        if n_sources not in own:
            own.append(n_sources)
    labels = {}
    for method, by_beam in numbers.items():
        for place in range(max(map(len, by_beam.values()))):  # a beam with fewer repeats its last
            several = {beam: own[min(place, len(own) - 1)] for beam, own in by_beam.items()}
            texts = [str(n_sources or "") for n_sources in several.values()]
            text = texts[0] if len(set(texts)) == 1 else "/".join(texts)
            for beam, n_sources in several.items():
                labels.setdefault((beam, method, n_sources), (method, text))
    return labels


def _curve(several, look):
    """(x, mean, low, high, style) of the `Curve` of each sky."""
    ratio = np.array([row.ratio for row in several])
    low, high = np.percentile(ratio, _INSIDE, axis=0)
    return several[0].at, ratio.mean(axis=0), low, high, look
