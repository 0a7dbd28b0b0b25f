"""Section 1: the sky; Section 4.3: the number of sources (Figs. 3 and 4); Appendix A: diagnostics."""

import numpy as np

from himap.measures.diagnostics import MSE_DEFINITIONS
from himap.paper.claims.base import (
    LOW_K,
    METHODS,
    angular_band,
    bump,
    claim,
    claims_of,
    finding,
    frequency_band,
    larger,
    listing,
    sd_least,
    total,
)
from himap.paper.claims.verdicts import CONSISTENT, Part, is_smaller, not_applicable, parts_of, places_of

scan_claim = claims_of(section="4.3", notebook="11_ns_scan")
appendix_claim = claims_of(section="A", notebook="14_diagnostics")


@claim(
    "F1",
    "none",
    number="log10 of the rms of the foregrounds over that of HI, all sky",
    paper="> 4, up to 5",
    section="1",
    notebook="01_simulations",
)
def foregrounds_above_hi(sky):
    """The foregrounds are over 4 orders of magnitude above HI, up to 5, at high latitude too.

    Of brightness temperatures, before the beam: the root mean square over channels and pixels of all
    foregrounds together over that of HI, mean brightness included. Its log10 is above 4 over all the sky, and
    from 3 to 5 at |b| > 30 deg, as "up to" is an upper bound. Two parts, both main.
    """
    rms = sky.brightness()
    orders = {region: float(np.log10(foregrounds / hi)) for region, (foregrounds, hi) in rms.items()}
    everywhere, high = orders
    parts = (
        Part(f"over 4 orders, {everywhere}", orders[everywhere] > 4),
        Part(f"3 to 5 orders, {high}", 3 <= orders[high] <= 5),
    )
    in_mk = {region: dict(zip(("foregrounds", "HI"), pair, strict=True)) for region, pair in rms.items()}
    return finding(orders[everywhere], parts, {"Orders of magnitude": orders, "rms in mK": in_mk})


def _missing(sky, *counts):
    """A `Finding` that says so if the scan lacks some number of sources, else None."""
    missing = ", ".join(str(n) for n in counts if n not in sky.scan)
    return not_applicable(f"The scan does not hold n_s = {missing}.") if missing else None


def _best(scan, error):
    """The number of sources with the least `error`, a function of a `Comparison`."""
    return min(scan, key=lambda n: error(scan[n]))


@scan_claim("N1", "oscillating", number="n_s of the smallest MSE", paper="5", figure="3")
def scan_minimum(sky):
    """The total MSE of SD has its minimum at 5 sources, for 2 to 20.

    The sum of the mean squared relative errors of C_l (l <= 200) and P(k); the minimum must be at 5. One main
    part; the others are the places of the minimum. The scan must have 4 and 6 too.
    """
    if missing := _missing(sky, 4, 5, 6):
        return missing
    best = _best(sky.scan, total)
    parts = (Part("least at 5", best == 5, method="SD"), *places_of({"least at": best}))
    return finding(best, parts, {"Total MSE at n_s =": {n: total(sky.scan[n]) for n in {best, 5}}})


@scan_claim("N2", "oscillating", number="smallest MSE of these over that at n_s = 5", paper="> 1", figure="3")
def scan_ends(sky):
    """The MSE of SD is larger at n_s = 2, 3 and at n_s >= 10.

    Larger than at n_s = 5, by more than 1 %: at 2, at 3, and at all from 10 on. Three parts, all main.
    """
    if missing := _missing(sky, 2, 3, 5, 10):
        return missing
    totals = {n: total(comparison) / total(sky.scan[5]) for n, comparison in sky.scan.items()}
    least = min(total for n, total in totals.items() if n >= 10)
    values = {"n_s = 2": totals[2], "n_s = 3": totals[3], "n_s >= 10, least": least}
    parts = parts_of(values, larger, "larger", method="SD")
    return finding(min(values.values()), parts, {"MSE over that at n_s = 5": values})


@scan_claim(
    "N3", "oscillating", number="best n_s at low k", paper="5 (6 for the bump, 7 at 10 < l < 100)", figure="4"
)
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


