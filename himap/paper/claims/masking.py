"""Sections 4.1 and 5: peaks masked, lines of sight left out, the Galaxy dimmed (Figs. 5 to 7)."""

import numpy as np

from himap.maps import sphere
from himap.paper.claims.base import (
    BLIND,
    LOW_K,
    METHODS,
    Finding,
    angular_error,
    bump,
    by_method,
    claim,
    each_part,
    frequency_error,
    listing,
    total,
)
from himap.paper.methods import BSS

__all__ = [
    "dimmed_all",
    "dimmed_peak",
    "dimmed_range",
    "flagged_in_plane",
    "masked_angular",
    "masked_others",
    "masked_sdecgmca",
    "peaks_left_in",
]

_POST = {"section": "5.1", "notebook": "12_post_masking"}
_DIMMED = {"section": "5.2", "figure": "7", "notebook": "13_dimmed_galaxy"}
_PLANE = 15.0  # deg of latitude


@claim(
    "B1", "oscillating", "Without the masking of peaks every method is worse.",
    number="smallest ratio of total MSE, without over with", paper="> 1",
    section="4.1, B", figure="B.3", notebook="03_peak_masking",
)  # fmt: skip
def peaks_left_in(realisation):
    """Worse is a total MSE of both spectra that is larger by a thousandth, one part for each method."""
    with_mask = by_method(realisation.of("oscillating"), total)
    without = by_method(realisation.of("peaks left in"), total)
    values = {name: without[name] / with_mask[name] for name in with_mask}
    return Finding(
        value=min(values.values()),
        parts=each_part(values, lambda value: value > 1.001, "worse"),
        sentence=f"Total MSE without peak masking over that with it: {listing(values, '{:.4g}')}.",
    )


@claim(
    "M1", "oscillating", "The lines of sight whose error stands out lie along the Galactic plane.",
    number="share of SD's flagged lines within 15 deg of the plane", paper="most", figure="5", **_POST,
)  # fmt: skip
def flagged_in_plane(realisation):
    """More than half of those that SD leaves lie within 15 deg of the plane, which is 26 % of the sky."""
    flagged = realisation.flagged("sdecgmca")
    if not flagged.any():
        return Finding(value=np.nan, parts={}, sentence="No line of sight is flagged.")
    latitude = np.abs(sphere.pixel_latitude(sphere.nside_of(flagged))[flagged])
    share = float(np.mean(latitude < _PLANE))
    return Finding(
        value=share,
        parts={"most lie in the plane": share > 0.5},
        sentence=f"{flagged.mean():.2%} of all are flagged; {share:.0%} of these lie within 15 deg "
        f"of the plane, their median |b| is {np.median(latitude):.0f} deg.",
    )


@claim(
    "M2", "oscillating", "Without them the peak of SD is lower, and lower k are recovered.",
    number="highest P/P0 of SD near k = 0.31, masked", paper="lower than unmasked", figure="6", **_POST,
)  # fmt: skip
def masked_sdecgmca(realisation):
    """The highest P/P0 near k = 0.31 is lower, and the mean |P/P0 - 1| at k < 0.1 is smaller. Two parts."""
    unmasked, masked = realisation.of("oscillating")["sdecgmca"], realisation.masked("sdecgmca")
    peak = bump(unmasked), bump(masked)
    low = frequency_error(0, LOW_K)(unmasked), frequency_error(0, LOW_K)(masked)
    return Finding(
        value=peak[1],
        parts={"lower peak": peak[1] < peak[0], "better at k < 0.1": low[1] < low[0]},
        sentence=f"The highest P/P0 goes from {peak[0]:.4g} to {peak[1]:.4g}, "
        f"the mean |P/P0 - 1| at k < 0.1 from {low[0]:.3g} to {low[1]:.3g}.",
    )


