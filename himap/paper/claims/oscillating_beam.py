"""Claims on the oscillating beam, and on all three beams (Sect. 4.2, Figs. 1 and 2)."""

import numpy as np

from himap.measures.diagnostics import FAILING
from himap.paper.claims.base import (
    BEAMS,
    LOW_K,
    METHODS,
    above,
    angular_band,
    bump,
    claim,
    claims_of,
    each,
    finding,
    frequency_band,
    mean_error,
    sd_least,
)
from himap.paper.claims.verdicts import (
    CLEAR,
    MUCH,
    RECOVERED,
    STRONG,
    Part,
    is_smaller,
    not_applicable,
    parts_of,
)
from himap.paper.methods import BSS

angular_claim, frequency_claim = (claims_of(section="4.2", figure=n, notebook="10_results") for n in "12")
_ACCURATE = 0.05
_NEAR_200 = (150, 300)
_DIGITS = 1 / np.finfo(np.float32).eps  # condition number from which float32 maps leave no digit


@angular_claim("O1", "oscillating", number="smallest of the four mean deviations from 1", paper="> 0.1")
def oscillating_fits(sky):
    """POL and PAR fail in both spectra.

    A fit fails if its mean |C/C0 - 1| is above 10 % for 10 < l < 200 (or 2 nside), as in all claims, and in
    P/P0 if the mean over all k is. Four parts, all main.
    """
    measures = {"C": mean_error, "P": frequency_band("error")}
    errors = {
        f"{METHODS[name]} in {spectrum}": measure(sky.of("oscillating")[name])
        for name in ("polynomial", "parametric")
        for spectrum, measure in measures.items()
    }
    parts = (Part(f"{name} fails", value > FAILING, method=name[:3]) for name, value in errors.items())
    return finding(min(errors.values()), tuple(parts), {"Mean deviation from 1": errors})


@angular_claim("O2", "oscillating", number="smallest mean C/C0 at l < 10", paper="> 1.5")
def oscillating_large_scales(sky):
    """The BSS methods have a strong excess in C/C0 at l < 10.

    A strong excess is a mean of more than 1.5 for 2 <= l < 10. Three main parts: PCA/ICA by the worse of the
    two, GMCA, SD.
    """
    means = each(sky, "oscillating", angular_band("mean", 1, 10), BSS)
    parts = parts_of(means, above(STRONG), "in excess")
    return finding(min(means.values()), parts, {"Mean C/C0 at l < 10": means})


@angular_claim("O3", "oscillating", number="|C/C0 - 1| of SD, at 95 % of the l", paper="< 0.05")
def oscillating_angular(sky):
    """SD recovers C to within 5 % for 10 < l < 200; PCA, ICA and GMCA each deviate more.

    Main part: SD is within 5 % at 95 % of the l (the conclusions of the paper say 20 < l < 200, which is
    shown but not judged). Two others: the mean |C/C0 - 1| is larger by more than 1 % for PCA/ICA, both of
    them, and for GMCA.
    """
    sd = sky.of("oscillating")["sdecgmca"]
    within = {f"from {low} on": angular_band("within", low, 200)(sd) for low in (10, 20)}
    errors = each(sky, "oscillating", mean_error, BSS)
    others = {name: value for name, value in errors.items() if name != "SD"}
    parts = (
        Part("SD within 5 %", within["from 10 on"] < _ACCURATE, method="SD"),
        *parts_of(others, lambda value: is_smaller(errors["SD"], value), "further off", main=False),
    )
    wording = {"|C/C0 - 1| of SD at 95 % of the l": within, "mean |C/C0 - 1|": errors}
    return finding(within["from 10 on"], parts, wording)


