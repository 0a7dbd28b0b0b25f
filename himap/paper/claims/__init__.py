"""The claims of the paper as checks: one function for each, on one `Realisation` of the sky.

A claim is divided into parts that hold or do not; those that its sentence in the paper is about are *main*.
Its verdict follows from the share of skies and restarts in which these hold (`himap.paper.claims.entries`);
it does not apply to maps that lack what it is about. How the words of the paper are read is in the docstring
of each function, which is shown with its verdict.
"""

from himap.paper.claims import beams, further, other_sections, peak_masking  # noqa: F401
from himap.paper.claims.base import FAILED, IN_PART, INAPPLICABLE, REGISTRY, REPRODUCED, UNDECIDED

__all__ = ["CLAIMS", "FAILED", "INAPPLICABLE", "IN_PART", "REPRODUCED", "UNDECIDED"]

_LETTERS = "FDEORNBMGSAV"  # in the order of the paper; others follow

CLAIMS = {
    id: REGISTRY[id]
    for id in sorted(REGISTRY, key=lambda id: ((_LETTERS + id[0]).index(id[0]), id[0], int(id[1:])))
}
"""{id: `himap.paper.claims.base.Claim`}, in the order of the paper."""
