"""Claims on masks before and after the separation (Sects. 4.1 and 5.1, Appendix B)."""

import math

import numpy as np

from himap.maps import sphere
from himap.measures.diagnostics import BUMP
from himap.paper.claims.base import (
    BEAMS,
    BLIND,
    CLIPPED,
    LEFT_IN,
    LOW_K,
    METHODS,
    above,
    angular_band,
    bump,
    claim,
    each,
    finding,
    frequency_band,
    larger,
    quotients,
    sd_least,
    smaller,
    total,
)
from himap.paper.claims.verdicts import (
    CLEAR,
    CONSISTENT,
    MOST,
    NOTABLE,
    RECOVERED,
    STRONG,
    Part,
    is_smaller,
    parts_of,
)
from himap.paper.methods import BSS

_PLANE = 15.0  # deg of latitude


def _with_and_without(sky, beam, measure, methods):
    """A measure of some methods with the masking of peaks, and without it, each {method: value}."""
    return [each(sky, case, measure, methods) for case in (beam, LEFT_IN.format(beam))]


def _known(values):
    """Those numbers of {name: number or None} that are not None, a list."""
    return [value for value in values.values() if value is not None]


def _all_absent(parts):
    """Whether the premise of every part is absent."""
    return all(part.held is None for part in parts)


@claim("O8", "oscillating", "4.2", "1", "share of masked voxels that are ripple", "notable")
def excess_of_masking(sky):
    """The excess at l < 10 is due to the peak masking, which misidentifies ripples as peaks.

    Without peak masking the mean C/C0 - 1 at l < 10 falls by more than half, for each method that has the
    excess of O2; for a method without it the premise is absent. The deviation of a masked voxel from the
    first baseline is that of HI, noise and foreground, each less its baseline; the voxel is ripple if the
    foreground contributes most. More than a fifth of the masked voxels are ripple; most of them cannot be,
    since B3 states that they are HI. Main parts: PCA/ICA, GMCA and SD; the voxels, without premise where no
    method has the excess; each with the sigma of the clipping with which it holds best: that of each line of
    sight, with which a sine can never exceed 5 sigma, of each channel, or of the cube, since the paper does
    not say which. Other parts: those with each sigma.
    """
    measure = angular_band("mean", 1, 10)
    clips = {"line": "oscillating"} | CLIPPED
    unmasked = each(sky, LEFT_IN.format("oscillating"), measure, BSS)
    masked = {spread: each(sky, case, measure, BSS) for spread, case in clips.items()}
    gone = {
        spread: {
            name: 1 - (unmasked[name] - 1) / (value - 1) if value > STRONG else None
            for name, value in row.items()
        }
        for spread, row in masked.items()
    }
    counts = {spread: sky.masked_voxels(case) for spread, case in clips.items()}
    ripple = {
        spread: row["foreground"] / max(sum(row.values()), 1) if any(_known(gone[spread])) else None
        for spread, row in counts.items()
    }
    best = {
        name: max(_known({clip: row[name] for clip, row in gone.items()}), default=None) for name in unmasked
    }
    most, parts = max(_known(ripple), default=None), ()
    clipped = {f", sigma of the {spread}": (row, ripple[spread]) for spread, row in gone.items()}
    for clip, (shares, share) in ({"": (best, most)} | clipped).items():
        parts += parts_of(shares, above(MOST), f"excess gone without masking{clip}", main=not clip)
        held = None if share is None else share > NOTABLE
        parts += (Part(f"ripple among the masked voxels{clip}", held, main=not clip),)
    wording = {"Mean C/C0 at l < 10 by the sigma of the clipping": masked, "without masking": unmasked}
    wording |= {"masked voxels by what stands out most": counts}
    return finding(math.nan if most is None else most, parts, wording)