@frequency_claim("O4", "oscillating", number="highest P/P0 of SD near k = 0.31", paper="> 1, lowest")
def oscillating_peak(sky):
    """Every BSS method has a spurious peak in P/P0 near k = 0.3, SD the lowest.

    A peak is a P/P0 above 1.1 for 0.25 < k < 0.38. Three main parts: PCA/ICA (both of them) and GMCA have
    one; SD has one; SD has the lowest of all, by more than 1 %.
    """
    tops = each(sky, "oscillating", bump, BSS)
    blind = all(value > CLEAR for name, value in tops.items() if name != "SD")
    parts = (
        Part("PCA/ICA, GMCA have the peak", blind, method="PCA/ICA, GMCA"),
        Part("SD has the peak", tops["SD"] > CLEAR, method="SD"),
        Part("SD has the lowest", sd_least(tops), method="SD"),
    )
    return finding(tops["SD"], parts, {"Highest P/P0 near k = 0.31": tops})


@frequency_claim("O5", "oscillating", number="mean P/P0 of SD at k < 0.1", paper="> 1.1")
def oscillating_low_k(sky):
    """The BSS methods have an excess in P/P0 at low k, SD no smaller than PCA or ICA.

    An excess is a mean of more than 1.1 at k < 0.1; better is nearer to 1, by more than 1 % of the distance.
    Main parts: SD is in excess, and it is no better than PCA/ICA, neither of them. Two others: PCA/ICA and
    GMCA are in excess.
    """
    means = each(sky, "oscillating", frequency_band("mean", 0, LOW_K), BSS)
    distance = {name: abs(value - 1) for name, value in means.items()}
    no_better = not is_smaller(distance["SD"], max(distance["PCA"], distance["ICA"]))
    others = {name: value for name, value in means.items() if name != "SD"}
    parts = (
        Part("SD in excess", means["SD"] > CLEAR, method="SD"),
        Part("SD no better than PCA/ICA", no_better, method="SD"),
        *parts_of(others, above(CLEAR), "in excess", main=False),
    )
    return finding(means["SD"], parts, {"Mean P/P0 at k < 0.1": means})


@angular_claim("O6", "all three", number="highest C/C0 of SD at l > 200", paper="> 1.1")
def beyond_200(sky):
    """Beyond l = 200 SD has a spurious peak in C, due to its regularised inversion.

    The regularised inversion of SD is continued beyond l = 200. A peak is a C/C0 of more than 1.1 between l =
    200 and 2 nside: a main part for each beam. It is due to the regularisation if its top lies where strategy
    3 regularises (R1): another part for each beam. It does not apply to maps that end before.
    """
    parts, found = (), {}
    for beam in BEAMS:
        comparison = sky.beyond(beam)
        beyond = comparison.degrees > 200
        if not beyond.any():
            return not_applicable(f"These maps end at l = {comparison.degrees.max():.0f}.")
        ratios = comparison.angular_ratio[beyond]
        peak, top, onset = ratios.max(), comparison.degrees[beyond][ratios.argmax()], _onset(sky, beam)[0]
        parts += (Part(f"{beam} beam: a peak", bool(peak > CLEAR), method="SD"),)
        parts += (Part(f"{beam} beam: where it is regularised", bool(top >= onset), False, "SD"),)
        found[beam] = {"C/C0": peak, "at l =": top, "regularised from l =": onset}
    highest = max(row["C/C0"] for row in found.values())
    return finding(highest, parts, {"Highest C/C0 of SD beyond l = 200": found}, "{:.4g}")


@angular_claim(
    "O7",
    "all three",
    number="offset with the oscillating beam over that with the others, smallest of BSS",
    paper="> 2",
)
def offset_in_other_beams(sky):
    """The offset of BSS at l < 10 exists with all beams, much larger with the oscillating one.

    The offset is the largest |C/C0 - 1| for 2 <= l < 10. It exists where it is above 10 %, and is much larger
    where it is at least twice as large. Six main parts, two for each of PCA/ICA (by the worse of the two),
    GMCA and SD: it exists in the degraded and in the evolving beam; it is much larger in the oscillating one
    than in both.
    """
    offsets = {beam: each(sky, beam, angular_band("deviation", 1, 10), BSS) for beam in BEAMS}
    degraded, evolving, oscillating = offsets.values()
    smaller = {name: min(degraded[name], evolving[name]) for name in degraded}
    times = {name: oscillating[name] / max(degraded[name], evolving[name]) for name in degraded}
    parts = parts_of(smaller, above(RECOVERED), "in the other beams")
    parts += parts_of(times, lambda value: value >= MUCH, "much larger in the oscillating")
    return finding(min(times.values()), parts, {"Largest |C/C0 - 1| at l < 10": offsets})


