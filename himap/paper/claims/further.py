"""Claims and premises that the paper mentions in passing, without a number or figure.

They concern the inversion of the beam, convergence, foreground residual, point sources, noise, the cause of
the peak, the dependence on the regularisation, and robustness.
"""

import numpy as np

from himap.measures.diagnostics import FAILING
from himap.paper.claims.base import (
    BEAMS,
    CLEAR,
    METHODS,
    MOST,
    RECOVERED,
    Part,
    above,
    angular_band,
    below,
    claim,
    finding,
    frequency_band,
    in_band,
    is_smaller,
    mean_error,
    not_applicable,
    parts_of,
    recovered,
    smaller,
)
from himap.paper.methods import BSS

_TOLERANCES = {"warm-up": 1e-2, "refinement": 1e-4}
_NEAR_200 = (150, 300)
_DIGITS = 1 / np.finfo(np.float32).eps  # condition number above which float32 maps have no significant digit
_LEFT_OUT = 0.1  # share of the lines of sight that counts as exceptionally bright


@claim("O6", "all three", "4.2", "1", "highest C/C0 of SD at l > 200", "> 1.1")
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


@claim(
    "R1",
    "all three",
    "4.2",
    "",
    "first l where strategy 3 regularises, smallest of the beams",
    "about 200",
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
    parts, onsets, conditions = (), {}, {}
    for beam in BEAMS:
        onset, condition = onsets[beam], conditions[beam] = _onset(sky, beam)
        near = _NEAR_200[0] <= onset <= _NEAR_200[1]
        parts += (Part(f"{beam} beam: sets in near l = 200", near, method="SD"),)
        parts += (Part(f"{beam} beam: cannot be inverted there", condition > _DIGITS, method="SD"),)
    last = min(sky.windows(beam).shape[1] for beam in BEAMS) - 1
    if last < _NEAR_200[1] and np.isnan([*onsets.values()]).any():
        return not_applicable(f"These maps end at l = {last}, before it sets in.")
    wording = {"Strategy 3 regularises from l =": onsets, "condition number": conditions}
    return finding(float(np.fmin.reduce([*onsets.values()])), parts, wording)


def _onset(sky, beam):
    """First l that strategy 3 regularises, or NaN, and the condition number of A^T H_l^2 A there or at the
    end.

    Singular values of H_l A, whose squares are the eigenvalues of A^T H_l^2 A, keep twice the digits.
    """
    mixing, windows = sky.assessed("sdecgmca", beam).mixing, sky.windows(beam)
    blurred = windows.T[:, :, None] * mixing
    highest, *_, lowest = np.linalg.svd(blurred, compute_uv=False).T ** 2
    limit = np.linalg.svd(mixing, compute_uv=False)[-1] ** 2
    regularised = lowest / limit < sky.regularisation(beam)
    at = int(regularised.argmax()) if regularised.any() else -1
    return at if at >= 0 else np.nan, float(highest[at] / lowest[at]) if lowest[at] else np.inf


@claim("V1", "all three", "3.3", "", "largest relative change of S at the end of the refinement", "< 1e-4")
def convergence(sky):
    """SD converges: S changes by less than 1e-2 at the end of the warm-up, 1e-4 of the refinement.

    The paper stops each stage when the relative change of S between two iterations is below a tolerance. A
    stage has converged if the change in its last iteration is below the paper's tolerance, 1e-2 in the
    warm-up and 1e-4 in the refinement. As in the public code of C21 a stage ends after 150 or 50 iterations
    at the latest; if its change is then above the tolerance, it has not converged. Six main parts: each stage
    with each beam. It does not apply to a method without these stages.
    """
    found = {beam: sky.assessed("sdecgmca", beam).diagnostics for beam in BEAMS}
    if not all(found.values()):
        return not_applicable("This method does not iterate in two stages.")
    parts, wording = (), {}
    for beam, row in found.items():
        wording[beam] = {}
        for stage, tolerance in _TOLERANCES.items():
            name = stage.replace("-", "")
            change, n = row[f"{name}_change"], row[f"n_{name}"]
            parts += (Part(f"{stage} converges, {beam} beam", bool(change < tolerance), method="SD"),)
            wording[beam] |= {f"{n:.0f} iterations of the {stage}": change}
    value = max(row["refinement_change"] for row in found.values())
    return finding(value, parts, {"Relative change of S after": wording}, "{:.2g}")


@claim(
    "V2", "oscillating", "5.1", "5", "share of the error of flagged lines in the foreground's spectra", "most"
)
def leaked_foreground(sky):
    """Flagged lines of sight show coherent spectral structure, that of leaked foreground.

    The error is the residual of SD less the truth, on the lines of sight that the paper's rule flags, as a
    mean square over these lines and all channels. Coherent: more than half of it lies in the foreground's
    spectra, those principal spectra of the true foreground through the beam of which each has more variance
    than HI and noise have in all channels together; an error without structure has n / n_channels of itself
    in n spectra. Signal loss lies in such spectra too, so the error is split into foreground residual and
    signal loss, for the mixing matrix as estimated. Leaked foreground: the foreground residual is larger than
    the signal loss, by more than 1 %. Two parts, both main. The premise is absent if no line is flagged.
    """
    found = sky.flagged_error()
    share, held, wording = None, (None, None), "No line of sight is flagged."
    if found["error"]:
        share, of_truth = found["in spectra"] / found["error"], found["truth in spectra"] / found["truth"]
        held = share > MOST, is_smaller(found["signal loss"], found["foreground residual"])
        rms = {name: found[name] ** 0.5 for name in ("error", "foreground residual", "signal loss")}
        shares = {"error of flagged lines": share, "truth": of_truth}
        wording = {f"Share in the {found['n_spectra']} spectra of the foreground": shares, "rms in mK": rms}
    names = "most of the error in the foreground's spectra", "foreground residual above signal loss"
    parts = (Part(name, one, method="SD") for name, one in zip(names, held, strict=True))
    return finding(share, parts, wording)


@claim(
    "V3",
    "degraded",
    "3.2",
    "",
    "change of C or P by the point sources over the truth, at 95 % of the l or k",
    "small",
)
def absorbed_sources(sky):
    """Point sources are absorbed by the two components of the parametric fit.

    The same sky, with the same HI, Galaxy and noise, is observed and cleaned by PAR again without its point
    sources. They are absorbed if their presence changes C by less than 10 % of the true C, the accuracy that
    the paper calls recovered, at 95 % or more of 3 < l < 200, and P likewise at k > 0.03 (the ranges of D1
    and D2). Two parts, both main. How near the residual is to the truth is judged by D1 and D2.
    """
    one, other = sky.of("degraded")["parametric"], sky.without_sources()
    angular = np.abs(one.angular - other.angular) / one.true_angular
    frequency = np.abs(one.frequency - other.frequency) / one.true_frequency
    tops = {
        "C": in_band("below", one.degrees, angular, 3, 200),
        "P": in_band("below", one.k, frequency, 0.03),
    }
    parts = parts_of(tops, recovered, "the same without point sources", method="PAR")
    wording = {"Change by point sources over the true spectrum, at 95 % of the l or k below": tops}
    return finding(max(tops.values()), parts, wording)


@claim(
    "V4", "all three", "2.2", "", "noise over HI in C or P at 95 % of the l or k, largest of the beams", "< 1"
)
def subdominant_noise(sky):
    """The long observing time makes the noise subdominant.

    The paper chose that time "to minimize noise impact", read here as noise below HI on all scales. The power
    spectra of noise and HI, as they enter the truth: HI through the beam; the noise of the pixels,
    which only the degraded beam smooths. The noise is subdominant if its power is below that of HI, by more
    than 1 %, at 95 % or more of 2 <= l <= 200, in the mean over channels, and of all k. Six main parts: each
    spectrum with each beam. The noise of a pixel does not depend on its size, so that C_l of the noise are
    proportional to the area of pixels, and inversely to the width of channels: they are those of pixels and
    channels as large as the paper's. P(k) has the paper's channels, and the pixels of the maps: where the
    beam is degraded after the noise, coarser pixels make its noise larger. HI is that of the maps, which has
    less power in coarser cells and channels: below the paper's size the ratio is an upper limit.
    """
    parts, median, most = (), {}, {}
    for beam in BEAMS:
        noise = sky.noise_over_hi(beam)
        for row, statistic in ((median, "median"), (most, "below")):
            angular, frequency = angular_band(statistic, 1, 201), frequency_band(statistic)
            row[beam] = {"C": angular(noise), "P": frequency(noise)}
        parts += parts_of(most[beam], smaller, f"of noise below HI, {beam} beam")
    value = max(max(row.values()) for row in most.values())
    return finding(value, parts, {"Noise over HI, median": median, "at 95 % of the l or k below": most})


@claim(
    "V5",
    "oscillating",
    "5.2",
    "7",
    "share of the excess of SD that remains without the brightest 10 % of the lines",
    "< 0.5",
)
def bright_lines(sky):
    """The peak is driven by the lines of sight with the brightest foreground.

    Lines of sight are ranked by their foreground through the beam, in the mean over channels. The excess is
    the highest P/P0 near k = 0.31, less 1, of residual and truth on the same lines. The paper does not say
    how many lines are exceptionally bright; the brightest tenth is read here, and it drives the peak if more
    than half of the excess vanishes without it. Main part: SD. Others: PCA/ICA and GMCA; and as a control,
    more than half of the excess of SD remains without the faintest tenth. The premise is absent for a method
    without a peak, which is a P/P0 above 1.1.
    """
    tops, remaining, words = {}, {}, "excess gone without the brightest"
    for method in BSS:
        shares, values = sky.without_brightest(method)
        one = dict(zip((*shares, "faintest"), values, strict=True))
        remaining[METHODS[method]] = (one[_LEFT_OUT] - 1) / (one[0.0] - 1) if one[0.0] > CLEAR else None
        names = (*(f"{share:.0%}" for share in shares), "faintest")
        tops[METHODS[method]] = dict(zip(names, values, strict=True))
    sd = remaining.pop("SD")
    faint = None if sd is None else (one["faintest"] - 1) / (one[0.0] - 1)
    parts = (
        *parts_of({"SD": sd}, below(MOST), words),
        *parts_of(remaining, below(MOST), words, main=False),
        *parts_of({"SD": faint}, above(MOST), "excess remains without the faintest", main=False),
    )
    wording = {"Highest P/P0 near k = 0.31 without the brightest lines, and without the faintest": tops}
    return finding(sd, parts, wording, "{:.4g}")


@claim(
    "V6",
    "oscillating",
    "6",
    "",
    "median spread of C/C0 over settings of the regularisation, 10 < l < 200",
    "a major challenge",
    notebook="09_sdecgmca",
)
def regularisation_scheme(sky):
    """SD depends on the regularisation.

    The settings are c = 1e-3, 1e-2 (Table 1) and 1e-1, and strategies 3 and 4 in the refinement with c of
    Table 1; all else is unchanged. The spread at each l or k is the highest less the lowest ratio to the
    truth, and its median is over 10 < l < 200 or over all k. SD depends on the regularisation if this spread
    is above 10 %, so that the setting can decide whether a spectrum is recovered; and if it is larger, by
    more than 1 %, than the spread of as many restarts with the same setting: the iteration is chaotic, and
    any change of a setting acts as a restart too. Four main parts: both for C/C0 and for P/P0. It does not
    apply to a method without these settings.
    """
    settings = sky.by_regularisation()
    if len(settings) < 2:
        return not_applicable("This method is not regularised.")
    parts, spreads = (), []
    for several in (list(settings.values()), sky.by_restart(len(settings))):
        spread_l = np.ptp([one.angular_ratio for one in several], axis=0)
        spread_k = np.ptp([one.frequency_ratio for one in several], axis=0)
        median_l = in_band("median", several[0].degrees, spread_l, 10, 200)
        spreads.append({"C/C0": median_l, "P/P0": float(np.median(spread_k))})
    over_settings, over_restarts = spreads
    for spectrum, spread in over_settings.items():
        more = is_smaller(over_restarts[spectrum], spread)
        parts += (Part(f"{spectrum} spreads by more than 10 %", spread > RECOVERED, method="SD"),)
        parts += (Part(f"{spectrum} spreads more than over restarts", more, method="SD"),)
    wording = {"Median spread over settings": over_settings, "over as many restarts": over_restarts}
    wording |= {"mean |C/C0 - 1|": {name: mean_error(one) for name, one in settings.items()}}
    return finding(over_settings["C/C0"], parts, wording)


@claim("V7", "all three", "6", "1", "mean |C/C0 - 1| at 10 < l < 200, largest of the beams", "small")
def robust(sky):
    """SD is robust on the full sky, without masks.

    A member fails if its mean |C/C0 - 1| over 10 < l < min(200, 2 nside) is above 10 %: twice the accuracy
    that the paper gives for these scales through the oscillating beam, and that of the others. SD is robust
    if it does not fail on the full sky, the Galactic plane included, before any mask: a main part for each
    beam. The share of the members in which a part holds is one less the probability of failure.
    """
    errors = {beam: mean_error(sky.of(beam)["sdecgmca"]) for beam in BEAMS}
    parts = (
        Part(f"does not fail, {beam} beam", error <= FAILING, method="SD") for beam, error in errors.items()
    )
    return finding(max(errors.values()), parts, {"Mean |C/C0 - 1| of SD at 10 < l < 200": errors})
