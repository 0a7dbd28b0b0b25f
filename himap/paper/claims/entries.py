"""The ledger: each claim of the paper with its verdict over skies and restarts, from the rows of a record."""

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import pandas as pd
from scipy.stats import binomtest, norm

from himap.core.errors import InputError
from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED, UNDECIDED
from himap.paper.claims.base import PLACE, Claim, all_hold

HOLDS = 0.84
"""Share of the members at or above which a part holds."""

HOLDS_NOT = 0.16
"""Share of the members at or below which it does not hold."""

_ROUNDING = 1e-9  # of a share

COLUMNS = {
    "restart": int,
    "claim": str,
    "value": float,
    "sentence": str,
    "part": str,
    "method": str,
    "main": bool,
    "held": bool,
}
"""{column: type} of the rows of findings: one for each part, or one if there is no part."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A claim and its findings in every member."""

    claim: Claim
    members: pd.DataFrame  # "value" and "sentence" by (seed, restart), the first sky and start first
    shares: pd.DataFrame  # share of the members in which each part holds: its rows in `shares_of`

    @cached_property
    def main_shares(self):
        """The rows of the main parts."""
        return self.shares[self.shares["main"]]

    @cached_property
    def _judgement(self):
        return judge_shares(self.main_shares)

    @property
    def verdict(self):
        """`REPRODUCED` or another verdict, from the shares of the main parts."""
        return self._judgement[0]

    @property
    def holds(self):
        """Whether the claim is reproduced, at least in part."""
        return self.verdict in (REPRODUCED, IN_PART)

    @property
    def label(self):
        """The verdict; if some methods fail, which, and whether it fails only for lack of its premise."""
        verdict, why = self._judgement
        return f"{verdict} ({why})" if why else verdict

    @property
    def about_sd(self):
        """Whether a main part is about SDecGMCA; if there is none, whether the statement names it."""
        return "SD" in ({*self.main_shares["method"]} or self.claim.statement.split())

    @property
    def is_single_run(self):
        """Whether it is about SDecGMCA, which is chaotic, and has one member: a draw, not a verdict."""
        return self.about_sd and len(self.members) == 1

    @property
    def values(self):
        """The measured number: median, and the range from 16 to 84 % over members that have it, or NaN."""
        values = self.members["value"]
        sizes = values.groupby("seed").transform("size")
        often = math.lcm(*sizes) // sizes  # so that skies have equal weight
        known = np.isfinite(values)
        if not known.any():
            return (math.nan,) * 3
        weighed = values[known].repeat(often[known])
        return tuple(np.quantile(weighed, (0.5, HOLDS_NOT, HOLDS)).tolist())

    @property
    def places(self):
        """{place: share of the members} for a claim about a place, such as a minimum; else empty."""
        return {name.replace(PLACE, " "): mean for name, mean in self.shares["mean"].items() if PLACE in name}

    @property
    def sentence(self):
        """The numbers for the first member."""
        return self.members["sentence"].iloc[0]

    @property
    def n_skies(self):
        """Number of skies."""
        return self.members.index.unique("seed").size

    @property
    def n_restarts(self):
        """Largest number of restarts of a sky."""
        return int(self.members.groupby("seed").size().max())


def finding_rows(findings, restart):
    """The rows of {claim: `Finding`} for a restart, dicts with `COLUMNS`."""
    return [
        {
            "restart": restart,
            "claim": claim,
            "value": float(finding.value),
            "sentence": finding.sentence,
            "part": part and part.name,
            "method": part and part.method,
            "main": part and part.main,
            "held": part and part.held,
        }
        for claim, finding in findings.items()
        for part in finding.parts or (None,)
    ]


def entries(rows):
    """The `Entry` of each claim in a table of findings, a list in the order of the paper.

    `rows` is a DataFrame with the columns "seed" and `COLUMNS`. InputError for a claim that himap does not
    have.
    """
    if unknown := sorted({*rows["claim"]} - CLAIMS.keys()):
        raise InputError(
            f"the record has claims of another version of himap, {', '.join(unknown)}; measure it again with "
            "`himap measure`."
        )
    members = rows.drop_duplicates(["claim", "seed", "restart"]).set_index(["seed", "restart"])
    shares = shares_of(rows).reset_index("claim")
    none, by_claim = shares.iloc[:0], dict(list(shares.groupby("claim")))
    return [
        Entry(claim=CLAIMS[id], members=several[["value", "sentence"]], shares=by_claim.get(id, none))
        for id, several in sorted(members.groupby("claim"), key=lambda pair: list(CLAIMS).index(pair[0]))
    ]


