"""How often what is known of a run of SDecGMCA without the truth says that it failed.

Through the oscillating beam, under each of some readings; members of an ensemble differ in their start.
"""

from himap.paper import cleaned
from himap.paper.claims.base import mean_error
from himap.paper.experiments.claims import judged_skies, realisations
from himap.paper.readings import find_reading
from himap.paper.record import Experiment
from himap.paper.restarts import FLAGS, flag_table
from himap.store.store import product

READINGS = ("default", "code", "follow-up")
"""Readings of SDecGMCA that are measured: they fail in different ways, and not equally often."""

COLUMNS = {"reading": str, "restart": int, "quantity": str, "value": float}
"""{column: type}; quantities are "mean error", |C/C0 - 1| at 10 < l < 200, and those of `FLAGS`."""


def skies(*, n_restarts=8, **settings):
    """A list of `JudgedSky`, each with `n_restarts` of every reading; other parameters as of
    `himap.paper.experiments.claims.realisations`.
    """
    several = realisations(n_sources_min=2, n_sources_max=2, **settings)  # no scan
    return judged_skies(several, [find_reading(label) for label in READINGS], n_restarts)


@product(name="measured_flags")
def measure(sky):
    """Rows with `COLUMNS` of every member on a `JudgedSky`."""
    rows = []
    for reading, members in sky.realisations.items():
        calls = [member.calls("oscillating")["sdecgmca"][:3] for member in members]
        for restart, (call, values) in enumerate(zip(calls, cleaned.ensemble(calls).values, strict=True)):
            known = cleaned.separation(*call).diagnostics | values
            known["mean error"] = mean_error(cleaned.compared(*call))
            first = {"reading": reading, "restart": restart}
            rows += [
                first | {"quantity": name, "value": float(known[name])} for name in ("mean error", *FLAGS)
            ]
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
