"""The ledger: each claim of the paper with its verdict over several skies, from the rows of a record."""

import math
from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from himap.core.errors import InputError
from himap.paper.claims import CLAIMS, IN_PART, REPRODUCED, Claim, Finding, Part
from himap.paper.claims.verdicts import HOLDS, HOLDS_NOT, PLACE, Share, judge_shares

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
"""{column: type} of the rows of findings: one for each part, or one without a part."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A claim, and the findings of every member.

    Attributes
    ----------
    claim
        The `himap.paper.claims.Claim`.
    findings
        {(seed, restart): `Finding`}, of the first sky and start first.
    """

    claim: Claim
    findings: dict

    @cached_property
    def shares(self):
        """{part: `Share`} over the members in which the claim applies; skies weigh the same.

        A part that a member does not have does not hold there.
        """
        applying = {member: one for member, one in self.findings.items() if one.parts}
        parts = {part.name: part for one in applying.values() for part in one.parts}
        shares = {}
        for name, part in parts.items():
            held = {}
            for (seed, _), one in applying.items():
                here = [found.held for found in one.parts if found.name == name]
                held.setdefault(seed, []).append(here[0] if here else False)
            shares[name] = Share.of(part, held)
        return shares

    @cached_property
    def main_shares(self):
        """Those of the main parts, a list."""
        return [share for share in self.shares.values() if share.part.main]

    @property
    def verdict(self):
        """One of `himap.paper.claims.VERDICTS`, from the shares of the main parts."""
        return judge_shares(self.main_shares)[0]

    @property
    def holds(self):
        """Whether the claim is reproduced, at least in part."""
        return self.verdict in (REPRODUCED, IN_PART)

    @property
    def label(self):
        """The verdict; with the methods that a claim in part holds for, or that its premise is absent."""
        verdict, why = judge_shares(self.main_shares)
        return f"{verdict} ({why})" if why else verdict

    @property
    def about_sd(self):
        """Whether a main part is about SDecGMCA; where there is none, whether the statement names it."""
        methods = {share.part.method for share in self.main_shares} or {*self.claim.statement.split()}
        return "SD" in methods

    @property
    def values(self):
        """The measured number: median, and the range from 16 to 84 % of the members; NaN if there is none."""
        skies = {}
        for (seed, _), one in self.findings.items():
            if math.isfinite(one.value):
                skies.setdefault(seed, []).append(one.value)
        if not skies:
            return (math.nan,) * 3
        often = math.lcm(*map(len, skies.values()))  # so that skies weigh the same
        values = [value for several in skies.values() for value in several * (often // len(several))]
        return tuple(np.quantile(values, (0.5, HOLDS_NOT, HOLDS)).tolist())

    @property
    def places(self):
        """{place: share of the members} of what the claim locates, such as a minimum; empty for others."""
        found = {name: share.mean for name, share in self.shares.items() if PLACE in name}
        return {name.replace(PLACE, " "): share for name, share in found.items()}

    @property
    def sentence(self):
        """The numbers behind it, of the first member."""
        return next(iter(self.findings.values())).sentence

    @property
    def n_skies(self):
        """How many skies there are."""
        return len({seed for seed, _ in self.findings})

    @property
    def n_restarts(self):
        """The most restarts of a sky."""
        return max(Counter(seed for seed, _ in self.findings).values())


def finding_rows(findings, restart):
    """The rows of {claim: `Finding`} of a restart, dicts with `COLUMNS`."""
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

    Parameters
    ----------
    rows
        DataFrame with the columns "seed" and `COLUMNS`.

    Raises
    ------
    InputError
        A claim that himap does not have.
    """
    found = {}
    for row in rows.itertuples():
        found.setdefault(row.claim, {}).setdefault((row.seed, row.restart), []).append(row)
    if unknown := sorted(found.keys() - CLAIMS.keys()):
        raise InputError(
            f"the record has claims of another version of himap, {', '.join(unknown)}; measure it again with "
            "`himap measure claims`."
        )
    return [
        Entry(claim=claim, findings={member: _finding(several) for member, several in found[id].items()})
        for id, claim in CLAIMS.items()
        if id in found
    ]


def _finding(rows):
    parts = tuple(Part(row.part, row.held, row.main, row.method) for row in rows if row.part is not None)
    return Finding(value=rows[0].value, parts=parts, sentence=rows[0].sentence)
