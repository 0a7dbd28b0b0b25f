"""Section 5.1: lines of sight left out (Figs. 5 and 6)."""

import numpy as np

from himap.maps import sphere
from himap.measures.diagnostics import BUMP
from himap.paper.claims.base import (
    BLIND,
    METHODS,
    angular_error,
    bump,
    by_method,
    claim,
    frequency_error,
    listing,
)
from himap.paper.claims.verdicts import (
    CLEAR,
    CONSISTENT,
    MOST,
    NOTABLE,
    RECOVERED,
    Finding,
    Part,
    not_applicable,
    parts_of,
)
from himap.paper.methods import BSS

_POST = {"section": "5.1", "notebook": "12_post_masking"}
_PLANE = 15.0  # deg of latitude


@claim(
    "M1", "oscillating", "The lines of sight whose error stands out lie along the Galactic plane.",
    number="share of SD's flagged lines within 15 deg of the plane", paper="most", figure="5", **_POST,
)  # fmt: skip
def flagged_in_plane(realisation):
    """More than half of those that SD leaves lie within 15 deg of the plane, which is 26 % of the sky. One
    part; the share of the sky that is flagged is told. It does not apply where none is.
    """
    flagged = realisation.flagged("sdecgmca")
    if not flagged.any():
        return not_applicable("No line of sight is flagged.")
    latitude = np.abs(sphere.pixel_latitude(sphere.nside_of(flagged))[flagged])
    share = float(np.mean(latitude < _PLANE))
    return Finding(
        value=share,
        parts=(Part(name="most lie in the plane", held=share > MOST),),
        sentence=f"{flagged.mean():.2%} of all are flagged; {share:.0%} of these lie within 15 deg "
        f"of the plane, their median |b| is {np.median(latitude):.0f} deg.",
    )


@claim(
    "M2", "oscillating", "Without them the peak of SD is lower.",
    number="highest P/P0 of SD near k = 0.31, masked", paper="lower than unmasked", figure="6", **_POST,
)  # fmt: skip
def masked_sdecgmca(realisation):
    """The highest P/P0 near k = 0.31 is lower. One part. It does not apply where SD has no peak, which is a
    P/P0 above 1.1 there.
    """
    before, after = bump(realisation.of("oscillating")["sdecgmca"]), bump(realisation.masked("sdecgmca"))
    numbers = f"the highest P/P0 goes from {before:.4g} to {after:.4g}"
    if before <= CLEAR:
        return not_applicable(f"SD has no peak: {numbers}.")
    return Finding(
        value=after,
        parts=(Part(name="lower peak", held=after < before),),
        sentence=f"{numbers[0].upper()}{numbers[1:]}.",
    )


@claim(
    "M3", "oscillating", "P/P0 of the other methods does not improve notably.",
    number="smallest mean |P/P0 - 1| over that without the mask", paper="about 1", figure="6", **_POST,
)  # fmt: skip
def masked_others(realisation):
    """Notably is by more than a fifth of the mean |P/P0 - 1|. Two main parts: PCA/ICA by the worse of the
    two, and GMCA.
    """
    before = by_method(realisation.of("oscillating"), frequency_error(0), BLIND)
    after = {METHODS[name]: frequency_error(0)(realisation.masked(name)) for name in BLIND}
    values = {name: after[name] / before[name] for name in before}
    return Finding(
        value=min(values.values()),
        parts=parts_of(values, lambda value: value >= 1 - NOTABLE, "not notably better"),
        sentence=f"Mean |P/P0 - 1| with over without the mask: {listing(values)}.",
    )


@claim(
    "M4", "oscillating", "C/C0 improves for every BSS method, most for SD.",
    number="largest mean |C/C0 - 1| over that without the mask", paper="< 1", figure="6", **_POST,
)  # fmt: skip
def masked_angular(realisation):
    """The mean |C/C0 - 1| for 2 <= l < 200 shrinks, with spectra of the whole sky in the bins of the masked
    ones; most is by the largest factor. Four main parts: PCA/ICA by the worse of the two, GMCA, SD; SD most.
    """
    error = angular_error(1, 200)
    values = {
        METHODS[name]: error(realisation.masked(name)) / error(realisation.unmasked(name)) for name in BSS
    }
    return Finding(
        value=max(values.values()),
        parts=(
            *parts_of(values, lambda value: value < 1, "improves"),
            Part(name="SD most", held=min(values, key=values.get) == "SD"),
        ),
        sentence=f"Mean |C/C0 - 1| with over without the mask: {listing(values)}.",
    )


@claim(
    "M5", "oscillating", "With the mask SD is recovered down to smaller multipoles and lower k.",
    number="lowest l from which SD is recovered, masked", paper="lower than unmasked", figure="6", **_POST,
)  # fmt: skip
def masked_range(realisation):
    """A spectrum is recovered from the lowest l (or k) at which, and from which on up to l = 200 (or up to
    k = 0.25, below the peak), it is within 10 % of the truth at 95 % of them or more. With the mask both are
    lower, in the same bins. Two parts, both main, as far as there is something to gain: a range that is
    whole without the mask is no part.
    """
    parts, words = [], []
    before, after = realisation.unmasked("sdecgmca"), realisation.masked("sdecgmca")
    ranges = {
        "smaller l": [_recovered_from(one.degrees, one.angular_ratio, 200) for one in (before, after)],
        "lower k": [_recovered_from(one.k, one.frequency_ratio, BUMP[0]) for one in (before, after)],
    }
    for (name, (without, with_mask)), lowest in zip(
        ranges.items(), (before.degrees[0], before.k[0]), strict=True
    ):
        if without > lowest:
            parts.append(Part(name=f"SD recovered to {name}", held=with_mask < without))
        words.append(f"{name[-1]} from {without:.3g} without and {with_mask:.3g} with the mask")
    return Finding(
        value=ranges["smaller l"][1] if parts else np.nan,
        parts=tuple(parts),
        sentence=f"SD is recovered in {', '.join(words)} (the lowest are {before.degrees[0]:.3g} and "
        f"{before.k[0]:.3g}).",
    )


def _recovered_from(x, ratios, top):
    """The lowest x from which on up to `top` the ratios are consistently near 1; infinite if none."""
    inside = x <= top
    near = np.abs(ratios[inside] - 1) < RECOVERED
    share = np.cumsum(near[::-1])[::-1] / np.arange(len(near), 0, -1)
    begins = near & (share >= CONSISTENT)
    return float(x[inside][begins][0]) if begins.any() else np.inf
