"""Claims on masks before and after the separation (Sects. 4.1 and 5.1, Appendix B)."""

import math

import numpy as np

from himap.maps import sphere
from himap.measures.diagnostics import BUMP, Comparison
from himap.paper.claims.base import (
    BEAMS,
    BLIND,
    CLEAR,
    CLIPPED,
    CONSISTENT,
    LEFT_IN,
    LOW_K,
    METHODS,
    MOST,
    NOTABLE,
    RECOVERED,
    STRONG,
    Part,
    above,
    angular_band,
    bump,
    claim,
    each,
    finding,
    frequency_band,
    is_smaller,
    larger,
    parts_of,
    sd_least,
    smaller,
)
from himap.paper.methods import BSS

_PLANE = 15.0  # deg of latitude


def _with_and_without(sky, beam, measure, methods):
    """A measure for some methods with and without peak masking, each {method: value}."""
    return [each(sky, case, measure, methods) for case in (beam, LEFT_IN.format(beam))]


@claim("O8", "oscillating", "4.2", "1", "share of masked voxels that are ripple", "notable")
def excess_of_masking(sky):
    """The excess at l < 10 may be due to the peak masking, which can take ripples for peaks.

    Without peak masking the mean C/C0 - 1 at l < 10 falls by more than half, for each method that has the
    excess of O2; for a method without it the premise is absent. The deviation of a masked voxel from the
    first baseline is that of HI, noise and foreground, each less its baseline; the voxel is ripple if the
    foreground contributes most. More than a fifth of the masked voxels are ripple; most of them cannot be,
    since B3 states that they are HI. Main parts: PCA/ICA, GMCA and SD; the voxels, without premise where no
    method has the excess. The paper does not say what sigma of the clipping is: that of each line of sight,
    with which a sine can never exceed 5 sigma, of each channel, or of the cube. The main parts are those with
    the one with which most of them hold. Other parts: those with each sigma.
    """
    measure = angular_band("mean", 1, 10)
    clips = {"line": "oscillating"} | CLIPPED
    unmasked = each(sky, LEFT_IN.format("oscillating"), measure, BSS)
    masked = {spread: each(sky, case, measure, BSS) for spread, case in clips.items()}
    counts = {spread: sky.masked_voxels(case) for spread, case in clips.items()}
    gone, ripples = {}, {}
    for spread, row in masked.items():
        gone[spread] = {
            name: 1 - (unmasked[name] - 1) / (value - 1) if value > STRONG else None
            for name, value in row.items()
        }
        ripple = counts[spread]["foreground"] / max(sum(counts[spread].values()), 1)
        ripples[spread] = None if {*gone[spread].values()} == {None} else ripple

    def parts_with(spread, clip=""):
        ripple = {"ripple": ripples[spread]}
        return (
            *parts_of(gone[spread], above(MOST), f"excess gone without masking{clip}", main=not clip),
            *parts_of(ripple, above(NOTABLE), f"among the masked voxels{clip}", main=not clip),
        )

    best = max(clips, key=lambda spread: sum(part.held is True for part in parts_with(spread)))
    parts = parts_with(best)
    for spread in clips:
        parts += parts_with(spread, f", sigma of the {spread}")
    wording = {"Mean C/C0 at l < 10 by the sigma of the clipping": masked, "without masking": unmasked}
    wording |= {"masked voxels by what stands out most": counts}
    return finding(ripples[best], parts, wording)


@claim("B1", "all three", "4.1, B", "B.3", "smallest ratio of total MSE, without over with", "> 1")
def unmasked_peaks(sky):
    """Without the masking of peaks every method is less accurate.

    Less accurate is a larger total MSE of both spectra, by more than 1 %: a main part for each beam and
    method, PCA/ICA by the worse of the two. The premise is absent for a beam with which no voxel is masked.
    """
    parts, ratios = (), {}
    for beam in BEAMS:
        masked, unmasked = _with_and_without(sky, beam, Comparison.total_error, tuple(METHODS))
        ratios[beam] = {name: value / masked[name] for name, value in unmasked.items()}
        any_masked = any(sky.masked_voxels(beam).values())
        judged = ratios[beam] if any_masked else dict.fromkeys(ratios[beam])
        parts += parts_of(judged, larger, f"worse, {beam} beam")
    least = min(min(row.values()) for row in ratios.values())
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
    return finding(worst, parts, wording, "{:.4g}")


@claim("B3", "all three", "4.1, B", "B.1", "smallest share of masked voxels on an HI peak", "most")
def masked_peaks(sky):
    """The peaks that are masked are bright HI, not point sources.

    The deviation of a masked voxel from the first baseline is that of HI, noise and foreground (point sources
    included), each less its baseline. The voxel lies on an HI peak if HI contributes most; more than half of
    the voxels do. A main part for each beam, without premise where no voxel is masked.
    """
    counts = {beam: sky.masked_voxels(beam) for beam in BEAMS}
    shares = {beam: row["HI"] / n if (n := sum(row.values())) else None for beam, row in counts.items()}
    parts = parts_of(shares, above(MOST), "beam: most on HI peaks")
    least = min((share for share in shares.values() if share is not None), default=None)
    return finding(least, parts, {"Masked voxels by what stands out most": counts}, "{}")


