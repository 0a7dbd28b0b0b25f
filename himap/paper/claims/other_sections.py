"""The sky (Sect. 1), the number of sources (4.3), the dimmed Galaxy (5.2), and diagnostics (App. A)."""

import math

import numpy as np
from scipy.stats import gmean

from himap.measures.diagnostics import MSE_DEFINITIONS, Comparison
from himap.paper.claims.base import (
    CLEAR,
    CONSISTENT,
    LOW_K,
    METHODS,
    Part,
    above,
    angular_band,
    below,
    bump,
    claim,
    each,
    finding,
    frequency_band,
    in_band,
    is_smaller,
    larger,
    not_applicable,
    parts_of,
    places_of,
    sd_least,
    smaller,
)

_DIMMED = ("oscillating", "dimmed")
_THREE = ("pca", "fastica", "sdecgmca")


@claim("F1", "none", "1", "", "log10 of the rms of the foregrounds over that of HI, all sky", "> 4, up to 5")
def foregrounds_above_hi(sky):
    """The foregrounds are over 4 orders of magnitude above HI, up to 5, at high latitude too.

    Of brightness temperatures, before the beam: the root mean square over channels and pixels of all
    foregrounds together over that of HI, mean brightness included. Its log10 is above 4 over all the sky, and
    from 3 to 5 at |b| > 30 deg, as "up to" is an upper bound. Two parts, both main.
    """
    rms = {region: {"foregrounds": bright, "HI": hi} for region, (bright, hi) in sky.brightness().items()}
    orders = {region: math.log10(row["foregrounds"] / row["HI"]) for region, row in rms.items()}
    (everywhere, above_all), (high, above_high) = orders.items()
    parts = (
        Part(f"over 4 orders, {everywhere}", above_all > 4),
        Part(f"3 to 5 orders, {high}", 3 <= above_high <= 5),
    )
    return finding(above_all, parts, {"Orders of magnitude": orders, "rms in mK": rms})


def _missing(sky, *counts):
    """A `Finding` that says so if the scan lacks a number of sources, else None."""
    missing = ", ".join(str(n) for n in counts if n not in sky.scan)
    return not_applicable(f"The scan does not hold n_s = {missing}.") if missing else None


def _best(scan, error):
    """The number of sources with the smallest `error`, a function of a `Comparison`."""
    return min(scan, key=lambda n: error(scan[n]))


@claim("N1", "oscillating", "4.3", "3", "n_s of the smallest MSE", "5")
def scan_minimum(sky):
    """The total MSE of SD has its minimum at 5 sources.

    The sum of the mean squared relative errors of C_l (l <= 200) and P(k); the minimum must be at 5. One main
    part; the others are the places of the minimum. The paper tries 2 to 20 sources, the ledger those that its
    scan has, and 4 and 6 must be among them.
    """
    if missing := _missing(sky, 4, 5, 6):
        return missing
    best = _best(sky.scan, Comparison.total_error)
    parts = (Part("least at 5", best == 5, method="SD"), *places_of({"least at": best}))
    return finding(best, parts, {"Total MSE at n_s =": {n: sky.scan[n].total_error() for n in {best, 5}}})


@claim("N2", "oscillating", "4.3", "3", "smallest MSE of these over that at n_s = 5", "> 1")
def scan_ends(sky):
    """The MSE of SD is larger at n_s = 2, 3 and at n_s >= 10.

    Larger than at n_s = 5, by more than 1 %: at 2, at 3, and at all from 10 on. Three parts, all main.
    """
    if missing := _missing(sky, 2, 3, 5, 10):
        return missing
    five = sky.scan[5].total_error()
    over = {n: comparison.total_error() / five for n, comparison in sky.scan.items()}
    least = min(value for n, value in over.items() if n >= 10)
    values = {"n_s = 2": over[2], "n_s = 3": over[3], "n_s >= 10, least": least}
    parts = parts_of(values, larger, "larger", method="SD")
    return finding(min(values.values()), parts, {"MSE over that at n_s = 5": values})


@claim("N3", "oscillating", "4.3", "4", "best n_s at low k", "5 (6 for the bump, 7 at 10 < l < 100)")
def scan_scales(sky):
    """The best n_s of SD is 5 at low k, 6 for the bump near k = 0.3, 7 at 10 < l < 100.

    Best is the smallest mean |P/P0 - 1| at k < 0.1, |P/P0 - 1| at the bump's top, mean |C/C0 - 1|. Three
    parts, all main; the others are the places.
    """
    best = {
        "low k": _best(sky.scan, frequency_band("error", 0, LOW_K)),
        "bump": _best(sky.scan, lambda comparison: abs(bump(comparison) - 1)),
        "10 < l < 100": _best(sky.scan, angular_band("error", 10, 100)),
    }
    pairs = zip(best.items(), (5, 6, 7), strict=True)
    parts = tuple(Part(f"{name}: {n}", found == n, method="SD") for (name, found), n in pairs)
    parts += places_of(best)
    return _missing(sky, 5, 6, 7) or finding(best["low k"], parts, {"Best n_s": best})


@claim("N4", "oscillating", "4.3", "3", "n_s of the smallest total, relative errors", "5 to 7")
def scan_compromise(sky):
    """An n_s of 5 to 7 is the best compromise over all scales.

    The paper does not define its total MSE: its minimum is at 5, 6 or 7 for three definitions. A main part
    for each, relative, logarithmic and absolute; the others are the places. The scan must have 4 and 8 too.
    """
    best = {name: _best(sky.scan, lambda one, by=name: one.total_error(by)) for name in MSE_DEFINITIONS}
    parts = parts_of(best, lambda n: 5 <= n <= 7, "least at 5 to 7", method="SD") + places_of(best)
    return _missing(sky, 4, 5, 6, 7, 8) or finding(best["relative"], parts, {"Least total at n_s": best})