@claim("B1", "all three", "4.1, B", "B.3", "smallest ratio of total MSE, without over with", "> 1")
def unmasked_peaks(sky):
    """Without the masking of peaks every method is less accurate.

    Less accurate is a larger total MSE of both spectra, by more than 1 %: a main part for each beam and
    method, PCA/ICA by the worse of the two. The premise is absent for a beam with which no voxel is masked.
    """
    parts, ratios = (), {}
    for beam in BEAMS:
        masked, unmasked = _with_and_without(sky, beam, total, tuple(METHODS))
        any_masked = sum(sky.masked_voxels(beam).values())
        ratios[beam] = quotients(unmasked, masked)
        judged = {name: value if any_masked else None for name, value in ratios[beam].items()}
        parts += parts_of(judged, larger, f"worse, {beam} beam")
    least = math.nan if _all_absent(parts) else min(min(row.values()) for row in ratios.values())
    return finding(least, parts, {"Total MSE without peak masking over that with it": ratios}, "{:.4g}")


@claim(
    "B2",
    "all three",
    "4.1, B",
    "B.3",
    "largest median |P/P0 - 1| at k > 0.1 of BSS, with masking",
    "smaller than without",
)
def broadband_bias(sky):
    """The masking of peaks removes a bias of P/P0 over all scales.

    The bias is the deviation of the median P/P0 at k > 0.1 from 1, which a peak of a few k does not change.
    It is removed if the masking reduces it by more than half: a main part for each beam and BSS method,
    PCA/ICA by the worse of the two. The premise is absent where the bias is below 10 % without the masking.
    """
    median, parts, masked, unmasked = frequency_band("median", LOW_K), (), {}, {}
    for beam in BEAMS:
        masked[beam], unmasked[beam] = _with_and_without(sky, beam, median, BSS)
        bias = {name: abs(value - 1) for name, value in unmasked[beam].items()}
        gone = {
            name: 1 - abs(masked[beam][name] - 1) / value if value > RECOVERED else None
            for name, value in bias.items()
        }
        parts += parts_of(gone, above(MOST), f"less biased, {beam} beam")
    worst = max(abs(value - 1) for row in masked.values() for value in row.values())
    wording = {"Median P/P0 at k > 0.1 without masking": unmasked, "with it": masked}
    return finding(math.nan if _all_absent(parts) else worst, parts, wording, "{:.4g}")


@claim("B3", "all three", "4.1, B", "B.1", "smallest share of masked voxels on an HI peak", "most")
def masked_peaks(sky):
    """The peaks that are masked are bright HI, not point sources.

    The deviation of a masked voxel from the first baseline is that of HI, noise and foreground (point sources
    included), each less its baseline. The voxel lies on an HI peak if HI contributes most; more than half of
    the voxels do. A main part for each beam, without premise where no voxel is masked.
    """
    counts = {beam: sky.masked_voxels(beam) for beam in BEAMS}
    shares = {
        beam: row["HI"] / sum(row.values()) if sum(row.values()) else None for beam, row in counts.items()
    }
    parts = parts_of(shares, above(MOST), "beam: most on HI peaks")
    wording = {"Masked voxels by what stands out most": counts}
    return finding(min(_known(shares), default=math.nan), parts, wording, "{}")


@claim("M1", "oscillating", "5.1", "5", "share of SD's flagged lines within 15 deg of the plane", "most")
def flagged_in_plane(sky):
    """Lines of sight flagged by their error lie along the Galactic plane.

    More than half of the flagged lines of sight of SD lie within 15 deg of the plane, which is 26 % of the
    sky. One part, without premise where none is flagged; the share of the sky that is flagged is shown.
    """
    flagged, name = sky.flagged("sdecgmca"), "most lie in the plane"
    if not flagged.any():
        return finding(math.nan, (Part(name, None, method="SD"),), "No line of sight is flagged.")
    latitude = np.abs(sphere.pixel_latitude(sphere.nside_of(flagged))[flagged])
    share = float(np.mean(latitude < _PLANE))
    return finding(
        share,
        (Part(name, share > MOST, method="SD"),),
        f"{flagged.mean():.2%} of all are flagged; {share:.0%} of these lie within 15 deg of the plane, "
        f"their median |b| is {np.median(latitude):.0f} deg.",
    )