def shares_of(rows):
    """Share of the members to which a claim applies in which each part holds; skies have equal weight.

    `rows` are as in `entries`; a part does not hold in a member without it. The DataFrame has the index
    (claim, part) and the columns "method" and "main", as in `Part`; "mean", the mean over skies of the share
    of restarts; "low" and "high", the smallest and largest share over skies, or, for one sky, the 1 sigma
    Wilson interval of its restarts, or of one draw if another method has none; "absent", the share of the
    members in which the premise is absent; "holds": True, False, or None if undecided.
    """
    judged, part = rows[rows["part"].notna()], ["claim", "part"]
    sizes = judged.groupby(["claim", "seed"])["restart"].nunique().rename("size").reset_index()
    counts = judged.assign(held=judged["held"].eq(True), absent=judged["held"].isna())
    counts = counts.groupby([*part, "seed"])[["held", "absent"]].sum().reset_index()
    parts = judged.drop_duplicates(part)[[*part, "method", "main"]].astype({"main": bool})
    skies = parts[part].merge(sizes, on="claim").merge(counts, on=[*part, "seed"], how="left").fillna(0)
    skies[["held", "absent"]] = skies[["held", "absent"]].div(skies["size"], axis=0)
    columns = {"mean": ("held", "mean"), "low": ("held", "min"), "high": ("held", "max")}
    columns |= {"absent": ("absent", "mean"), "members": ("size", "sum"), "skies": ("size", "size")}
    shares = skies.groupby(part, sort=False).agg(**columns)
    alone = shares["skies"] == 1
    # Parts that no restart changes are one draw: another method, or a claim about none with one value.
    changed = judged.groupby("claim")["value"].nunique(dropna=False) > 1
    drawn = parts["method"].eq("SD") | (parts["method"].eq("") & parts["claim"].map(changed))
    draws = shares["members"].where(drawn.to_numpy(), 1)[alone]
    ends = [wilson(round(share * n), n) for share, n in zip(shares["mean"][alone], draws, strict=True)]
    shares.loc[alone, ["low", "high"]] = np.reshape(ends, (-1, 2))
    sure = shares["mean"] >= HOLDS - _ROUNDING, shares["mean"] <= HOLDS_NOT + _ROUNDING
    shares["holds"] = np.select(sure, (True, False), None)
    return parts.set_index(part).join(shares.drop(columns=["members", "skies"]))


@cache  # called thousands of times, half a millisecond each
def wilson(count, total, z=1.0):
    """Wilson interval of a probability, (low, high), at `z` sigma, for `count` of `total`."""
    share = 1 - 2 * norm.sf(z)
    return tuple(binomtest(int(count), total).proportion_ci(share, method="wilson"))


def judge_shares(shares):
    """(verdict, words about the methods) for the main parts of a claim, rows of `shares_of`.

    A method holds if all its parts do, and fails if one of them fails; parts about no single method count
    separately. A claim about several methods is *in part* if it holds for one and fails for another.
    """
    shares = list(shares.itertuples())
    groups = {}
    for share in shares:
        groups.setdefault(share.method or share.Index, []).append(share.holds)
    outcome = {name: all_hold(held) for name, held in groups.items()}
    methods = {share.method for share in shares} - {""}
    by_method = [outcome[name] for name in methods] if len(methods) > 1 else []
    if not shares:
        return INAPPLICABLE, ""
    if all(outcome.values()):
        return REPRODUCED, ""
    others = [share for share in shares if share.holds is not True]
    if False not in outcome.values():
        never_fails = all(share.mean + share.absent >= 1 - _ROUNDING for share in others)
        return UNDECIDED, "holds where its premise is present" if never_fails else ""
    if True in by_method:
        count = f"for {len(shares) - len(others)} of {len(shares)} parts"
        return IN_PART, "; ".join([count, *_which(outcome, methods, {False: "not", None: "undecided"})])
    if None in by_method:
        return UNDECIDED, "; ".join(_which(outcome, methods, {False: "not"}))
    if not all(share.absent >= HOLDS - _ROUNDING for share in others):
        return FAILED, ""
    some = f" in {len(others)} of {len(shares)} parts" if len(others) < len(shares) else ""
    return FAILED, f"premise absent{some}"


def _which(outcome, methods, words):
    """Texts: the methods, and the other parts, that have one of the outcomes {outcome: its word}."""
    texts = []
    for held, word in words.items():
        names = [name for name, one in outcome.items() if one is held]
        of_methods, parts = [n for n in names if n in methods], [n for n in names if n not in methods]
        texts += [f"{word} for {', '.join(of_methods)}"] * bool(of_methods)
        texts += [f"{word}: {', '.join(parts)}"] * bool(parts)
    return texts
