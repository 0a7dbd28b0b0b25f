"""Section 4.2 and the conclusions: what is said of all three beams, and where the beam is inverted."""

import numpy as np

from himap.measures.diagnostics import largest_deviation
from himap.paper.claims.base import (
    BEAMS,
    METHODS,
    angular_error,
    by_method,
    claim,
    frequency_error,
    listing_by_beam,
)
from himap.paper.claims.verdicts import CLEAR, MUCH, RECOVERED, Finding, Part, not_applicable, parts_of
from himap.paper.methods import BSS

_RESULTS = {"section": "4.2", "figure": "1", "notebook": "10_results"}
_NEAR_200 = (150, 300)
_DIGITS = 1 / np.finfo(np.float32).eps  # condition number from which float32 maps leave no digit


@claim(
    "O6", "all three", "Run beyond l = 200, SD has a spurious peak in C there: it regularises.",
    number="highest C/C0 of SD at l > 200", paper="> 1.1", **_RESULTS,
)  # fmt: skip
def beyond_200(realisation):
    """SD goes on beyond l = 200 with its regularised inversion. A peak is a C/C0 of more than 1.1 between
    l = 200 and 2 nside: a main part for each beam. The regularisation is behind it if its top lies where
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
        parts += [
            Part(name=f"{beam} beam: a peak", held=peaks[beam] > CLEAR),
            Part(name=f"{beam} beam: where it is regularised", held=behind, main=False),
        ]
        words.append(f"{beam} {peaks[beam]:.4g} at l = {top:.0f} (regularised from {onset or 'nowhere'})")
    return Finding(
        value=max(peaks.values()),
        parts=tuple(parts),
        sentence=f"Highest C/C0 of SD beyond l = 200: {', '.join(words)}.",
    )


@claim(
    "O7", "all three", "The offset of BSS at l < 10 is there in all beams, much larger in the oscillating.",
    number="offset of the oscillating beam over that of the others, least of BSS", paper="> 2", **_RESULTS,
)  # fmt: skip
def offset_in_other_beams(realisation):
    """The offset is the largest |C/C0 - 1| for 2 <= l < 10. It exists where it is above 10 %, and is much
    larger where it is at least twice as large. Six main parts, two for each of PCA/ICA (by the worse of the
    two), GMCA and SD: it exists in the degraded and in the evolving beam; it is much larger in the
    oscillating one than in both.
    """

    def offset(comparison):
        return largest_deviation(comparison.degrees, comparison.angular_ratio, 1, 10)[0]

    offsets = {beam: by_method(realisation.of(beam), offset, BSS) for beam in BEAMS}
    degraded, evolving, oscillating = offsets.values()
    smaller = {name: min(degraded[name], evolving[name]) for name in degraded}
    times = {name: oscillating[name] / max(degraded[name], evolving[name]) for name in degraded}
    return Finding(
        value=min(times.values()),
        parts=parts_of(smaller, lambda value: value > RECOVERED, "in the other beams")
        + parts_of(times, lambda value: value >= MUCH, "much larger in the oscillating"),
        sentence=f"Largest |C/C0 - 1| at l < 10: {listing_by_beam(offsets)}.",
    )


@claim(
    "R1", "all three", "The beam is inverted without regularisation up to l = 200 or so, not beyond.",
    number="first l where strategy 3 regularises, least of the beams", paper="about 200",
    section="4.2", figure="", notebook="09_sdecgmca",
)  # fmt: skip
def inversion_limit(realisation):
    """With SD's mixing matrix A and the beam H itself, strategy 3 of C21 gives epsilon_l = max(0, c -
    lambda_min(A^T H_l^2 A) / lambda_min(A^T A)), c of Table 1. The first l with epsilon_l > 0 lies from 150
    to 300: a main part for each beam, with the widths of the beams as the reason for the range. That the
    matrix cannot be inverted there is another part of each: its condition number is above 8e6, where float32
    maps leave no digit. It does not apply to maps that end before it sets in, and before l = 300.
    """
    found = {beam: _onset(realisation, beam) for beam in BEAMS}
    last = min(realisation.windows(beam).shape[1] for beam in BEAMS) - 1
    if last < _NEAR_200[1] and any(onset is None for onset, _ in found.values()):
        return not_applicable(f"These maps end at l = {last}, before it sets in.")
    parts, words = [], []
    for beam, (onset, condition) in found.items():
        near = onset is not None and _NEAR_200[0] <= onset <= _NEAR_200[1]
        parts += [
            Part(name=f"{beam} beam: sets in near l = 200", held=near),
            Part(name=f"{beam} beam: cannot be inverted there", held=bool(condition > _DIGITS), main=False),
        ]
        where = f"from l = {onset}" if onset is not None else f"nowhere to l = {last}"
        words.append(f"{beam} {where} (condition number {condition:.2g})")
    onsets = [onset for onset, _ in found.values() if onset is not None]
    return Finding(
        value=float(min(onsets, default=np.nan)),
        parts=tuple(parts),
        sentence=f"Strategy 3 regularises: {', '.join(words)}.",
    )


def _onset(realisation, beam):
    """First l that strategy 3 regularises, or None, and the condition number of A^T H_l^2 A there, or at the
    end.

    Singular values of H_l A, whose squares are the eigenvalues of A^T H_l^2 A, keep twice the digits.
    """
    mixing, windows = realisation.mixing(beam), realisation.windows(beam)
    blurred = windows.T[:, :, None] * mixing
    largest, *_, smallest = np.linalg.svd(blurred, compute_uv=False).T ** 2
    limit = np.linalg.svd(mixing, compute_uv=False)[-1] ** 2
    regularised = smallest / limit < realisation.regularisation(beam)
    onset = int(regularised.argmax()) if regularised.any() else None
    at = -1 if onset is None else onset
    return onset, float(largest[at] / smallest[at]) if smallest[at] else np.inf


@claim(
    "S1", "all three", "SD is the most consistent over the three beams.",
    number="largest mean |C/C0 - 1| of SD over the beams", paper="least of all", **_RESULTS,
)  # fmt: skip
def most_consistent(realisation):
    """The most consistent is the method whose deviation in its worst beam is the smallest of all six: the
    mean |C/C0 - 1| for 2 <= l < 200, and the mean |P/P0 - 1| over all k. Two parts, both main.
    """
    worst = {}
    for spectrum, error in (("C/C0", angular_error(1, 200)), ("P/P0", frequency_error(0))):
        by_beam = [by_method(realisation.of(beam), error) for beam in BEAMS]
        worst[spectrum] = {name: max(row[name] for row in by_beam) for name in METHODS.values()}
    return Finding(
        value=worst["C/C0"]["SD"],
        parts=tuple(
            Part(name=f"SD least off in {spectrum}", held=min(row, key=row.get) == "SD")
            for spectrum, row in worst.items()
        ),
        sentence=f"Mean deviation in the worst beam: {listing_by_beam(worst)}.",
    )
