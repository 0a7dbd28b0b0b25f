"""The five conclusions of the paper (its Sect. 6), and the claims of the ledger that each rests on."""

from dataclasses import dataclass

from himap.paper.claims import IN_PART, INAPPLICABLE, REPRODUCED, UNDECIDED


@dataclass(frozen=True, kw_only=True)
class Conclusion:
    """One conclusion of the paper.

    Attributes
    ----------
    says
        What the paper concludes, in our words.
    claims
        Ids of the claims that hold its numbers.
    """

    says: str
    claims: tuple


CONCLUSIONS = (
    Conclusion(
        says="With all channels at one resolution every method recovers both spectra to better than 10 %.",
        claims=("D1", "D2"),
    ),
    Conclusion(
        says="With a beam that evolves smoothly with frequency the parametric fit fails, GMCA degrades from "
        "intermediate scales on, and PCA, FastICA and SDecGMCA remain accurate.",
        claims=("E1", "E2", "E3", "E4"),
    ),
    Conclusion(
        says="Both fits fail; of the other methods SDecGMCA is the most accurate: it suppresses the spurious "
        "peak near k = 0.3 and recovers the angular spectrum at intermediate multipoles. Beyond l of about "
        "200 its inversion of the beam is unstable.",
        claims=("O1", "O3", "O4", "O6", "S1"),
    ),
    Conclusion(
        says="The number of sources is critical; 5 to 7 is the best compromise.",
        claims=("N1", "N2", "N4"),
    ),
    Conclusion(
        says="Excluding contaminated lines of sight after the separation reduces the residual of SDecGMCA; "
        "dimming the Galactic plane before it improves PCA, FastICA and most of all SDecGMCA.",
        claims=("M2", "M4", "M5", "G1", "G3", "G4"),
    ),
)
"""In the order of the paper."""


def verdict(entries):
    """The verdict on a conclusion, from those on its claims.

    It is "reproduced" if all of them are, "in part" if one of them is at least in part, "not reproduced" if
    all are that, and else "undecided". Claims that do not apply do not count.

    Parameters
    ----------
    entries
        `himap.paper.claims.entries.Entry` of each of its claims.
    """
    verdicts = {entry.verdict for entry in entries} - {INAPPLICABLE}
    if len(verdicts) < 2:
        return verdicts.pop() if verdicts else INAPPLICABLE
    return IN_PART if verdicts & {REPRODUCED, IN_PART} else UNDECIDED
