"""All methods side by side over many skies: ratios to the truth by l and k, uncorrected and corrected."""

import math

import numpy as np
import pandas as pd

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.measures.diagnostics import BANDS, FAILING, JUDGED, bands
from himap.measures.transfer import quotient
from himap.paper import grid
from himap.paper.record import Experiment
from himap.store.store import product

COLUMNS = {
    "beam": str,
    "method": str,
    "n_sources": int,  # 0 for a method without
    "corrected": bool,  # whether the power is divided by the transfer function (of cross power)
    "kind": str,  # "angular", C/C0, or "frequency", P/P0
    "low": int,  # first and last element of a bin, in steps of the axis
    "high": int,
    "step": float,  # 1 for l, the spacing of k, 1/MHz
    "ratio": float,  # to the truth, averaged over the bin
}

METHOD = ["beam", "method", "n_sources", "corrected"]
"""Columns that distinguish curves of one kind."""

_WIDTH = 1.2  # of a bin: its end over its beginning, except for the narrowest


def skies(*, beams, methods, corrected=(), n_mocks=3, **settings):
    """A list of `Sky` with a case for each beam name; settings as in `cases_and_methods`.

    `methods` are pairs (name, number of sources), with a list of numbers if it differs between beams. Those
    named in `corrected` are also corrected, with `n_mocks` mocks. InputError if a number is missing,
    `corrected` names a method that is not in `methods`, or for errors of `cases_and_methods`.
    """
    whole_number("n_mocks", n_mocks, 1, 1000)
    are_names = isinstance(beams, list | tuple) and all(isinstance(beam, str) for beam in beams)
    if not are_names or not beams or len(set(beams)) < len(beams):
        raise InputError(f"beams must be a list of names, each once, got {beams!r}.")
    observed = []
    for place, beam in enumerate(beams):
        pairs = [_of_beam(pair, place, len(beams)) for pair in methods]
        pairs = [pair for n, pair in enumerate(pairs) if pair not in pairs[:n]]
        observed.append(grid.cases_and_methods(beam=beam, other_beams=beams, methods=pairs, **settings))
    there = {remover.name for _, removers in observed for remover in removers}
    if unknown := {*map(str, corrected)} - there:
        absent, present = (", ".join(sorted(names)) for names in (unknown, there))
        raise InputError(
            f"corrected names {absent}, but the methods are {present}: give some of these, or []."
        )
    return grid.skies_of(*observed, n_mocks=n_mocks, corrected=tuple(corrected))


def _of_beam(pair, place, n_beams):
    """A pair (name, number of sources) for the beam at `place`; other values are refused later."""
    match pair:
        case [name, [*numbers]] if len(numbers) != n_beams:
            raise InputError(f"{name} has {len(numbers)} numbers of sources for {n_beams} beams: one each.")
        case [name, [*numbers]]:
            return name, numbers[place]
        case [name, number]:
            return name, number
    return pair


@product(name="measured_methods")
def measure(sky):
    """Ratios to the truth in bins of l and k, for each beam and method of a `Sky`."""
    rows = []
    for case, remover, power, transfer in grid.measured_recoveries(sky):
        first = {"beam": str(case.beam)} | grid.method_columns(remover)
        for divisor in (None, transfer) if transfer else (None,):
            corrected = {"corrected": divisor is not None}
            rows += [first | corrected | row for row in curves(power, divisor)]
    return rows