@claim(
    "R1",
    "all three",
    number="first l where strategy 3 regularises, smallest of the beams",
    paper="about 200",
    section="4.2",
    notebook="09_sdecgmca",
)
def inversion_limit(sky):
    """The beam can be inverted without regularisation up to l of about 200, not beyond.

    With SD's mixing matrix A and the beam H itself, strategy 3 of C21 gives epsilon_l = max(0, c -
    lambda_min(A^T H_l^2 A) / lambda_min(A^T A)), c of Table 1. The first l with epsilon_l > 0 lies from 150
    to 300, a range that allows for the widths of the beams; and the matrix cannot be inverted there: its
    condition number is above 8e6, at which float32 maps have no significant digit. Two main parts for each
    beam. It does not apply to maps that end before it sets in, and before l = 300.
    """
    pairs = zip(*(_onset(sky, beam) for beam in BEAMS), strict=True)
    onsets, conditions = (dict(zip(BEAMS, several, strict=True)) for several in pairs)
    last = min(sky.windows(beam).shape[1] for beam in BEAMS) - 1
    if last < _NEAR_200[1] and np.isnan([*onsets.values()]).any():
        return not_applicable(f"These maps end at l = {last}, before it sets in.")
    parts = ()
    for beam in BEAMS:
        near = _NEAR_200[0] <= onsets[beam] <= _NEAR_200[1]
        parts += (Part(f"{beam} beam: sets in near l = 200", near, method="SD"),)
        parts += (Part(f"{beam} beam: cannot be inverted there", conditions[beam] > _DIGITS, method="SD"),)
    wording = {"Strategy 3 regularises from l =": onsets, "condition number": conditions}
    return finding(float(np.fmin.reduce([*onsets.values()])), parts, wording)


def _onset(sky, beam):
    """First l that strategy 3 regularises, or NaN, and the condition number of A^T H_l^2 A there, or at the
    end.

    Singular values of H_l A, whose squares are the eigenvalues of A^T H_l^2 A, keep twice the digits.
    """
    mixing, windows = sky.mixing(beam), sky.windows(beam)
    blurred = windows.T[:, :, None] * mixing
    highest, *_, lowest = np.linalg.svd(blurred, compute_uv=False).T ** 2
    limit = np.linalg.svd(mixing, compute_uv=False)[-1] ** 2
    regularised = lowest / limit < sky.regularisation(beam)
    at = int(regularised.argmax()) if regularised.any() else -1
    return at if at >= 0 else np.nan, float(highest[at] / lowest[at]) if lowest[at] else np.inf


@angular_claim(
    "S1", "all three", number="largest mean |C/C0 - 1| of SD over the beams", paper="smallest of all"
)
def most_consistent(sky):
    """SD is the most consistent over the three beams.

    The most consistent is the method whose deviation in its worst beam is the smallest of all six, by more
    than 1 %: the mean |C/C0 - 1| for 2 <= l < 200, and the mean |P/P0 - 1| over all k. Two parts, both main.
    """
    worst = {}
    for spectrum, error in (("C/C0", angular_band("error", 1, 200)), ("P/P0", frequency_band("error"))):
        by_beam = [each(sky, beam, error) for beam in BEAMS]
        worst[spectrum] = {name: max(row[name] for row in by_beam) for name in METHODS.values()}
    parts = (
        Part(f"SD least off in {spectrum}", sd_least(row), method="SD") for spectrum, row in worst.items()
    )
    return finding(worst["C/C0"]["SD"], tuple(parts), {"Mean deviation in the worst beam": worst})
