# ---
# jupyter:
#   himap:
#     figures: ["3", "4"]
#     section: "4.3"
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The number of sources
#
# > - **Read first**: {doc}`10_results`.
# > - **Tests** (verdicts of {doc}`15_claims`): {claim}`N1`, {claim}`N2`, {claim}`N3`, {claim}`N4`, {claim}`N5`.
# > - **Time and memory**: {cost}`11_ns_scan`.
#
# A component method assumes a number of sources $n_s$: the number of spectra that it removes from the maps.
# Too few leave foreground residual; too many remove HI or, with SDecGMCA, reintroduce foreground residual.
# {cite:t}`gkogkou2025` vary $n_s$ from 2 to 20 for SDecGMCA with the oscillating beam, compare both spectra
# with the truth, and adopt 5. This chapter repeats the scan, adds PCA, which does not use the beam, and tests
# how sensitive the optimum is to the definition of the error and to the start of SDecGMCA
# ({doc}`27_restarts`). {glue:text}`scan_reading` ([readings](sdecgmca-reading)).

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, meerkat or a file of widths or b_l
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
method: str = "sdecgmca"  # a method with a number of sources: sdecgmca, beam_subspace, gmca...
beside: str | None = "pca"  # another one to compare with, or null
n_sources_min: int = 2  # the scan begins here
n_sources_max: int = 20  # and ends here: each number to 8, then 10, 15, 20
shown: list | None = None  # numbers of sources of the spectra; null: 3 to 7 and 10 if in the scan
definition: str = "relative"  # of the error: relative, logarithmic or absolute
reading: str = "default"  # of SDecGMCA: default, letter, code, code-rounding, follow-up, instrument-noise
n_restarts: int = 2  # starts of SDecGMCA, which is chaotic, with each number

# %% tags=["hide-input"]
import warnings
from dataclasses import fields

import numpy as np

from himap import removal
from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.figures import plotting, styles
from himap.figures.numbers import one_run, quote, show, show_table
from himap.measures.diagnostics import BUMP, MSE_DEFINITIONS, mean_squared_error
from himap.paper import captions
from himap.paper.claims.base import LOW_K, angular_band, bump, frequency_band
from himap.paper.methods import beam_called, check_reading, sdecgmca_for
from himap.paper.study import Study, over_restarts
from himap.paper.study_figures import both_figure, median_of
from himap.removal.base import REGISTRY, SeparationWarning
from himap.removal.restarts import has_restarts

selected = beam_called(beam, ripple=ripple)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    n_restarts=n_restarts,
)
counted = [
    name for name in removal.available() if "n_sources" in {item.name for item in fields(REGISTRY[name])}
]
methods = list(dict.fromkeys([method] if beside is None else [method, beside]))
for name in methods:
    if name not in counted:
        raise InputError(
            f"method and beside must have a number of sources: {', '.join(counted)}; got {name!r}."
        )
if definition not in MSE_DEFINITIONS:
    raise InputError(f"unknown definition {definition!r}; there are {', '.join(MSE_DEFINITIONS)}.")
n_channels = study.survey.n_channels
first = whole_number("n_sources_min", n_sources_min, 1, n_channels)
last = whole_number("n_sources_max", n_sources_max, first, n_channels)
wanted = [whole_number("each number in shown", n, first, last) for n in shown or ()]
tried = {*range(9), 10, 15, 20, first, last, *wanted}
scanned = [n for n in range(first, last + 1) if n in tried]
drawn = wanted or [n for n in (3, 4, 5, 6, 7, 10) if n in scanned] or [first]


def remover(name, n):
    """The method called `name` with n sources."""
    if name == "sdecgmca":
        return sdecgmca_for(selected, n_sources=n, reading=reading)
    return removal.create(name, n_sources=n)


removers = {selected: [remover(name, n) for name in methods for n in scanned]}
check_reading(reading, removers[selected])
study.check(removers)
warnings.simplefilter("ignore", SeparationWarning)  # which runs did not converge is listed at the end
stated = {"reading": reading} if "sdecgmca" in methods else {}  # in the lines under the figures
quote(
    scan_reading=captions.in_short(sdecgmca_for(selected, reading=reading), study.survey.nside, n_restarts)
    if stated
    else "There is no SDecGMCA in this run"
)