def curves(power, transfer=None):
    """The last columns for each bin, from the `MockPower` of the truth, over a `TransferFunction` if given.

    Bins have equal logarithmic widths within each of the `bands`, and do not cross their ends.
    """
    rows = []
    ratios = power.ratios()
    known_at = {"angular": power.degrees, "frequency": power.k}
    for kind, x in known_at.items():
        edges = set()
        for its, inside in bands(**known_at).values():
            if its == kind:
                low, high = np.flatnonzero(inside)[[0, -1]] + [0, 1]
                n_bins = math.ceil(math.log(high / low) / math.log(_WIDTH))
                edges |= set(np.round(np.geomspace(low, high, n_bins + 1)).astype(int).tolist())
        edges = np.array(sorted(edges))
        ratio = ratios[kind][edges[0] : edges[-1]]
        if transfer is not None:
            # Below 0 for a failed run of a chaotic method, whose output is anticorrelated with the mocks.
            ratio = quotient(ratio, getattr(transfer, kind)[edges[0] : edges[-1]])
        means = np.add.reduceat(ratio, edges[:-1] - edges[0]) / np.diff(edges)
        first = {"kind": kind, "step": float(x[1] - x[0])}
        rows += [
            first | {"low": int(low), "high": int(end - 1), "ratio": float(mean)}
            for low, end, mean in zip(edges[:-1], edges[1:], means, strict=True)
        ]
    return rows


def middles(table):
    """Centres of the bins, l or k in 1/MHz, a Series."""
    return table["step"] * (table["low"] + table["high"]) / 2


def _means(table, columns):
    """Means of the column "ratio" over bins, weighted by their widths, a Series by some columns."""
    weight = table["high"] - table["low"] + 1
    weighted = table.assign(ratio=weight * table["ratio"], weight=weight)
    sums = weighted.groupby(columns, sort=False)[["ratio", "weight"]].sum()
    return (sums["ratio"] / sums["weight"]).rename("ratio")


def in_bands(table):
    """Means of the ratio over `himap.measures.diagnostics.bands`: a Series by `METHOD`, band and seed."""
    ends = table["high"] * table["step"]
    inside = [(table["kind"] == kind) & (ends > low) & (ends < high) for kind, low, high in BANDS.values()]
    return _means(table.assign(band=np.select(inside, [*BANDS], default="")), [*METHOD, "band", "seed"])


def distances(tables):
    """Deviation from 1 of the median over skies of the worst of the `JUDGED` bands; signed.

    {(beam, method, n_sources, corrected): distance}, below 0 if power is missing. For several tables, such as
    one per Galaxy, the largest distance. Medians, not means, because a single failed run of a chaotic method
    dominates a mean.
    """
    medians = pd.concat([in_bands(table).groupby([*METHOD, "band"], sort=False).median() for table in tables])
    judged = medians[medians.index.get_level_values("band").isin(JUDGED)] - 1
    return judged.groupby(METHOD, sort=False).agg(lambda one: max(one, key=abs)).to_dict()


def failures(tables):
    """Number of skies on which each method fails: the mean |C/C0 - 1| at 10 < l < 200 exceeds `FAILING`.

    {(beam, method, n_sources): number of skies}, over all skies of several tables of the experiment,
    uncorrected; from the mean C/C0 in each bin.
    """
    rows = pd.concat([table.assign(table=n) for n, table in enumerate(tables)])
    degree = middles(rows)
    rows = rows[(rows["kind"] == "angular") & (degree > 10) & (degree < 200)]
    errors = _means(rows.assign(ratio=(rows["ratio"] - 1).abs()), [*METHOD, "table", "seed"])
    failed = (errors > FAILING).groupby(METHOD, sort=False).sum()
    return {key[:3]: int(n) for key, n in failed.items() if not key[3]}


def _summary(table):
    """The median over skies for every band, and its 16 to 84 % range."""
    shown = in_bands(table).groupby([*METHOD, "band"], sort=False).quantile([0.5, 0.16, 0.84]).unstack()
    shown.columns = ["residual / truth", "16 %", "84 %"]
    shown = shown.map("{:.4f}".format).reset_index()
    shown["corrected"] = shown["corrected"].map({True: "corrected", False: "uncorrected"})
    return grid.with_labels(shown.rename(columns={"corrected": "spectra"}))


EXPERIMENT = Experiment(
    name="methods",
    chapter="25_side_by_side",
    columns=COLUMNS,
    key=(*METHOD, "kind"),
    skies=skies,
    measure=measure,
    summary=_summary,
    without=("results", "iterated", "larger"),
)
