"""Readings of the choices about SDecGMCA that the paper leaves open, and the outcome of each."""

import itertools
import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pandas as pd

from himap.core.errors import InputError
from himap.maps import sphere
from himap.measures import diagnostics
from himap.measures.diagnostics import FAILING
from himap.paper.claims.entries import entries
from himap.removal.sdecgmca.readings import OPTIONS, READINGS, resolved

BANDS = {
    name.replace("0-0.03", "k < 0.03").replace("-", " to "): band for name, band in diagnostics.BANDS.items()
}
"""`diagnostics.BANDS` with the names used in records."""

_NEAR_PLANE = 10.0  # deg of Galactic latitude

CURVES = ("C/C0", "P/P0")
"""Quantities with a value for each x: l, or k in 1/MHz."""

COLUMNS = {
    "reading": str,
    "restart": int,
    "quantity": str,
    "x": float,
    "value": float,
    "part": str,
    "method": str,
    "main": bool,
    "held": bool,
}
"""{column: type} of the rows of readings. The quantity is the id of a claim, or another number:
mean ratios in `BANDS`; "bump", the highest P/P0 near k = 0.31 / MHz; "mean error" and "largest error",
those of |C/C0 - 1| at 10 < l < 200; the share of lines of sight that are "flagged", and of these "near the
plane"; "total error", the MSE of both spectra; "iterations" of both stages; whether the last one "converged";
the diagnostics of the iteration (`himap.removal.separation.Separation`); and `CURVES` in bins.
"""


def flagged_shares(errors, none=math.nan):
    """Share of the lines of sight flagged by their errors (n_pix,), and of these near the plane, a dict.

    The latter is `none` if no line is flagged.
    """
    flagged = diagnostics.flagged_lines(errors)
    near = np.abs(sphere.pixel_latitude(sphere.nside_of(flagged))[flagged]) < _NEAR_PLANE
    return {"flagged": flagged.mean(), "near the plane": near.mean() if len(near) else none}


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One way to read the paper on SDecGMCA."""

    label: str  # a name in `READINGS`, or the option that differs from the default, e.g. "last = repeated"
    options: tuple  # pairs (name, value) for `himap.paper.realisation.Realisation`
    changed: tuple | None = None  # (option, value) if only this differs from the default

    @property
    def title(self):
        """The label, and for a named reading the one option that it changes, if so."""
        if self.changed is None or self.label not in READINGS:
            return self.label
        return f"{self.label} ({' = '.join(map(str, self.changed))})"

    @property
    def values(self):
        """{option: value} of all options."""
        given = dict(self.options)
        return READINGS[given.pop("reading", "default")] | given

    @property
    def departures(self):
        """{option: value} of options that contradict the paper's text."""
        return {name: self.values[name] for name, one in OPTIONS.items() if self.values[name] in one.against}


def readings():
    """{label: `Reading`}: the named readings, and the default with one option changed at a time.

    If a change turns the default into a named reading, it is that reading; combinations of options that
    exclude each other are omitted.
    """
    default = READINGS["default"]
    named = {name: (("reading", name),) for name in READINGS} | {"default": ()}
    known = {name: Reading(label=name, options=options) for name, options in named.items()}
    for change in ((name, value) for name, one in OPTIONS.items() for value in one.choices):
        values = default | dict([change])
        with suppress(InputError):
            resolved("default", values)
            same = [name for name, one in READINGS.items() if one == values]
            label = same[0] if same else " = ".join(map(str, change))
            if values != default:
                known[label] = Reading(label=label, options=named.get(label, (change,)), changed=change)
    return known


def candidates():
    """{label: `Reading`} of candidates for the default: named readings, with each foreground beyond lmax."""
    several = {}
    for name, beyond in itertools.product(READINGS.keys() - {"default"}, OPTIONS["beyond"].choices):
        label, options = name, (("reading", name),)
        if READINGS[name]["beyond"] != beyond:
            label, options = f"{name}, beyond = {beyond}", (*options, ("beyond", beyond))
        several[label] = Reading(label=label, options=options)
    return dict(sorted(several.items()))