@scan_claim(
    "N4", "oscillating", number="n_s of the smallest total, relative errors", paper="5 to 7", figure="3"
)
def scan_compromise(sky):
    """An n_s of 5 to 7 is the best compromise over all scales.

    The paper does not define its total MSE: its minimum is at 5, 6 or 7 for three definitions. A main part
    for each, relative, logarithmic and absolute; the others are the places. The scan must have 4 and 8 too.
    """
    best = {name: _best(sky.scan, lambda one, by=name: one.total_error(by)) for name in MSE_DEFINITIONS}
    parts = parts_of(best, lambda n: 5 <= n <= 7, "least at 5 to 7", method="SD") + places_of(best)
    return _missing(sky, 4, 5, 6, 7, 8) or finding(best["relative"], parts, {"Least total at n_s": best})


@scan_claim(
    "N5",
    "oscillating",
    number="spread over n_s at l > 150 over that at 10 < l < 100",
    paper="< 1",
    figure="4",
)
def scan_large_degrees(sky):
    """At the largest multipoles the differences between n_s are small.

    The spread at one l is the highest less the lowest C/C0 of all n_s. Its median over 150 < l <= 200 is
    smaller than that over 10 < l < 100, by more than 1 %. One part. It does not apply to maps that end before
    l = 200.
    """
    scan = list(sky.scan.values())
    degrees = scan[0].degrees
    if degrees.max() < 200:
        return not_applicable(f"These maps end at l = {degrees.max():.0f}.")
    if len(scan) < 2:
        return not_applicable("The scan holds one n_s only.")
    spread = np.ptp([comparison.angular_ratio for comparison in scan], axis=0)
    middle = float(np.median(spread[(degrees > 10) & (degrees < 100)]))
    large = float(np.median(spread[(degrees > 150) & (degrees <= 200)]))
    parts = (Part("smaller at l > 150", is_smaller(large, middle), method="SD"),)
    wording = {"Median spread of C/C0 over n_s": {"10 < l < 100": middle, "l > 150": large}}
    return finding(large / middle, parts, wording)


def _share_of_sd(values):
    """At what share of l or channels SD has the smallest of {name: values}."""
    rows = zip(*values.values(), strict=True)
    return float(np.mean([sd_least(dict(zip(values, row, strict=True))) for row in rows]))


@appendix_claim("A1", "oscillating", number="share of channels where SD is highest", paper="1", figure="A.1")
def correlation_highest(sky):
    """SD has the highest correlation with the truth, consistently over frequency.

    The highest r is the smallest 1 - r, by more than 1 % of it, since r is close to 1. Consistently is in 95
    % of the channels or more: the main part. Another: highest on average over them.
    """
    distances = {short: 1 - sky.correlation(name) for name, short in METHODS.items()}
    share, means = _share_of_sd(distances), {name: row.mean() for name, row in distances.items()}
    parts = (
        Part("SD highest in 95 % of the channels", share >= CONSISTENT, method="SD"),
        Part("SD highest on average", sd_least(means), False, "SD"),
    )
    return finding(
        share, parts, f"SD is highest in {share:.0%} of the channels; mean 1 - r: {listing(means)}."
    )


@appendix_claim("A2", "oscillating", number="share of l where SD is smallest", paper="1", figure="A.2")
def variance_smallest(sky):
    """SD has the smallest variance of R_l for 10 <= l <= 200.

    Smallest, by more than 1 %, over a range is at 95 % of the l or more: the main part. Another: smallest on
    average, the geometric mean over l.
    """
    values = {}
    for name, short in METHODS.items():
        degrees = sky.of("oscillating")[name].degrees
        values[short] = sky.variance(name)[(degrees >= 10) & (degrees <= 200)]
    share, means = _share_of_sd(values), {name: np.exp(np.mean(np.log(row))) for name, row in values.items()}
    parts = (
        Part("SD smallest at 95 % of the l", share >= CONSISTENT, method="SD"),
        Part("SD smallest on average", sd_least(means), False, "SD"),
    )
    return finding(share, parts, f"SD is smallest at {share:.0%} of the l; mean variance: {listing(means)}.")
