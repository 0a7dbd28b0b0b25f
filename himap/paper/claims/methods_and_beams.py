"""Section 4.2: six methods, three beams (Figs. 1 and 2)."""

import numpy as np

from himap.measures.diagnostics import band_max, largest_deviation
from himap.paper.claims.base import (
    LOW_K,
    METHODS,
    Finding,
    angular_deviation,
    angular_error,
    angular_mean,
    bump,
    by_method,
    claim,
    each_part,
    frequency_deviation,
    frequency_mean,
    listing,
)
from himap.paper.methods import BSS

__all__ = [
    "beyond_200",
    "degraded_angular",
    "degraded_frequency",
    "degraded_loss",
    "evolving_angular",
    "evolving_frequency",
    "evolving_gmca",
    "evolving_parametric",
    "evolving_polynomial",
    "oscillating_angular",
    "oscillating_excess",
    "oscillating_fits",
    "oscillating_low_k",
    "oscillating_peak",
]

_ANGULAR = {"section": "4.2", "figure": "1", "notebook": "10_results"}
_FREQUENCY = {"section": "4.2", "figure": "2", "notebook": "10_results"}


@claim(
    "D1", "degraded", "All six methods recover C/C0 to 10 % for 3 < l < 200.",
    number="largest |C/C0 - 1|", paper="< 0.1", **_ANGULAR,
)  # fmt: skip
def degraded_angular(realisation):
    """Every l between 3 and 200 (or 2 nside), one part for each method."""
    values = by_method(realisation.of("degraded"), angular_deviation(3, 200))
    return Finding(
        value=max(values.values()),
        parts=each_part(values, lambda value: value < 0.1, "within 10 %"),
        sentence=f"Largest |C/C0 - 1|: {listing(values)}.",
    )


@claim(
    "D2", "degraded", "All six methods recover P/P0 to 10 % for k > 0.03.",
    number="largest |P/P0 - 1|", paper="< 0.1", **_FREQUENCY,
)  # fmt: skip
def degraded_frequency(realisation):
    """Every k above 0.03, one part for each method."""
    values = by_method(realisation.of("degraded"), frequency_deviation(0.03))
    return Finding(
        value=max(values.values()),
        parts=each_part(values, lambda value: value < 0.1, "within 10 %"),
        sentence=f"Largest |P/P0 - 1|: {listing(values)}.",
    )


@claim(
    "D3", "degraded", "All six methods lose power at k < 0.03.",
    number="largest P/P0", paper="< 1", **_FREQUENCY,
)  # fmt: skip
def degraded_loss(realisation):
    """P/P0 below 1 at every k below 0.03, one part for each method."""
    values = by_method(
        realisation.of("degraded"),
        lambda comparison: band_max(comparison.k, comparison.frequency_ratio, 0, 0.03),
    )
    return Finding(
        value=max(values.values()),
        parts=each_part(values, lambda value: value < 1, "loses power"),
        sentence=f"Largest P/P0 below k = 0.03: {listing(values)}.",
    )


@claim(
    "E1", "evolving", "The parametric fit is too high in C/C0 by orders of magnitude at every l.",
    number="lowest C/C0 of PAR", paper="> 100", **_ANGULAR,
)  # fmt: skip
def evolving_parametric(realisation):
    """Orders of magnitude are two or more: a factor of 100 at every l to 200, with 10 as the other part."""
    comparison = realisation.of("evolving")["parametric"]
    ratios = comparison.angular_ratio[comparison.degrees <= 200]
    return Finding(
        value=float(ratios.min()),
        parts={"10 times at every l": ratios.min() > 10, "100 times at every l": ratios.min() > 100},
        sentence=f"C/C0 goes from {ratios.min():.3g} to {ratios.max():.3g}.",
    )


@claim(
    "E2", "evolving", "PCA, ICA and SD recover C/C0 to about 10 % for 4 <= l <= 200.",
    number="largest |C/C0 - 1|", paper="about 0.1", **_ANGULAR,
)  # fmt: skip
def evolving_angular(realisation):
    """Less than 15 % at every l, one part for each method."""
    values = by_method(realisation.of("evolving"), angular_deviation(3, 201), ("pca", "fastica", "sdecgmca"))
    return Finding(
        value=max(values.values()),
        parts=each_part(values, lambda value: value < 0.15, "within about 10 %"),
        sentence=f"Largest |C/C0 - 1|: {listing(values)}.",
    )


