"""Claims on the dimmed Galaxy (Sect. 5.2, Fig. 7)."""

import numpy as np

from himap.paper.claims.base import (
    above,
    bump,
    by_method,
    claim,
    each,
    listing,
    number_claim,
    over_each,
    smaller,
    smallest,
    total,
)
from himap.paper.claims.verdicts import CLEAR, RECOVERED, Finding, Part, is_smaller, parts_of

_DIMMED = {"section": "5.2", "figure": "7", "notebook": "13_dimmed_galaxy"}
_CASES = ("oscillating", "dimmed")
_THREE = ("pca", "fastica", "sdecgmca")


def _gain(realisation):
    """Total MSE dimmed over full, {method: ratio}."""
    full, dimmed = (each(case, total)(realisation) for case in _CASES)
    return over_each(dimmed, full)


def _those_most(gain):
    """Whether PCA, ICA and SD have smaller ratios than all others."""
    others = [value for name, value in gain.items() if name not in ("PCA", "ICA", "SD")]
    return is_smaller(max(gain["PCA"], gain["ICA"], gain["SD"]), min(others))


number_claim(
    "G1",
    "oscillating, dimmed",
    "Dimming the plane improves every method, most PCA, ICA and SD.",
    values=_gain,
    test=smaller,
    words="improves",
    sentence="Total MSE dimmed over full",
    also={"most PCA, ICA, SD": _those_most},
    number="largest total MSE over that of the full Galaxy",
    paper="< 1",
    **_DIMMED,
    reading="To improve is a total MSE that is smaller by more than 1 %; most is by factors that are larger "
    "than all others, by more than 1 %. Six main parts: each method, PCA/ICA by the worse of the two; those "
    "three most.",
)


@claim(
    "G2",
    "oscillating, dimmed",
    "The peak near k = 0.3 persists for PCA and ICA, and is below 2 % for SD.",
    number="highest P/P0 of SD near k = 0.31, less 1",
    paper="< 0.02",
    **_DIMMED,
)
def dimmed_peak(realisation):
    """A peak is a P/P0 of more than 1.1 for 0.25 < k < 0.38. Two main parts: it persists for PCA/ICA, both of
    them; that of SD is below 1.02.
    """
    values = each("dimmed", bump, _THREE)(realisation)
    blind = {name: values[name] for name in ("PCA", "ICA")}
    parts = (
        *parts_of(blind, above(CLEAR), "keep the peak"),
        Part("SD below 2 %", values["SD"] < 1.02, method="SD"),
    )
    return Finding(values["SD"] - 1, parts, f"Highest P/P0 near k = 0.31: {listing(values, '{:.4g}')}.")


def _grows(pair):
    """Whether the second of two numbers is larger than the first."""
    return is_smaller(*pair)


def _growth(realisation):
    """Share of l within 10 % before, after, and after less before, each {method: share}."""

    def share(comparison):
        return float(np.mean(np.abs(comparison.angular_ratio[comparison.degrees <= 200] - 1) < RECOVERED))

    before, after = (by_method(realisation.of(case), share, _THREE) for case in _CASES)
    return before, after, {name: after[name] - before[name] for name in before}


@claim(
    "G3",
    "oscillating, dimmed",
    "The recovered range of l grows for PCA, ICA and SD.",
    number="smallest growth of the share of l within 10 %",
    paper="> 0",
    **_DIMMED,
)
def dimmed_range(realisation):
    """The share of l, 2 <= l <= 200, with |C/C0 - 1| < 10 % grows by more than 1 % of itself. Two main parts:
    PCA/ICA by the worse of the two, and SD.
    """
    before, after, growth = _growth(realisation)
    return Finding(
        smallest(growth),
        parts_of({name: (before[name], after[name]) for name in growth}, _grows, "grows"),
        f"Share of l within 10 %: {listing(before, '{:.0%}')}; dimmed: {listing(after, '{:.0%}')}.",
    )


@claim(
    "G4",
    "oscillating, dimmed",
    "Of PCA, ICA and SD, SD gains most from dimming.",
    number="growth of SD's share of l within 10 %",
    paper="> that of PCA and ICA",
    **_DIMMED | {"section": "6"},
)
def dimmed_most(realisation):
    """The conclusions are about the range of l: the share of l, 2 <= l <= 200, within 10 % grows for SD, and
    more than for PCA and for ICA, by more than 1 %. Main part. Another: its total MSE shrinks, by the largest
    factor of the three.
    """
    before, after, growth = _growth(realisation)
    gain = {name: value for name, value in _gain(realisation).items() if name in growth}
    most = _grows((before["SD"], after["SD"])) and is_smaller(max(growth["PCA"], growth["ICA"]), growth["SD"])
    parts = (
        Part("SD's range grows most", most, method="SD"),
        Part(
            "SD's error shrinks most", is_smaller(gain["SD"], min(1, gain["PCA"], gain["ICA"])), False, "SD"
        ),
    )
    return Finding(
        growth["SD"],
        parts,
        f"Growth of the share of l within 10 %: {listing(growth)}; total MSE dimmed over full: "
        f"{listing(gain)}.",
    )
