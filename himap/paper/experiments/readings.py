"""Every claim, and both spectra, under each reading of what the paper leaves open about SDecGMCA.

Each reading is judged on the same skies, and through the oscillating beam at noise levels a thousandth apart,
which should change nothing of account.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from himap.maps import sphere
from himap.measures.diagnostics import BUMP
from himap.paper import readings_table
from himap.paper.claims.base import angular_deviation, angular_error, bump
from himap.paper.claims.entries import finding_rows
from himap.paper.experiments.claims import NUDGES, judge, realisations
from himap.paper.readings import BANDS, COLUMNS, CURVES, NEAR_PLANE, outcomes, readings
from himap.paper.realisation import make
from himap.paper.record import Experiment

_N_BINS = 40  # of a curve, at most
_EDGE = 200  # of l that the paper recovers


@dataclass(frozen=True)
class ReadSky:
    """One sky, with SDecGMCA under every reading.

    Attributes
    ----------
    judged
        {label of a reading: `Realisation`}.
    nudged
        {label: [`Realisation` at another noise level]}, of which only the oscillating beam is needed.
    """

    judged: dict
    nudged: dict

    @property
    def survey(self):
        return next(iter(self.judged.values())).survey

    @property
    def galaxy(self):
        return next(iter(self.judged.values())).galaxy


def skies(**settings):
    """A list of `ReadSky`; parameters as of `himap.paper.experiments.claims.realisations`."""
    found = []
    for sky in realisations(**settings):
        judged = {label: replace(sky, options=reading.options) for label, reading in readings().items()}
        nudged = {label: [replace(one, noise_level=n) for n in NUDGES] for label, one in judged.items()}
        found.append(ReadSky(judged, nudged))
    return found


def _prepare(several):
    """Readings of one sky share its observations, which are deleted, and the results of other methods."""
    make(
        [one for sky in several for one in sky.judged.values()],
        only_oscillating=[one for sky in several for levels in sky.nudged.values() for one in levels],
    )


def measure(sky):
    """Claims and ratios under every reading on a `ReadSky`, rows with `himap.paper.readings.COLUMNS`."""
    _prepare([sky])
    rows = []
    for label, realisation in sky.judged.items():
        rows += [
            _row(label, 1.0, row["claim"], **{name: row[name] for name in ("value", "part", "main", "held")})
            for row in finding_rows(judge(realisation), 1.0)
        ]
        for one in (realisation, *sky.nudged[label]):
            rows += [
                _row(label, one.noise_level, quantity, value, x)
                for quantity, values in _run(one).items()
                for x, value in values
            ]
    return rows


def _row(reading, noise_level, quantity, value, x=math.nan, part=None, main=None, held=None):
    values = (reading, noise_level, quantity, x, value, part, main, held)
    return dict(zip(COLUMNS, values, strict=True))


def _run(realisation):
    """{quantity: [(x, value)]} of SDecGMCA on the oscillating case of a `Realisation`."""
    assessed, comparison = realisation.assessed("sdecgmca"), realisation.of("oscillating")["sdecgmca"]
    flagged = realisation.flagged("sdecgmca")
    near = np.abs(sphere.pixel_latitude(realisation.survey.nside)[flagged]) < NEAR_PLANE
    curves = {
        "C/C0": (comparison.degrees, comparison.angular_ratio),
        "P/P0": (comparison.k, comparison.frequency_ratio),
    }
    k = comparison.k
    numbers = {
        **_band_means(curves),
        "bump": bump(comparison) if ((k > BUMP[0]) & (k < BUMP[1])).any() else math.nan,
        "mean error": angular_error(10, _EDGE)(comparison),
        "largest error": angular_deviation(10, _EDGE)(comparison),
        "flagged": flagged.mean(),
        "near the plane": near.mean() if len(near) else math.nan,
        "iterations": assessed.n_iterations,
        "converged": assessed.converged,
    }
    single = {name: [(math.nan, float(value))] for name, value in numbers.items()}
    return single | {name: _binned(*curves[name]) for name in CURVES}


def _band_means(curves):
    """{band: mean of the ratio in it}, of the bands that hold some values."""
    found = {}
    for name, (curve, low, high) in BANDS.items():
        x, values = curves[curve]
        inside = values[(x > low) & (x < high)]
        if len(inside):
            found[name] = inside.mean()
    return found


def _binned(x, values):
    """Means of both in logarithmic bins of x, pairs, without the bins that are empty."""
    place = np.floor(np.log(x / x[0]) / np.log(x[-1] / x[0]) * _N_BINS * (1 - 1e-9)).astype(int)
    bins = [place == n for n in np.unique(place)]
    return [(float(x[one].mean()), float(values[one].mean())) for one in bins]


def _summary(rows):
    found = readings_table.plain_rows(outcomes(rows))
    return pd.DataFrame(found, columns=readings_table.HEADER)


EXPERIMENT = Experiment(
    name="readings",
    chapter="15_claims",
    columns=COLUMNS,
    key=("reading", "noise_level", "quantity"),
    skies=skies,
    measure=measure,
    summary=_summary,
    prepare=_prepare,
    defaults={"preset": "quick", "n_realisations": 2, "n_sources_max": 12},
    without=("reading", "method", "nudged"),  # they are what is varied, or always so
    stated=("n_realisations", "n_sources_max"),
)
