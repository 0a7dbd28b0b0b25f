"""How a claim is judged: its parts, the verdict that follows from them, and what the paper's words mean.

A word of the paper is one number, the same in every claim that uses it. An edge that the paper gives as
about, such as l ~ 40, is that number itself.
"""

import math
from dataclasses import dataclass

from scipy.stats import binomtest, norm

METHODS = {
    "pca": "PCA",
    "fastica": "ICA",
    "gmca": "GMCA",
    "sdecgmca": "SD",
    "polynomial": "POL",
    "parametric": "PAR",
}
"""Short names of the methods in the ledger."""

_ALONE = ("PCA/ICA", *METHODS.values())  # what a part can be about

RECOVERED = 0.1
"""|ratio - 1| below which a spectrum counts as recovered: the 10 % of the paper."""

CLEAR = 1.1
"""Ratio to the truth above which there is an excess, or a peak."""

STRONG = 1.5
"""Ratio to the truth above which an excess is *strong*."""

MUCH = 2
"""*Much larger*: at least this many times as large."""

ORDERS = 100
"""Too high *by orders of magnitude*: two of them or more, in the median."""

LEAST_ORDER = 10
"""Too high *across all scales*: by this factor at every multipole."""

MOST = 0.5
"""*Most* of some voxels or lines of sight, or of an excess: more than this share."""

CONSISTENT = 0.95
"""*Consistently*, *within x %* or *about x %* over a range: this share or more of its l, k or channels."""

NOTABLE = 0.2
"""*Notable*: more than this share of the whole, or of what it was."""

EQUAL = 0.01
"""Two numbers within this of each other are equal, where a part compares two."""

REPRODUCED = "reproduced"
IN_PART = "in part"
UNDECIDED = "undecided"
FAILED = "not reproduced"
INAPPLICABLE = "does not apply"
"""The verdicts, from the best to the worst; and where maps or scan do not hold what the claim is about."""

HOLDS = 0.84
"""Share of the members from which a part holds."""

HOLDS_NOT = 0.16
"""Share of the members up to which it does not."""


@dataclass(frozen=True)
class Part:
    """One part of a claim.

    Attributes
    ----------
    name
        What it says, in a few words.
    held
        Whether it holds; None where its premise is absent, such as a peak to lower, which counts as False.
    main
        Whether it is what the paper's sentence is about: the verdict follows from the main parts.
    method
        Short name of the method that it is about, "PCA/ICA" for both; empty if it is about several or none.
    """

    name: str
    held: bool | None
    main: bool = True
    method: str = ""


@dataclass(frozen=True)
class Finding:
    """The parts of a claim in one member: a sky, and a restart of SDecGMCA.

    Attributes
    ----------
    value
        The measured number, NaN if it cannot be measured.
    parts
        Tuple of `Part`; none where the claim does not apply.
    sentence
        The numbers behind every part.
    """

    value: float
    parts: tuple
    sentence: str


_ROUNDING = 1e-9  # of a share


def wilson(count, total, z=1.0):
    """Wilson interval of a probability, (low, high), `z` sigma, from a count of `total`."""
    share = 1 - 2 * norm.sf(z)
    return tuple(binomtest(int(count), total).proportion_ci(share, method="wilson"))


def holds_in(share):
    """Whether a part holds that does so in this share of the members: True, False, or None, undecided."""
    return True if share >= HOLDS - _ROUNDING else False if share <= HOLDS_NOT + _ROUNDING else None


def judge_shares(shares):
    """(verdict, what it says of the methods) of the main parts of a claim, rows of `entries.shares_of`.

    A method holds if all its parts do, and fails if one of them does; parts about no single method are each
    by themselves. A claim about several methods is *in part* if it holds for one and fails for another.
    """
    shares = list(shares.itertuples())
    if not shares:
        return INAPPLICABLE, ""
    groups = {}
    for share in shares:
        groups.setdefault(share.method or share.Index, []).append(share.holds)
    outcome = {name: _all_hold(held) for name, held in groups.items()}
    if all(outcome.values()):
        return REPRODUCED, ""
    methods = {share.method for share in shares} - {""}
    by_method = [outcome[name] for name in methods]
    if len(methods) > 1 and True in by_method:
        return (IN_PART, _which(shares, outcome)) if False in outcome.values() else (UNDECIDED, "")
    if any(one is not False for one in by_method) if len(methods) > 1 else False not in outcome.values():
        return UNDECIDED, ""
    failing = [share for share in shares if share.holds is False]
    absent = all(share.absent >= HOLDS - _ROUNDING for share in failing)
    return FAILED, "premise absent" if absent else ""


def _which(shares, outcome):
    """For how many parts a claim about several methods holds, and for which methods not."""
    n_held = sum(share.holds is True for share in shares)
    words = [f"for {n_held} of {len(shares)} parts"]
    for held, word in ((False, "not for"), (None, "undecided for")):
        if names := [name for name, one in outcome.items() if one is held]:
            words.append(f"{word} {', '.join(names)}")
    return "; ".join(words)


def is_smaller(one, other):
    """Whether a number is smaller than another, by more than the dead band `EQUAL`."""
    return bool(one < other * (1 - EQUAL if other > 0 else 1 + EQUAL))


PLACE = ": place "
"""In the name of a part that is a place, which is not main and holds in those members that have it there."""


def places_of(best):
    """A `Part` for the place of each of {name: place}, such as the number of sources with the least error."""
    return tuple(Part(f"{name}{PLACE}{place}", True, False, "SD") for name, place in best.items())


def not_applicable(sentence):
    """The `Finding` where maps or scan do not hold what a claim is about, which the sentence says."""
    return Finding(math.nan, (), sentence)


def parts_of(values, test, words, *, main=True, method=""):
    """A `Part` for each of {name: value}: whether `test(value)` is true; absent where the value is None.

    PCA and ICA leave the same foreground, and are one part: that of the worse of the two, so that it holds if
    it does for both. A part is about the method that it has the name of, otherwise about `method`.
    """
    joint = {}
    for name, value in values.items():
        held = None if value is None else bool(test(value))
        joint.setdefault("PCA/ICA" if name in ("PCA", "ICA") else name, []).append(held)
    return tuple(
        Part(f"{name} {words}", _all_hold(several), main, name if name in _ALONE else method)
        for name, several in joint.items()
    )


def _all_hold(held):
    """False if one of them does not hold, else None if one is undecided or its premise is absent."""
    return False if False in held else None if None in held else True
