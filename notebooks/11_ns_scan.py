# ---
# jupyter:
#   himap:
#     figures: ["3", "4"]
#     reads:
#     - book/results/claims_laptop.json
#     - book/results/claims_paper_templates.json
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
# # How many sources?
#
# Every component method asks its user for one number before it starts: $n_s$, how many spectra it may take out of the maps. Too few leave
# foreground, too many take HI. {cite:t}`gkogkou2025` try 2 to 20 with SDecGMCA on the oscillating beam, compare both spectra with the truth, and
# choose 5. This notebook repeats the scan, beside it that of a method which does not know the beam, and asks how much of the answer
# depends on what is called an error.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, meerkat or a file of widths or b_l
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
method: str = "sdecgmca"  # a method with a number of sources: fastica, gmca, pca or sdecgmca
beside: str | None = "pca"  # another one to compare with, or null
n_sources_min: int = 2  # the scan begins here
n_sources_max: int = 20  # and ends here
shown: list | None = None  # numbers of sources of the spectra; null: 2, 3, 5, 6, 7, 10, 20 if in the scan
definition: str = "relative"  # of the error: relative, logarithmic or absolute
iteration: str = "stable"  # SDecGMCA: stable or published

# %%
import warnings
from dataclasses import fields

import numpy as np

from himap import removal
from himap.checks import whole_number
from himap.companion.stored import RESULTS, number_after
from himap.errors import InputError
from himap.figures import plotting, styles
from himap.figures.numbers import quote, show_table
from himap.instrument.beams import named
from himap.measures.diagnostics import BUMP, MSE_DEFINITIONS, mean_squared_error
from himap.paper.claims.base import LOW_K, angular_error, bump, frequency_error
from himap.paper.ledger import read_ledger
from himap.paper.methods import paper_beams, sdecgmca_for
from himap.paper.study import Study
from himap.removal.base import REGISTRY, SeparationWarning

beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    keep_cubes=False,
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
scanned = range(first, last + 1)
if shown is None:
    drawn = [n for n in (2, 3, 5, 6, 7, 10, 20) if n in scanned] or [first]
else:
    drawn = [whole_number("each number in shown", n, first, last) for n in shown]


def remover(name, n):
    """The method called `name` with n sources."""
    if name == "sdecgmca":
        return sdecgmca_for(selected, n_sources=n, iteration=iteration)
    return removal.create(name, n_sources=n)


removers = {selected: [remover(name, n) for name in methods for n in scanned]}
study.check(removers)
warnings.simplefilter("ignore", SeparationWarning)  # which runs did not settle is listed at the end

# %% [markdown]
# ## The scan
#
# Every run is one cleaning of the same maps, {doc}`with their peaks masked <03_peak_masking>`, and one pair of spectra. The runs know nothing of each
# other: `--jobs` says how many are made at a time, and one that was made before, here or in another notebook, is not made again.

# %%
study.prepare(removers)

# %%
comparisons = {name: {n: study.compared(selected, remover(name, n)) for n in scanned} for name in methods}

# %% [markdown]
# ## One number for two spectra
#
# The paper's Fig. 3 shows a *total MSE* over both spectra. How the mean squared error of a $C_\ell$ in mK$^2$ and that of a $P(k_\nu)$ in
# mK$^2$ MHz become one number it does not say. Each must lose its unit first. With $S$ the spectrum of what is left, $S^0$
# that of the truth, and $i$ running over the $\ell$ of the one or the $k_\nu$ of the other, there are three ways that come to mind:
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
# The total is that of $C_\ell$, averaged over channels, for $2 \le \ell \le \min(200, 2\,N_\mathrm{side})$, plus that of $P(k_\nu)$ at all $k_\nu > 0$.
# The first weighs all scales alike and an excess more than a loss, which cannot exceed 1. The second weighs a factor of two the same
# in both directions. The third hears mostly where the spectra are highest: low $\ell$ and low $k_\nu$. The parameter `definition` chooses; the default is
# the first, because the paper reads its spectra by their ratios.

