"""SDecGMCA as an ensemble: skies x restarts x readings, with each beam and other numbers of sources.

A member is a sky and a restart. Its rows have both spectra over the truth, diagnostics of the iteration, and
every claim. Readings that differ only in the last S share the fit of A.
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from himap.measures.diagnostics import BUMP, band_means
from himap.paper import cleaned
from himap.paper.claims.base import BEAMS, angular_band, bump, mean_error
from himap.paper.claims.entries import finding_rows
from himap.paper.ensembles import failures
from himap.paper.experiments.claims import judge, judged_skies, other_restarts, prepare, realisations
from himap.paper.readings import BANDS, COLUMNS, candidates, find_reading, flagged_shares
from himap.paper.record import Experiment
from himap.store.store import product

_N_BINS = 40  # largest number of bins of a curve
_SPARSE = (10, 15, 20)  # numbers of sources beyond 8

CASES = (*BEAMS, "dimmed")
"""Observations for which members are measured."""

SCAN = "scan"
"""Case of the scan of numbers of sources, Table 1's among them, through the oscillating beam."""


def skies(*, n_restarts=8, reading="all", n_sources_min=2, n_sources_max=20, **settings):
    """A list of `JudgedSky`, each with `n_restarts` of a reading, or of every candidate for "all".

    The scan has each number of sources up to 8, then 10, 15 and 20; if it includes none of these, the
    smallest. Settings and errors raised are as in `himap.paper.experiments.claims.realisations`.
    """
    whole = realisations(n_sources_min=n_sources_min, n_sources_max=n_sources_max, **settings)
    every = whole[0].n_sources
    scan = tuple(n for n in every if n <= 8 or n in _SPARSE) or every[:1]
    several = candidates().values() if reading == "all" else [find_reading(reading)]
    return judged_skies([replace(sky, n_sources=scan) for sky in whole], several, n_restarts)


@product(name="measured_restarts")
def measure(sky):
    """Claims and numbers of every member on a `JudgedSky`, rows with the columns of a record.

    For a single reading there are also curves and the scan; for many readings, only the mean error for the
    other beams, so that a record stays small.
    """
    empty, rows = dict.fromkeys(EXPERIMENT.columns) | {"n_sources": 0, "x": math.nan}, []
    single = len(sky.realisations) == 1
    for label, members in sky.realisations.items():
        for member in members:
            first = empty | {"reading": label}
            rows += [first | row for row in claim_rows(member)]
            shown = [(case, member.calls(case)["sdecgmca"]) for case in CASES]
            shown += [(SCAN, call) for call in member.scan_calls().values()] if single else []
            for case, call in shown:
                run = first | {"case": case, "n_sources": call[1].n_sources, "restart": member.restart}
                for row in member_rows(call, masks=case == "oscillating"):
                    few = row["quantity"] == "mean error" or (case == "oscillating" and "x" not in row)
                    rows += [run | row] if single or few else []
    return rows


def claim_rows(member):
    """Claims on a `Realisation`, with their ids as quantity: rows without other columns of a record."""
    names = ("restart", "value", "part", "method", "main", "held")
    return [
        {name: row[name] for name in names} | {"quantity": row["claim"]}
        for row in finding_rows(judge(member), member.restart)
    ]


def member_rows(call, *, masks=False):
    """The columns quantity, x and value for SDecGMCA, a list of dicts; `call` as for `cleaned.assessment`.

    With `masks` there are also curves without the flagged lines of sight, and the correlation.
    """
    result, comparison = cleaned.assessment(*call), cleaned.compared(*call)
    k = comparison.k
    numbers = {
        **band_means(comparison.ratios, comparison.degrees, k, BANDS, complete=False),
        "bump": bump(comparison) if ((k > BUMP[0]) & (k < BUMP[1])).any() else math.nan,
        "mean error": mean_error(comparison),
        "largest error": angular_band("deviation", 10, 200)(comparison),
        "total error": comparison.total_error(),
        **flagged_shares(result.line_errors),
        "iterations": result.n_iterations,
        "converged": result.converged,
        **(result.diagnostics or {}),
    }
    curves = {"C/C0": (comparison.degrees, comparison.angular_ratio), "P/P0": (k, comparison.frequency_ratio)}
    if masks:
        masked = cleaned.compared(*call, masked=True)
        curves["C/C0, masked"] = masked.degrees, masked.angular_ratio
        curves["P/P0, masked"] = masked.k, masked.frequency_ratio
        curves["r"] = call[0].survey.freqs, result.correlation
    rows = [{"quantity": name, "value": float(value)} for name, value in numbers.items()]
    for name, curve in curves.items():
        rows += [{"quantity": name, "x": x, "value": value} for x, value in _binned(*curve)]
    return rows


def _binned(x, values):
    """Means of both in logarithmic bins of x, pairs, without empty bins."""
    place = np.floor(np.log(x / x[0]) / np.log(x[-1] / x[0]) * _N_BINS * (1 - 1e-9))
    means = pd.DataFrame({"x": x, "value": values}).groupby(place).mean()
    return list(means.itertuples(index=False, name=None))


def _summary(rows):
    """For each reading, case and number of sources, the count of failures and medians of some numbers."""
    shown = ("mean error", "C/C0, 2 to 4", "P/P0, k < 0.03", "bump", "flagged", "condition")
    numbers = rows[rows["quantity"].isin(shown)]
    run, failed = ["reading", "case", "n_sources"], failures(rows)
    table = numbers.pivot_table("value", run, "quantity", "median", sort=False)
    table = table.reindex(pd.MultiIndex.from_frame(failed[run]))  # there is no row if no number is finite
    table.insert(0, "failed", [f"{one.failed} of {one.members}" for one in failed.itertuples()])
    texts = table.reset_index().map(lambda value: f"{value:.3g}" if isinstance(value, float) else str(value))
    return texts.replace("nan", "–")  # not measured for many readings


EXPERIMENT = Experiment(
    name="restarts",
    chapter="15_claims",
    columns={"case": str, "n_sources": int} | COLUMNS,
    key=("reading", "case", "n_sources", "restart", "quantity"),
    skies=skies,
    measure=measure,
    summary=_summary,
    prepare=prepare,
    other_restarts=other_restarts,
    defaults={"preset": "ci", "n_realisations": 3, "n_restarts": 8, "n_sources_max": 20, "reading": "all"},
    without=("method", "average", "polynomial"),
    stated=("reading", "n_sources_max"),
)
