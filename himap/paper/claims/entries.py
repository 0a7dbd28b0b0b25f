"""The ledger: each claim of the paper with its verdict over several skies, from the rows of a record."""

import math
from dataclasses import dataclass

import numpy as np

from himap.core.errors import InputError
from himap.paper.claims import CLAIMS, IN_PART, REPRODUCED, Claim, Finding, Part
from himap.paper.claims.verdicts import most_common

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
    """A claim, and what was found on every sky.

    Attributes
    ----------
    claim
        The `himap.paper.claims.Claim`.
    findings
        {(seed, restart): `Finding`}, of the first sky and start first.
    """

    claim: Claim
    findings: dict

    @property
    def verdict(self):
        """That of most skies; of two with equal counts the worse, in the order of `VERDICTS`."""
        return most_common(finding.verdict for finding in self.findings.values())

    @property
    def holds(self):
        """Whether the claim is reproduced, at least in part."""
        return self.verdict in (REPRODUCED, IN_PART)

    @property
    def label(self):
        """The verdict; *in part* with how many parts hold, the least and the most over its skies."""
        if self.verdict != IN_PART:
            return self.verdict
        partly = [finding for finding in self.findings.values() if finding.verdict == IN_PART]
        held = sorted({finding.n_held for finding in partly})
        totals = sorted({len(finding.parts) for finding in partly})
        return f"{IN_PART} ({_span(held)} of {_span(totals)})"

    @property
    def agreeing(self):
        """How many skies have the verdict of the entry."""
        return sum(finding.verdict == self.verdict for finding in self.findings.values())

    @property
    def values(self):
        """The measured number: median, lowest and highest over skies; NaN if there is none."""
        values = [finding.value for finding in self.findings.values() if math.isfinite(finding.value)]
        return (float(np.median(values)), min(values), max(values)) if values else (math.nan,) * 3

    @property
    def sentence(self):
        """The numbers behind it, of the first sky."""
        return next(iter(self.findings.values())).sentence

    def failed_parts(self):
        """{part: on how many skies it does not hold}, of the parts that fail on some."""
        count = {}
        for finding in self.findings.values():
            for part in finding.parts:
                if not part.held:
                    count[part.name] = count.get(part.name, 0) + 1
        return count


def _span(numbers):
    """One number, or the first and the last of several."""
    return f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"


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
            "held": part and bool(part.held),
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
