"""How often flags of a run of SDecGMCA that do not need the truth correctly predict its failure.

For the oscillating beam, with several readings; members of an ensemble differ in their start.
"""

import itertools

from himap.paper import cleaned, pipeline
from himap.paper.claims.base import mean_error
from himap.paper.experiments.claims import judged_skies, realisations
from himap.paper.readings import find_reading
from himap.paper.record import Experiment
from himap.paper.restarts import FLAGS, flag_table
from himap.store.store import product, temporary

READINGS = ("default", "code", "follow-up")
"""Measured readings of SDecGMCA: they fail in different ways, and not equally often."""

COLUMNS = {"reading": str, "restart": int, "quantity": str, "value": float}
"""{column: type}; quantities are "mean error", |C/C0 - 1| at 10 < l < 200, and those of `FLAGS`."""


def skies(*, n_restarts=8, **settings):
    """A list of `JudgedSky`, each with `n_restarts` of every reading; other parameters as in
    `himap.paper.experiments.claims.realisations`.
    """
    several = realisations(n_sources_min=2, n_sources_max=2, **settings)  # no scan
    return judged_skies(several, [find_reading(label) for label in READINGS], n_restarts)


@product(name="measured_flags")
def measure(sky):
    """Rows with `COLUMNS` for every member on a `JudgedSky`."""
    calls = {
        reading: [member.calls("oscillating")["sdecgmca"] for member in members]
        for reading, members in sky.realisations.items()
    }
    every = list(itertools.chain(*calls.values()))
    with temporary(*pipeline.OF_SKIES, *pipeline.OF_CASES, cleaned.fit, cleaned.separation):
        cleaned.make([(made, call) for made in (cleaned.separation, cleaned.assessment) for call in every])
        return [{"reading": label} | row for label, one in calls.items() for row in ensemble_rows(one)]


def ensemble_rows(calls):
    """The columns restart, quantity and value for an ensemble, arguments of `cleaned.separation`."""
    rows = []
    for restart, (call, values) in enumerate(zip(calls, cleaned.ensemble(calls).values, strict=True)):
        known = cleaned.separation(*call).diagnostics | values
        known["mean error"] = mean_error(cleaned.compared(*call))
        several = ((name, float(known[name])) for name in ("mean error", *FLAGS))
        rows += [{"restart": restart, "quantity": name, "value": value} for name, value in several]
    return rows


EXPERIMENT = Experiment(
    name="flags",
    chapter="15_claims",
    columns=COLUMNS,
    key=("reading", "restart", "quantity"),
    skies=skies,
    measure=measure,
    summary=lambda rows: flag_table(rows).map(str),
    defaults={"preset": "ci", "n_realisations": 3, "n_restarts": 8},
    without=("reading", "method", "n_sources_min", "n_sources_max", "average", "polynomial"),
)
