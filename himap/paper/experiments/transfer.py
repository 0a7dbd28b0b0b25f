"""Accuracy of corrected spectra of residuals, and how often their error bars cover the truth."""

from dataclasses import replace

import numpy as np
from scipy.stats import binom, binomtest

from himap.core.checks import whole_number
from himap.measures.bootstrap import KINDS, sigma
from himap.measures.transfer import quotient
from himap.paper import grid
from himap.paper.mocks import bootstrap, foreground_left, mocks_of_sky, own_recovery, resampled
from himap.paper.record import Experiment
from himap.store.store import product

COLUMNS = {
    "method": str,
    "n_sources": int,  # 0 for a method without
    "band": str,
    "uncorrected": float,
    "corrected": float,
    "error_bar": float,
    "foreground": float,
}
"""Power over that of the truth, averaged over a band such as "C/C0, 10-19": of the residual, and `corrected`.
`error_bar` is the scatter of `corrected` over the members of the bootstrap. `foreground` is the subtracted
foreground residual, by which `corrected` may be wrong: its systematic error."""


def skies(*, n_mocks=8, **settings):
    """A list of `Sky`, each with two or more mocks that no other sky has.

    Parameters and errors as in `cases_and_methods`.
    """
    whole_number("n_mocks", n_mocks, 2, 1000)  # one mock has no scatter
    several = grid.skies_of(grid.cases_and_methods(**settings))
    return [replace(sky, mocks=mocks_of_sky(sky.survey.seed, n_mocks)) for sky in several]


@product(name="measured_transfer")
def measure(sky):
    """Ratios to the truth, corrections and error bars in each band, for each method of a `Sky`."""
    ((case, removers),) = sky.methods.items()
    work = [(resampled, (case, tuple(removers), mock, sky.mocks)) for mock in sky.mocks]
    work += [(own_recovery, (case, remover)) for remover in removers]
    work += [(foreground_left, (case, remover, sky.mocks)) for remover in removers]
    grid.make_products(work)
    transfers, rows = bootstrap(case, removers, sky.mocks), []
    for remover in removers:
        power, left = own_recovery(case, remover), foreground_left(case, remover, sky.mocks)
        found = corrected_bands(power, left, transfers[remover])
        rows += [grid.method_columns(remover) | row for row in found]
    return rows


def corrected_bands(power, left, transfer):
    """Rows for one method, from the `MockPower` of the truth and a `TransferFunction` of two or more mocks.

    `left` is the `HarmonicPower` of the foreground residual of the method, as estimated from the data.
    """
    corrected, foreground, less = {}, {}, power.output.less(left)
    for kind in KINDS:
        true, residual = (getattr(part, kind)[1:] for part in (power.input, power.output))
        found = transfer.corrected(kind, getattr(less, kind))[1:]
        whole = quotient(residual, getattr(transfer, kind)[1:])
        corrected[kind] = np.r_[np.nan, found / true]
        foreground[kind] = np.r_[np.nan, (whole - found) / true]
    errors = power.band_means({kind: transfer.errors(kind) for kind in corrected})
    rows = grid.band_rows(power, uncorrected=power.ratios(), corrected=corrected, foreground=foreground)
    return [row | {"error_bar": float(sigma(errors[row["band"]]))} for row in rows]


def with_systematic(table):
    """The same table, with the systematic error added to its error bars, in quadrature.

    That is all of the subtracted foreground residual: the data do not show which share of it the estimated
    foreground represents.
    """
    return table.assign(error_bar=np.hypot(table["error_bar"], table["foreground"]))


def coverage(table):
    """How often the truth is within the error bar, (hits, trials, lower and upper end of a 95 % interval).

    The interval is that of Clopper & Pearson (1934). Each row is a trial, although bands of one sky are not
    independent, so the interval is somewhat too narrow.
    """
    hits, trials = int(((table["corrected"] - 1).abs() < table["error_bar"]).sum()), len(table)
    return hits, trials, *binomtest(hits, trials).proportion_ci()


def chance_of_right(trials):
    """Probability that the interval of `coverage` contains 68 %, for this many trials with correct bars."""
    ends = [binomtest(hits, trials).proportion_ci() for hits in range(trials + 1)]
    return float(
        sum(binom.pmf(hits, trials, 0.68) for hits, one in enumerate(ends) if one.low <= 0.68 <= one.high)
    )


def chi_squared(table):
    """Mean of ((corrected - truth) / error bar)^2; expected `himap.measures.bootstrap.squared_pull`."""
    return float((((table["corrected"] - 1) / table["error_bar"]) ** 2).mean())


def _summary(table):
    """Means over skies for each method and band, and on how many skies the error bar covers the truth."""
    groups = table.groupby(["method", "n_sources", "band"], sort=False)
    means = groups[["uncorrected", "corrected", "error_bar", "foreground"]].mean()
    means.insert(2, "scatter", groups["corrected"].std())
    shown = means.map("{:.4f}".format).rename(columns={"error_bar": "error bar"})
    covered = [coverage(group) for _, group in groups]
    shown["within 1σ"] = [
        f"{hits} of {trials} ({100 * low:.0f} to {100 * high:.0f} %)" for hits, trials, low, high in covered
    ]
    shown["χ²"] = [f"{chi_squared(group):.2f}" for _, group in groups]
    return grid.with_labels(shown.reset_index())


EXPERIMENT = Experiment(
    name="transfer",
    chapter="20_transfer_function",
    columns=COLUMNS,
    key=("method", "n_sources"),
    skies=skies,
    measure=measure,
    summary=_summary,
    defaults={
        "n_mocks": 8,
        "methods": [["beam_subspace", 3], ["beam_subspace", 4], ["pca", 6], ["pca", 7]],
    },
    without=("results", "larger", "other_methods"),
)
