# ---
# jupyter:
#   himap:
#     figures: []
#     section: ''
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
# # Masks within the separation
#
# > - **Read first**: {doc}`12_post_masking`, {doc}`13_dimmed_galaxy`.
# > - **Time and memory**: {cost}`24_masks`.
#
# Foregrounds are brightest in the Galactic plane. The paper masks *after* the separation
# ({doc}`12_post_masking`), tests a dimmer plane ({doc}`13_dimmed_galaxy`), and names masks within SDecGMCA as
# future work.
#
# The two fits clean each line of sight separately, so a mask changes nothing. PCA computes its components
# from the pixels that are kept. Beam-aware methods transform maps, and should solve, on the kept pixels $p$,
#
# ```{math}
# \min_{s} \sum_\nu \sum_{p\ \mathrm{kept}} \Big( x_\nu(p) - \sum_{\ell m} Y_{\ell m}(p)\, H_{\nu\ell}\, (A s)_{\nu \ell m} \Big)^2
# ```
#
# with sources that are free elsewhere. Masked pixels do not enter the sum: filling them with the model
# $H A s$ adds nothing to it. The few bright maps are therefore inpainted smoothly across the mask, and the
# method works on the full sky. Sources within two beam widths of the edge, where the inpainting is uncertain,
# have low weight in the fit of $A$.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, rippled, meerkat, meerkat_lobes or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
methods: list = [
    ["beam_subspace", 3],
    ["beam_subspace", 5],
    ["pca", 5],
]  # pairs of a name and a number of sources
reading: str = "default"  # of SDecGMCA: default, letter, code, code-rounding, follow-up, instrument-noise
latitude: float = 10.0  # least |b| that is kept, deg
cap: float = 53.13  # latitude at which a survey of the north ends, deg; 53.13 is a tenth of the sky
margin: float = 4.0  # how far inside of an edge spectra begin, deg

# %% tags=["hide-input"]
import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show_table
from himap.measures.diagnostics import BUMP, inside
from himap.paper.grid import cases_and_methods
from himap.paper.masked import WAYS, Region, by_depth, compared
from himap.paper.study import Study

# %% tags=["hide-input"]
(case,), removers = cases_and_methods(
    preset=preset,
    survey=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    beam=beam,
    ripple=ripple,
    methods=methods,
    reading=reading,
    n_realisations=1,
)
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)
k = 2 * np.pi * np.fft.rfftfreq(case.survey.n_channels, case.survey.channel_width)
for low, high in ((0.03, 0.1), BUMP):
    inside(k, k, low, high)  # refuses, before the separation, a band without what the tables show
plane, north = Region(latitude=latitude), Region(latitude=cap, north=True)
names = {one: styles.numbered(one.name, getattr(one, "n_sources", 0)) for one in removers}

# %% [markdown]
# ## Without the Galactic plane
#
# Four cases are compared on the same pixels, further from the plane than `latitude` plus `margin`: no mask;
# lines of sight with large errors masked afterwards (with the truth); a sky with a dimmed plane; and the
# plane masked within the separation (*inside*).

# %%
found = {(one, way): compared(case, one, plane, way, margin) for one in removers for way in WAYS}

# %% tags=["hide-input"]
looks = dict(
    zip(
        WAYS,
        ((styles.BLUE, "-"), (styles.ORANGE, ":"), (styles.GREEN, "-."), (styles.VERMILION, "--")),
        strict=True,
    )
)


def ratios(results, title):
    """Panels of C/C0 and P/P0, of {way: Comparison}."""
    curves = {"angular": [], "frequency": []}
    for way, one in results.items():
        colour, dashes = looks[way]
        style = {"color": colour, "linestyle": dashes, "label": way}
        curves["angular"].append((one.degrees, one.angular_ratio, style))
        curves["frequency"].append((one.k, one.frequency_ratio, style))
    return [
        {
            "curves": several,
            "title": title,
            "xscale": "log",
            "ylim": (0.6, 1.4),
            "xlabel": styles.AXES[kind]["xlabel"],
            "ylabel": styles.AXES[kind]["ratio_label"],
        }
        for kind, several in curves.items()
    ]


