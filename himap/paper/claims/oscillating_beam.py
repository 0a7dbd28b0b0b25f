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
    by_method,
    claim,
    each,
    frequency_band,
    largest,
    listing,
    listing_by_beam,
    number_claim,
    sd_least,
    smallest,
)
from himap.paper.claims.verdicts import (
    CLEAR,
    MUCH,
    RECOVERED,
    STRONG,
    Finding,
    Part,
    is_smaller,
    not_applicable,
    parts_of,
)
from himap.paper.methods import BSS

_ANGULAR = {"section": "4.2", "figure": "1", "notebook": "10_results"}
_FREQUENCY = {"section": "4.2", "figure": "2", "notebook": "10_results"}
_ACCURATE = 0.05
_NEAR_200 = (150, 300)
_DIGITS = 1 / np.finfo(np.float32).eps  # condition number from which float32 maps leave no digit


@claim(
    "O1",
    "oscillating",
    "POL and PAR fail in both spectra.",
    number="smallest of the four mean deviations from 1",
    paper="> 0.1",
    **_ANGULAR,
)
def oscillating_fits(realisation):
    """A fit fails if its mean |C/C0 - 1| is above 10 % for 10 < l < 200 (or 2 nside), as in all claims, and
    in P/P0 if the mean over all k is. Four parts, all main.
    """
    values, parts = {}, ()
    for name in ("polynomial", "parametric"):
        comparison, short = realisation.of("oscillating")[name], METHODS[name]
        errors = {
            f"{short} in C": angular_band("error", 10, 200)(comparison),
            f"{short} in P": frequency_band("error")(comparison),
        }
        values |= errors
        parts += parts_of(errors, above(FAILING), "fails", method=short)
    return Finding(smallest(values), parts, f"Mean deviation of the ratios from 1: {listing(values)}.")


number_claim(
    "O2",
    "oscillating",
    "The BSS methods have a strong excess in C/C0 at l < 10.",
    values=each("oscillating", angular_band("mean", 1, 10), BSS),
    test=above(STRONG),
    words="in excess",
    value=smallest,
    sentence="Mean C/C0 at l < 10",
    number="smallest mean C/C0 at l < 10",
    paper="> 1.5",
    reading="A strong excess is a mean of more than 1.5 for 2 <= l < 10. Three main parts: PCA/ICA by the "
    "worse of the two, GMCA, SD.",
    **_ANGULAR,
)


@claim(
    "O3",
    "oscillating",
    "SD recovers C to within 5 % for 10 < l < 200; PCA, ICA and GMCA each deviate more.",
    number="|C/C0 - 1| of SD, at 95 % of the l",
    paper="< 0.05",
    **_ANGULAR,
)
def oscillating_angular(realisation):
    """Main part: SD is within 5 % at 95 % of the l (the conclusions of the paper say 20 < l < 200, which is
    shown but not judged). Two others: the mean |C/C0 - 1| is larger by more than 1 % for PCA/ICA, both of
    them, and for GMCA.
    """
    comparisons = realisation.of("oscillating")
    within, from_20 = (angular_band("within", low, 200)(comparisons["sdecgmca"]) for low in (10, 20))
    values = by_method(comparisons, angular_band("error", 10, 200), BSS)
    others = {name: value for name, value in values.items() if name != "SD"}
    parts = (
        Part("SD within 5 %", within < _ACCURATE, method="SD"),
        *parts_of(others, lambda value: is_smaller(values["SD"], value), "further off", main=False),
    )
    return Finding(
        within,
        parts,
        f"At 95 % of the l SD is within {within:.2g}, from 20 on within {from_20:.2g}. "
        f"Mean |C/C0 - 1|: {listing(values)}.",
    )


