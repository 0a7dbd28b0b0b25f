"""Every claim, and both spectra, under each reading of the open choices of SDecGMCA.

Each reading is judged on the same skies and from the same restarts.
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from himap.maps import sphere
from himap.measures.diagnostics import BUMP
from himap.paper.claims.base import angular_band, bump
from himap.paper.claims.entries import finding_rows
from himap.paper.experiments.claims import JudgedSky, judge, prepare, realisations, restarts
from himap.paper.readings import BANDS, COLUMNS, CURVES, NEAR_PLANE, outcomes, readings
from himap.paper.readings_table import summary_table
from himap.paper.record import Experiment

_N_BINS = 40  # of a curve, at most
_EDGE = 200  # of l that the paper recovers


def skies(*, n_restarts=4, **settings):
    """A list of `JudgedSky`, each with `n_restarts` of every reading; other parameters as of
    `himap.paper.experiments.claims.realisations`.
    """
    return [
        JudgedSky(
            {
                label: restarts(replace(sky, options=reading.options), n_restarts)
                for label, reading in readings().items()
            }
        )
        for sky in realisations(**settings)
    ]


def measure(sky):
    """Claims and ratios under every reading on a `JudgedSky`, rows with `himap.paper.readings.COLUMNS`."""
    empty, rows = dict.fromkeys(COLUMNS) | {"x": math.nan}, []
    for label, several in sky.realisations.items():
        for one in several:
            first = empty | {"reading": label, "restart": one.restart}
            for row in finding_rows(judge(one), one.restart):
                shared = {name: row[name] for name in ("value", "part", "method", "main", "held")}
                rows.append(first | shared | {"quantity": row["claim"]})
            rows += [first | row for row in _ratios(one)]
    return rows


def _ratios(realisation):
    """The columns quantity, x and value of SDecGMCA on the oscillating case of a `Realisation`."""
    assessed, comparison = realisation.assessed("sdecgmca"), realisation.of("oscillating")["sdecgmca"]
    flagged = realisation.flagged("sdecgmca")
    near = np.abs(sphere.pixel_latitude(realisation.survey.nside)[flagged]) < NEAR_PLANE
    k = comparison.k
    curves = dict(
        zip(
            CURVES,
            ((comparison.degrees, comparison.angular_ratio), (k, comparison.frequency_ratio)),
            strict=True,
        )
    )
    inside = {
        band: (curve, (curves[curve][0] > low) & (curves[curve][0] < high))
        for band, (curve, low, high) in BANDS.items()
    }
    numbers = {
        **{band: curves[curve][1][there].mean() for band, (curve, there) in inside.items() if there.any()},
        "bump": bump(comparison) if ((k > BUMP[0]) & (k < BUMP[1])).any() else math.nan,
        "mean error": angular_band("error", 10, _EDGE)(comparison),
        "largest error": angular_band("deviation", 10, _EDGE)(comparison),
        "flagged": flagged.mean(),
        "near the plane": near.mean() if len(near) else math.nan,
        "iterations": assessed.n_iterations,
        "converged": assessed.converged,
    }
    rows = [{"quantity": name, "value": float(value)} for name, value in numbers.items()]
    for name, curve in curves.items():
        rows += [{"quantity": name, "x": x, "value": value} for x, value in _binned(*curve)]
    return rows


def _binned(x, values):
    """Means of both in logarithmic bins of x, pairs, without the bins that are empty."""
    place = np.floor(np.log(x / x[0]) / np.log(x[-1] / x[0]) * _N_BINS * (1 - 1e-9))
    means = pd.DataFrame({"x": x, "value": values}).groupby(place).mean()
    return list(means.itertuples(index=False, name=None))


EXPERIMENT = Experiment(
    name="readings",
    chapter="15_claims",
    columns=COLUMNS,
    key=("reading", "restart", "quantity"),
    skies=skies,
    measure=measure,
    summary=lambda rows: summary_table(outcomes(rows)),
    prepare=prepare,
    defaults={"preset": "quick", "n_realisations": 2, "n_restarts": 4, "n_sources_max": 12},
    without=("reading", "method"),  # varied, or always so
    stated=("n_realisations", "n_restarts", "n_sources_max"),
)
