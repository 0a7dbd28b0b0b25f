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
    frequency_band,
    larger,
    listing,
    listing_by_beam,
    number_claim,
    over_each,
    sd_least,
    smaller,
    smallest,
    total,
)
from himap.paper.claims.verdicts import (
    CLEAR,
    CONSISTENT,
    MOST,
    NOTABLE,
    RECOVERED,
    STRONG,
    Finding,
    Part,
    is_smaller,
    parts_of,
)
from himap.paper.methods import BSS

_PEAKS = {"section": "4.1, B", "notebook": "03_peak_masking"}
_POST = {"section": "5.1", "notebook": "12_post_masking"}
_PLANE = 15.0  # deg of latitude
_IN_PLANE = "most lie in the plane"


def _with_and_without(realisation, beam, measure, methods):
    """A measure of some methods with the masking of peaks, and without it, each {method: value}."""
    return [each(case, measure, methods)(realisation) for case in (beam, LEFT_IN.format(beam))]


@claim(
    "O8",
    "oscillating",
    "The excess at l < 10 is due to the peak masking, which misidentifies ripples as peaks.",
    number="share of masked voxels that are ripple",
    paper="notable",
    section="4.2",
    figure="1",
    notebook="10_results",
)
def excess_of_masking(realisation):
    """Without peak masking the mean C/C0 - 1 at l < 10 falls by more than half, for each method that has the
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
    unmasked = each(LEFT_IN.format("oscillating"), measure, BSS)(realisation)
    masked = {spread: each(case, measure, BSS)(realisation) for spread, case in clips.items()}
    gone = {
        spread: {name: _share_gone(value, unmasked[name]) for name, value in row.items()}
        for spread, row in masked.items()
    }
    counts = {spread: realisation.masked_voxels(case) for spread, case in clips.items()}
    ripple = {
        spread: row["foreground"] / max(sum(row.values()), 1) if any(_known(gone[spread])) else None
        for spread, row in counts.items()
    }
    best = {
        name: max(_known({clip: row[name] for clip, row in gone.items()}), default=None) for name in unmasked
    }
    most = max(_known(ripple), default=None)
    words, voxels = "excess gone without masking", "ripple among the masked voxels"
    parts = *parts_of(best, above(MOST), words), _ripple(voxels, most)
    for spread, row in gone.items():
        parts += parts_of(row, above(MOST), f"{words}, sigma of the {spread}", main=False)
        parts += (_ripple(f"{voxels}, sigma of the {spread}", ripple[spread], main=False),)
    sentence = (
        f"Mean C/C0 at l < 10 by the sigma of the clipping: {listing_by_beam(masked)}; without masking: "
        f"{listing(unmasked)}. Masked voxels by what stands out most: {listing_by_beam(counts, '{}')}."
    )
    return Finding(math.nan if most is None else most, parts, sentence)


def _share_gone(masked, unmasked):
    """Share of the excess of a mean C/C0 that is gone without masking; None where there is no excess."""
    return 1 - (unmasked - 1) / (masked - 1) if masked > STRONG else None


def _known(values):
    """Those numbers of {name: number or None} that are not None, a list."""
    return [value for value in values.values() if value is not None]


def _ripple(name, share, **about):
    """The part that a notable share of the masked voxels is ripple."""
    return Part(name, None if share is None else share > NOTABLE, **about)


@claim(
    "B1",
    "all three",
    "Without the masking of peaks every method is less accurate.",
    number="smallest ratio of total MSE, without over with",
    paper="> 1",
    figure="B.3",
    **_PEAKS,
)
def unmasked_peaks(realisation):
    """Less accurate is a larger total MSE of both spectra, by more than 1 %: a main part for each beam and
    method, PCA/ICA by the worse of the two. The premise is absent for a beam with which no voxel is masked.
    """
    parts, ratios = (), {}
    for beam in BEAMS:
        masked, unmasked = _with_and_without(realisation, beam, total, tuple(METHODS))
        any_masked = sum(realisation.masked_voxels(beam).values())
        ratios[beam] = over_each(unmasked, masked)
        judged = {name: value if any_masked else None for name, value in ratios[beam].items()}
        parts += parts_of(judged, larger, f"worse, {beam} beam")
    least = min(map(smallest, ratios.values())) if any(part.held is not None for part in parts) else math.nan
    sentence = f"Total MSE without peak masking over that with it: {listing_by_beam(ratios, '{:.4g}')}."
    return Finding(least, parts, sentence)


@claim(
    "B2",
    "all three",
    "The masking of peaks removes a bias of P/P0 over all scales.",
    number="largest median |P/P0 - 1| at k > 0.1 of BSS, with masking",
    paper="smaller than without",
    figure="B.3",
    **_PEAKS,
)
def broadband_bias(realisation):
    """The bias is the deviation of the median P/P0 at k > 0.1 from 1, which a peak of a few k does not
    change. It is removed if the masking reduces it by more than half: a main part for each beam and BSS
    method, PCA/ICA by the worse of the two. The premise is absent where the bias is below 10 % without the
    masking.
    """
    median, parts, masked, unmasked = frequency_band("median", LOW_K), (), {}, {}
    for beam in BEAMS:
        masked[beam], unmasked[beam] = _with_and_without(realisation, beam, median, BSS)
        bias = {name: abs(value - 1) for name, value in unmasked[beam].items()}
        gone = {
            name: 1 - abs(masked[beam][name] - 1) / value if value > RECOVERED else None
            for name, value in bias.items()
        }
        parts += parts_of(gone, above(MOST), f"less biased, {beam} beam")
    sentence = (
        f"Median P/P0 at k > 0.1 without masking: {listing_by_beam(unmasked, '{:.4g}')}; "
        f"with it: {listing_by_beam(masked, '{:.4g}')}."
    )
    worst = max(abs(value - 1) for row in masked.values() for value in row.values())
    return Finding(worst if any(part.held is not None for part in parts) else math.nan, parts, sentence)


@claim(
    "B3",
    "all three",
    "The peaks that are masked are bright HI, not point sources.",
    number="smallest share of masked voxels on an HI peak",
    paper="most",
    figure="B.1",
    **_PEAKS,
)
def masked_peaks(realisation):
    """The deviation of a masked voxel from the first baseline is that of HI, noise and foreground (point
    sources included), each less its baseline. The voxel lies on an HI peak if HI contributes most; more than
    half of the voxels do. A main part for each beam, without premise where no voxel is masked.
    """
    counts = {beam: realisation.masked_voxels(beam) for beam in BEAMS}
    shares = {
        beam: row["HI"] / sum(row.values()) if sum(row.values()) else None for beam, row in counts.items()
    }
    return Finding(
        min(_known(shares), default=math.nan),
        parts_of(shares, above(MOST), "beam: most on HI peaks"),
        f"Masked voxels by what stands out most: {listing_by_beam(counts, '{}')}.",
    )


@claim(
    "M1",
    "oscillating",
    "Lines of sight flagged by their error lie along the Galactic plane.",
    number="share of SD's flagged lines within 15 deg of the plane",
    paper="most",
    figure="5",
    **_POST,
)
def flagged_in_plane(realisation):
    """More than half of the flagged lines of sight of SD lie within 15 deg of the plane, which is 26 % of the
    sky. One part, without premise where none is flagged; the share of the sky that is flagged is shown.
    """
    flagged = realisation.flagged("sdecgmca")
    if not flagged.any():
        return Finding(math.nan, (Part(_IN_PLANE, None, method="SD"),), "No line of sight is flagged.")
    latitude = np.abs(sphere.pixel_latitude(sphere.nside_of(flagged))[flagged])
    share = float(np.mean(latitude < _PLANE))
    return Finding(
        share,
        (Part(_IN_PLANE, share > MOST, method="SD"),),
        f"{flagged.mean():.2%} of all are flagged; {share:.0%} of these lie within 15 deg of the plane, "
        f"their median |b| is {np.median(latitude):.0f} deg.",
    )


@claim(
    "M2",
    "oscillating",
    "Excluding the flagged lines of sight lowers the peak of SD.",
    number="highest P/P0 of SD near k = 0.31, masked",
    paper="lower than unmasked",
    figure="6",
    **_POST,
)
def masked_sdecgmca(realisation):
    """The highest P/P0 near k = 0.31 is lower, by more than 1 %. One part, without premise where SD has no
    peak, which is a P/P0 above 1.1 there.
    """
    before, after = bump(realisation.of("oscillating")["sdecgmca"]), bump(realisation.masked("sdecgmca"))
    peak = before > CLEAR
    held = is_smaller(after, before) if peak else None
    sentence = (
        f"{'The' if peak else 'SD has no peak: the'} highest P/P0 goes from {before:.4g} to {after:.4g}."
    )
    return Finding(after if peak else math.nan, (Part("lower peak", held, method="SD"),), sentence)


def _masked_over_unmasked(measure, unmasked, methods):
    """Function from a `Realisation` to a measure with the mask over that without it, {short name: ratio}."""

    def values(realisation):
        return {
            METHODS[name]: measure(realisation.masked(name)) / measure(unmasked(realisation, name))
            for name in methods
        }

    return values


number_claim(
    "M3",
    "oscillating",
    "P/P0 of the other methods does not improve notably without the flagged lines.",
    values=_masked_over_unmasked(frequency_band("error"), lambda sky, one: sky.of("oscillating")[one], BLIND),
    test=lambda value: value >= 1 - NOTABLE,
    words="not notably better",
    value=smallest,
    sentence="Mean |P/P0 - 1| with over without the mask",
    number="smallest mean |P/P0 - 1| over that without the mask",
    paper="about 1",
    figure="6",
    **_POST,
    reading="Notably is by more than a fifth of the mean |P/P0 - 1|. Two main parts: PCA/ICA by the worse of "
    "the two, and GMCA.",
)

number_claim(
    "M4",
    "oscillating",
    "C/C0 improves for every BSS method, most for SD.",
    values=_masked_over_unmasked(angular_band("error", 1, 200), lambda sky, one: sky.unmasked(one), BSS),
    test=smaller,
    words="improves",
    also={"SD most": sd_least},
    sentence="Mean |C/C0 - 1| with over without the mask",
    number="largest mean |C/C0 - 1| over that without the mask",
    paper="< 1",
    figure="6",
    **_POST,
    reading="The mean |C/C0 - 1| for 2 <= l < 200 shrinks by more than 1 %, with spectra of the full sky in "
    "the bins of the masked ones; most is by the largest factor. Four main parts: PCA/ICA by the worse of "
    "the two, GMCA, SD; SD most.",
)


@claim(
    "M5",
    "oscillating",
    "Without the flagged lines SD recovers smaller multipoles and lower k.",
    number="lowest l from which SD recovers C, masked",
    paper="lower than unmasked",
    figure="6",
    **_POST,
)
def masked_range(realisation):
    """A spectrum is recovered from the lowest l (or k) at which, and from which on up to l = 200 (or up to k
    = 0.25, below the peak), it is within 10 % of the truth at 95 % of them or more. With the mask both are
    lower, in the same bins. Two parts, both main, without premise where a range is complete without the mask.
    """
    both = realisation.unmasked("sdecgmca"), realisation.masked("sdecgmca")
    lowest_l, lowest_k = both[0].degrees[0], both[0].k[0]
    in_l = [_recovered_from(one.degrees, one.angular_ratio, 200) for one in both]
    in_k = [_recovered_from(one.k, one.frequency_ratio, BUMP[0]) for one in both]
    parts, words = [], []
    for name, (before, after), lowest in (("smaller l", in_l, lowest_l), ("lower k", in_k, lowest_k)):
        held = is_smaller(after, before) if before > lowest else None
        parts.append(Part(f"SD recovered to {name}", held, method="SD"))
        words.append(f"{name[-1]} from {before:.3g} without and {after:.3g} with the mask")
    sentence = f"SD is recovered in {', '.join(words)} (the lowest are {lowest_l:.3g} and {lowest_k:.3g})."
    return Finding(in_l[1] if in_l[0] > lowest_l else math.nan, tuple(parts), sentence)


def _recovered_from(x, ratios, top):
    """The lowest x from which on up to `top` the ratios are consistently near 1; infinite if none."""
    inside = x <= top
    near = np.abs(ratios[inside] - 1) < RECOVERED
    share = np.cumsum(near[::-1])[::-1] / np.arange(len(near), 0, -1)
    begins = near & (share >= CONSISTENT)
    return float(x[inside][begins][0]) if begins.any() else np.inf
