"""Section 4.3: the number of sources of SDecGMCA (Figs. 3 and 4)."""

import numpy as np

from himap.measures.diagnostics import MSE_DEFINITIONS
from himap.paper.claims.base import (
    LOW_K,
    angular_error,
    bump,
    claim,
    frequency_error,
    listing,
    total,
)
from himap.paper.claims.verdicts import Finding, Part, not_applicable, parts_of

_SCAN = {"section": "4.3", "notebook": "11_ns_scan"}


def _missing(realisation, *counts):
    """A Finding that says so if the scan lacks some number of sources, else None."""
    lacking = [n for n in counts if n not in realisation.scan]
    if lacking:
        return not_applicable(f"The scan does not hold n_s = {', '.join(map(str, lacking))}.")
    return None


@claim(
    "N1", "oscillating", "The total MSE of SD is least at 5 sources of 2 to 20.",
    number="n_s of the least MSE", paper="5", figure="3", **_SCAN,
)  # fmt: skip
def scan_minimum(realisation):
    """The sum of the mean squared relative errors of C_l (l <= 200) and P(k); the minimum must be at 5. One
    part.
    """
    totals = {n: total(comparison) for n, comparison in realisation.scan.items()}
    best = min(totals, key=totals.get)
    at_five = f", at n_s = 5 {totals[5]:.3g}" if 5 in totals else ""
    return _missing(realisation, 5) or Finding(
        value=best,
        parts=(Part(name="least at 5", held=best == 5),),
        sentence=f"The least total MSE, {totals[best]:.3g}, is at n_s = {best}{at_five}.",
    )


@claim(
    "N2", "oscillating", "The MSE of SD is larger at n_s = 2, 3 and at n_s >= 10.",
    number="smallest MSE of these over that at n_s = 5", paper="> 1", figure="3", **_SCAN,
)  # fmt: skip
def scan_ends(realisation):
    """Larger than at n_s = 5: at 2, at 3, and at all from 10 to 20. Three parts, all main."""
    lacking = _missing(realisation, 2, 3, 5, 10)
    if lacking:
        return lacking
    totals = {n: total(comparison) / total(realisation.scan[5]) for n, comparison in realisation.scan.items()}
    least = min(total for n, total in totals.items() if n >= 10)
    values = {"n_s = 2": totals[2], "n_s = 3": totals[3], "n_s >= 10, least": least}
    return Finding(
        value=min(values.values()),
        parts=parts_of(values, lambda value: value > 1, "larger"),
        sentence=f"MSE over that at n_s = 5: {listing(values)}.",
    )


@claim(
    "N3", "oscillating", "The best n_s of SD is 5 at low k, 6 for the bump near k = 0.3, 7 at 10 < l < 100.",
    number="best n_s at low k", paper="5 (6 for the bump, 7 at 10 < l < 100)", figure="4", **_SCAN,
)  # fmt: skip
def scan_scales(realisation):
    """Best is the least mean |P/P0 - 1| at k < 0.1, |P/P0 - 1| at the bump's top, mean |C/C0 - 1|. Three
    parts, all main.
    """
    errors = {
        "low k": frequency_error(0, LOW_K),
        "bump": lambda comparison: abs(bump(comparison) - 1),
        "10 < l < 100": angular_error(10, 100),
    }
    best = {
        name: min(realisation.scan, key=lambda n, error=error: error(realisation.scan[n]))
        for name, error in errors.items()
    }
    return _missing(realisation, 5, 6, 7) or Finding(
        value=best["low k"],
        parts=tuple(
            Part(name=f"{name}: {n}", held=best[name] == n) for name, n in zip(errors, (5, 6, 7), strict=True)
        ),
        sentence=f"Best n_s: {listing(best)}.",
    )


@claim(
    "N4", "oscillating", "An n_s of 5 to 7 is the best compromise over all scales.",
    number="n_s of the least total, relative errors", paper="5 to 7", figure="3", **_SCAN,
)  # fmt: skip
def scan_compromise(realisation):
    """The paper does not define its total MSE: the minimum of every definition that we have lies at 5, 6 or
    7. A main part for each, relative, logarithmic and absolute.
    """
    best = {
        definition: min(realisation.scan, key=lambda n, by=definition: realisation.scan[n].total_error(by))
        for definition in MSE_DEFINITIONS
    }
    return _missing(realisation, 5, 6, 7) or Finding(
        value=best["relative"],
        parts=parts_of(best, lambda n: 5 <= n <= 7, "least at 5 to 7"),
        sentence=f"Least total at n_s: {listing(best)}.",
    )


@claim(
    "N5", "oscillating", "At the largest multipoles the differences between n_s are small.",
    number="spread over n_s at l > 150 over that at 10 < l < 100", paper="< 1", figure="4", **_SCAN,
)  # fmt: skip
def scan_large_degrees(realisation):
    """The spread at one l is the highest less the lowest C/C0 of all n_s. Its median over 150 < l <= 200 is
    smaller than that over 10 < l < 100. One part. It does not apply to maps that end before l = 200.
    """
    degrees = next(iter(realisation.scan.values())).degrees
    if degrees.max() < 200:
        return not_applicable(f"These maps end at l = {degrees.max():.0f}.")
    if len(realisation.scan) < 2:
        return not_applicable("The scan holds one n_s only.")
    spread = np.ptp([comparison.angular_ratio for comparison in realisation.scan.values()], axis=0)
    middle = float(np.median(spread[(degrees > 10) & (degrees < 100)]))
    large = float(np.median(spread[(degrees > 150) & (degrees <= 200)]))
    return Finding(
        value=large / middle,
        parts=(Part(name="smaller at l > 150", held=large < middle),),
        sentence=f"Median spread of C/C0 over n_s: {middle:.3g} at 10 < l < 100, {large:.3g} at l > 150.",
    )