@claim(
    "O4",
    "oscillating",
    "Every BSS method has a spurious peak in P/P0 near k = 0.3, SD the lowest.",
    number="highest P/P0 of SD near k = 0.31",
    paper="> 1, lowest",
    **_FREQUENCY,
)
def oscillating_peak(realisation):
    """A peak is a P/P0 above 1.1 for 0.25 < k < 0.38. Three main parts: PCA/ICA (both of them) and GMCA have
    one; SD has one; SD has the lowest of all, by more than 1 %.
    """
    values = each("oscillating", bump, BSS)(realisation)
    blind = all(value > CLEAR for name, value in values.items() if name != "SD")
    parts = (
        Part("PCA/ICA, GMCA have the peak", blind, method="PCA/ICA, GMCA"),
        Part("SD has the peak", values["SD"] > CLEAR, method="SD"),
        Part("SD has the lowest", sd_least(values), method="SD"),
    )
    return Finding(values["SD"], parts, f"Highest P/P0 near k = 0.31: {listing(values)}.")


@claim(
    "O5",
    "oscillating",
    "The BSS methods have an excess in P/P0 at low k, SD no smaller than PCA or ICA.",
    number="mean P/P0 of SD at k < 0.1",
    paper="> 1.1",
    **_FREQUENCY,
)
def oscillating_low_k(realisation):
    """An excess is a mean of more than 1.1 at k < 0.1; better is nearer to 1, by more than 1 % of the
    distance. Main parts: SD is in excess, and it is no better than PCA/ICA, neither of them. Two others:
    PCA/ICA and GMCA are in excess.
    """
    values = each("oscillating", frequency_band("mean", 0, LOW_K), BSS)(realisation)
    distance = {name: abs(value - 1) for name, value in values.items()}
    no_better = not is_smaller(distance["SD"], max(distance["PCA"], distance["ICA"]))
    others = {name: value for name, value in values.items() if name != "SD"}
    parts = (
        Part("SD in excess", values["SD"] > CLEAR, method="SD"),
        Part("SD no better than PCA/ICA", no_better, method="SD"),
        *parts_of(others, above(CLEAR), "in excess", main=False),
    )
    return Finding(values["SD"], parts, f"Mean P/P0 at k < 0.1: {listing(values)}.")


@claim(
    "O6",
    "all three",
    "Beyond l = 200 SD has a spurious peak in C, due to its regularised inversion.",
    number="highest C/C0 of SD at l > 200",
    paper="> 1.1",
    **_ANGULAR,
)
def beyond_200(realisation):
    """The regularised inversion of SD is continued beyond l = 200. A peak is a C/C0 of more than 1.1 between
    l = 200 and 2 nside: a main part for each beam. It is due to the regularisation if its top lies where
    strategy 3 regularises (R1): another part for each beam. It does not apply to maps that end before.
    """
    peaks, parts, words = {}, [], []
    for beam in BEAMS:
        comparison = realisation.beyond(beam)
        beyond = comparison.degrees > 200
        if not beyond.any():
            return not_applicable(f"These maps end at l = {comparison.degrees.max():.0f}.")
        peaks[beam] = float(comparison.angular_ratio[beyond].max())
        top = comparison.degrees[beyond][comparison.angular_ratio[beyond].argmax()]
        onset, _ = _onset(realisation, beam)
        behind = onset is not None and top >= onset
        parts.append(Part(f"{beam} beam: a peak", peaks[beam] > CLEAR, method="SD"))
        parts.append(Part(f"{beam} beam: where it is regularised", behind, False, "SD"))
        words.append(f"{beam} {peaks[beam]:.4g} at l = {top:.0f} (regularised from {onset or 'nowhere'})")
    return Finding(largest(peaks), tuple(parts), f"Highest C/C0 of SD beyond l = 200: {', '.join(words)}.")


@claim(
    "O7",
    "all three",
    "The offset of BSS at l < 10 exists with all beams, much larger with the oscillating one.",
    number="offset with the oscillating beam over that with the others, smallest of BSS",
    paper="> 2",
    **_ANGULAR,
)
def offset_in_other_beams(realisation):
    """The offset is the largest |C/C0 - 1| for 2 <= l < 10. It exists where it is above 10 %, and is much
    larger where it is at least twice as large. Six main parts, two for each of PCA/ICA (by the worse of the
    two), GMCA and SD: it exists in the degraded and in the evolving beam; it is much larger in the
    oscillating one than in both.
    """
    offsets = {beam: each(beam, angular_band("deviation", 1, 10), BSS)(realisation) for beam in BEAMS}
    degraded, evolving, oscillating = offsets.values()
    smaller = {name: min(degraded[name], evolving[name]) for name in degraded}
    times = {name: oscillating[name] / max(degraded[name], evolving[name]) for name in degraded}
    parts = parts_of(smaller, above(RECOVERED), "in the other beams")
    parts += parts_of(times, lambda value: value >= MUCH, "much larger in the oscillating")
    return Finding(smallest(times), parts, f"Largest |C/C0 - 1| at l < 10: {listing_by_beam(offsets)}.")


