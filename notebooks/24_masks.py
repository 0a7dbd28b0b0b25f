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
# # Masks inside of the separation
#
# > - **Read first**: {doc}`12_post_masking`, {doc}`13_dimmed_galaxy`.
# > - **Time and memory**: {cost}`24_masks`.
#
# Foregrounds are bright in the Galactic plane, and HI is wanted everywhere else. The paper leaves the plane out *after* the separation ({doc}`12_post_masking`), asks what a fainter plane would change ({doc}`13_dimmed_galaxy`), and names masks
# inside of SDecGMCA as future work. And a telescope sees a part of the sky only.
#
# For a method that takes each line of sight as it comes a mask is no question. One that knows the beam transforms whole maps. What it wants on kept pixels $p$ is
#
# ```{math}
# \min_{S} \sum_\nu \sum_{p\ \mathrm{kept}} \Big( x_\nu(p) - \sum_{\ell m} Y_{\ell m}(p)\, H_{\nu\ell}\, (A s)_{\ell m} \Big)^2 ,
# ```
#
# with sources that are free outside. An extension of the maps by any $H A s$ costs nothing there; so the few bright maps are continued smoothly over the masked sky, and the method works on the whole of it. The sources that say where $A$ is
# looked for are weighted down to nothing at the edge, where the continuation is a guess: within reach of the beam, two of its widths. (Conjugate gradients on the sources themselves were tried: foregrounds are brighter than HI by five orders,
# and they do not get there.)

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
latitude: float = 10.0  # least |b| that is kept, deg
cap: float = 53.13  # latitude at which a survey of the north ends, deg; 53.13 is a tenth of the sky
margin: float = 4.0  # how far inside of an edge spectra begin, deg

# %% tags=["hide-input"]
import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show_table
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
    n_realisations=1,
)
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)
plane, north = Region(latitude=latitude), Region(latitude=cap, north=True)
names = {one: styles.numbered(one.name, getattr(one, "n_sources", 0)) for one in removers}

# %% [markdown]
# ## The plane left out
#
# Four ways, measured on the same pixels, those further from the plane than `latitude` and `margin` together (at the top of this page): the foreground found on the whole sky; the same, without the lines of sight whose error stands out (which needs the truth); the plane dimmed in the sky
# itself; and the plane left out of the separation.

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
# One row for each method. Where the four curves lie together the mask does not matter, as it does for the method that knows the beam in all but *inside*; where
# *inside* stands out above the others, its edge has left foreground.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-masks-plane", "caption": "Power that is left over that of the truth, beyond the Galactic plane, for each method (rows) and way: across the sky (left) and along the line of sight (right). What is off by more than 40 % is not drawn."}}
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
# ## How far the edge reaches

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
# Solid and dashed lines of a method part near the edge and run side by side further in. How far out they part, against the margin, is what the edge costs.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-masks-depth", "caption": "What is wrong with the cleaned maps, by the distance from the edge of the mask, where the plane is left out of the separation (dashed) and where it is not (solid). The grey line is the margin."}}
study.stamped(plotting.lines([panel], columns=1, size=(6.4, 4)), beam=case.beam, latitude=latitude)

# %% [markdown]
# (masks-survey)=
# ## A tenth of the sky
#
# A survey of the northern cap, with nothing known outside. *No mask* is the same pixels of a survey of the whole sky.

# %%
survey_of = {
    (one, way): compared(case, one, north, way, margin) for one in removers for way in ("no mask", "inside")
}

# %% [markdown]
# Solid is what a survey of the whole sky would have in these pixels, dashed what the tenth alone allows. For PCA the dashed curve can be the nearer
# one: the plane, which cost it components, is not in this survey.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-masks-survey", "caption": "Power that is left over that of the truth within a tenth of the sky, for each method (rows), separated on the whole sky and on that tenth alone."}}
panels = [
    panel
    for one in removers
    for panel in ratios({way: survey_of[one, way] for way in ("no mask", "inside")}, names[one])
]
study.stamped(plotting.lines(panels), beam=case.beam, cap=cap, margin=margin)

# %% tags=["hide-input"]
show_table({f"{names[one]}, {way}": means(result) for (one, way), result in survey_of.items()})


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
    masks_last_inside=off(found[last, "inside"]),
    masks_survey=off(survey_of[first, "inside"]),
    masks_survey_last=off(survey_of[last, "inside"]),
)

# %% [markdown]
# ## What to take away
#
# How far the worst band of the tables is from the truth, on this sky:
#
# | | no mask | post-masked | dimmed | inside | a tenth of the sky |
# |---|---|---|---|---|---|
# | {glue:text}`masks_first` | {glue:text}`masks_none` | {glue:text}`masks_post` | {glue:text}`masks_dimmed` | {glue:text}`masks_inside` | {glue:text}`masks_survey` |
# | {glue:text}`masks_last` | {glue:text}`masks_last_none` | | | {glue:text}`masks_last_inside` | {glue:text}`masks_survey_last` |
#
# - **To know the beam replaces the mask.** For a method whose model holds the plane too, that is one more place to learn the spectra from: without a mask, masked afterwards and dimmed it does alike. Left out of the separation the plane
#   costs it some foreground from the edge, which shows at small $k_\nu$ and where the beam ripples, most with the fewest sources.
# - **A mask helps** where the model does not hold: PCA, to which the plane gives components that the rest of the sky does not need.
# - **The edge costs a margin**, about two widths of the beam: spectra should begin there.
# - **A part of the sky can be cleaned by all of them.** Where its edge is long and its interior small, a method without a beam has the least to lose: the table says which is nearer.
#
# On a cube of one's own, of the whole sky or a part of it:
#
# ```sh
# himap clean cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 --mask mask.fits -o cleaned.h5
# ```
#
# ## Exercises
#
# **1.** Which share of the sky is left beyond $|b| = 10°$ and a margin of $4°$?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# $1 - \sin 14° = 0.76$. The margin alone takes $\sin 14° - \sin 10° = 0.07$ of the sky.
#
# </details>
#
# **2.** From which latitude on does a cap hold a tenth of the sky?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# A cap beyond the latitude $b$ has the share $(1 - \sin b)/2$ of the sky, so $\sin b = 0.8$ and $b = 53.1°$, the `cap` in the last line of the figure.
#
# </details>
#
# **3.** Why is a margin of two widths of the beam enough, and why does the rest of the map not suffer?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# What is guessed outside of the mask enters a pixel through the beam only, and two widths away hardly anything of a Gaussian is left: $\exp(-4 \ln 2
# \cdot 2^2) = 2^{-16}$.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 24_masks -p galaxy=templates -p template_dir=maps
# himap run 24_masks -p 'methods=[["smooth_spectra", 4], ["gmca", 5]]'
# himap run 24_masks -p latitude=20
# ```