# %% [markdown]
# ## The scan
#
# Beyond 8 only 10, 15 and 20 sources are tried. All runs clean the same maps,
# {doc}`with their peaks masked <03_peak_masking>`.

# %%
study.prepare(removers)

# %%
comparisons = {  # of all restarts
    name: {n: study.ensemble(selected, remover(name, n)) for n in scanned} for name in methods
}

# %% [markdown]
# ## The total error
#
# The paper's Fig. 3 shows a *total MSE* of both spectra, but does not define how the errors of a $C_\ell$ in
# mK$^2$ and of a $P(k_\nu)$ in mK$^2$ MHz are combined. With $S$ the recovered spectrum, $S^0$ the true one,
# and $i$ over $\ell$ or $k_\nu$, three dimensionless definitions are
#
# ```{math}
# :label: eq-scan-mse
# \begin{aligned}
# \mathrm{relative:} &\quad \Big\langle \Big(\frac{S_i}{S_i^0} - 1\Big)^2 \Big\rangle_i \\
# \mathrm{logarithmic:} &\quad \Big\langle \ln^2 \frac{S_i}{S_i^0} \Big\rangle_i \\
# \mathrm{absolute:} &\quad \frac{\sum_i (S_i - S_i^0)^2}{\sum_i (S_i^0)^2}
# \end{aligned}
# ```
#
# The total is that of the channel-averaged $C_\ell$ for $2 \le \ell \le \min(200, 2\,N_\mathrm{side})$ plus
# that of $P(k_\nu)$ for $k_\nu > 0$. The first is dominated by foreground residual, since a loss cannot
# exceed 1; the second is symmetric in excess and loss; the third is dominated by low $\ell$ and low $k_\nu$,
# where the spectra are largest. The default (`definition`) is the first, since the paper discusses ratios.

# %% tags=["hide-input"]
LMAX = 200


def errors(comparison, definition):
    """The mean squared errors of C_l and of P(k) of one `Comparison`."""
    low = comparison.degrees <= LMAX
    angular = mean_squared_error(comparison.angular[low], comparison.true_angular[low], definition)
    return angular, mean_squared_error(comparison.frequency, comparison.true_frequency, definition)


def over_scan(name, measure):
    """A measure of a `Comparison` for each restart and n_s, (n_members, n_scanned)."""
    return np.array([[measure(one) for one in members] for members in comparisons[name].values()]).T


def totals(name, definition):
    """Total error for each restart and n_s, (n_members, n_scanned)."""
    return over_scan(name, lambda comparison: comparison.total_error(definition, lmax=LMAX))


def best(values):
    """The n_s of the least value of one restart."""
    return scanned[int(np.argmin(values))]


def listed(numbers):
    """Whole numbers of all restarts in turn, "5 and 6", or the one that they share."""
    *others, final = map(str, numbers if len(set(numbers)) > 1 else numbers[:1])
    return " and ".join(filter(None, [", ".join(others), final]))


def each_of(numbers, name):
    """The entry of a whole number of each restart of a method: all of them, for two have no percentiles."""
    return one_run(listed(numbers)) if has_restarts(remover(name, first)) else (numbers[0], 1)


def curve(values):
    """A curve, or an ensemble of them, for `plotting.lines`."""
    return values[0] if len(values) == 1 else values


