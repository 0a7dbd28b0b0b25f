"""The claims of the paper as checks: one function for each, on one `Realisation` of the sky.

A claim is broken into parts that hold or do not. It is reproduced if all hold, reproduced with a difference
if at least half of them do, not reproduced otherwise. How the words of the paper are read is in the
docstring of each function and shown with its verdict; "about 10 %" is read as less than 15 %.
"""

from himap.paper.claims import appendix, masking, methods_and_beams, scan
from himap.paper.claims.base import DIFFERENT, FAILED, REGISTRY, REPRODUCED, UNDECIDED, Claim, Finding

__all__ = ["CLAIMS", "DIFFERENT", "FAILED", "REPRODUCED", "UNDECIDED", "Claim", "Finding"]

CLAIMS = {
    id: claim
    for module in (methods_and_beams, scan, masking, appendix)
    for id, claim in REGISTRY.items()
    if claim.check.__module__ == module.__name__
}
"""{id: `Claim`}, in the order of the paper."""
