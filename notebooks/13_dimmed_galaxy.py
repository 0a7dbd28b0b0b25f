# ---
# jupyter:
#   himap:
#     figures: ["7"]
#     section: "5.2"
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
# # A dimmed Galaxy
#
# > - **Read first**: {doc}`10_results`, {doc}`12_post_masking`.
# > - **Tests** (verdicts of {doc}`15_claims`): {claim}`G1`, {claim}`G2`, {claim}`G3`, {claim}`G4`, {claim}`V5`.
# > - **Time and memory**: {cost}`13_dimmed_galaxy`.
#
# SDecGMCA works in harmonic space and cannot mask the Galactic plane before the separation.
# {cite:t}`gkogkou2025` emulate such a mask: they multiply the foregrounds of every channel, before beam and
# noise, by a weight that depends on latitude,
#
# ```{math}
# :label: eq-dimming
# w(b) = 1 - (1 - w_0)\, \frac{g(b) - g(b_\mathrm{edge})}{1 - g(b_\mathrm{edge})} , \qquad
# g(b) = \exp\!\left( -\frac{b^2}{2 \sigma^2} \right) ,
# ```
#
# for $|b| < b_\mathrm{edge}$, and 1 beyond. The paper gives $w_0 = 0.1$, $b_\mathrm{edge} = 15°$ and a
# Gaussian shape. Its width is not given; here it is $\sigma = b_\mathrm{edge} / 3$, and the subtractions make
# both ends exact. HI and noise are unchanged. The paper finds that all methods improve, especially PCA,
# FastICA and SDecGMCA, and that the peak at the ripple persists for PCA and FastICA but is below 2 % for
# SDecGMCA.
#
# Dimming shows which part of the errors in {doc}`10_results` is due to the brightest foreground. Here it is
# applied to the oscillating beam and the synthetic Galaxy, with several restarts of SDecGMCA
# ({doc}`27_restarts`). {glue:text}`dimmed_reading` ([readings](sdecgmca-reading)).

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, meerkat or a file of widths or b_l
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 5  # components that PCA, FastICA, GMCA and SDecGMCA remove
reading: str = "default"  # of SDecGMCA: default, letter, code, code-rounding, follow-up, instrument-noise
n_restarts: int = 4  # starts of SDecGMCA, which is chaotic: all of them are shown
plane_weight: float = 0.1  # what is left of the foregrounds at b = 0
plane_edge: float = 15.0  # latitude beyond which nothing is dimmed, deg

# %% tags=["hide-input"]
import warnings
from itertools import product

import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import of_restarts, quote, show_table
from himap.maps import sphere
from himap.measures.diagnostics import inside
from himap.paper import captions, cleaned, pipeline
from himap.paper.evidence import dimmed_spectra
from himap.paper.leakage import error_parts
from himap.paper.methods import beam_called, methods_for
from himap.paper.study import Study, over_restarts
from himap.paper.study_figures import both_figure, ensemble_style, median_of
from himap.removal.base import SeparationWarning
from himap.removal.pca import PCA
from himap.sky.emission import emission_maps
from himap.sky.galaxy import Dimming

common = {
    "preset": preset,
    "overrides": survey,
    "galaxy": galaxy,
    "template_dir": template_dir,
    "small_scales": small_scales,
    "n_restarts": n_restarts,
}
dimming = Dimming(weight=plane_weight, edge=plane_edge)
selected = beam_called(beam, ripple=ripple)
full, dimmed = Study(**common), Study(**common, dimming=dimming)
removers = methods_for(selected, n_sources, reading=reading)
full.check({selected: removers})
warnings.simplefilter("ignore", SeparationWarning)  # which methods converge is listed in 10_results
quote(dimmed_reading=captions.in_short(removers[3], full.survey.nside, n_restarts))

# %%
component = [remover for remover in removers if hasattr(remover, "n_sources")]
for study in (full, dimmed):
    study.prepare({selected: removers})
    study.prepare({selected: component}, error_parts)

