"""Claims on the dimmed Galaxy (Sect. 5.2, Fig. 7)."""

import numpy as np

from himap.paper.claims.base import above, bump, claims_of, each, finding, quotients, smaller, total
from himap.paper.claims.verdicts import CLEAR, RECOVERED, Part, is_smaller, parts_of

dimmed_claim = claims_of(figure="7", notebook="13_dimmed_galaxy")
_CASES = ("oscillating", "dimmed")
_THREE = ("pca", "fastica", "sdecgmca")


def _gain(sky):
    """Total MSE dimmed over full, {method: ratio}."""
    full, dimmed = (each(sky, case, total) for case in _CASES)
    return quotients(dimmed, full)


@dimmed_claim(
    "G1",
    "oscillating, dimmed",
    number="largest total MSE over that of the full Galaxy",
    paper="< 1",
    section="5.2",
)
def dimmed_error(sky):
    """Dimming the plane improves every method, most PCA, ICA and SD.

    To improve is a total MSE that is smaller by more than 1 %; most is by factors that are larger than all
    others, by more than 1 %. Six main parts: each method, PCA/ICA by the worse of the two; those three most.
    """
    gain = _gain(sky)
    others = [value for name, value in gain.items() if name not in ("PCA", "ICA", "SD")]
    most = is_smaller(max(gain["PCA"], gain["ICA"], gain["SD"]), min(others))
    parts = (*parts_of(gain, smaller, "improves"), Part("most PCA, ICA, SD", most))
    return finding(max(gain.values()), parts, {"Total MSE dimmed over full": gain})


@dimmed_claim(
    "G2",
    "oscillating, dimmed",
    number="highest P/P0 of SD near k = 0.31, less 1",
    paper="< 0.02",
    section="5.2",
)
def dimmed_peak(sky):
    """The peak near k = 0.3 persists for PCA and ICA, and is below 2 % for SD.

    A peak is a P/P0 of more than 1.1 for 0.25 < k < 0.38. Two main parts: it persists for PCA/ICA, both of
    them; that of SD is below 1.02.
    """
    tops = each(sky, "dimmed", bump, _THREE)
    parts = (
        *parts_of({name: tops[name] for name in ("PCA", "ICA")}, above(CLEAR), "keep the peak"),
        Part("SD below 2 %", tops["SD"] < 1.02, method="SD"),
    )
    return finding(tops["SD"] - 1, parts, {"Highest P/P0 near k = 0.31": tops}, "{:.4g}")


def _recovered_shares(sky):
    """Share of l within 10 %, {case: {method: share}}, and how much it grows with dimming, {method: more}."""

    def share(comparison):
        return float(np.mean(np.abs(comparison.angular_ratio[comparison.degrees <= 200] - 1) < RECOVERED))

    shares = {case: each(sky, case, share, _THREE) for case in _CASES}
    full, dimmed = shares.values()
    return shares, {name: dimmed[name] - full[name] for name in full}


@dimmed_claim(
    "G3",
    "oscillating, dimmed",
    number="smallest growth of the share of l within 10 %",
    paper="> 0",
    section="5.2",
)
def dimmed_range(sky):
    """The recovered range of l grows for PCA, ICA and SD.

    The share of l, 2 <= l <= 200, with |C/C0 - 1| < 10 % grows by more than 1 % of itself. Two main parts:
    PCA/ICA by the worse of the two, and SD.
    """
    shares, growth = _recovered_shares(sky)
    pairs = {name: [row[name] for row in shares.values()] for name in growth}
    parts = parts_of(pairs, lambda pair: is_smaller(*pair), "grows")
    return finding(min(growth.values()), parts, {"Share of l within 10 %": shares}, "{:.0%}")


@dimmed_claim(
    "G4",
    "oscillating, dimmed",
    number="growth of SD's share of l within 10 %",
    paper="> that of PCA and ICA",
    section="6",
)
def dimmed_most(sky):
    """Of PCA, ICA and SD, SD gains most from dimming.

    The conclusions are about the range of l: the share of l, 2 <= l <= 200, within 10 % grows for SD, and
    more than for PCA and for ICA, by more than 1 %. Main part. Another: its total MSE shrinks, by the largest
    factor of the three.
    """
    shares, growth = _recovered_shares(sky)
    gain = {name: value for name, value in _gain(sky).items() if name in growth}
    grows = is_smaller(*(row["SD"] for row in shares.values()))
    most = grows and is_smaller(max(growth["PCA"], growth["ICA"]), growth["SD"])
    shrinks = is_smaller(gain["SD"], min(1, gain["PCA"], gain["ICA"]))
    parts = (
        Part("SD's range grows most", most, method="SD"),
        Part("SD's error shrinks most", shrinks, False, "SD"),
    )
    wording = {"Growth of the share of l within 10 %": growth, "total MSE dimmed over full": gain}
    return finding(growth["SD"], parts, wording)