panels = [panel for one in removers for panel in ratios({way: found[one, way] for way in WAYS}, names[one])]

# %% [markdown]
# Where the four curves agree, the mask does not matter. Where *inside* rises above 1, as for the beam-aware
# method with the fewest sources, there is foreground residual from the edge. Where it is closer to 1 from
# below, the signal loss is smaller.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-masks-plane", "caption": "Power of the residual over that of the truth away from the Galactic plane, for each method (rows) and way: angular (left) and frequency (right) power spectrum. Deviations of more than 40 % are not shown."}}
study.stamped(plotting.lines(panels), beam=case.beam, latitude=latitude, margin=margin)


# %% tags=["hide-input"]
def means(one):
    """Means of both ratios in bands."""
    low, high = (one.degrees >= 10) & (one.degrees < 40), (one.degrees >= 40) & (one.degrees < 100)
    slow, fast = (one.k > 0.03) & (one.k <= 0.1), one.k > 0.1
    values = {
        "l 10-39": one.angular_ratio[low].mean(),
        "l 40-99": one.angular_ratio[high].mean(),
        "k 0.03-0.1": one.frequency_ratio[slow].mean(),
        "k > 0.1": one.frequency_ratio[fast].mean(),
    }
    return {name: (float(value), 0.02 * max(1, abs(float(value)))) for name, value in values.items()}


show_table({f"{names[one]}, {way}": means(result) for (one, way), result in found.items()})

# %% [markdown]
# ## The effect of the edge

# %% tags=["hide-input"]
edges = np.array([0, 1, 2, 4, 6, 8, 12, 16, 24])
depth = plane.depth(case.survey.nside)
curves = []
for n, one in enumerate(removers):
    for way, dashes in (("no mask", "-"), ("inside", "--")):
        wrong = by_depth(case, one, plane, way, edges)
        style = {
            "color": styles.COLOURS[n % len(styles.COLOURS)],
            "linestyle": dashes,
            "marker": "o",
            "markersize": 3,
        }
        curves.append(((edges[:-1] + edges[1:]) / 2, wrong, style | {"label": f"{names[one]}, {way}"}))
curves.append(((margin, margin), (1e-3, 1), {"color": "0.7", "linewidth": 0.8}))
panel = {
    "curves": curves,
    "yscale": "log",
    "xlabel": "distance from the edge [deg]",
    "ylabel": "rms error [mK]",
}

# %% [markdown]
# Near the edge the error of BeamSubspace with the plane masked rises steeply. Further from the edge, with
# five sources it is below the error without a mask; with three it remains above it at all distances. PCA has
# a smaller error with the plane masked at every distance.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-masks-depth", "caption": "Rms error of the cleaned maps by the distance from the edge of the mask, with the plane masked within the separation (dashed) and without a mask (solid). Grey line: margin."}}
study.stamped(plotting.lines([panel], columns=1, size=(6.4, 4)), beam=case.beam, latitude=latitude)

# %% [markdown]
# (masks-survey)=
# ## A tenth of the sky
#
# A survey of the northern cap, with no data outside, is compared with the same pixels of a survey of the full
# sky (*no mask*).

# %%
survey_of = {
    (one, way): compared(case, one, north, way, margin) for one in removers for way in ("no mask", "inside")
}

# %% [markdown]
# For PCA the dashed curve (this tenth alone) is closer to 1 in $P/P_0$ except at the smallest $k_\nu$,
# because this survey excludes the plane, which requires components. For BeamSubspace the solid curve (full
# sky) is closer at nearly all $k_\nu$ with three sources, but only at the smallest $k_\nu$ and at the ripple
# with five.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-masks-survey", "caption": "Power of the residual over that of the truth within a tenth of the sky, for each method (rows), separated on the full sky and on that tenth alone. Deviations of more than 40 % are not shown."}}
panels = [
    panel
    for one in removers
    for panel in ratios({way: survey_of[one, way] for way in ("no mask", "inside")}, names[one])
]
study.stamped(plotting.lines(panels), beam=case.beam, cap=cap, margin=margin)