# %% [markdown]
# ## The weight
#
# The weight changes smoothly, and only within the edges.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-dimmed-weight", "caption": "Weight of the foregrounds against Galactic latitude; it reaches 1 at the dashed lines."}}
rings, first = np.unique(sphere.pixel_latitude(256), return_index=True)
weight = dimming.weights(256)[first]
near = np.abs(rings) < min(2 * plane_edge, 90)
edge = {"color": "0.4", "linestyle": "--", "linewidth": 0.8}
panel = {
    "curves": [
        (rings[near], weight[near], {"color": styles.BLUE, "label": "_weight"}),
        ([-plane_edge, -plane_edge], [0, 1], edge | {"label": "_edge"}),
        ([plane_edge, plane_edge], [0, 1], edge | {"label": "_edge"}),
    ],
    "xlabel": "Galactic latitude b [°]",
    "ylabel": "weight of the foregrounds",
    "ylim": (0, 1.05),
}
full.stamped(
    plotting.lines([panel], columns=1, size=(6.4, 3)), plane_weight=plane_weight, plane_edge=plane_edge
)

# %% [markdown]
# The ridge along the plane disappears; at the lowest weight the plane is fainter than the sky next to it.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-dimmed-maps", "caption": "Foregrounds of a channel in the middle of the band before the beam, full and dimmed, same logarithmic colours."}}
channel = full.survey.n_channels // 2
components = pipeline.components_of_sky(full.survey.sky, full.milky_way)
(foreground,) = emission_maps(components, full.survey.freqs[[channel]])
freq = f"{full.survey.freqs[channel]:.0f} MHz"
maps = {
    f"foregrounds, {freq}": foreground,
    f"dimmed, {freq}": foreground * dimming.weights(full.survey.nside),
}
span = tuple(np.percentile(foreground, (0.5, 99.5)))
full.stamped(plotting.sky_maps(maps, log=True, span=span), plane_weight=plane_weight, plane_edge=plane_edge)

# %% [markdown]
# ## Spectra
#
# With the dimmed Galaxy PCA, FastICA, GMCA and restarts of SDecGMCA that do not fail are within the grey band
# at most $\ell$; GMCA has an excess at the lowest $\ell$. PCA, FastICA and GMCA have a peak near
# $k_\nu = 0.31$ MHz$^{-1}$, and SDecGMCA can have it. The parametric fit exceeds the truth by an order of
# magnitude or more on most scales. The polynomial fit exceeds it by less at most $k_\nu$, and by most near
# $k_\nu = 0.04$ MHz$^{-1}$, at the ripple and at high $\ell$; at the lowest $k_\nu$ and at $\ell$ of about 10
# it is below the truth.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-dimmed-spectra", "caption": "Frequency (left) and angular (right) power spectrum recovered by six methods from the dimmed sky, and the ratio to the truth (the paper's Fig. 7). Grey band: 10 %; ratios are linear near 1, logarithmic beyond. {glue:text}`dimmed_reading` ([readings](sdecgmca-reading)). PCA and FastICA coincide."}}
ensembles = {
    remover: {name: study.ensemble(selected, remover) for name, study in (("full", full), ("dimmed", dimmed))}
    for remover in removers
}
curves = [
    (ensemble_style(styles.method_style(remover), members["dimmed"]), members["dimmed"])
    for remover, members in ensembles.items()
]
look = {"plane_weight": plane_weight, "plane_edge": plane_edge, "n_sources": n_sources, "reading": reading}
both_figure(dimmed, selected, curves, **look)

