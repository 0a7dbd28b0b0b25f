"""Sensitivity of methods to errors of the assumed beam: against the truth, over several skies."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from himap.core.errors import InputError
from himap.instrument.beams import named
from himap.instrument.beams.others import PerturbedBeam
from himap.instrument.beams.paper import Oscillating, Rippled
from himap.measures.diagnostics import JUDGED
from himap.measures.transfer import mock_power
from himap.paper import cleaned, grid, pipeline
from himap.paper.mocks import own_recovery
from himap.paper.record import Experiment
from himap.store.store import product

KINDS = {
    "width": "relative error of the FWHM",
    "ripple": "relative amplitude of an additional ripple of 20 MHz",
    "amplitude": "relative error of the ripple's amplitude",
    "phase": "error of the ripple's phase [rad]",
    "period": "relative error of the ripple's period",
    "beam": "another beam",
}
"""Kinds of errors of the assumed beam."""

COLUMNS = {
    "method": str,
    "n_sources": int,  # 0 for a method without
    "kind": str,  # of the error (`KINDS`), or "none" for a method that does not use the beam
    "error": (float, str),  # its size; the name of the assumed beam for "beam"; 0 for "none"
    "band": str,
    "ratio": float,  # C/C0 or P/P0, averaged over the band, like the next two
    "recovered": float,  # its part that is correlated with the truth
    "excess": float,  # the rest, which is mostly foreground residual
}

_METHOD = ["method", "n_sources", "kind", "error"]

_ERRORS = {
    "width": [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2],
    "ripple": [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3],
    "amplitude": [0.003, 0.01, 0.03, 0.1, 0.3, 1.0],
    "phase": [0.003, 0.01, 0.03, 0.1, 0.3, 1.0],
    "period": [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2],
}


def assumed_beam(beam, kind, error):
    """The `Beam` that a method assumes if the `kind` of `beam` has an error `error`.

    InputError for an unknown kind, an error that is no number, or a ripple if the beam has none.
    """
    if kind == "beam":
        return named(error)
    if kind not in KINDS or isinstance(error, bool) or not isinstance(error, int | float):
        raise InputError(
            f"an error of the beam is one of {', '.join(KINDS)} and a number, got {kind!r} and {error!r}."
        )
    if kind in ("width", "ripple"):
        return PerturbedBeam(beam=str(beam), **{kind: float(error)})
    ripple = Rippled() if beam == Oscillating() else beam
    if not isinstance(ripple, Rippled):
        raise InputError(
            f"the {kind} of a ripple can be wrong of the beams rippled and oscillating, got {beam}."
        )
    true = getattr(ripple, kind)
    return replace(ripple, **{kind: true + error if kind == "phase" else true * (1 + error)})


@product
def recovery_assuming(case, remover, beam):
    """The `MockPower` of the truth for a method that assumes the `Beam` `beam`; peaks are masked.

    A method that needs the noise level uses that of the instrument.
    """
    found = cleaned.cleaning(case, remover).with_beams(beam.of_survey(case.survey).total).separation
    wrong = cleaned.error_of(case, found)
    return mock_power(pipeline.truth_alms(case, found.lmax), wrong, case.survey.channel_width)


def skies(*, errors=_ERRORS, **settings):
    """A list of `Sky` with the assumed beams, always including the true one, as ("width", 0).

    `errors` are {kind: [error]}, as in `assumed_beam`; settings and errors raised are as in
    `cases_and_methods`. Methods that do not use the beam are included for comparison.
    """
    cases, removers = grid.cases_and_methods(**settings)
    beam = cases[0].beam
    beams = {("width", 0.0): beam}
    for kind, several in errors.items():
        if not isinstance(several, list | tuple):
            raise InputError(f"errors of each kind are a list, such as {{'width': [0.01]}}, got {errors!r}.")
        beams |= {(kind, error): assumed_beam(beam, kind, error) for error in several}
    for assumed in beams.values():
        assumed.of_survey(cases[0].survey)  # fails early
    return grid.skies_of((cases, removers), beams=beams)


@product(name="measured_beam_errors")
def measure(sky):
    """Ratios to the truth in each band, for each method and assumed beam of a `Sky`."""
    ((case, removers),) = sky.methods.items()
    work = {}
    for remover in removers:
        if "beams" in remover.uses:
            for key, beam in sky.beams.items():
                work[remover, *key] = recovery_assuming, (case, remover, beam)
        else:
            work[remover, "none", 0.0] = own_recovery, (case, remover)
    grid.make_products(work.values())
    rows = []
    for (remover, kind, error), (measured, call) in work.items():
        power = measured(*call)
        ratio, recovered = power.ratios(), power.ratios("cross")
        excess = {axis: ratio[axis] - recovered[axis] for axis in ratio}
        first = grid.method_columns(remover) | {"kind": kind, "error": error}
        rows += [
            first | row for row in grid.band_rows(power, ratio=ratio, recovered=recovered, excess=excess)
        ]
    return rows


def median_over_skies(table):
    """Medians of ratio, recovered and excess for each method, error and judged band, a DataFrame.

    Medians, not means, because a single failed run of a chaotic method dominates a mean.
    """
    judged = table[table["band"].isin(JUDGED)]
    medians = judged.groupby([*_METHOD, "band"], sort=False)[["ratio", "recovered", "excess"]].median()
    return medians.reset_index()


def worst_excess(table):
    """{(method, n_sources, kind, error): the largest median over skies of the excess in any judged band}."""
    return median_over_skies(table).groupby(_METHOD, sort=False)["excess"].max().to_dict()


def tolerated(table, limit=0.01):
    """Error of each kind up to which the largest excess is at most `limit` above that with the exact beam.

    {(method, n_sources, kind): error}. It is interpolated in logarithms between the tried errors; it is the
    largest one if all are tolerated, and NaN if the smallest is not. For errors of both signs the worse one
    counts.
    """
    excess, curves = worst_excess(table), {}
    for (*method, kind, error), value in excess.items():
        if kind not in ("none", "beam") and error:
            more = value - excess[*method, "width", 0.0]
            known, size = curves.setdefault((*method, kind), {}), abs(error)
            known[size] = max(more, known.get(size, limit / 1e6))
    largest = {}
    for key, more in curves.items():
        errors, values = np.array(sorted(more.items())).T
        above = np.flatnonzero(values > limit)
        if len(above) and above[0]:
            pair = slice(above[0] - 1, above[0] + 1)
            largest[key] = float(np.exp(np.interp(np.log(limit), *np.log([values[pair], errors[pair]]))))
        else:
            largest[key] = math.nan if len(above) else float(errors[-1])
    return largest


def _summary(table):
    """The band furthest from 1 and the band with most excess, for each method and error."""
    medians = median_over_skies(table)
    groups = medians.assign(off=(medians["ratio"] - 1).abs()).groupby(_METHOD, sort=False)
    furthest, most = (medians.loc[groups[name].idxmax()].reset_index() for name in ("off", "excess"))
    columns = {
        "method": grid.with_labels(furthest)["method"],
        "what is wrong": furthest["kind"],
        "by": furthest["error"].map(lambda error: error if isinstance(error, str) else f"{error:g}"),
        "furthest from 1": furthest["ratio"].map("{:.4g}".format),
        "in": furthest["band"],
        "HI recovered": furthest["recovered"].map("{:.3f}".format),
        "most excess": most["excess"].map("{:.2%}".format),
        "excess in": most["band"],
    }
    return pd.DataFrame(columns)


EXPERIMENT = Experiment(
    name="beam_errors",
    chapter="21_beam_errors",
    columns=COLUMNS,
    key=tuple(_METHOD),
    skies=skies,
    measure=measure,
    summary=_summary,
    defaults={
        "errors": _ERRORS,
        "methods": [
            *(["beam_subspace", n] for n in (3, 4, 5, 6)),
            *(["sdecgmca", 5], ["pca", 6], ["pca", 8]),
        ],
    },
    without=("results", "lobes"),
)