# %% tags=["hide-input"]
rows = {}
for (one, way), result in survey_of.items():
    top = inside(result.k, result.frequency_ratio, *BUMP).max()
    rows[f"{names[one]}, {way}"] = means(result) | {"highest near k = 0.31": (top, 0.05 * top)}
show_table(rows)


# %% tags=["hide-input"]
def off(result):
    """How far the worst band is from 1, %."""
    worst = 100 * max(abs(value - 1) for value, _ in means(result).values())
    return (worst, max(1, 0.2 * worst), "%")


first, last = removers[0], removers[-1]
quote(
    masks_first=names[first],
    masks_last=names[last],
    masks_none=off(found[first, "no mask"]),
    masks_post=off(found[first, "post-masked"]),
    masks_dimmed=off(found[first, "dimmed"]),
    masks_inside=off(found[first, "inside"]),
    masks_last_none=off(found[last, "no mask"]),
    masks_last_post=off(found[last, "post-masked"]),
    masks_last_dimmed=off(found[last, "dimmed"]),
    masks_last_inside=off(found[last, "inside"]),
    masks_survey=off(survey_of[first, "inside"]),
    masks_survey_last=off(survey_of[last, "inside"]),
)

# %% [markdown]
# ## What follows
#
# Deviation from 1 in the worst band of the tables, on this sky:
#
# | | no mask | post-masked | dimmed | inside | a tenth of the sky |
# |---|---|---|---|---|---|
# | {glue:text}`masks_first` | {glue:text}`masks_none` | {glue:text}`masks_post` | {glue:text}`masks_dimmed` | {glue:text}`masks_inside` | {glue:text}`masks_survey` |
# | {glue:text}`masks_last` | {glue:text}`masks_last_none` | {glue:text}`masks_last_post` | {glue:text}`masks_last_dimmed` | {glue:text}`masks_last_inside` | {glue:text}`masks_survey_last` |
#
# - **BeamSubspace needs no mask here**: its model describes the plane too. It is equally accurate without a
#   mask, masked afterwards and with a dimmed plane. SDecGMCA was not tested. With three sources masking
#   within the separation adds foreground residual from the edge, at small $k_\nu$ and at the ripple; with
#   five it lowers the error beyond the margin.
# - **A mask within the separation helps PCA**, with the five components tried: the plane needs some that the
#   rest of the sky does not. On these pixels, beyond the plane and its margin, a further mask after the
#   separation changes little; over the full sky it excludes the pixels with the largest errors
#   ({doc}`12_post_masking`).
# - **The edge requires a margin**: within about two beam widths of it the error of BeamSubspace rises
#   steeply. With three sources it exceeds that without a mask at all distances shown.
# - **All methods can clean part of the sky.** In the tenth of the sky PCA, which is not affected by an edge,
#   has less foreground residual than BeamSubspace with three sources, although it loses more signal; the
#   table lists both.
#
# ```sh
# himap clean cube.h5 --method pca -p n_sources=5 --mask mask.fits -o cleaned.h5
# ```
#
# ## Exercises
#
# **1.** What share of the sky is beyond $|b| = 10°$ and a margin of $4°$, and above what latitude does a cap
# contain a tenth of the sky?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# $1 - \sin 14° = 0.76$. A cap above latitude $b$ covers the share $(1 - \sin b)/2$, so $\sin b = 0.8$ and
# $b = 53.1°$, the default of `cap`.
#
# </details>
#
# **2.** Why does the error fall so steeply within two beam widths of the edge, and what can remain further in?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The inpainted part affects a pixel only through the beam, and two widths away a Gaussian has fallen to
# $\exp(-4 \ln 2 \cdot 2^2) = 2^{-16}$. An error in the fitted spectra affects every pixel.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 24_masks -p galaxy=templates -p template_dir=maps
# himap run 24_masks -p 'methods=[["smooth_spectra", 4], ["gmca", 5]]'
# ```
