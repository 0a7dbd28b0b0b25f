"""How well transfer functions correct the signal loss of methods: against the truth, over several skies."""

from dataclasses import replace

import numpy as np
from scipy import stats

from himap.core.checks import whole_number
from himap.measures.transfer import DEFINITIONS
from himap.paper.grid import (
    band_rows,
    cases_and_methods,
    measured_recoveries,
    method_columns,
    skies_of,
    summarise,
)
from himap.paper.record import Experiment

COLUMNS = {
    "method": str,
    "n_sources": int,  # 0 of a method that has none
    "band": str,
    "uncorrected": float,
    "corrected": float,
    "corrected_auto": float,
    "error_bar": float,
}
"""Power over that of the truth, mean in a band such as "C/C0, 10-19": of the residual, divided by the
transfer function of cross power, and by that of auto power; and the scatter of `corrected` that the mocks
predict."""


def skies(*, n_mocks=10, **settings):
    """A list of `Sky`, each with two mocks or more; parameters and errors as of `cases_and_methods`."""
    whole_number("n_mocks", n_mocks, 2, 1000)  # one mock has no scatter
    return skies_of(cases_and_methods(**settings), n_mocks=n_mocks)


def measure(sky):
    """Ratios to the truth with and without correction, in each band and of each method of a `Sky`."""
    return [
        method_columns(remover) | row
        for _, remover, power, transfer in measured_recoveries(sky)
        for row in corrected_bands(power, transfer)
    ]


def corrected_bands(power, transfer):
    """Rows of one method, from the `MockPower` of the truth and a `TransferFunction` of two mocks or more."""
    cross, auto = (replace(transfer, definition=name) for name in DEFINITIONS)
    ratios = power.ratios()
    over = [{kind: ratio / getattr(one, kind) for kind, ratio in ratios.items()} for one in (cross, auto)]
    rows = band_rows(power, uncorrected=ratios, corrected=over[0], corrected_auto=over[1])
    errors = power.band_means({kind: cross.errors(kind) for kind in ratios})
    return [row | {"error_bar": float(np.sqrt(np.mean(errors[row["band"]] ** 2)))} for row in rows]


def coverage(table):
    """How often the truth is within the error bar, (hits, trials, lower and upper end of a 95 % interval).

    The interval is that of Clopper & Pearson (1934). Each row is a trial, although bands of one sky, and
    skies with the same mocks, are not independent: it is rather too narrow.
    """
    hits, trials = int(((table["corrected"] - 1).abs() < table["error_bar"]).sum()), len(table)
    low = stats.beta.ppf(0.025, hits, trials - hits + 1) if hits else 0.0
    high = stats.beta.ppf(0.975, hits + 1, trials - hits) if hits < trials else 1.0
    return hits, trials, float(low), float(high)


def _summary(table):
    """Means over skies for each method and band, and on how many skies the truth is within the error bar."""

    def mean(column):
        return lambda group: f"{group[column].mean():.4f}"

    def within(group):
        hits, trials, low, high = coverage(group)
        return f"{hits} of {trials} ({100 * low:.0f} to {100 * high:.0f} %)"

    cells = {
        "method": "method",
        "band": "band",
        "uncorrected": mean("uncorrected"),
        "corrected": mean("corrected"),
        "by T auto": mean("corrected_auto"),
        "scatter": lambda group: f"{group['corrected'].std():.4f}",
        "expected": mean("error_bar"),
        "within 1σ": within,
    }
    return summarise(table, ["method", "n_sources", "band"], cells)


EXPERIMENT = Experiment(
    name="transfer",
    chapter="20_transfer_function",
    columns=COLUMNS,
    key=("method", "n_sources"),
    skies=skies,
    measure=measure,
    summary=_summary,
    defaults={
        "n_mocks": 10,
        "methods": [["beam_subspace", 3], ["pca", 5], ["pca", 8], ["gmca", 5], ["sdecgmca", 5]],
    },
    without=("results", "larger"),
    stated=("n_realisations", "n_mocks"),
)
