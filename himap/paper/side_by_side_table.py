"""The table of methods side by side: how far each is from the truth in its worst band, through every beam."""

import numpy as np

from himap.figures import styles
from himap.measures.transfer import JUDGED
from himap.paper.side_by_side import band_means, furthest
from himap.paper.side_by_side_figures import labels_of

__all__ = ["distance", "overview", "signed"]


def distance(records, beam, method, n_sources, *, corrected=False, of=JUDGED):
    """How far the mean over skies of the worst band is from 1, of the record where that is most; signed.

    Parameters
    ----------
    records
        Lists of `himap.paper.side_by_side.Curve`, one for each Galaxy.
    beam, method, n_sources, corrected
        As of a `Curve`.
    of
        Names of the bands that are judged.

    Returns
    -------
    float
        Below 0 where power is missing; nan if no record has it.
    """
    found = [
        furthest(bands, of)[1] - 1
        for rows in records
        for key, bands in band_means(rows).items()
        if key == (beam, method, n_sources, corrected)
    ]
    return max(found, key=abs, default=np.nan)


def signed(value):
    """A `distance` as a text, in percent."""
    if np.isnan(value):
        return "–"
    percent = 100 * value
    digits = 0 if abs(percent) >= 10 else 1
    return f"{percent:+.{digits}f}\N{NO-BREAK SPACE}%".replace("-", "−")


def overview(records, *, of=JUDGED):
    """(header, rows) of texts: each method, as it leaves each beam and corrected; as `distance`."""
    labels = labels_of(records[0])
    beams = list(dict.fromkeys(beam for beam, *_ in labels))
    rows = []
    for label in dict.fromkeys(labels.values()):
        numbers = _numbers(label, beams)
        cells = [
            signed(distance(records, beam, label[0], n, corrected=corrected, of=of))
            for corrected in (False, True)
            for beam, n in zip(beams, numbers, strict=True)
        ]
        rows.append((styles.numbered(*label), *cells))
    return ["method", *beams, *(f"{beam}, corrected" for beam in beams)], rows


def _numbers(label, beams):
    """The number of sources for each beam, of a label of `labels_of`."""
    numbers = [int(text or 0) for text in label[1].split("/")]
    return numbers * len(beams) if len(numbers) == 1 else numbers