@claim(
    "E3", "evolving", "GMCA has a clear excess in C/C0 from l = 40 down, and in P/P0 below k = 0.2.",
    number="mean C/C0 of GMCA for 10 < l < 40", paper="> 1.1", **_ANGULAR,
)  # fmt: skip
def evolving_gmca(realisation):
    """A clear excess is a mean of more than 1.1: for 2 <= l < 10, for 10 < l < 40, and for k < 0.2."""
    comparison = realisation.of("evolving")["gmca"]
    large, intermediate = angular_mean(1, 10)(comparison), angular_mean(10, 40)(comparison)
    frequency = frequency_mean(0, 0.2)(comparison)
    return Finding(
        value=intermediate,
        parts={
            "excess at l < 10": large > 1.1,
            "excess at 10 < l < 40": intermediate > 1.1,
            "excess at k < 0.2": frequency > 1.1,
        },
        sentence=f"C/C0 of GMCA is {large:.3g} at l < 10 and {intermediate:.3g} at 10 < l < 40; "
        f"its P/P0 below 0.2 is {frequency:.3g}.",
    )


@claim(
    "E4", "evolving", "All but PAR recover P/P0 down to k of about 0.1, and deviate more below.",
    number="largest |P/P0 - 1| at k > 0.1", paper="< 0.1", **_FREQUENCY,
)  # fmt: skip
def evolving_frequency(realisation):
    """Recovered is to 10 % at every k above 0.1; the deviation below must be larger. Two parts a method."""
    methods = tuple(name for name in METHODS if name != "parametric")
    above = by_method(realisation.of("evolving"), frequency_deviation(0.1), methods)
    below = by_method(realisation.of("evolving"), frequency_deviation(0, 0.1), methods)
    grows = {f"{name} deviates more below": below[name] > above[name] for name in above}
    return Finding(
        value=max(above.values()),
        parts=each_part(above, lambda value: value < 0.1, "recovered above") | grows,
        sentence=f"Largest |P/P0 - 1| above 0.1: {listing(above)}; below: {listing(below)}.",
    )


@claim(
    "E5", "evolving", "POL does not feel this beam.",
    number="largest change of C/C0 from the degraded to the evolving beam", paper="small", **_FREQUENCY,
)  # fmt: skip
def evolving_polynomial(realisation):
    """Both ratios are within 10 % of those of the degraded beam, for 3 < l < 200 and for k > 0.03."""
    evolving, degraded = (realisation.of(beam)["polynomial"] for beam in ("evolving", "degraded"))
    angular = largest_deviation(evolving.degrees, evolving.angular_ratio / degraded.angular_ratio, 3, 200)[0]
    frequency = largest_deviation(
        evolving.k, evolving.frequency_ratio / degraded.frequency_ratio, 0.03, np.inf
    )[0]
    return Finding(
        value=angular,
        parts={"same C/C0": angular < 0.1, "same P/P0": frequency < 0.1},
        sentence=f"C/C0 of POL changes by up to {angular:.2g}, its P/P0 by up to {frequency:.2g}.",
    )


@claim(
    "O1", "oscillating", "POL and PAR fail in both spectra.",
    number="smallest of the four median errors, as a factor", paper="> 2", **_ANGULAR,
)  # fmt: skip
def oscillating_fits(realisation):
    """To fail is to be off by a factor of 2 at half of all l up to 200, or of all k. Four parts."""

    def factor(ratios):
        return float(np.median(np.maximum(ratios, 1 / ratios)))

    values = {}
    for name in ("polynomial", "parametric"):
        comparison = realisation.of("oscillating")[name]
        values[f"{METHODS[name]} in C"] = factor(comparison.angular_ratio[comparison.degrees <= 200])
        values[f"{METHODS[name]} in P"] = factor(comparison.frequency_ratio)
    return Finding(
        value=min(values.values()),
        parts=each_part(values, lambda value: value > 2, "fails"),
        sentence=f"Median factor between recovered and true: {listing(values)}.",
    )