# %%
LMAX = 200


def errors(comparison, definition):
    """The mean squared errors of C_l and of P(k) of one `Comparison`."""
    low = comparison.degrees <= LMAX
    angular = mean_squared_error(comparison.angular[low], comparison.true_angular[low], definition)
    return angular, mean_squared_error(comparison.frequency, comparison.true_frequency, definition)


def totals(name, definition):
    """Total error for every n_s of the scan."""
    return np.array(
        [comparison.total_error(definition, lmax=LMAX) for comparison in comparisons[name].values()]
    )


def best(values):
    """The n_s of the least value."""
    return scanned[int(np.argmin(values))]


looks = {name: styles.method_style(remover(name, first)) for name in methods}
ticks = scanned if len(scanned) <= 20 else range(first, last + 1, -(-len(scanned) // 20))
axis = {"xlabel": "number of sources $n_s$", "xticks": ticks, "xlim": (first - 0.5, last + 0.5)}


def scan_panel(definition):
    """Total error against n_s, and where it is least; the axis ends above its values at many sources."""
    curves, points = [], []
    for name in methods:
        values, style = totals(name, definition), looks[name]
        curves.append((scanned, values, style))
        mark = {"color": style["color"], "marker": "o" if name == method else "s", "markersize": 9}
        mark |= {"label": f"least at $n_s$ = {best(values)}", "markeredgecolor": "black"}
        points.append(([best(values)], [values.min()], mark))
    low, high = min(values.min() for _, values, _ in curves), max(values[-1] for _, values, _ in curves)
    return axis | {"curves": curves, "points": points, "yscale": "log", "ylim": (0.3 * low, 3 * high)}


whole = scan_panel(definition) | {"ylabel": f"total MSE, {definition}", "legend": {"loc": "upper right"}}
parts = np.array([errors(comparison, definition) for comparison in comparisons[method].values()]).T
for values, of, line in zip(parts, (r"$C_\ell$", r"$P(k_\nu)$"), ((0, (5, 1.5)), ":"), strict=True):
    look = {"color": looks[method]["color"], "linestyle": line, "linewidth": 1.1}
    whole["curves"].append((scanned, values, look | {"label": f"{looks[method]['label']}, {of} alone"}))


def bare(curves):
    """The same without labels, for a panel beside one with a legend."""
    return [(x, y, {key: value for key, value in style.items() if key != "label"}) for x, y, style in curves]


detail = whole | {"curves": bare(whole["curves"]), "points": bare(whole["points"]), "title": "near the least"}
detail["ylim"] = (0.7 * parts.min(), whole["ylim"][1])
whole = whole | {"ylim": None, "title": "all of it"}

# %% mystnb={"figure": {"name": "fig-ns-scan-mse", "caption": "Total MSE of both spectra against the number of sources (the paper's Fig. 3), and where it is least. The thin lines are what each spectrum adds to the thick one. Right: the same on an axis that ends above the values at the largest number of sources."}}
study.stamped(plotting.lines([whole, detail], size=(5, 3.9)), beam=selected, definition=definition)

# %% tags=["hide-input"]
of_method, of_beside = totals(method, definition), totals(methods[-1], definition)
least, at = of_method.min(), dict(zip(scanned, of_method, strict=True))
many = [error for n, error in at.items() if n >= 10] or [np.nan]
five = at.get(5, np.nan)
quote(
    scan_best=best(of_method),
    scan_best_beside=best(of_beside),
    scan_cliff=(at.get(2, np.nan) / least, 7e6),
    scan_five=(five / least, 0.2),
    scan_ten=(min(many) / least, 0.5),
    scan_ten_over_five=(min(many) / five, 0.2),
    scan_beside_over_best=(of_beside.min() / least, 0.3),
    scan_r_best=(study.assessed(selected, remover(method, best(of_method))).correlation.mean(), 0.005),
)

# %% [markdown]
# Both curves have the shape of the paper's figure: a cliff where foreground is left, a slope where HI is lost, and a sharp minimum between. But SDecGMCA has its
# minimum at {glue:text}`scan_best`, where the paper has 5. It is PCA, which does not know the beam, that needs more: {glue:text}`scan_best_beside`. The two other definitions
# find the same:

# %% mystnb={"figure": {"name": "fig-ns-scan-definitions", "caption": "Total MSE by the two definitions that the figure above does not use, near the least; curves are cut off at the top."}}
panels = [
    scan_panel(other) | {"ylabel": f"total MSE, {other}"} for other in MSE_DEFINITIONS if other != definition
]
study.stamped(plotting.lines(panels, size=(5, 3.6)), beam=selected)

# %% [markdown]
# The conclusion does not hang on the definition. What does is how the two methods compare at their best: by the absolute error PCA with many
# sources comes out better than SDecGMCA with as many, because it loses less at the lowest $\ell$.
#
# ## The spectra behind it

# %% mystnb={"figure": {"name": "fig-ns-scan-spectra", "caption": "Frequency (left) and angular (right) power spectra after SDecGMCA with several numbers of sources, and their ratios to the truth (the paper's Fig. 4). The grey band is 10 %; two sources lie above the lower panels."}}
lines = styles.sequence([f"$n_s$ = {n}" for n in drawn])
curves = [(look, comparisons[method][n]) for look, n in zip(lines, drawn, strict=True)]
study.both_figure(selected, curves, ratio_limits=(0, 1.4), method=method)

# %% [markdown]
# Two sources leave foreground on all scales. Three leave none that shows; from there on each source takes signal, first at low $k_\nu$ and low
# $\ell$, where HI is smooth enough in frequency to look like a foreground. The order of the curves is the same on all scales.
#
# ## Which number is best, and for what
#
# By each definition of the total, and by scale as in the paper's Sect. 4.3: the mean of $|P/P^0 - 1|$ at $k_\nu < 0.1$ MHz$^{-1}$, $|P/P^0 - 1|$ at the
# highest point of the bump near $k_\nu = 2\pi/20$ MHz, the mean of $|C/C^0 - 1|$ at $10 < \ell < 100$ (or $2\,N_\mathrm{side}$).

# %%
measures = {
    f"total, {name}": lambda comparison, name=name: comparison.total_error(name, lmax=LMAX)
    for name in MSE_DEFINITIONS
}
measures["low k"] = frequency_error(0, LOW_K)
if np.pi / study.survey.channel_width > BUMP[1]:
    measures["bump"] = lambda comparison: abs(bump(comparison) - 1)
intermediate = f"10 < l < {min(100, study.l_top)}"
measures[intermediate] = angular_error(10, 100)

rows = {}
for scale, measure in measures.items():
    rows[scale] = {}
    for name in methods:
        values = np.array([measure(comparison) for comparison in comparisons[name].values()])
        label = looks[name]["label"]
        rival = np.sort(values)[1] if len(values) > 1 else np.inf
        sharp = rival - values.min() > 0.001  # else another machine may find its neighbour
        rows[scale][f"{label}: best n_s"] = str(best(values)) if sharp else (best(values), 1)
        for n, column in ((best(values), "error there"), (5, "at n_s = 5")):
            if n in scanned:
                value = values[scanned.index(n)]
                rows[scale][f"{label}: {column}"] = (value, max(0.05 * value, 0.002))
show_table(rows)

# %% tags=["hide-input"]
label = looks[method]["label"]
of_bump = [measures["bump"](comparisons[method][n]) for n in scanned if "bump" in measures and 3 <= n <= 8]
quote(
    scan_best_low=rows["low k"][f"{label}: best n_s"],
    scan_best_intermediate=rows[intermediate][f"{label}: best n_s"],
    scan_bump=(100 * max(of_bump, default=np.nan), 0.2, "%"),
)

# %% [markdown]
# The paper finds 5 best at low $k_\nu$, 6 for the bump and 7 for intermediate $\ell$. Here it is {glue:text}`scan_best_low` at low $k_\nu$ and {glue:text}`scan_best_intermediate` for intermediate $\ell$. For the bump
# there is nothing to choose: its error is at most {glue:text}`scan_bump` from 3 to 8 sources, because SDecGMCA leaves no bump, and what changes is how much signal is lost there. A best number written with ± 1 is
# one that a neighbour nearly shares.
#
# ## What too few leave and too many take
#
# The relative error can be split by the sign of $S_i - S_i^0$: an *excess*, which is foreground, and a *loss*, which is HI and noise that was taken for
# foreground. (Where both happen at one $i$ only their difference shows.) Foreground goes with a cliff, because it has few spectra: SDecGMCA needs three of them, and PCA three more for
# what the beam makes of them. Signal goes with a slope that is the same for both methods, and for P/P0 hardly steeper than it must be: a
# source is one number for each direction of the sky or each $(\ell, m)$ where there were $N_\nu$, so that at least about $1/N_\nu$ of a signal without correlation goes with it. C/C0 falls faster, for HI
# at low $\ell$ correlates between channels.

# %% mystnb={"figure": {"name": "fig-ns-scan-parts", "caption": "Left: the total relative MSE as the sum of a part where the spectra are too high and one where they are too low; the losses of the two methods lie on each other, and the excess leaves the axis at both ends. Right: mean of P/P0 at all k and of C/C0 at the l of the total, for numbers of sources that leave no excess; the dotted line loses one part in the number of channels for each source. Parts that are zero are not drawn."}}


def part(name, sign):
    """Mean squares of that part of both ratios minus 1 which has `sign`, summed, for every n_s."""
    return [
        sum(
            np.mean(np.maximum(sign * (values - 1), 0) ** 2)
            for values in (comparison.angular_ratio[comparison.degrees <= LMAX], comparison.frequency_ratio)
        )
        for comparison in comparisons[name].values()
    ]


def shown_where(values, condition):
    """The values, without those that would only leave the axis."""
    return np.where(condition, values, np.nan)


split, power = [], []
for name in methods:
    label, color, marker = looks[name]["label"], looks[name]["color"], "o" if name == methods[0] else "x"
    excess, loss = np.array(part(name, 1)), np.array(part(name, -1))
    compared = comparisons[name].values()
    frequency = [comparison.frequency_ratio.mean() for comparison in compared]
    angular = [comparison.angular_ratio[comparison.degrees <= LMAX].mean() for comparison in compared]
    for curves, values, what, condition, line in (
        (split, excess, "excess", excess > 0, "-"),
        (split, loss, "loss", loss > 0, "--"),
        (power, frequency, "P/P0", excess < 0.01, "-"),
        (power, angular, "C/C0", excess < 0.01, "--"),
    ):
        look = {"label": f"{label}: {what}", "color": color, "linestyle": line, "marker": marker}
        curves.append((scanned, shown_where(values, condition), look))
rule = 1 - np.array(scanned) / n_channels
power.append((scanned, rule, {"label": f"1 - $n_s$ / {n_channels}", "color": "black", "linestyle": ":"}))
panels = [
    axis | {"curves": split, "ylabel": "part of the relative MSE", "yscale": "log", "ylim": (1e-5, 1e2)},
    axis | {"curves": power, "ylabel": "mean ratio", "legend": {"loc": "lower left"}},
]
study.stamped(plotting.lines(panels, size=(5, 3.6)), beam=selected)

# %% [markdown]
# In numbers, for the first method:

# %%
rows = {}
for n, excess, loss in zip(scanned, part(method, 1), part(method, -1), strict=True):
    if n in drawn:
        comparison = comparisons[method][n]
        frequency = comparison.frequency_ratio.mean()
        angular = comparison.angular_ratio[comparison.degrees <= LMAX].mean()
        rows[f"n_s = {n}"] = {
            "excess part": (excess, max(0.05 * excess, 0.001)),
            "loss part": (loss, max(0.05 * loss, 0.001)),
            "mean P/P0": (frequency, 0.01 * max(1, frequency)),
            "mean C/C0": (angular, 0.01 * max(1, angular)),
            "mean r": (study.assessed(selected, remover(method, n)).correlation.mean(), 0.005),
        }
show_table(rows)

# %% [markdown]
# Which runs say that they did not settle:

# %%
unsettled = [
    f"{styles.method_style(tried)['label']}, {tried.n_sources}"
    for tried in removers[selected]
    if not study.assessed(selected, tried).converged
]
print("; ".join(unsettled) or "none")

# %% tags=["hide-input"]
laptop, paper = (
    {entry.claim["id"]: entry for entry in read_ledger(RESULTS / f"claims_{size}.json")[0]}
    for size in ("laptop", "paper_templates")
)
of_five = [number_after("at n_s = 5", size["N1"]) for size in (laptop, paper)]
of_least = [number_after("The least total MSE,", size["N1"]) for size in (laptop, paper)]
quote(
    scan_best_laptop=int(number_after("is at n_s =", laptop["N1"])),
    scan_five_laptop=(of_five[0] / of_least[0], 0.2),
    scan_five_paper=(of_five[1] / of_least[1], 0.2),
)

# %% [markdown]
# ## Why not 5
#
# - **It is not the definition** of the error, as the figures show, **nor the Galaxy**: with the real templates (nside 64) the minimum is at {glue:text}`scan_best_laptop` at `laptop` and at
#   {glue:text}`18_paper_size.ipynb::paper_size_sd_best:s` at the paper's size, and at 5 the relative error is {glue:text}`scan_five_laptop` and {glue:text}`scan_five_paper` times as much ({doc}`15_claims`,
#   {doc}`18_paper_size`). In the figure above it is {glue:text}`scan_five` times.
# - **The sky needs three**: that many spectra hold its foregrounds to below HI, and SDecGMCA has the beam in its model, so that the beam adds none.
#   PCA must describe what the beam does with spectra of its own, and pays for the cliff at {glue:text}`scan_best_beside` with the loss of {glue:text}`scan_best_beside`.
# - **Nor is it the number of channels.** The paper has 500, so that a source costs a quarter as much of a signal without correlation as it does with 125, and more sources are cheaper.
#   The run at the paper's size has these channels, and its minimum all the same.
# - **The iteration** can be changed (`iteration=published`). It is sensitive to small changes, so that one run of it says little: {doc}`09_sdecgmca`.
#
# What the paper says of the method holds: it needs a choice, the cliff is far worse than the slope, and the truth is needed to find the
# minimum. A user without it does well to err on the side of one source too many.
#
# ## What to take away
#
# - Total MSE of SDecGMCA is least at {glue:text}`scan_best` sources, not at 5 as in the paper, by all three definitions, and for each range of scales where there is something to choose.
#   At 2 it is {glue:text}`scan_cliff` times larger, from 10 on at least {glue:text}`scan_ten` times ({glue:text}`scan_ten_over_five` times the error at 5), as the paper says; but at
#   {glue:text}`scan_best` it is smaller than at 5.
# - PCA needs {glue:text}`scan_best_beside`. That is what not knowing the beam costs: its relative error there is {glue:text}`scan_beside_over_best` times that of SDecGMCA with {glue:text}`scan_best`.
# - Beyond the cliff the loss is a matter of counting: one part in the number of channels for each source, more at low $k_\nu$ and low $\ell$.
#
# Three commands worth trying:
#
# ```sh
# himap run 11_ns_scan -p method=gmca -p n_sources_max=10       # another method that does not know the beam
# himap run 11_ns_scan -p beam=degraded -p n_sources_max=10     # one resolution: does PCA still need more?
# himap run 11_ns_scan -p n_channels=250 -p n_sources_max=10    # twice the channels, half the price of a source
# ```