def find_reading(label):
    """The `Reading` with a label from `readings` or `candidates`; InputError if there is none."""
    known = readings() | candidates()
    if label not in known:
        raise InputError(f"reading must be one of {'; '.join(known)}, got {label!r}.")
    return known[label]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The outcome of one reading."""

    entries: dict  # {claim: `himap.paper.claims.entries.Entry`}
    # The other numbers, for the oscillating beam: a row for each (seed, restart) and a column for each
    # quantity without an x; bands that the maps lack are missing.
    numbers: pd.DataFrame
    curves: pd.DataFrame  # the rows of `CURVES`
    statements: float  # number of the paper's on SDecGMCA that hold: mean over skies of `statement_counts`

    @property
    def n_failing(self):
        """Number of members that fail: their mean error is above `FAILING`."""
        return int((~(self.numbers["mean error"] <= FAILING)).sum())

    @property
    def fails(self):
        """That number in words, "1 of 4"."""
        return f"{self.n_failing} of {len(self.numbers)}"


def outcomes(rows):
    """{label: `Outcome`} from a table with `COLUMNS`, in the order of `readings` and `candidates`. Some
    may be missing. InputError for readings or claims unknown to himap.
    """
    known = readings() | candidates()
    if "case" in rows:  # in a record of restarts, which also has other beams
        rows = rows[rows["case"].isna() | (rows["case"] == "oscillating")]
    if unknown := {*rows["reading"]} - {*known}:
        raise InputError(
            f"the record has a reading of another version of himap, {', '.join(sorted(unknown))}; "
            "measure it again."
        )
    by_label, groups, counts = {}, dict(list(rows.groupby("reading"))), statement_counts(rows).mean()
    for label in (label for label in known if label in groups):
        of_reading = groups[label]
        judged = of_reading["quantity"].str.fullmatch(r"[A-Z]\d+")
        curves = of_reading["quantity"].isin(CURVES)
        claims = of_reading[judged].rename(columns={"quantity": "claim"}).assign(sentence="")
        numbers = of_reading[~judged & of_reading["x"].isna()].pivot(
            index=["seed", "restart"], columns="quantity", values="value"
        )
        by_claim = {entry.claim.id: entry for entry in entries(claims)}
        by_label[label] = Outcome(
            entries=by_claim,
            numbers=numbers,
            curves=of_reading[curves],
            statements=float(counts.get(label, 0)),
        )
    return by_label


def statement_counts(rows):
    """Number of the paper's statements on SDecGMCA that hold, by reading and sky, a DataFrame.

    It has a row for each seed and a column for each label: the sum over the main parts about SDecGMCA of the
    share of the restarts in which each holds. `rows` have `COLUMNS`.
    """
    judged, claim = rows[rows["part"].notna()], ["seed", "reading", "quantity"]
    restarts = judged.groupby(claim)["restart"].nunique()
    main = judged[judged["main"].eq(True) & (judged["method"] == "SD")]
    holding = main[main["held"].eq(True)].groupby(claim).size().reindex(restarts.index, fill_value=0)
    return (holding / restarts).groupby(["seed", "reading"]).sum().unstack()


def ranked_candidates(counts):
    """[(label, statements, departures from the text)] of the candidates for the default, the best first.

    The best is the most charitable: most statements of the paper on SDecGMCA hold with it, averaged over
    skies, from `statement_counts`. Ties are broken by fewer departures.
    """
    known = readings() | candidates()
    ranked = [
        (label, float(mean), len(known[label].departures))
        for label, mean in counts.mean().items()
        if label in candidates() or label == "default"
    ]
    return sorted(ranked, key=lambda row: (-round(row[1], 9), row[2]))


def shares_first(counts):
    """Share of 2000 bootstrap resamples of the skies in which each candidate has the highest mean count.

    A Series by label, from `statement_counts`: NaN if it is not known on every sky; candidates with equal
    counts share a resample.
    """
    weights = np.random.default_rng(0).multinomial(len(counts), np.full(len(counts), 1 / len(counts)), 2000)
    known = counts.dropna(axis=1)
    if known.empty:
        return pd.Series(np.nan, counts.columns)
    means = weights @ known.to_numpy()
    first = np.isclose(means, means.max(axis=1, keepdims=True))
    shares = (first / first.sum(axis=1, keepdims=True)).mean(axis=0)
    return pd.Series(shares, known.columns).reindex(counts.columns)