@claim(
    "O2", "oscillating", "The BSS methods have a strong excess in C/C0 at l < 10.",
    number="smallest mean C/C0 at l < 10", paper="> 1.5", **_ANGULAR,
)  # fmt: skip
def oscillating_excess(realisation):
    """A strong excess is a mean of more than 1.5 for 2 <= l < 10, one part for each method."""
    values = by_method(realisation.of("oscillating"), angular_mean(1, 10), BSS)
    return Finding(
        value=min(values.values()),
        parts=each_part(values, lambda value: value > 1.5, "in excess"),
        sentence=f"Mean C/C0 at l < 10: {listing(values)}.",
    )


@claim(
    "O3", "oscillating", "SD recovers C/C0 to 5 % for 10 < l < 200; PCA, ICA and GMCA are each further off.",
    number="largest |C/C0 - 1| of SD", paper="< 0.05", **_ANGULAR,
)  # fmt: skip
def oscillating_angular(realisation):
    """SD at every l; the others by their mean |C/C0 - 1|. Four parts."""
    comparisons = realisation.of("oscillating")
    comparison = comparisons["sdecgmca"]
    worst, degree = largest_deviation(comparison.degrees, comparison.angular_ratio, 10, 200)
    inside = (comparison.degrees > 10) & (comparison.degrees < 200)
    share = np.mean(np.abs(comparison.angular_ratio[inside] - 1) < 0.05)
    values = by_method(comparisons, angular_error(10, 200), BSS)
    further = {f"{name} further off": values[name] > values["SD"] for name in ("PCA", "ICA", "GMCA")}
    return Finding(
        value=worst,
        parts={"SD within 5 %": worst < 0.05} | further,
        sentence=f"SD is furthest off, by {worst:.2g}, at l = {degree:.0f}, and within 5 % at {share:.0%} "
        f"of the l. Mean |C/C0 - 1|: {listing(values)}.",
    )


@claim(
    "O4", "oscillating", "Every method has a spurious peak in P/P0 near k = 0.3; that of SD is the lowest.",
    number="highest P/P0 of SD near k = 0.31", paper="> 1, lowest", **_FREQUENCY,
)  # fmt: skip
def oscillating_peak(realisation):
    """A peak is a P/P0 above 1.1 for 0.25 < k < 0.38; one part for each method, one for the rank."""
    values = by_method(realisation.of("oscillating"), bump)
    return Finding(
        value=values["SD"],
        parts=each_part(values, lambda value: value > 1.1, "has the peak")
        | {"SD has the lowest": min(values, key=values.get) == "SD"},
        sentence=f"Highest P/P0 near k = 0.31: {listing(values)}.",
    )


@claim(
    "O5", "oscillating", "The BSS methods have an excess in P/P0 at low k, SD no less than PCA or ICA.",
    number="mean P/P0 of SD at k < 0.1", paper="> 1.1", **_FREQUENCY,
)  # fmt: skip
def oscillating_low_k(realisation):
    """An excess is a mean of more than 1.1 at k < 0.1; better is nearer to 1. Five parts."""
    values = by_method(realisation.of("oscillating"), frequency_mean(0, LOW_K), BSS)
    no_better = abs(values["SD"] - 1) >= min(abs(values[name] - 1) for name in ("PCA", "ICA"))
    return Finding(
        value=values["SD"],
        parts=each_part(values, lambda value: value > 1.1, "in excess")
        | {"SD no better than PCA": no_better},
        sentence=f"Mean P/P0 at k < 0.1: {listing(values)}.",
    )


@claim(
    "O6", "all", "Beyond l = 200 SD has a spurious peak in C, from inverting the beam.",
    number="highest C/C0 of SD at l > 200", paper="> 1.1", **_ANGULAR,
)  # fmt: skip
def beyond_200(realisation):
    """A peak is a C/C0 of more than 1.1 between l = 200 and 2 nside, one part for each beam."""
    values = {}
    for beam in ("degraded", "evolving", "oscillating"):
        comparison = realisation.of(beam)["sdecgmca"]
        beyond = comparison.angular_ratio[comparison.degrees > 200]
        if not len(beyond):
            top = comparison.degrees.max()
            return Finding(value=np.nan, parts={}, sentence=f"These maps end at l = {top:.0f}.")
        values[beam] = float(beyond.max())
    return Finding(
        value=max(values.values()),
        parts=each_part(values, lambda value: value > 1.1, "beam: a peak"),
        sentence=f"Highest C/C0 of SD beyond l = 200: {listing(values)}.",
    )
