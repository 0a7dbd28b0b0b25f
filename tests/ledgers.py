"""Entries of a ledger that several tests share."""

import math

from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED, Finding, Part
from himap.paper.claims.entries import Entry

A, NOT_A = Part(name="a", held=True), Part(name="a", held=False)
B, NOT_B = Part(name="b", held=True, main=False), Part(name="b", held=False, main=False)
PARTS = {REPRODUCED: (A, B), IN_PART: (A, NOT_B), FAILED: (NOT_A, B), INAPPLICABLE: ()}


def finding(verdict, value=0.5, sentence=""):
    return Finding(value=math.nan if value is None else value, parts=PARTS[verdict], sentence=sentence)


def entry(*verdicts, values=None, id="D1", first=0):
    """An `Entry` of seeds `first`, `first` + 1, ..., each with one start."""
    values = values or [0.5] * len(verdicts)
    findings = {
        (seed, 0): finding(verdict, value, f"{seed}.")
        for seed, (verdict, value) in enumerate(zip(verdicts, values, strict=True), first)
    }
    return Entry(claim=CLAIMS[id], findings=findings)


def luminance(colour):
    """Relative luminance of a colour such as #00664b (WCAG)."""
    shares = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares]
    return sum(weight * share for weight, share in zip((0.2126, 0.7152, 0.0722), linear, strict=True))
