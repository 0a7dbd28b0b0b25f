"""Claims on the degraded and the evolving beam (Sect. 4.2, Figs. 1 and 2)."""

import numpy as np

from himap.paper.claims.base import (
    METHODS,
    above,
    angular_band,
    claims_of,
    each,
    finding,
    frequency_band,
    in_band,
    recovered,
    smaller,
)
from himap.paper.claims.verdicts import CLEAR, LEAST_ORDER, ORDERS, is_smaller, parts_of

angular_claim, frequency_claim = (claims_of(section="4.2", figure=n, notebook="10_results") for n in "12")


@angular_claim("D1", "degraded", number="|C/C0 - 1| of the worst method, at 95 % of the l", paper="< 0.1")
def degraded_angular(sky):
    """All six methods recover C to within 10 % for 3 < l < 200.

    Within 10 % at 95 % of the l between 3 and 200 (or 2 nside). A main part for each method, PCA/ICA by the
    worse of the two.
    """
    errors = each(sky, "degraded", angular_band("within", 3, 200))
    wording = {"|C/C0 - 1| at 95 % of the l is below": errors}
    return finding(max(errors.values()), parts_of(errors, recovered, "within 10 %"), wording)


@frequency_claim("D2", "degraded", number="|P/P0 - 1| of the worst method, at 95 % of the k", paper="< 0.1")
def degraded_frequency(sky):
    """All six methods recover P to within 10 % for k > 0.03.

    Within 10 % at 95 % of the k above 0.03. A main part for each method, PCA/ICA by the worse of the two.
    """
    errors = each(sky, "degraded", frequency_band("within", 0.03))
    wording = {"|P/P0 - 1| at 95 % of the k is below": errors}
    return finding(max(errors.values()), parts_of(errors, recovered, "within 10 %"), wording)


@frequency_claim(
    "D3", "degraded", number="P/P0 of the method with the smallest loss, at 95 % of the k", paper="< 1"
)
def degraded_low_k(sky):
    """All six methods lose power at k < 0.03.

    P/P0 below 1, by more than 1 %, at 95 % of the k below 0.03. A main part for each method, PCA/ICA by the
    worse of the two.
    """
    tops = each(sky, "degraded", frequency_band("below", 0, 0.03))
    wording = {"P/P0 at 95 % of the k below 0.03 is at most": tops}
    return finding(max(tops.values()), parts_of(tops, smaller, "loses power"), wording)


@angular_claim("E1", "evolving", number="median C/C0 of PAR", paper="> 100")
def evolving_parametric(sky):
    """The parametric fit overestimates C by orders of magnitude at every l.

    Orders of magnitude are two or more: the median of C/C0 over 2 <= l <= 200 is above 100. Across all
    scales: the smallest is above 10. Two main parts.
    """
    comparison = sky.of("evolving")["parametric"]
    ratios = comparison.angular_ratio[comparison.degrees <= 200]
    median, lowest = float(np.median(ratios)), float(ratios.min())
    parts = (
        *parts_of({"PAR": median}, above(ORDERS), "100 times in the median"),
        *parts_of({"PAR": lowest}, above(LEAST_ORDER), "10 times at every l"),
    )
    return finding(median, parts, {"C/C0": {"lowest": lowest, "median": median, "highest": ratios.max()}})


@angular_claim("E2", "evolving", number="|C/C0 - 1| of the worst method, at 95 % of the l", paper="about 0.1")
def evolving_angular(sky):
    """PCA, ICA and SD recover C to within about 10 % for 4 <= l <= 200.

    Within about 10 % is within 10 % at 95 % of the l. Two main parts: PCA/ICA by the worse of the two, and
    SD.
    """
    errors = each(sky, "evolving", angular_band("within", 3, 201), ("pca", "fastica", "sdecgmca"))
    wording = {"|C/C0 - 1| at 95 % of the l is below": errors}
    return finding(max(errors.values()), parts_of(errors, recovered, "within about 10 %"), wording)


@angular_claim("E3", "evolving", number="mean C/C0 of GMCA for 10 < l < 40", paper="> 1.1")
def evolving_gmca(sky):
    """GMCA has a clear excess in C/C0 from l = 40 down, and in P/P0 below k = 0.2.

    A clear excess is a mean of more than 1.1. Four parts, all main: C/C0 for 2 <= l < 10 (small) and for 10 <
    l < 40 (intermediate); P/P0 for k < 0.2, and for 0.1 < k < 0.2 by itself, so that the lowest k alone do
    not suffice.
    """
    measures = {
        "l < 10": angular_band("mean", 1, 10),
        "10 < l < 40": angular_band("mean", 10, 40),
        "k < 0.2": frequency_band("mean", 0, 0.2),
        "0.1 < k < 0.2": frequency_band("mean", 0.1, 0.2),
    }
    comparison = sky.of("evolving")["gmca"]
    excess = {name: measure(comparison) for name, measure in measures.items()}
    parts = parts_of(excess, above(CLEAR), "in excess", method="GMCA")
    return finding(excess["10 < l < 40"], parts, {"Mean C/C0 and P/P0 of GMCA at": excess})


@frequency_claim(
    "E4", "evolving", number="|P/P0 - 1| of the worst method, at 95 % of the k above 0.1", paper="< 0.1"
)
def evolving_frequency(sky):
    """All methods but PAR recover P down to k of about 0.1, and deviate more below.

    Recovered is to 10 % at 95 % of the k above 0.1; the deviation grows if 95 % of the k below are within a
    larger one, by more than 1 %. Two main parts for each method, PCA/ICA by the worse of the two. For GMCA
    this is hardly compatible with its excess at 0.1 < k < 0.2 (E3).
    """
    methods = [name for name in METHODS if name != "parametric"]
    over = each(sky, "evolving", frequency_band("within", 0.1), methods)
    under = each(sky, "evolving", frequency_band("within", 0, 0.1), methods)
    pairs = {name: (over[name], under[name]) for name in over}
    parts = parts_of(over, recovered, "recovered above")
    parts += parts_of(pairs, lambda pair: is_smaller(*pair), "deviates more below")
    return finding(max(over.values()), parts, {"|P/P0 - 1| at 95 % of the k above 0.1": over, "below": under})


@frequency_claim(
    "E5",
    "evolving",
    number="change of C/C0 from the degraded to the evolving beam, at 95 % of the l",
    paper="small",
)
def evolving_polynomial(sky):
    """POL is insensitive to this beam.

    Both ratios are within 10 % of those of the degraded beam, at 95 % of the l with 3 < l < 200 and of the k
    above 0.03, below which it loses power with any beam (D3). Two parts, both main.
    """
    evolving, degraded = (sky.of(beam)["polynomial"] for beam in ("evolving", "degraded"))
    ratio_l = evolving.angular_ratio / degraded.angular_ratio
    ratio_k = evolving.frequency_ratio / degraded.frequency_ratio
    change = {
        "C/C0": in_band("within", evolving.degrees, ratio_l, 3, 200),
        "P/P0": in_band("within", evolving.k, ratio_k, 0.03, np.inf),
    }
    parts = parts_of(change, recovered, "the same", method="POL")
    return finding(change["C/C0"], parts, {"Change of POL at 95 % of the l and k": change})
