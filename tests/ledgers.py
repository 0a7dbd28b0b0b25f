"""Entries of a ledger that several tests share."""

import math

from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED, Finding, Part
from himap.paper.ledger import Entry

WORDS = ("id", "beam", "statement", "number", "paper", "section", "figure", "notebook", "reading")
A, NOT_A = Part(name="a", held=True), Part(name="a", held=False)
B, NOT_B = Part(name="b", held=True, main=False), Part(name="b", held=False, main=False)
PARTS = {REPRODUCED: (A, B), IN_PART: (A, NOT_B), FAILED: (NOT_A, B), INAPPLICABLE: ()}


def finding(verdict, value=0.5, sentence=""):
    return Finding(value=math.nan if value is None else value, parts=PARTS[verdict], sentence=sentence)


def entry(*verdicts, values=None, id="D1", nudged=None):
    """An `Entry` of seeds 0, 1, ...; `nudged` is {noise level: `Finding`}."""
    values = values or [0.5] * len(verdicts)
    findings = {
        seed: finding(verdict, value, f"{seed}.")
        for seed, (verdict, value) in enumerate(zip(verdicts, values, strict=True))
    }
    words = {name: getattr(CLAIMS[id], name) for name in WORDS}
    return Entry(claim=words, findings=findings, nudged=nudged or {})
