"""How a claim is judged: its parts, the verdict that follows from them, and what the paper's words mean.

A word of the paper stands for one number, the same in every claim that uses it. An edge that the paper gives
as about, such as l ~ 40, is that number itself.
"""

import math
from collections import Counter
from dataclasses import dataclass

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

ROUGHLY = 1.5
"""Within *about* x: below 1.5 x, so that about 10 % is below 15 %."""

CLEAR = 1.1
"""Ratio to the truth above which there is an excess, or a peak."""

STRONG = 1.5
"""Ratio to the truth above which an excess is *strong*."""

MUCH = 2
"""*Much larger*: at least this many times as large."""

FAILS = 2
"""To *fail* is to be off by this factor, up or down, at half of all multipoles or k."""

ORDERS = 100
"""Too high *by orders of magnitude*: two of them or more."""

MOST = 0.5
"""*Most*: more than this share."""

CONSISTENT = 0.95
"""*Consistently*: at this share, or more, of the multipoles, k or channels."""

NOTABLE = 0.2
"""*Notable*: more than this share of the whole, or of what it was."""

REPRODUCED = "reproduced"
IN_PART = "in part"
INAPPLICABLE = "does not apply"
FAILED = "not reproduced"
VERDICTS = (REPRODUCED, IN_PART, INAPPLICABLE, FAILED)
"""From the best to the worst."""


@dataclass(frozen=True)
class Part:
    """One part of a claim.

    Attributes
    ----------
    name
        What it says, in a few words.
    held
        Whether it holds.
    main
        Whether it is what the paper's sentence is about; the claim is not reproduced without it.
    method
        Short name of the method that it is about, "PCA/ICA" for both; empty if it is about several or none.
    """

    name: str
    held: bool
    main: bool = True
    method: str = ""


@dataclass(frozen=True)
class Finding:
    """What one realisation says of one claim.

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

    @property
    def verdict(self):
        """One of `VERDICTS`.

        Reproduced if all parts hold, in part if all main parts do and another does not, not reproduced if a
        main part does not hold. Without parts it does not apply.
        """
        if not self.parts:
            return INAPPLICABLE
        if all(part.held for part in self.parts):
            return REPRODUCED
        return IN_PART if all(part.held for part in self.parts if part.main) else FAILED

    @property
    def n_held(self):
        """How many parts hold."""
        return sum(part.held for part in self.parts)


def most_common(verdicts):
    """The verdict of most realisations; of two that as many have, the worse, in the order of `VERDICTS`."""
    count = Counter(verdicts)
    return max(count, key=lambda verdict: (count[verdict], VERDICTS.index(verdict)))


def not_applicable(sentence):
    """The `Finding` where what a claim speaks of does not occur; the sentence says what is missing."""
    return Finding(math.nan, (), sentence)


def parts_of(values, test, words, *, main=True, method=""):
    """A `Part` for each of {name: value}: whether `test(value)` is true.

    PCA and ICA leave the same foreground, and are one part: that of the worse of the two, so that it holds if
    it does for both. A part is about the method that it has the name of, otherwise about `method`.
    """
    held = {}
    for name, value in values.items():
        joint = "PCA/ICA" if name in ("PCA", "ICA") else name
        held[joint] = held.get(joint, True) and bool(test(value))
    about = {name: name if name in _ALONE else method for name in held}
    return tuple(Part(f"{name} {words}", one, main, about[name]) for name, one in held.items())
