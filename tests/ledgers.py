"""Entries of a ledger that several tests share."""

import math

from himap.paper.claims import CLAIMS, DIFFERENT, FAILED, REPRODUCED, UNDECIDED, Finding
from himap.paper.ledger import Entry


def entry(*verdicts, values=None, id="D1"):
    claim = CLAIMS[id]
    words = {
        name: getattr(claim, name)
        for name in ("id", "beam", "statement", "number", "paper", "section", "figure", "notebook", "reading")
    }
    parts = {REPRODUCED: {"a": True}, DIFFERENT: {"a": False, "b": True}, FAILED: {"a": False}, UNDECIDED: {}}
    values = values or [0.5] * len(verdicts)
    findings = {
        seed: Finding(value=math.nan if value is None else value, parts=parts[verdict], sentence=f"{seed}.")
        for seed, (verdict, value) in enumerate(zip(verdicts, values, strict=True))
    }
    return Entry(claim=words, findings=findings)
