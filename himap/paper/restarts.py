"""Diagnostics of a run of SDecGMCA without the truth, and how often they are right.

A table has the columns seed, reading, restart, quantity and value (`himap.paper.experiments.flags`), one
ensemble for each seed and reading; missing quantities are skipped.
"""

import numpy as np
import pandas as pd

from himap.paper.readings import FAILING
from himap.removal.restarts import FLAGS as USED

FLAGS = {
    "condition": ("condition of A above 10^4.5", 10**4.5),
    "refinement_change": ("last relative change of S above the tolerance", 1e-4),
    "cost": ("cost above that of the median member", None),
    "floored": ("the floor acts in the last S", 0.0),
    "contrast": ("residual follows the foreground", USED["contrast"][0]),
    "distance": ("residual far from that of the medoid", USED["distance"][0]),
}
"""{quantity: (meaning of its flag, value above which it is set)}, None for the median of the ensemble. At a
condition of 10^4.5 eigenvalues of A^T A reach the floor of C21's code, 1e-9."""


def members_of(table):
    """A row for each member, a DataFrame: columns "ensemble", "failed" and one for each quantity."""
    columns = ["seed", "reading", "restart"]
    values = table.pivot(index=columns, columns="quantity", values="value")  # keeps non-finite values
    known = values.dropna(axis=1, how="all")
    values = values[["mean error", *(name for name in FLAGS if name in known)]].reset_index()
    ensembles = values.groupby(columns[:2], sort=False).ngroup()
    return values.assign(ensemble=ensembles, failed=~(values["mean error"] <= FAILING))


def flag_rates(table):
    """How often each flag is right, a DataFrame by quantity.

    "hits" of "n_failed" members that failed, "false_alarms" of "n_sound" others; and "ranked", the
    probability that a failed member has a larger value than one that did not fail, which needs no threshold:
    0.5 is chance level.
    """
    members, rows = members_of(table), {}
    failed = members["failed"].to_numpy()
    limits = {name: limit for name, (_, limit) in FLAGS.items() if name in members}
    if used := [name for name in USED if name in members]:
        members["either"] = np.any([~(members[name] <= USED[name][0]) for name in used], axis=0).astype(float)
        limits["either"] = 0.5
    for name, limit in limits.items():
        values = members[name]
        if limit is None:  # comparable within one data set only
            values, limit = values / values.groupby(members["ensemble"]).transform("median"), 1.0
        values = values.fillna(np.inf).to_numpy()  # a record holds no infinity
        flagged = values > limit
        bad, good = values[failed], values[~failed]
        more = (bad[:, None] > good) + 0.5 * (bad[:, None] == good)
        rows[name] = {
            "hits": int(np.sum(flagged & failed)),
            "n_failed": len(bad),
            "false_alarms": int(np.sum(flagged & ~failed)),
            "n_sound": len(good),
            "ranked": float(more.mean()) if more.size else np.nan,
        }
    return pd.DataFrame(rows).T.convert_dtypes()


def chosen_failures(table):
    """Number of ensembles in which the member chosen by a criterion failed, {criterion: (failed, ensembles)}.

    Criteria are the smallest value of each quantity, "distance" that of the medoid; "any" is a random member.
    If several members of an ensemble share the smallest value, none is chosen.
    """
    members = members_of(table)
    chosen = {"any": (int(members["failed"].sum()), len(members))}
    for name in FLAGS:
        if name in members:
            least = members[members[name] == members.groupby("ensemble")[name].transform("min")]
            if least["ensemble"].is_unique:
                chosen[name] = int(least["failed"].sum()), len(least)
    return chosen


def flag_table(table):
    """Both results as texts, a DataFrame: a row for each flag."""
    rates, chosen = flag_rates(table), chosen_failures(table)
    words = {name: text for name, (text, _) in FLAGS.items()}
    words["either"] = "either of the last two"
    rows = [
        {
            "flag": words[name],
            "hit rate": share(one["hits"], one["n_failed"]),
            "false alarms": share(one["false_alarms"], one["n_sound"]),
            "ranked right": f"{one['ranked']:.2f}" if pd.notna(one["ranked"]) else "–",
            "least of it fails": share(*chosen[name]) if name in chosen else "",
        }
        for name, one in rates.iterrows()
    ]
    rows.append({"flag": "none: any member", "least of it fails": share(*chosen["any"])})
    return pd.DataFrame(rows).fillna("")


def share(n, of):
    """ "12 of 16 (75 %)"; a dash if there are none."""
    return f"{n} of {of} ({100 * n / of:.0f} %)" if of else "–"
