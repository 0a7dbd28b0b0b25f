"""Entries of a ledger that several tests share."""

from himap.paper.claims import CLAIMS, REPRODUCED
from himap.paper.ledger import Entry


def entry(*verdicts, values=None, id="D1"):
    claim = CLAIMS[id]
    words = {
        name: getattr(claim, name)
        for name in ("id", "beam", "statement", "number", "paper", "section", "figure", "notebook", "reading")
    }
    values = values or [0.5] * len(verdicts)
    findings = {
        seed: {
            "value": value,
            "verdict": verdict,
            "parts": {"a": verdict == REPRODUCED},
            "sentence": f"{seed}.",
        }
        for seed, (verdict, value) in enumerate(zip(verdicts, values, strict=True))
    }
    return Entry(claim=words, findings=findings)
