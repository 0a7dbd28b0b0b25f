"""Every claim, and both spectra, under each reading of the open choices of SDecGMCA.

Each reading is judged on the same skies, and through the oscillating beam at noise levels a thousandth apart,
which should change nothing of account.
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from himap.maps import sphere
from himap.measures.diagnostics import BUMP
from himap.paper.claims.base import angular_band, bump
from himap.paper.claims.entries import finding_rows
from himap.paper.experiments.claims import NUDGES, JudgedSky, judge, realisations
from himap.paper.readings import BANDS, COLUMNS, CURVES, NEAR_PLANE, outcomes, readings
from himap.paper.readings_table import summary_table
from himap.paper.realisation import make
from himap.paper.record import Experiment

_N_BINS = 40  # of a curve, at most
_EDGE = 200  # of l that the paper recovers


def skies(**settings):
    """A list of `JudgedSky`; parameters as of `himap.paper.experiments.claims.realisations`."""
    return [
        JudgedSky(
            {
                label: [replace(sky, options=reading.options, noise_level=n) for n in (1.0, *NUDGES)]
                for label, reading in readings().items()
            }
        )
        for sky in realisations(**settings)
    ]


def _prepare(several):
    """Readings of one sky share its observations, which are deleted, and the results of other methods.

    At other noise levels only the oscillating beam is needed.
    """
    every = [levels for sky in several for levels in sky.realisations.values()]
    make([first for first, *_ in every], only_oscillating=[one for _, *others in every for one in others])


def measure(sky):
    """Claims and ratios under every reading on a `JudgedSky`, rows with `himap.paper.readings.COLUMNS`."""
    empty, rows = dict.fromkeys(COLUMNS) | {"x": math.nan}, []
    for label, (judged, *others) in sky.realisations.items():
        for row in finding_rows(judge(judged), 1.0):
            shared = {name: row[name] for name in ("noise_level", "value", "part", "main", "held")}
            rows.append(empty | shared | {"reading": label, "quantity": row["claim"]})
        for one in (judged, *others):
            first = empty | {"reading": label, "noise_level": one.noise_level}
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
    key=("reading", "noise_level", "quantity"),
    skies=skies,
    measure=measure,
    summary=lambda rows: summary_table(outcomes(rows)),
    prepare=_prepare,
    defaults={"preset": "quick", "n_realisations": 2, "n_sources_max": 12},
    without=("reading", "method", "nudged"),  # varied, or always so
    stated=("n_realisations", "n_sources_max"),
)