# %% [markdown]
# An excess that falls towards 1 compared with the full Galaxy was due to the plane; a change in a ratio below
# 1 is a change in signal loss. Another sky is also another restart of SDecGMCA: if the bands overlap, no
# change is established.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-dimmed-change", "caption": "P/P0 (left) and C/C0 (right) with the full (dotted) and the dimmed Galaxy (solid), for PCA, GMCA and SDecGMCA, on logarithmic axes that cut off larger ratios. {glue:text}`dimmed_reading` ([readings](sdecgmca-reading)); with the full Galaxy only the median is drawn."}}
panels = []
for remover in (removers[0], removers[2], removers[3]):
    method = styles.method_style(remover)
    looks = {"full": {"color": "black", "linestyle": ":"}, "dimmed": {"color": method["color"]}}
    axes = {
        "frequency": (styles.AXES["frequency"]["xlabel"], r"$P / P_0$"),
        "angular": (styles.AXES["angular"]["xlabel"], r"$C / C_0$"),
    }
    for kind, (xlabel, ylabel) in axes.items():
        panels.append(
            {
                "curves": [
                    (
                        members[0].k if kind == "frequency" else members[0].degrees,
                        median_of(members).ratios[kind]
                        if name == "full"  # two bands would hide each other
                        else np.squeeze([one.ratios[kind] for one in members]),
                        ensemble_style(looks[name] | {"label": name}, members),
                    )
                    for name, members in ensembles[remover].items()
                ],
                "title": method["label"],
                "xlabel": xlabel,
                "ylabel": ylabel,
                "xscale": "log",
                "yscale": "log",
                "ylim": (0.05, 20),
            }
        )
dimmed.stamped(plotting.lines(panels, size=(4.6, 2.6)), beam=selected, **look)

# %% [markdown]
# The table lists the total error of both spectra (mean of $(C/C_0 - 1)^2$ up to $\ell = 200$ plus that of
# $P/P_0$), the highest $P/P_0$ at $0.25 < k_\nu < 0.38$ MHz$^{-1}$, and the share of multipoles up to 200 (or
# $2\,N_\mathrm{side}$) with $C_\ell$ within 10 %; for SDecGMCA medians of the restarts.


# %% tags=["hide-input"]
def row_of(full, dimmed):
    """Numbers of two `Comparison`."""
    row = {}
    for name, comparison in (("full", full), ("dimmed", dimmed)):
        total = comparison.total_error()
        peak = inside(comparison.k, comparison.frequency_ratio, 0.25, 0.38).max()
        share = np.mean(np.abs(comparison.angular_ratio[comparison.degrees <= 200] - 1) < 0.1)
        row[f"error, {name}"] = (total, 0.02 * max(0.1, total))
        row[f"peak, {name}"] = (peak, 0.02 * max(1, peak))
        row[f"within 10 %, {name} [%]"] = (100 * share, 1)
    return dict(sorted(row.items(), key=lambda item: item[0].partition(",")[0]))


rows = {  # of each member
    styles.method_style(remover)["label"]: [
        row_of(*pair) for pair in zip(members["full"], members["dimmed"], strict=True)
    ]
    for remover, members in ensembles.items()
}


table = {
    label: over_restarts(remover, members)
    for remover, (label, members) in zip(removers, rows.items(), strict=True)
}
show_table(table, columns=3)


# %% tags=["hide-input"]
def gain_of(label):
    """By which factor dimming reduces the total error of a method without restarts."""
    (row,) = rows[label]
    gain = row["error, full"][0] / row["error, dimmed"][0]
    return gain, 0.1 * gain


def at_ripple(comparison):
    """P/P0 at the wavenumber of the ripple."""
    return comparison.frequency_ratio[np.abs(comparison.k - 2 * np.pi / 20).argmin()]


within = {
    when: {
        remover.name: over_restarts(
            remover,
            [(*row[f"within 10 %, {when} [%]"], "%") for row in rows[styles.method_style(remover)["label"]]],
        )
        for remover in removers
    }
    for when in ("full", "dimmed")
}
of_sd = ensembles[removers[3]]["dimmed"]
pca, sd = table["PCA"], table["SDecGMCA"]
quote(
    dimmed_gain_pca=gain_of("PCA"),
    dimmed_gain_gmca=gain_of("GMCA"),
    dimmed_gain_pol=gain_of("polynomial"),
    dimmed_gain_par=gain_of("parametric"),
    dimmed_error_sd=sd["error, full"],
    dimmed_error_sd_dimmed=sd["error, dimmed"],
    dimmed_peak_pca=(pca["peak, dimmed"][0], 0.03),
    dimmed_peak_sd=sd["peak, dimmed"],
    dimmed_ripple_sd=of_restarts([(at_ripple(one), 0.02) for one in of_sd]),
    dimmed_within_sd=within["dimmed"]["sdecgmca"],
    dimmed_within_sd_full=within["full"]["sdecgmca"],
    dimmed_within_pca=within["dimmed"]["pca"],
    dimmed_within_pca_full=within["full"]["pca"],
)