@claim(
    "M3", "oscillating", "P/P0 of the other methods does not improve notably.",
    number="smallest mean |P/P0 - 1| over that without the mask", paper="about 1", figure="6", **_POST,
)  # fmt: skip
def masked_others(realisation):
    """Notably is by more than a fifth of the mean |P/P0 - 1|; PCA, ICA and GMCA, one part for each."""
    before = by_method(realisation.of("oscillating"), frequency_error(0), BLIND)
    after = {METHODS[name]: frequency_error(0)(realisation.masked(name)) for name in BLIND}
    values = {name: after[name] / before[name] for name in before}
    return Finding(
        value=min(values.values()),
        parts=each_part(values, lambda value: value > 0.8, "not notably better"),
        sentence=f"Mean |P/P0 - 1| with over without the mask: {listing(values)}.",
    )


@claim(
    "M4", "oscillating", "C/C0 improves for every BSS method, most for SD.",
    number="largest mean |C/C0 - 1| over that without the mask", paper="< 1", figure="6", **_POST,
)  # fmt: skip
def masked_angular(realisation):
    """The mean |C/C0 - 1| for 2 <= l < 200 shrinks; most is by the largest factor. Five parts."""
    error = angular_error(1, 200)
    values = {
        METHODS[name]: error(realisation.masked(name)) / error(realisation.of("oscillating")[name])
        for name in BSS
    }
    return Finding(
        value=max(values.values()),
        parts=each_part(values, lambda value: value < 1, "improves")
        | {"SD most": min(values, key=values.get) == "SD"},
        sentence=f"Mean |C/C0 - 1| with over without the mask: {listing(values)}.",
    )


@claim(
    "G1", "oscillating, dimmed", "Dimming the plane improves every method, most PCA, ICA and SD.",
    number="largest total MSE over that of the full Galaxy", paper="< 1", **_DIMMED,
)  # fmt: skip
def dimmed_all(realisation):
    """To improve is a smaller total MSE; most is by the three largest factors. Seven parts."""
    before, after = (by_method(realisation.of(case), total) for case in ("oscillating", "dimmed"))
    values = {name: after[name] / before[name] for name in before}
    best = set(sorted(values, key=values.get)[:3])
    return Finding(
        value=max(values.values()),
        parts=each_part(values, lambda value: value < 1, "improves")
        | {"most PCA, ICA, SD": best == {"PCA", "ICA", "SD"}},
        sentence=f"Total MSE dimmed over full: {listing(values)}.",
    )


@claim(
    "G2", "oscillating, dimmed", "The peak near k = 0.3 stays for PCA and ICA, and is below 2 % for SD.",
    number="highest P/P0 of SD near k = 0.31, less 1", paper="< 0.02", **_DIMMED,
)  # fmt: skip
def dimmed_peak(realisation):
    """A peak is a P/P0 of more than 1.1 for 0.25 < k < 0.38. Three parts."""
    values = by_method(realisation.of("dimmed"), bump, ("pca", "fastica", "sdecgmca"))
    return Finding(
        value=values["SD"] - 1,
        parts={f"{name}: the peak stays": values[name] > 1.1 for name in ("PCA", "ICA")}
        | {"SD below 2 %": values["SD"] < 1.02},
        sentence=f"Highest P/P0 near k = 0.31: {listing(values, '{:.4g}')}.",
    )


@claim(
    "G3", "oscillating, dimmed", "The range of l that is recovered grows for PCA, ICA and SD.",
    number="smallest growth of the share of l within 10 %", paper="> 0", **_DIMMED,
)  # fmt: skip
def dimmed_range(realisation):
    """The share of l, 2 <= l <= 200, with |C/C0 - 1| < 10 % grows, one part for each method."""

    def share(comparison):
        return float(np.mean(np.abs(comparison.angular_ratio[comparison.degrees <= 200] - 1) < 0.1))

    methods = ("pca", "fastica", "sdecgmca")
    before, after = (by_method(realisation.of(case), share, methods) for case in ("oscillating", "dimmed"))
    values = {name: after[name] - before[name] for name in before}
    return Finding(
        value=min(values.values()),
        parts=each_part(values, lambda value: value > 0, "grows"),
        sentence=f"Share of l within 10 %: {listing(before, '{:.0%}')}; dimmed: {listing(after, '{:.0%}')}.",
    )
