"""Section 4.3: the number of sources of SDecGMCA (Figs. 3 and 4)."""

import numpy as np

from himap.paper.claims.base import (
    LOW_K,
    Finding,
    angular_error,
    bump,
    claim,
    each_part,
    frequency_error,
    listing,
    total,
)

__all__ = ["scan_ends", "scan_minimum", "scan_scales"]

_SCAN = {"section": "4.3", "notebook": "11_ns_scan"}


def _missing(realisation, *counts):
    """A Finding that says so if the scan lacks some number of sources, else None."""
    lacking = [n for n in counts if n not in realisation.scan]
    if lacking:
        text = ", ".join(map(str, lacking))
        return Finding(value=np.nan, parts={}, sentence=f"The scan does not hold n_s = {text}.")
    return None


@claim(
    "N1", "oscillating", "The total MSE of SD is least at 5 sources of 2 to 20.",
    number="n_s of the least MSE", paper="5", figure="3", **_SCAN,
)  # fmt: skip
def scan_minimum(realisation):
    """The sum of the mean squared relative errors of C_l (l <= 200) and P(k); the minimum must be at 5."""
    totals = {n: total(comparison) for n, comparison in realisation.scan.items()}
    best = min(totals, key=totals.get)
    at_five = f", at n_s = 5 {totals[5]:.3g}" if 5 in totals else ""
    return _missing(realisation, 5) or Finding(
        value=best,
        parts={"least at 5": best == 5},
        sentence=f"The least total MSE, {totals[best]:.3g}, is at n_s = {best}{at_five}.",
    )


@claim(
    "N2", "oscillating", "The MSE of SD is larger at n_s = 2, 3 and at n_s >= 10.",
    number="smallest MSE of these over that at n_s = 5", paper="> 1", figure="3", **_SCAN,
)  # fmt: skip
def scan_ends(realisation):
    """Larger than at n_s = 5: at 2, at 3, and at all from 10 to 20. Three parts."""
    lacking = _missing(realisation, 2, 3, 5, 10)
    if lacking:
        return lacking
    totals = {n: total(comparison) / total(realisation.scan[5]) for n, comparison in realisation.scan.items()}
    least = min(total for n, total in totals.items() if n >= 10)
    values = {"n_s = 2": totals[2], "n_s = 3": totals[3], "n_s >= 10, least": least}
    return Finding(
        value=min(values.values()),
        parts=each_part(values, lambda value: value > 1, "larger"),
        sentence=f"MSE over that at n_s = 5: {listing(values)}.",
    )


@claim(
    "N3", "oscillating", "The best n_s of SD is 5 at low k, 6 for the bump near k = 0.3, 7 at 10 < l < 100.",
    number="best n_s at low k", paper="5 (6 for the bump, 7 at 10 < l < 100)", figure="4", **_SCAN,
)  # fmt: skip
def scan_scales(realisation):
    """Best is the least mean |P/P0 - 1| at k < 0.1, |P/P0 - 1| at the bump's top, mean |C/C0 - 1|."""
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
        parts={f"{name}: {n}": best[name] == n for name, n in zip(errors, (5, 6, 7), strict=True)},
        sentence=f"Best n_s: {listing(best)}.",
    )