@claim("M1", "oscillating", "5.1", "5", "share of SD's flagged lines within 15 deg of the plane", "most")
def flagged_in_plane(sky):
    """Lines of sight flagged by their error lie along the Galactic plane.

    More than half of the flagged lines of sight of SD lie within 15 deg of the plane, which is 26 % of the
    sky. One part, without premise where none is flagged; the share of the sky that is flagged is shown.
    """
    flagged = sky.flagged("sdecgmca")
    latitude = np.abs(sphere.pixel_latitude(sphere.nside_of(flagged))[flagged])
    share, wording = None, "No line of sight is flagged."
    if flagged.any():
        share = float(np.mean(latitude < _PLANE))
        wording = (
            f"{flagged.mean():.2%} of all are flagged; {share:.0%} of these lie within 15 deg of the plane, "
            f"their median |b| is {np.median(latitude):.0f} deg."
        )
    return finding(share, parts_of({"most lie": share}, above(MOST), "in the plane", method="SD"), wording)


@claim("M2", "oscillating", "5.1", "6", "highest P/P0 of SD near k = 0.31, masked", "lower than unmasked")
def masked_sdecgmca(sky):
    """Excluding the flagged lines of sight lowers the peak of SD.

    The highest P/P0 near k = 0.31 is lower, by more than 1 %. One part, without premise where SD has no peak,
    which is a P/P0 above 1.1 there.
    """
    before, after = bump(sky.of("oscillating")["sdecgmca"]), bump(sky.masked("sdecgmca"))
    lower = is_smaller(after, before) if before > CLEAR else None
    wording = {"Highest P/P0 near k = 0.31": {"without the mask": before, "with it": after}}
    return finding(after, [Part("lower peak", lower, method="SD")], wording, "{:.4g}")


def _by_mask(sky, measure, methods, *, binned):
    """A measure with the mask over that without, {short name: ratio}, if `binned` in the masked bins."""
    full = sky.unmasked if binned else sky.of("oscillating").get
    return {METHODS[name]: measure(sky.masked(name)) / measure(full(name)) for name in methods}


@claim("M3", "oscillating", "5.1", "6", "smallest mean |P/P0 - 1| over that without the mask", "about 1")
def masked_others(sky):
    """P/P0 of the other methods does not improve notably without the flagged lines.

    Notably is by more than a fifth of the mean |P/P0 - 1|. Each method has the mask of its own errors. Two
    main parts: PCA/ICA by the worse of the two, and GMCA.
    """
    ratios = _by_mask(sky, frequency_band("error"), BLIND, binned=False)
    parts = parts_of(ratios, lambda value: value >= 1 - NOTABLE, "not notably better")
    return finding(min(ratios.values()), parts, {"Mean |P/P0 - 1| with over without the mask": ratios})


@claim("M4", "oscillating", "5.1", "6", "largest mean |C/C0 - 1| over that without the mask", "< 1")
def masked_angular(sky):
    """C/C0 improves for every BSS method, most for SD.

    The mean |C/C0 - 1| for l < 200 shrinks by more than 1 %, with spectra of the full sky in the bins of the
    masked ones; most is by the largest factor. Each method has the mask of its own errors, where the paper
    has one mask. Four main parts: PCA/ICA by the worse of the two, GMCA, SD; SD most.
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
    both, parts, starts = (sky.unmasked("sdecgmca"), sky.masked("sdecgmca")), (), {}
    curves = {
        "l": ("smaller l", 200, [(one.degrees, one.angular_ratio) for one in both]),
        "k": ("lower k", BUMP[0], [(one.k, one.frequency_ratio) for one in both]),
    }
    for axis, (word, top, pair) in curves.items():
        before, after = (_recovered_from(*curve, top) for curve in pair)
        lowest = pair[0][0][0]
        lower = is_smaller(after, before) if before > lowest else None
        parts += (Part(f"SD recovered to {word}", lower, method="SD"),)
        starts[axis] = {"without the mask": before, "with it": after, "lowest": lowest}
    wording = {f"SD is recovered from {axis} =": row for axis, row in starts.items()}
    return finding(math.nan if parts[0].held is None else starts["l"]["with it"], parts, wording)


def _recovered_from(x, ratios, top):
    """The lowest x from which the ratios are consistently near 1 up to `top`; infinite if none."""
    inside = x <= top
    near = np.abs(ratios[inside] - 1) < RECOVERED
    share = np.cumsum(near[::-1])[::-1] / np.arange(len(near), 0, -1)
    begins = near & (share >= CONSISTENT)
    return float(x[inside][begins][0]) if begins.any() else np.inf