# %% [markdown]
# ## Foreground residual and signal loss
#
# Dimming can reduce only the foreground part of the error ({eq}`eq-post-split`).


# %% tags=["hide-input"]
def parts_of(remover):
    """Rms of both parts of the error of one member, with the full Galaxy and the dimmed one."""
    return {
        f"{what}, {name} [mK]": (
            np.sqrt(error_parts(study.case(selected), remover)[what]["all"].mean()),
            0.0005,
        )
        for what in ("foreground residual", "signal loss")
        for name, study in (("full", full), ("dimmed", dimmed))
    }


parts = {remover: [parts_of(member) for member in full.members(remover)] for remover in component}
lost = {
    styles.method_style(remover)["label"]: over_restarts(remover, rows) for remover, rows in parts.items()
}
show_table(lost, columns=3)

# %% tags=["hide-input"]
FULL = "foreground residual, full [mK]"


def share(over, under, pairs_of):
    """Of two parts, an entry for each method, over the pairs of its runs."""
    return {
        remover.name: over_restarts(
            remover, [(one[over][0] / other[under][0], 0.1) for one, other in pairs_of(rows, rows)]
        )
        for remover, rows in parts.items()
    }


less = share(FULL, "foreground residual, dimmed [mK]", product)
lost_over_left = share("signal loss, full [mK]", FULL, zip)
quote(
    dimmed_less_pca=less["pca"],
    dimmed_less_gmca=less["gmca"],
    dimmed_less_sd=less["sdecgmca"],
    dimmed_lost_pca=lost_over_left["pca"],
    dimmed_lost_gmca=lost_over_left["gmca"],
    dimmed_lost_sd=lost_over_left["sdecgmca"],
)

# %% [markdown]
# | | foreground residual, full/dimmed | signal loss/foreground residual, full |
# |---|---|---|
# | PCA, FastICA | {glue:text}`dimmed_less_pca` | {glue:text}`dimmed_lost_pca` |
# | GMCA | {glue:text}`dimmed_less_gmca` | {glue:text}`dimmed_lost_gmca` |
# | SDecGMCA | {glue:text}`dimmed_less_sd` | {glue:text}`dimmed_lost_sd` |
#
# The larger the second ratio, the less dimming can improve.
#
# ## Strength and width
#
# The paper has a single strength and width. For PCA, the left panel varies the weight in the plane and the
# right panel the edge. The peak shrinks with a smaller weight and a wider edge, but part of it remains. The
# excess at low $k_\nu$ shrinks only up to some edge.


# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-dimmed-scan", "caption": "P/P0 of PCA for several weights in the plane, with `plane_edge` as above (left), and for several latitudes of the edge, with `plane_weight` as above (right)."}}
def ratio_of(other):
    """P/P0 of PCA on the same HI and noise with foregrounds dimmed in another way."""
    if other in known:
        return known[other]
    return (dimmed_spectra(case, pca, other).frequency.power / full.truth(selected).frequency.power)[1:]