@claim("N5", "oscillating", "4.3", "4", "spread over n_s at l > 150 over that at 10 < l < 100", "< 1")
def scan_large_degrees(sky):
    """At the largest multipoles n_s matters less than at intermediate ones.

    The paper has them "less pronounced", which does not say that they are small. The spread at one l is the
    highest less the lowest C/C0 of all n_s. Its median over 150 < l <= 200 is smaller than that over 10 < l <
    100, by more than 1 %. One part. It does not apply to maps that end before l = 200.
    """
    scan = list(sky.scan.values())
    degrees = scan[0].degrees
    if degrees.max() < 200:
        return not_applicable(f"These maps end at l = {degrees.max():.0f}.")
    if len(scan) < 2:
        return not_applicable("The scan holds one n_s only.")
    spread = np.ptp([comparison.angular_ratio for comparison in scan], axis=0)
    middle, large = (in_band("median", degrees, spread, *ends) for ends in ((10, 100), (150, 201)))
    parts = [Part("smaller at l > 150", is_smaller(large, middle), method="SD")]
    wording = {"Median spread of C/C0 over n_s": {"10 < l < 100": middle, "l > 150": large}}
    return finding(large / middle, parts, wording)


def _gain(sky):
    """Total MSE with the dimmed over that with the full Galaxy, {method: ratio}."""
    full, dimmed = (each(sky, case, Comparison.total_error) for case in _DIMMED)
    return {name: value / full[name] for name, value in dimmed.items()}


@claim("G1", "oscillating, dimmed", "5.2", "7", "largest total MSE over that of the full Galaxy", "< 1")
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


@claim("G2", "oscillating, dimmed", "5.2", "7", "highest P/P0 of SD near k = 0.31, less 1", "< 0.02")
def dimmed_peak(sky):
    """The peak near k = 0.3 persists for PCA and ICA, and is below 2 % for SD.

    A peak is a P/P0 of more than 1.1 for 0.25 < k < 0.38. Two main parts: it persists for PCA/ICA, both of
    them; that of SD is below 1.02.
    """
    tops = each(sky, "dimmed", bump, _THREE)
    parts = parts_of({name: tops[name] for name in ("PCA", "ICA")}, above(CLEAR), "keep the peak")
    parts += parts_of({"SD": tops["SD"]}, below(1.02), "below 2 %")
    return finding(tops["SD"] - 1, parts, {"Highest P/P0 near k = 0.31": tops}, "{:.4g}")


def _recovered_shares(sky):
    """Share of l within 10 %, {case: {method: share}}, and its increase with dimming, {method: increase}."""
    shares = {case: each(sky, case, angular_band("recovered", 1, 201), _THREE) for case in _DIMMED}
    full, dimmed = shares.values()
    return shares, {name: dimmed[name] - full[name] for name in full}


@claim("G3", "oscillating, dimmed", "5.2", "7", "smallest growth of the share of l within 10 %", "> 0")
def dimmed_range(sky):
    """The recovered range of l grows for PCA, ICA and SD.

    The share of l, 2 <= l <= 200, with |C/C0 - 1| < 10 % grows by more than 1 % of itself. Two main parts:
    PCA/ICA by the worse of the two, and SD.
    """
    shares, growth = _recovered_shares(sky)
    pairs = {name: [row[name] for row in shares.values()] for name in growth}
    parts = parts_of(pairs, lambda pair: is_smaller(*pair), "grows")
    return finding(min(growth.values()), parts, {"Share of l within 10 %": shares}, "{:.0%}")


@claim(
    "G4",
    "oscillating, dimmed",
    "6",
    "7",
    "growth of SD's share of l within 10 %",
    "> that of PCA and ICA",
    notebook="13_dimmed_galaxy",
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


def _sd_consistently(values, mean, word, where, wording):
    """The `Finding` on whether SD has the smallest of {name: values} at `CONSISTENT` of the l or channels."""
    rows = zip(*values.values(), strict=True)
    share = float(np.mean([sd_least(dict(zip(values, row, strict=True))) for row in rows]))
    means = {name: mean(row) for name, row in values.items()}
    parts = (
        Part(f"SD {word} {where.format('95 %')}", share >= CONSISTENT, method="SD"),
        Part(f"SD {word} on average", sd_least(means), False, "SD"),
    )
    return finding(share, parts, {f"SD is {word} {where.format(f'{share:.0%}')}; {wording}": means})


@claim("A1", "oscillating", "A", "A.1", "share of channels where SD is highest", "1")
def correlation_highest(sky):
    """SD has the highest correlation with the truth, consistently over frequency.

    The highest r is the smallest 1 - r, by more than 1 % of it, since r is close to 1. Consistently is in 95
    % of the channels or more: the main part. Another: highest on average over them.
    """
    distances = {short: 1 - sky.assessed(name).correlation for name, short in METHODS.items()}
    return _sd_consistently(distances, np.mean, "highest", "in {} of the channels", "mean 1 - r")


@claim("A2", "oscillating", "A", "A.2", "share of l where SD is smallest", "1")
def variance_smallest(sky):
    """SD has the smallest variance of R_l for 10 <= l <= 200.

    Smallest, by more than 1 %, over a range is at 95 % of the l or more: the main part. Another: smallest on
    average, the geometric mean over l.
    """
    values = {}
    for name, short in METHODS.items():
        degrees = sky.of("oscillating")[name].degrees
        values[short] = sky.variance(name)[(degrees >= 10) & (degrees <= 200)]
    return _sd_consistently(values, gmean, "smallest", "at {} of the l", "mean variance")
