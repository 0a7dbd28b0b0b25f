"""Entries of a ledger that several tests share."""

import math

from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED, Finding, Part
from himap.paper.claims.entries import Entry

A, NOT_A = Part(name="a", held=True), Part(name="a", held=False)
B, NOT_B = Part(name="b", held=True, main=False), Part(name="b", held=False, main=False)
PARTS = {REPRODUCED: (A, B), IN_PART: (A, NOT_B), FAILED: (NOT_A, B), INAPPLICABLE: ()}


def finding(verdict, value=0.5, sentence=""):
    return Finding(value=math.nan if value is None else value, parts=PARTS[verdict], sentence=sentence)


def entry(*verdicts, values=None, id="D1", nudged=None, first=0):
    """An `Entry` of seeds `first`, `first` + 1, ...; `nudged` is {noise level: `Finding`}."""
    values = values or [0.5] * len(verdicts)
    findings = {
        seed: finding(verdict, value, f"{seed}.")
        for seed, (verdict, value) in enumerate(zip(verdicts, values, strict=True), first)
    }
    return Entry(claim=CLAIMS[id], findings=findings, nudged=nudged or {})