looks = {name: styles.method_style(remover(name, first)) for name in methods}
chaotic = {name: has_restarts(remover(name, first)) and n_restarts > 1 for name in methods}
ticks = scanned if len(scanned) <= 20 else scanned[:: -(-len(scanned) // 20)]
axis = {"xlabel": "number of sources $n_s$", "xticks": ticks, "xlim": (first - 0.5, last + 0.5)}


def scan_panel(definition):
    """Total error against n_s, and its minimum of each restart; the axis ends at ten thousand times that."""
    curves, points = [], []
    for name in methods:
        values, style = totals(name, definition), looks[name]
        label = f"{style['label']}, median of {n_restarts}" if chaotic[name] else style["label"]
        curves.append((scanned, curve(values), style | {"label": label}))
        minima = [best(one) for one in values]
        marker, size = ("o", 13) if name == method else ("s", 7)
        mark = {"color": style["color"], "marker": marker, "markersize": size, "markerfacecolor": "none"}
        mark |= {"label": f"minimum at $n_s$ = {listed(minima)}", "markeredgewidth": 1.8}
        points.append((minima, values.min(axis=1), mark))
    low = min(values.min() for _, values, _ in curves)
    return axis | {"curves": curves, "points": points, "yscale": "log", "ylim": (0.3 * low, 1e4 * low)}


whole = scan_panel(definition) | {
    "ylabel": f"total MSE, {definition}",
    "legend": {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14), "ncols": 2},
}
parts = np.median(
    [[errors(one, definition) for one in members] for members in comparisons[method].values()], axis=1
).T
for values, of, line in zip(parts, (r"$C_\ell$", r"$P(k_\nu)$"), ((0, (5, 1.5)), ":"), strict=True):
    look = {"color": looks[method]["color"], "linestyle": line, "linewidth": 1.1}
    whole["curves"].append((scanned, values, look | {"label": f"{looks[method]['label']}, {of} alone"}))


def bare(curves):
    """The same without labels, for a panel beside one with a legend."""
    return [(x, y, {key: value for key, value in style.items() if key != "label"}) for x, y, style in curves]


detail = whole | {
    "curves": bare(whole["curves"]),
    "points": bare(whole["points"]),
    "title": "near the minimum",
}
detail["ylim"] = (
    0.7 * parts.min(),
    1e3 * min(values.min() for _, values, _ in whole["curves"][: len(methods)]),
)
whole = whole | {"ylim": None, "title": "full range"}

# %% [markdown]
# Each curve first falls with the foreground residual. The curve of PCA rises again because further sources
# remove HI. That of SDecGMCA depends on which restarts fail, and rises with many sources because foreground
# residual returns ({numref}`fig-ns-scan-parts`). If the bands of two neighbouring $n_s$ overlap, the restarts
# do not distinguish them. This error does not show foreground residual that compensates signal loss
# ({doc}`23_thresholds`); the mean $r$ in the last table does.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-ns-scan-mse", "caption": "Total MSE of both spectra against the number of sources, and its minimum (of SDecGMCA for each restart), for SDecGMCA (the paper's Fig. 3) and PCA. {glue:text}`scan_reading` ([readings](sdecgmca-reading)). Thin dashed and dotted: the two spectra; of several restarts the medians. Right: near the minimum; higher errors are cut off."}}
study.stamped(plotting.lines([whole, detail], size=(5, 3.9)), beam=selected, definition=definition, **stated)

# %% tags=["hide-input"]
of_method, of_beside = totals(method, definition), totals(methods[-1], definition)
least, at = np.median(of_method, axis=0).min(), dict(zip(scanned, of_method.T, strict=True))
many = [values for n, values in at.items() if n >= 10]


def of_members(values, tolerance, name=method, unit=()):
    """The entry of a number of each restart of a method."""
    return over_restarts(remover(name, first), [(value, tolerance, *unit) for value in values])


def times_least(values):
    """Errors of the restarts of the first method over its least median."""
    return of_members(values / least, max(0.2 * np.median(values) / least, 0.01))


def best_of(values, name):
    """The entry of the number of sources at which each restart of a method has its least error."""
    return each_of([best(one) for one in values], name)


def at_five(values, name):
    """The entry of the errors of the restarts of a method with five sources."""
    if 5 not in scanned:
        return "(not in this scan)"
    errors = values[:, scanned.index(5)]
    return of_members(errors, 0.05 * np.median(errors), name)


at_best = [study.members(remover(method, best(one)))[k] for k, one in enumerate(of_method)]
quote(
    scan_best=best_of(of_method, method),
    scan_best_beside=best_of(of_beside, methods[-1]),
    scan_best_logarithmic=best_of(totals(method, "logarithmic"), method),
    scan_best_logarithmic_beside=best_of(totals(methods[-1], "logarithmic"), methods[-1]),
    scan_best_absolute=best_of(totals(method, "absolute"), method),
    scan_best_absolute_beside=best_of(totals(methods[-1], "absolute"), methods[-1]),
    scan_error_five=at_five(of_method, method),
    scan_error_five_beside=at_five(of_beside, methods[-1]),
    scan_two=times_least(at[2]) if 2 in at else "(not in this scan)",
    scan_five=times_least(at[5]) if 5 in at else "(not in this scan)",
    scan_ten=times_least(np.min(many, axis=0)) if many else "(not in this scan)",
    scan_beside_over_best=of_members(
        np.median(of_beside, axis=0).min() / of_method.min(axis=1),
        max(0.2 * np.median(of_beside, axis=0).min() / least, 0.01),
    ),
    scan_failed=each_of([np.count_nonzero(one > 1) for one in of_method], method),
    scan_tried=f"{len(scanned)}",
    scan_choices=captions.in_short(sdecgmca_for(selected, reading=reading), study.survey.nside)
    + (f"; medians of {n_restarts} restarts, the legend has those that failed" if n_restarts > 1 else "")
    if stated
    else "There is no SDecGMCA in this run",
    scan_r_best=of_members([study.assessed(selected, one).correlation.mean() for one in at_best], 0.005),
)

# %% [markdown]
# In the paper the error has its minimum at 5 sources and rises again with many. Here the minimum of the
# restarts of SDecGMCA is at {glue:text}`scan_best` sources. Relative to the smallest median, the error is
# {glue:text}`scan_five` with 5 sources, {glue:text}`scan_two` with 2, and {glue:text}`scan_ten` with the best
# number from 10 on (medians and 16 to 84 % of the restarts). Of the {glue:text}`scan_tried` numbers tried,
# the total exceeds 1 for {glue:text}`scan_failed` (one count per restart). The minimum of PCA is at
# {glue:text}`scan_best_beside`.
#
# For the logarithmic error the minima are at {glue:text}`scan_best_logarithmic` (SDecGMCA) and
# {glue:text}`scan_best_logarithmic_beside` (PCA), for the absolute error at {glue:text}`scan_best_absolute` and
# {glue:text}`scan_best_absolute_beside`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-ns-scan-definitions", "caption": "Total MSE against the number of sources for the other two definitions, near the minimum; higher errors are cut off."}}
panels = [
    scan_panel(other) | {"ylabel": f"total MSE, {other}"} for other in MSE_DEFINITIONS if other != definition
]
study.stamped(plotting.lines(panels, size=(5, 3.6)), beam=selected, **stated)

# %% [markdown]
# ## The spectra
#
# Ratios above 1 mean that foreground residual exceeds signal loss, ratios below 1 the opposite. With 3
# sources there is foreground residual on most scales; with more sources it occurs mainly in restarts that
# fail, and the others lose HI at low $k_\nu$ and low $\ell$. In the paper fewer sources are better at low
# $k_\nu$ and more at intermediate $\ell$.


# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-ns-scan-spectra", "caption": "Frequency (left) and angular (right) power spectra recovered by SDecGMCA with several numbers of sources, and their ratios to the truth (the paper's Fig. 4). {glue:text}`scan_choices` ([readings](sdecgmca-reading)). Grey band: 10 %; ratios are linear near 1, logarithmic beyond."}}
def called(n):
    """What the legend says of a number of sources."""
    members = comparisons[method][n]
    failed = f" ({sum(one.fails for one in members)} of {len(members)} failed)" if len(members) > 1 else ""
    return f"$n_s$ = {n}{failed}"


lines = styles.sequence([called(n) for n in drawn])
curves = [(look, median_of(comparisons[method][n])) for look, n in zip(lines, drawn, strict=True)]
both_figure(study, selected, curves, method=method, **stated)

# %% [markdown]
# ## The optimum by scale
#
# The table lists the best $n_s$ for each definition of the total, and by scale as in the paper's Sect. 4.3:
# mean $|P/P_0 - 1|$ at $k_\nu < 0.1$ MHz$^{-1}$, $|P/P_0 - 1|$ at the top of the bump near
# $k_\nu = 2\pi/(20\,\mathrm{MHz})$, and mean $|C/C_0 - 1|$ at $10 < \ell < 100$ (or $2\,N_\mathrm{side}$).

# %% tags=["hide-input"]
measures = {
    f"total, {name}": lambda comparison, name=name: comparison.total_error(name, lmax=LMAX)
    for name in MSE_DEFINITIONS
}
measures["low k"] = frequency_band("error", 0, LOW_K)
if np.pi / study.survey.channel_width > BUMP[1]:
    measures["bump"] = lambda comparison: abs(bump(comparison) - 1)
intermediate = f"10 < l < {min(100, study.l_top)}"
measures[intermediate] = angular_band("error", 10, 100)


def row_of(values, label, sharp):
    """Of one restart: the best number, its error, and that with five; a sharp number is compared exactly."""
    row = {f"{label}: best n_s": str(best(values)) if sharp else (best(values), 1)}
    for n, column in ((best(values), "error there"), (5, "at n_s = 5")):
        if n in scanned:
            value = values[scanned.index(n)]
            row[f"{label}: {column}"] = (value, max(0.05 * value, 0.002))
    return row


rows = {}
for scale, measure in measures.items():
    rows[scale] = {}
    for name in methods:
        values = over_scan(name, measure)
        rival = np.sort(values[0])[1] if len(scanned) > 1 else np.inf
        sharp = (
            not chaotic[name] and rival - values.min() > 0.001
        )  # else another machine may find its neighbour
        members = [row_of(one, looks[name]["label"], sharp) for one in values]
        rows[scale] |= over_restarts(remover(name, first), members)
        if has_restarts(remover(name, first)):
            rows[scale][f"{looks[name]['label']}: best n_s"] = best_of(values, name)
show_table(rows)

# %% tags=["hide-input"]
label = looks[method]["label"]
quote(
    scan_best_low=rows["low k"][f"{label}: best n_s"],
    scan_best_bump=rows.get("bump", {}).get(f"{label}: best n_s", "(not on these channels)"),
    scan_best_intermediate=rows[intermediate][f"{label}: best n_s"],
)

# %% [markdown]
# The paper finds that 5 is best at low $k_\nu$, 6 for the bump and 7 at intermediate $\ell$. Here the
# restarts of SDecGMCA give {glue:text}`scan_best_low`, {glue:text}`scan_best_bump` and
# {glue:text}`scan_best_intermediate`.
#
# ## Excess and loss
#
# The relative error is the sum of an *excess* ($S_i > S_i^0$: foreground residual) and a *loss*
# ($S_i < S_i^0$: HI and noise removed with the foreground); only their net effect shows at each $i$. Every
# source removes one of the $N_\nu$ degrees of freedom per pixel or $(\ell, m)$. It therefore removes a
# fraction of about $1/N_\nu$ of a signal that is uncorrelated between channels, and more of HI, whose
# channels are correlated at low $\ell$.
#
# For PCA the excess falls steeply and the loss grows slowly with $n_s$; in the right panel its $P/P_0$
# follows the dotted line and its $C/C_0$ falls faster. For SDecGMCA the excess of restarts that fail hides
# the loss, as only the net ratio is split. The right panel shows only numbers of sources with little excess;
# if there is none for SDecGMCA, it is not drawn.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-ns-scan-parts", "caption": "Left: total relative MSE split into excess and loss; values of zero or beyond the axis are not drawn. {glue:text}`scan_reading` ([readings](sdecgmca-reading)). Right: mean P/P0 and C/C0 for numbers of sources with little excess (median); dotted: 1 less 1/N_channels for each source."}}


def part(name, sign):
    """Mean squares of that part of both ratios minus 1 which has `sign`, summed, as `over_scan`."""
    return over_scan(
        name,
        lambda comparison: sum(
            np.mean(np.maximum(sign * (values - 1), 0) ** 2)
            for values in (comparison.angular_ratio[comparison.degrees <= LMAX], comparison.frequency_ratio)
        ),
    )


def mean_frequency(comparison):
    """Mean P/P0 at all k."""
    return comparison.frequency_ratio.mean()


def mean_angular(comparison):
    """Mean C/C0 at the l of the total."""
    return comparison.angular_ratio[comparison.degrees <= LMAX].mean()


def shown_where(values, condition):
    """The values, without numbers of sources that would only leave the axis; of restarts down to its end."""
    return curve(np.where(condition, np.maximum(values, 1e-5 if len(values) > 1 else 0), np.nan))


split, power = [], []
for name in methods:
    label, color, marker = looks[name]["label"], looks[name]["color"], "o" if name == methods[0] else "x"
    excess, loss = part(name, 1), part(name, -1)
    little = np.median(excess, axis=0) < 0.01
    for curves, values, what, condition, line in (
        (split, excess, "excess", np.median(excess, axis=0) > 0, "-"),
        (split, loss, "loss", np.median(loss, axis=0) > 0, "--"),
        (power, over_scan(name, mean_frequency), "P/P0", little, "-"),
        (power, over_scan(name, mean_angular), "C/C0", little, "--"),
    ):
        look = {"label": f"{label}: {what}", "color": color, "linestyle": line, "marker": marker}
        if condition.any():
            curves.append((scanned, shown_where(values, condition), look))
rule = 1 - np.array(scanned) / n_channels
power.append((scanned, rule, {"label": f"1 - $n_s$ / {n_channels}", "color": "black", "linestyle": ":"}))
panels = [
    axis | {"curves": split, "ylabel": "part of the relative MSE", "yscale": "log", "ylim": (1e-5, 1e2)},
    axis | {"curves": power, "ylabel": "mean ratio"},
]
study.stamped(plotting.lines(panels, size=(5, 3.9), legend_above=True), beam=selected, **stated)

# %% [markdown]
# The same split for SDecGMCA, with the mean Pearson $r$ ({doc}`14_diagnostics`):

# %% tags=["hide-input"]
rows = {}
for n, excesses, losses in zip(scanned, part(method, 1).T, part(method, -1).T, strict=True):
    if n in drawn:
        members = []
        for excess, loss, comparison, member in zip(
            excesses, losses, comparisons[method][n], study.members(remover(method, n)), strict=True
        ):
            frequency, angular = mean_frequency(comparison), mean_angular(comparison)
            members.append(
                {
                    "excess part": (excess, max(0.05 * excess, 0.001)),
                    "loss part": (loss, max(0.05 * loss, 0.001)),
                    "mean P/P0": (frequency, 0.01 * max(1, frequency)),
                    "mean C/C0": (angular, 0.01 * max(1, angular)),
                    "mean r": (study.assessed(selected, member).correlation.mean(), 0.005),
                }
            )
        rows[f"n_s = {n}"] = over_restarts(remover(method, n), members)
show_table(rows, columns=3)

# %% [markdown]
# Numbers of sources for which a run, or one of its restarts, did not converge:

# %% tags=["hide-input"]
unconverged = {}
for name in methods:
    those = [
        f"{n}"
        for n in scanned
        if not all(study.assessed(selected, one).converged for one in study.members(remover(name, n)))
    ]
    which = f"all {len(those)}" if len(those) == len(scanned) > 1 else f"n_s = {', '.join(those)}"
    said = [which if those else "none"]
    unconverged[looks[name]["label"]] = over_restarts(remover(name, first), said)
show(unconverged)

# %% [markdown]
# ## Conclusions
#
# - The best $n_s$ is defined by the truth, here on a single sky; {doc}`22_how_many` tests criteria without
#   it.
# - The minima of SDecGMCA's restarts, each the best of {glue:text}`scan_tried` runs, are at
#   {glue:text}`scan_best` sources. The minimum of PCA, at {glue:text}`scan_best_beside`, is
#   {glue:text}`scan_beside_over_best` times as large. With 5 sources the total MSE is
#   {glue:text}`scan_error_five` for SDecGMCA and {glue:text}`scan_error_five_beside` for PCA.
# - The sample of restarts is small. In {doc}`10_results`, which has more of them with 5 sources on this sky,
#   {glue:text}`10_results.ipynb::results_oscillating_failed:s` fail; the total MSE of all is
#   {glue:text}`13_dimmed_galaxy.ipynb::dimmed_error_sd:s`. The position of the minimum depends on which
#   restarts fail and on the sky: {doc}`15_claims` tests N1 and N4 on several skies with the real Galaxy.
# - For PCA without foreground residual each source removes about $1/N_\nu$ of the power, and more at low
#   $k_\nu$ and low $\ell$.
#
# ## Exercise
#
# Which of the three definitions weights $S = 10\,S^0$ more than $S = 0.1\,S^0$?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Relative: $(10 - 1)^2 = 81$ against $(0.1 - 1)^2 = 0.81$; absolute: the same ratio at each $i$; logarithmic:
# $\ln^2 10$ for both.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 11_ns_scan -p reading=code -p n_sources_max=10      # another reading of SDecGMCA
# himap run 11_ns_scan -p beside=beam_subspace                  # another method with the beam in its model
# himap run 11_ns_scan -p n_channels=250 -p n_sources_max=10    # twice the channels
# ```