@claim(
    "R1",
    "all three",
    "The beam can be inverted without regularisation up to l of about 200, not beyond.",
    number="first l where strategy 3 regularises, smallest of the beams",
    paper="about 200",
    section="4.2",
    figure="",
    notebook="09_sdecgmca",
)
def inversion_limit(realisation):
    """With SD's mixing matrix A and the beam H itself, strategy 3 of C21 gives epsilon_l = max(0, c -
    lambda_min(A^T H_l^2 A) / lambda_min(A^T A)), c of Table 1. The first l with epsilon_l > 0 lies from 150
    to 300, a range that allows for the widths of the beams; and the matrix cannot be inverted there: its
    condition number is above 8e6, at which float32 maps have no significant digit. Two main parts for each
    beam. It does not apply to maps that end before it sets in, and before l = 300.
    """
    found = {beam: _onset(realisation, beam) for beam in BEAMS}
    onsets = [onset for onset, _ in found.values() if onset is not None]
    last = min(realisation.windows(beam).shape[1] for beam in BEAMS) - 1
    if last < _NEAR_200[1] and len(onsets) < len(BEAMS):
        return not_applicable(f"These maps end at l = {last}, before it sets in.")
    parts, words = [], []
    for beam, (onset, condition) in found.items():
        near = onset is not None and _NEAR_200[0] <= onset <= _NEAR_200[1]
        parts.append(Part(f"{beam} beam: sets in near l = 200", near, method="SD"))
        parts.append(Part(f"{beam} beam: cannot be inverted there", bool(condition > _DIGITS), method="SD"))
        where = f"from l = {onset}" if onset is not None else f"nowhere to l = {last}"
        words.append(f"{beam} {where} (condition number {condition:.2g})")
    value = float(min(onsets, default=np.nan))
    return Finding(value, tuple(parts), f"Strategy 3 regularises: {', '.join(words)}.")


def _onset(realisation, beam):
    """First l that strategy 3 regularises, or None, and the condition number of A^T H_l^2 A there, or at the
    end.

    Singular values of H_l A, whose squares are the eigenvalues of A^T H_l^2 A, keep twice the digits.
    """
    mixing, windows = realisation.mixing(beam), realisation.windows(beam)
    blurred = windows.T[:, :, None] * mixing
    highest, *_, lowest = np.linalg.svd(blurred, compute_uv=False).T ** 2
    limit = np.linalg.svd(mixing, compute_uv=False)[-1] ** 2
    regularised = lowest / limit < realisation.regularisation(beam)
    onset = int(regularised.argmax()) if regularised.any() else None
    at = -1 if onset is None else onset
    return onset, float(highest[at] / lowest[at]) if lowest[at] else np.inf


@claim(
    "S1",
    "all three",
    "SD is the most consistent over the three beams.",
    number="largest mean |C/C0 - 1| of SD over the beams",
    paper="smallest of all",
    **_ANGULAR,
)
def most_consistent(realisation):
    """The most consistent is the method whose deviation in its worst beam is the smallest of all six, by more
    than 1 %: the mean |C/C0 - 1| for 2 <= l < 200, and the mean |P/P0 - 1| over all k. Two parts, both main.
    """
    worst = {}
    for spectrum, error in (("C/C0", angular_band("error", 1, 200)), ("P/P0", frequency_band("error"))):
        by_beam = [each(beam, error)(realisation) for beam in BEAMS]
        worst[spectrum] = {name: max(row[name] for row in by_beam) for name in METHODS.values()}
    parts = tuple(
        Part(f"SD least off in {spectrum}", sd_least(row), method="SD") for spectrum, row in worst.items()
    )
    return Finding(worst["C/C0"]["SD"], parts, f"Mean deviation in the worst beam: {listing_by_beam(worst)}.")