@claim("M2", "oscillating", "5.1", "6", "highest P/P0 of SD near k = 0.31, masked", "lower than unmasked")
def masked_sdecgmca(sky):
    """Excluding the flagged lines of sight lowers the peak of SD.

    The highest P/P0 near k = 0.31 is lower, by more than 1 %. One part, without premise where SD has no peak,
    which is a P/P0 above 1.1 there.
    """
    before, after = bump(sky.of("oscillating")["sdecgmca"]), bump(sky.masked("sdecgmca"))
    peak = before > CLEAR
    parts = (Part("lower peak", is_smaller(after, before) if peak else None, method="SD"),)
    wording = {"Highest P/P0 near k = 0.31": {"without the mask": before, "with it": after}}
    return finding(after if peak else math.nan, parts, wording, "{:.4g}")


def _by_mask(sky, measure, methods, *, binned):
    """A measure with the mask over that without it, {short name: ratio}, `binned` as the masked spectra."""
    full = sky.unmasked if binned else sky.of("oscillating").get
    return {METHODS[name]: measure(sky.masked(name)) / measure(full(name)) for name in methods}


@claim("M3", "oscillating", "5.1", "6", "smallest mean |P/P0 - 1| over that without the mask", "about 1")
def masked_others(sky):
    """P/P0 of the other methods does not improve notably without the flagged lines.

    Notably is by more than a fifth of the mean |P/P0 - 1|. Two main parts: PCA/ICA by the worse of the two,
    and GMCA.
    """
    ratios = _by_mask(sky, frequency_band("error"), BLIND, binned=False)
    parts = parts_of(ratios, lambda value: value >= 1 - NOTABLE, "not notably better")
    return finding(min(ratios.values()), parts, {"Mean |P/P0 - 1| with over without the mask": ratios})


@claim("M4", "oscillating", "5.1", "6", "largest mean |C/C0 - 1| over that without the mask", "< 1")
def masked_angular(sky):
    """C/C0 improves for every BSS method, most for SD.

    The mean |C/C0 - 1| for 2 <= l < 200 shrinks by more than 1 %, with spectra of the full sky in the bins of
    the masked ones; most is by the largest factor. Four main parts: PCA/ICA by the worse of the two, GMCA,
    SD; SD most.
    """
    ratios = _by_mask(sky, angular_band("error", 1, 200), BSS, binned=True)
    parts = (*parts_of(ratios, smaller, "improves"), Part("SD most", sd_least(ratios), method="SD"))
    return finding(max(ratios.values()), parts, {"Mean |C/C0 - 1| with over without the mask": ratios})


@claim("M5", "oscillating", "5.1", "6", "lowest l from which SD recovers C, masked", "lower than unmasked")
def masked_range(sky):
    """Without the flagged lines SD recovers smaller multipoles and lower k.

    A spectrum is recovered from the lowest l (or k) at which, and from which on up to l = 200 (or up to k =
    0.25, below the peak), it is within 10 % of the truth at 95 % of them or more. With the mask both are
    lower, in the same bins. Two parts, both main, without premise where a range is complete without the mask.
    """
    both = sky.unmasked("sdecgmca"), sky.masked("sdecgmca")
    lowest = {"l": both[0].degrees[0], "k": both[0].k[0]}
    starts = {
        "l": [_recovered_from(one.degrees, one.angular_ratio, 200) for one in both],
        "k": [_recovered_from(one.k, one.frequency_ratio, BUMP[0]) for one in both],
    }
    parts = ()
    for axis, word in (("l", "smaller l"), ("k", "lower k")):
        before, after = starts[axis]
        held = is_smaller(after, before) if before > lowest[axis] else None
        parts += (Part(f"SD recovered to {word}", held, method="SD"),)
    wording = {
        f"SD is recovered from {axis} =": {
            "without the mask": before,
            "with it": after,
            "lowest": lowest[axis],
        }
        for axis, (before, after) in starts.items()
    }
    return finding(starts["l"][1] if starts["l"][0] > lowest["l"] else math.nan, parts, wording)


def _recovered_from(x, ratios, top):
    """The lowest x from which on up to `top` the ratios are consistently near 1; infinite if none."""
    inside = x <= top
    near = np.abs(ratios[inside] - 1) < RECOVERED
    share = np.cumsum(near[::-1])[::-1] / np.arange(len(near), 0, -1)
    begins = near & (share >= CONSISTENT)
    return float(x[inside][begins][0]) if begins.any() else np.inf
