"""How often what is known of a run of SDecGMCA without the truth says that it failed.

Through the oscillating beam, under each of some readings; members of an ensemble differ in their start.
"""

from himap.measures.diagnostics import Comparison
from himap.paper import cleaned, pipeline
from himap.paper.claims.base import angular_band
from himap.paper.experiments.claims import judged_skies, realisations
from himap.paper.record import Experiment
from himap.paper.restarts import FLAGS, flag_table

READINGS = ("letter", "code", "default")
"""Readings of SDecGMCA that are measured: they fail in different ways, and not equally often."""

_EDGE = 200  # of l that the paper recovers

COLUMNS = {"reading": str, "restart": int, "quantity": str, "value": float}
"""{column: type}; quantities are "mean error", |C/C0 - 1| at 10 < l < 200, and those of `FLAGS`."""


def skies(*, n_restarts=8, **settings):
    """A list of `JudgedSky`, each with `n_restarts` of every reading; other parameters as of
    `himap.paper.experiments.claims.realisations`.
    """
    several = realisations(n_sources_min=2, n_sources_max=2, **settings)  # no scan
    return judged_skies(several, {name: (("reading", name),) for name in READINGS}, n_restarts)


def measure(sky):
    """Rows with `COLUMNS` of every member on a `JudgedSky`."""
    rows = []
    for reading, members in sky.realisations.items():
        calls = [member.calls("oscillating")["sdecgmca"][:3] for member in members]
        for restart, (call, values) in enumerate(zip(calls, cleaned.ensemble(calls).values, strict=True)):
            known = {"mean error": error_of(call), **cleaned.separation(*call).diagnostics, **values}
            first = {"reading": reading, "restart": restart}
            rows += [
                first | {"quantity": name, "value": float(known[name])} for name in ("mean error", *FLAGS)
            ]
    return rows


def error_of(call):
    """Mean |C/C0 - 1| at 10 < l < 200 of arguments of `cleaned.assessment`."""
    truth, l_top = pipeline.true_spectra(call[0]), 2 * call[0].survey.nside
    comparison = Comparison.of(cleaned.assessment(*call).power_spectra, truth, l_top=l_top)
    return angular_band("error", 10, _EDGE)(comparison)


EXPERIMENT = Experiment(
    name="flags",
    chapter="15_claims",
    columns=COLUMNS,
    key=("reading", "restart", "quantity"),
    skies=skies,
    measure=measure,
    summary=lambda rows: flag_table(rows).map(str),
    defaults={"preset": "ci", "n_realisations": 3, "n_restarts": 8},
    without=("reading", "method", "n_sources_min", "n_sources_max"),
    stated=("n_realisations", "n_restarts"),
)
