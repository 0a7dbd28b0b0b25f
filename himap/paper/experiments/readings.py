"""Every claim, and both spectra, under each reading of the open choices of SDecGMCA.

Each reading is judged on the same skies and with the same restarts.
"""

import math

from himap.paper.experiments.claims import judged_skies, other_restarts, prepare, realisations
from himap.paper.experiments.restarts import claim_rows, member_rows
from himap.paper.readings import COLUMNS, outcomes, readings
from himap.paper.readings_table import summary_table
from himap.paper.record import Experiment
from himap.store.store import product


def skies(*, n_restarts=4, **settings):
    """A list of `JudgedSky`, each with `n_restarts` of every reading; other parameters as in
    `himap.paper.experiments.claims.realisations`.
    """
    return judged_skies(realisations(**settings), readings().values(), n_restarts)


@product(name="measured_readings")
def measure(sky):
    """Claims and ratios under every reading on a `JudgedSky`, rows with `himap.paper.readings.COLUMNS`."""
    empty, rows = dict.fromkeys(COLUMNS) | {"x": math.nan}, []
    for label, several in sky.realisations.items():
        for one in several:
            first = empty | {"reading": label, "restart": one.restart}
            call = one.calls("oscillating")["sdecgmca"]
            rows += [first | row for row in claim_rows(one) + member_rows(call)]
    return rows


EXPERIMENT = Experiment(
    name="readings",
    chapter="15_claims",
    columns=COLUMNS,
    key=("reading", "restart", "quantity"),
    skies=skies,
    measure=measure,
    summary=lambda rows: summary_table(outcomes(rows)),
    prepare=prepare,
    other_restarts=other_restarts,
    defaults={"preset": "quick", "n_realisations": 2, "n_restarts": 4, "n_sources_max": 12},
    without=("reading", "method", "average", "polynomial"),  # varied, or always so
    stated=("n_sources_max",),
)