case, pca = full.case(selected), PCA(n_sources=n_sources)
k = full.truth(selected).frequency.k[1:]
known = {  # from above
    Dimming(weight=1, edge=plane_edge): full.compared(selected, removers[0]).frequency_ratio,
    dimming: dimmed.compared(selected, removers[0]).frequency_ratio,
}
settings = {
    "weight in the plane": {
        f"weight {value:g}": {"weight": value} for value in sorted({0.01, plane_weight, 0.3, 1})
    },
    "latitude of the edge": {f"edge {value:g}°": {"edge": value} for value in sorted({5, plane_edge, 30})},
}
dimmings = {
    name: Dimming(**{"weight": plane_weight, "edge": plane_edge} | changed)
    for choices in settings.values()
    for name, changed in choices.items()
}
cleaned.make([(dimmed_spectra, (case, pca, one)) for one in dimmings.values() if one not in known])
looks = [
    (styles.BLUE, "-"),
    (styles.ORANGE, "--"),
    (styles.GREEN, "-."),
    (styles.PURPLE, ":"),
    (styles.SKY_BLUE, (0, (8, 3))),
]
table, panels = {}, []
for title, choices in settings.items():
    curves = []
    for name, (colour, line) in zip(choices, looks, strict=False):
        ratio = ratio_of(dimmings[name])
        curves.append((k, ratio, {"label": name, "color": colour, "linestyle": line}))
        low, peak = inside(k, np.abs(ratio - 1), 0, 0.1).mean(), inside(k, ratio, 0.25, 0.38).max()
        table[name] = {
            "mean |P/P0 - 1|, k < 0.1": (low, 0.02 * max(1, low)),
            "highest P/P0 near k = 0.31": (peak, 0.02 * max(1, peak)),
        }
    axes = {"xlabel": styles.AXES["frequency"]["xlabel"], "ylabel": r"$P / P_0$", "ylim": (0.1, 10)}
    panels.append({"curves": curves, "title": title, "xscale": "log", "yscale": "log"} | axes)
full.stamped(plotting.lines(panels), beam=selected, method="pca", n_sources=n_sources)

# %% tags=["hide-input"]
show_table(table)

# %% tags=["hide-input"]
faintest = min(settings["weight in the plane"])
quote(
    dimmed_peak_faintest=(table[faintest]["highest P/P0 near k = 0.31"][0], 0.03),
    dimmed_peak_widest=(table["edge 30°"]["highest P/P0 near k = 0.31"][0], 0.03),
)

# %% [markdown]
# The peak of PCA is {glue:text}`dimmed_peak_widest` times the truth with an edge at 30°, and
# {glue:text}`dimmed_peak_faintest` times the truth with the smallest weight. The remaining peak is due to the
# remaining foreground, within the edges and beyond.

# %% [markdown]
# ## Conclusions
#
# - **Improvement** (G1): the total error decreases by factors of {glue:text}`dimmed_gain_pca` for PCA and
#   FastICA, {glue:text}`dimmed_gain_gmca` for GMCA, {glue:text}`dimmed_gain_pol` for the polynomial and
#   {glue:text}`dimmed_gain_par` for the parametric fit. For restarts of SDecGMCA it is
#   {glue:text}`dimmed_error_sd` with the full and {glue:text}`dimmed_error_sd_dimmed` with the dimmed Galaxy;
#   they can fail with either, and if the ranges overlap no change is established.
# - **The peak** (G2): the maximum of $P/P_0$ at $0.25 < k_\nu < 0.38$ MHz$^{-1}$ is
#   {glue:text}`dimmed_peak_pca` for PCA and FastICA and {glue:text}`dimmed_peak_sd` for SDecGMCA, whose value
#   at the wavenumber of the ripple itself is {glue:text}`dimmed_ripple_sd`.
# - **The range of multipoles** (G3, G4): the share within 10 % changes from
#   {glue:text}`dimmed_within_pca_full` to {glue:text}`dimmed_within_pca` for PCA and FastICA, and from
#   {glue:text}`dimmed_within_sd_full` to {glue:text}`dimmed_within_sd` for SDecGMCA. In the paper it grows
#   for PCA, FastICA and SDecGMCA (Sect. 5.2), especially for SDecGMCA (Sect. 6).
#
# ## Exercise
#
# Dim the plane to a hundredth. Which methods improve further, and does the peak of PCA vanish?
#
# ```sh
# himap run 13_dimmed_galaxy -p plane_weight=0.01
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Of the component methods GMCA improves most. The fits improve by larger factors, but their errors remain far
# above all others. The peak of PCA shrinks but remains. SDecGMCA improves if its restarts have foreground
# residual.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 13_dimmed_galaxy -p plane_edge=30                  # dimmed over half of the sky
# himap run 13_dimmed_galaxy -p reading=code                   # another reading of SDecGMCA
# ```
