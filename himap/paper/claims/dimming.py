"""Section 5.2 and the conclusions: the Galaxy dimmed (Fig. 7)."""

import numpy as np

from himap.paper.claims.base import bump, by_method, claim, listing, total
from himap.paper.claims.verdicts import CLEAR, RECOVERED, Finding, Part, parts_of

_DIMMED = {"section": "5.2", "figure": "7", "notebook": "13_dimmed_galaxy"}
_CASES = ("oscillating", "dimmed")
_THREE = ("pca", "fastica", "sdecgmca")


def _growth(realisation):
    """Share of l within 10 % before, after, and after less before, each {method: share}."""

    def share(comparison):
        return float(np.mean(np.abs(comparison.angular_ratio[comparison.degrees <= 200] - 1) < RECOVERED))

    before, after = (by_method(realisation.of(case), share, _THREE) for case in _CASES)
    return before, after, {name: after[name] - before[name] for name in before}


def _gain(realisation):
    """Total MSE dimmed over full, {method: ratio}."""
    before, after = (by_method(realisation.of(case), total) for case in _CASES)
    return {name: after[name] / before[name] for name in before}


@claim(
    "G1", "oscillating, dimmed", "Dimming the plane improves every method, most PCA, ICA and SD.",
    number="largest total MSE over that of the full Galaxy", paper="< 1", **_DIMMED,
)  # fmt: skip
def dimmed_all(realisation):
    """To improve is a smaller total MSE; most is by the three largest factors. Six main parts: each method,
    PCA/ICA by the worse of the two; those three most.
    """
    values = _gain(realisation)
    best = set(sorted(values, key=values.get)[:3])
    return Finding(
        value=max(values.values()),
        parts=(
            *parts_of(values, lambda value: value < 1, "improves"),
            Part(name="most PCA, ICA, SD", held=best == {"PCA", "ICA", "SD"}),
        ),
        sentence=f"Total MSE dimmed over full: {listing(values)}.",
    )


@claim(
    "G2", "oscillating, dimmed", "The peak near k = 0.3 stays for PCA and ICA, and is below 2 % for SD.",
    number="highest P/P0 of SD near k = 0.31, less 1", paper="< 0.02", **_DIMMED,
)  # fmt: skip
def dimmed_peak(realisation):
    """A peak is a P/P0 of more than 1.1 for 0.25 < k < 0.38. Two main parts: it stays for PCA/ICA, both of
    them; that of SD is below 1.02.
    """
    values = by_method(realisation.of("dimmed"), bump, _THREE)
    blind = {name: values[name] for name in ("PCA", "ICA")}
    return Finding(
        value=values["SD"] - 1,
        parts=(
            *parts_of(blind, lambda value: value > CLEAR, "keep the peak"),
            Part(name="SD below 2 %", held=values["SD"] < 1.02),
        ),
        sentence=f"Highest P/P0 near k = 0.31: {listing(values, '{:.4g}')}.",
    )


@claim(
    "G3", "oscillating, dimmed", "The range of l that is recovered grows for PCA, ICA and SD.",
    number="smallest growth of the share of l within 10 %", paper="> 0", **_DIMMED,
)  # fmt: skip
def dimmed_range(realisation):
    """The share of l, 2 <= l <= 200, with |C/C0 - 1| < 10 % grows. Two main parts: PCA/ICA by the worse of
    the two, and SD.
    """
    before, after, growth = _growth(realisation)
    return Finding(
        value=min(growth.values()),
        parts=parts_of(growth, lambda value: value > 0, "grows"),
        sentence=f"Share of l within 10 %: {listing(before, '{:.0%}')}; dimmed: {listing(after, '{:.0%}')}.",
    )


@claim(
    "G4", "oscillating, dimmed", "Of PCA, ICA and SD, SD gains most from dimming.",
    number="growth of SD's share of l within 10 %", paper="> that of PCA and ICA",
    section="6", figure="7", notebook="13_dimmed_galaxy",
)  # fmt: skip
def dimmed_most(realisation):
    """The conclusions speak of the range of l: the share of l, 2 <= l <= 200, within 10 % grows for SD, and
    more than for PCA and for ICA. Main part. Another: its total MSE shrinks, by the largest factor of the
    three.
    """
    _, _, growth = _growth(realisation)
    gain = {name: value for name, value in _gain(realisation).items() if name in growth}
    most = growth["SD"] > max(0, growth["PCA"], growth["ICA"])
    least = gain["SD"] < min(1, gain["PCA"], gain["ICA"])
    return Finding(
        value=growth["SD"],
        parts=(
            Part(name="SD's range grows most", held=most),
            Part(name="SD's error shrinks most", held=least, main=False),
        ),
        sentence=f"Growth of the share of l within 10 %: {listing(growth)}; total MSE dimmed over full: "
        f"{listing(gain)}.",
    )
