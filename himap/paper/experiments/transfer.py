"""How well transfer functions correct the signal loss of methods: against the truth, over several skies."""

from dataclasses import replace

import numpy as np
import pandas as pd

from himap.core.checks import whole_number
from himap.figures import styles
from himap.measures.transfer import DEFINITIONS
from himap.paper.grid import Sky, cases_and_methods, measured_recoveries
from himap.paper.mocks import first_mocks
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
"""Power over that of the truth, mean in a band such as "C/C0, 10-19": as the method leaves it, divided by the
transfer function of cross power, and by that of auto power; and what the mocks predict of the scatter of
`corrected`."""


def skies(*, n_mocks=10, **settings):
    """A list of `Sky`, each with two mocks or more; parameters and errors as of `cases_and_methods`."""
    whole_number("n_mocks", n_mocks, 2, 1000)  # one mock has no scatter
    cases, removers = cases_and_methods(**settings)
    mocks = tuple(first_mocks(n_mocks, cases))
    return [Sky(methods={case: removers}, mocks=mocks) for case in cases]


def measure(sky):
    """Ratios to the truth with and without correction, in each band and of each method of a `Sky`."""
    names = [remover.name for removers in sky.methods.values() for remover in removers]
    return [
        {"method": remover.name, "n_sources": getattr(remover, "n_sources", 0)} | row
        for _, remover, own, transfer in measured_recoveries(sky, names)
        for row in corrected_bands(own, transfer)
    ]


def corrected_bands(own, transfer):
    """Rows of one method, from the `MockPower` of the truth and a `TransferFunction` of two mocks or more."""
    cross, auto = (replace(transfer, definition=name) for name in DEFINITIONS)
    uncorrected = own.ratios()
    ratios, ratios_auto = (
        own.band_means({kind: ratio / getattr(one, kind) for kind, ratio in uncorrected.items()})
        for one in (cross, auto)
    )
    errors = own.band_means({kind: cross.errors(kind) for kind in uncorrected})
    return [
        {
            "band": band,
            "uncorrected": float(mean),
            "corrected": float(ratios[band]),
            "corrected_auto": float(ratios_auto[band]),
            "error_bar": float(np.sqrt(np.mean(errors[band] ** 2))),
        }
        for band, mean in own.band_means(uncorrected).items()
    ]


def _summary(table):
    """Means over skies for each method and band, and on how many skies the truth is within the error bar."""
    within = (table["corrected"] - 1).abs() < table["error_bar"]
    rows = []
    for (method, n_sources, band), own in table.groupby(["method", "n_sources", "band"], sort=False):
        means = own[["uncorrected", "corrected", "corrected_auto"]].mean()
        numbers = [*means, own["corrected"].std(), own["error_bar"].mean()]
        label = styles.numbered(method, n_sources)
        rows.append(
            [label, band, *(f"{one:.4f}" for one in numbers), f"{within[own.index].sum()} of {len(own)}"]
        )
    header = ["method", "band", "uncorrected", "corrected", "by T auto", "scatter", "expected", "within 1σ"]
    return pd.DataFrame(rows, columns=header)


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
