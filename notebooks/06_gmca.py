# ---
# jupyter:
#   himap:
#     figures: []
#     section: 3.1.3
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
# # Generalised morphological component analysis
#
# > - **Read first**: {doc}`04_pca`, {doc}`05_fastica`.
# > - **Good to know**: the pseudo-inverse of a matrix; wavelets are introduced here.
# > - **Time and memory**: {cost}`06_gmca`.
#
# PCA asks that sources be uncorrelated, FastICA that they be independent ({doc}`04_pca`, {doc}`05_fastica`). Generalised
# morphological component analysis (GMCA) {cite:p}`bobin2007` asks that they be *sparse*: in the right basis, a wavelet basis for
# instance, a map of the sky is a few large coefficients and very many small ones. If the large coefficients of different sources
# fall in different places, they give the sources away. GMCA was made for the cosmic microwave background and later
# used on 21 cm maps {cite:p}`chapman2013,carucci2020`.
#
# Unlike FastICA it does not stay in the space of the principal components, so what it leaves is not what PCA leaves.
# This notebook shows the wavelets, the iteration, the sources, and the price of that freedom.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "evolving"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 4  # components to remove, for the beam shown in detail
n_scales: int = 4  # starlet detail scales
penalty: str = "l1"  # l1 (soft thresholds) or l0 (hard thresholds)
n_sigma: float = 3.0  # last threshold, in units of the noise of each scale

# %%
import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.instrument.beams import named
from himap.maps.starlets import starlet_filters, starlets
from himap.paper import pipeline
from himap.paper.methods import each_beam, paper_beams
from himap.paper.study import Study
from himap.paper.study_figures import (
    angular_figure,
    channel_figure,
    frequency_figure,
    mixing_figure,
    sources_figure,
)
from himap.removal.gmca import GMCA
from himap.removal.pca import PCA

beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
)


def gmca(n_sources, **changed):
    """GMCA with the parameters of this notebook."""
    return GMCA(
        **({"n_sources": n_sources, "n_scales": n_scales, "penalty": penalty, "n_sigma": n_sigma} | changed)
    )


removers = each_beam(gmca, beams.values())
removers[selected] = [gmca(n_sources)]
study.check(removers)
remover = removers[selected][0]
pca = PCA(n_sources=n_sources)

# %% [markdown]
# ## Starlets
#
# Starlets {cite:p}`starck2007` are isotropic wavelets on the sphere. A map is smoothed again and again, each time with a kernel
# twice as wide; the differences between one and the next are the *detail scales*, and what remains is the smooth scale. All are full maps, and
# their sum is the map. In harmonic space each scale is a filter of $\ell$.
#
# Each curve is one scale: the finest lets the highest multipoles through, each coarser one about half of those, and the smooth scale the lowest.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-filters", "caption": "Filters of the starlet scales against multipole; they add up to 1 at every multipole."}}
dashes = ["-", "--", "-.", ":", (0, (8, 2))]
looks = [{"color": styles.COLOURS[n], "linestyle": dashes[n]} for n in range(5)]
filters = starlet_filters(n_scales, 3 * study.survey.nside - 1)
names = [f"detail {n + 1}" for n in range(n_scales)] + ["smooth"]
curves = []
for n, (name, band) in enumerate(zip(names, filters, strict=True)):
    curves.append((np.arange(1, len(band)), band[1:], looks[n % 5] | {"label": name}))
labels = {"xlabel": styles.AXES["angular"]["xlabel"], "ylabel": "filter", "xscale": "log"}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 3.4)), n_scales=n_scales)

# %% [markdown]
# Below are the scales of one observed channel. Detail scales are zero nearly everywhere and large near compact emission and at the
# edges of the plane: they are sparse. The smooth scale is not.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-starlets", "caption": "The channel in the middle of the band, as observed, in starlet scales, fine to coarse. Colours span the central 96 % of the pixels."}}
channel = study.observed(selected).maps[study.survey.n_channels // 2].astype(float)
scales = starlets(channel - channel.mean(), n_scales)
scale_maps = dict(zip(names, scales, strict=True))
study.stamped(plotting.sky_maps(scale_maps, limits=(2, 98)), beam=selected, n_scales=n_scales)

# %% [markdown]
# How sparse? The next figure sorts the coefficients of each scale by size. If a small share of them holds most of the
# square sum, the scale is sparse. The finer the scale, the sparser it is: one coefficient in a thousand holds {glue:text}`gmca_share_finest` of the finest, and
# {glue:text}`gmca_share_smooth` of the smooth one.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-sparsity", "caption": "Share of the square sum of a scale of this channel that is in its largest coefficients, against the share of coefficients counted. A curve that rises early means a sparse scale."}}
counts = np.unique(np.geomspace(1, len(channel), 400).astype(int))
curves, brightest = [], {}
for n, (name, scale) in enumerate(scale_maps.items()):
    power = np.cumsum(np.sort(scale**2)[::-1])
    curves.append((counts / len(channel), power[counts - 1] / power[-1], looks[n % 5] | {"label": name}))
    brightest[name] = power[len(channel) // 1000 - 1] / power[-1]  # share of one coefficient in a thousand
labels = {"xlabel": "share of the coefficients", "ylabel": "share of the square sum", "xscale": "log"}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 3.4)), beam=selected)

# %% tags=["hide-input"]
quote(
    gmca_share_finest=(100 * brightest["detail 1"], 1, "%"),
    gmca_share_smooth=(100 * brightest["smooth"], 1, "%"),
)

# %% [markdown]
# ## How it works
#
# Write $\mathbf{X}^\mathrm{wt}$ for the detail scales of all channels and $\mathbf{S}^\mathrm{wt}$ for those of the sources. The
# mixture stays what it was, for starlets are linear. GMCA looks for
#
# ```{math}
# :label: eq-gmca
# \min_{\mathbf{A},\,\mathbf{S}^\mathrm{wt}} \;
#   \sum_{i=1}^{n_s} \lambda_i\, \|\mathbf{S}_i^\mathrm{wt}\|_1
#   + \|\mathbf{X}^\mathrm{wt} - \mathbf{A}\,\mathbf{S}^\mathrm{wt}\|_\mathrm{F}^2 ,
# ```
#
# the sources with the smallest sum of absolute coefficients that explain the maps. It begins with the $\mathbf{A}$ of PCA and repeats two steps:
#
# ```{math}
# :label: eq-gmca-steps
# \mathbf{S}^\mathrm{wt} \leftarrow \mathcal{T}_{\lambda}\!\left(\mathbf{A}^{+}\,\mathbf{X}^\mathrm{wt}\right), \qquad
# \mathbf{A} \leftarrow \mathbf{X}^\mathrm{wt}\,\mathbf{S}^{\mathrm{wt}\,+},
# ```
#
# $^{+}$ being the pseudo-inverse and $\mathcal{T}_\lambda$ the threshold: coefficients up to $\lambda$ become zero, and with the penalty
# $\ell_1$ (`l1`, soft) the others shrink by $\lambda$, with $\ell_0$ (`l0`, hard) they stay. Columns of $\mathbf{A}$ are scaled
# to unit length. The thresholds start high, so that at first only the brightest structures count, which belong
# to one source or another, and fall to $3\sigma$ over 50 iterations. Then it goes on until the foreground $\mathbf{A}\,\mathbf{A}^{+}\,\mathbf{X}$ stands
# still: until it changes by less than a thousandth of what is left. For
# each source and scale, $\sigma$ is 1.48 times the median of the absolute coefficients, the standard deviation if most of them were noise.
#
# At the end there is **no** threshold: $\mathbf{S} = \mathbf{A}^{+}\,\mathbf{X}$, and the cleaned maps are
#
# ```{math}
# :label: eq-gmca-residual
# \mathbf{R} = \mathbf{X} - \mathbf{A}\,\mathbf{A}^{+}\,\mathbf{X}.
# ```
#
# This is a projection again, and only the space that the columns of $\mathbf{A}$ span matters. PCA's space is the one that leaves least
# variance; every other leaves more, and GMCA's is another. The smooth scale takes no part in the search for $\mathbf{A}$, but the foreground is
# removed from it too. The method draws no random numbers.
#
# The figure follows the iteration. The columns of $\mathbf{A}$, orthogonal at the start, turn towards each other until they are nearly
# parallel: the condition number of $\mathbf{A}$ grows by orders of magnitude. To make up the same maps from nearly parallel spectra
# takes larger and larger sources of opposite sign, so in mK the thresholds need not fall even though they let more and
# more coefficients pass. $\mathbf{A}$ is still drifting when the iteration stops. But the space of $\mathbf{A}$, which is all that matters,
# leaves that of PCA in the first iterations and then hardly moves.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-iteration", "caption": "Left: threshold of each source in the finest detail scale against iteration (sources in the order of the principal components they start from). Middle: condition number of the mixing matrix. Right: sine of the largest angle between its space and that of PCA, 0 where they are the same."}}
masked = pipeline.peak_masked(study.case(selected)).maps
centred = (masked - masked.mean(axis=1, dtype=float)[:, None]).astype(np.float32)
steps = list(remover.iterate(centred))
axes = study.separation(selected, pca).mixing


def sine(mixing):
    """Sine of the largest angle between the spaces of `mixing` and of PCA."""
    basis = np.linalg.qr(mixing)[0]
    return np.linalg.norm(basis - axes @ (axes.T @ basis), 2)


iterations = [step.n_iterations for step in steps]
limits = np.array([step.thresholds[0] for step in steps])
curves = [
    (
        iterations,
        limits[:, n],
        looks[n % 5] | {"label": f"source {n + 1}"},
    )
    for n in range(n_sources)
]
threshold_panel = {"curves": curves, "ylabel": "threshold [mK]", "yscale": "log"}
condition = [np.linalg.cond(step.mixing) for step in steps]
condition_panel = {
    "curves": [(iterations, condition, {"color": "black"})],
    "ylabel": "condition number of A",
    "yscale": "log",
}
angle = [sine(step.mixing) for step in steps]
angle_panel = {
    "curves": [(iterations, angle, {"color": "black"})],
    "ylabel": "sine of the angle to PCA",
    "ylim": (0, None),
}
panels = [panel | {"xlabel": "iteration"} for panel in (threshold_panel, condition_panel, angle_panel)]
study.stamped(
    plotting.lines(panels, columns=3, size=(3.6, 3.3)), beam=selected, n_sources=n_sources, penalty=penalty
)

# %% [markdown]
# ## What is removed
#
# The spectra are positive and fall with frequency, like those of FastICA, and are closer still to one another. The
# brightest sources are brighter than the sky itself: they cancel. Those of PCA, with orthogonal spectra, cannot do that. So these maps
# are not emission of one kind or another either.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-mixing", "caption": "Columns of the mixing matrix of GMCA against frequency, each of unit length, ordered by the variance of their sources."}}
mixing_figure(study, selected, remover)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-sources", "caption": "The sources of GMCA, in mK summed over channels (a component of unit length in frequency). Colours span the central 96 % of the pixels."}}
sources_figure(study, selected, remover)

# %% [markdown]
# ## What is left
#
# Cleaned and true map are alike to the eye. The difference has structure near the centre of the Galaxy, where foreground was left or too
# much was taken.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-maps", "caption": "One channel in the middle of the band: what was observed, what GMCA leaves, the truth (HI plus noise), and what it leaves minus the truth. Channel means removed; colours span 1 to 99 % of the pixels, the same for cleaned and truth; the difference is white where nothing is wrong."}}
channel_figure(study, selected, remover)

# %% [markdown]
# ## The power spectra
#
# Both spectra, with those of PCA for comparison. For the degraded beam, where three components hold all of the foreground, the two methods
# differ by {glue:text}`gmca_degraded_off` at most in the bands of the table below. Where one foreground component is left in, with the evolving and the
# oscillating beam, they share what is wrong, and GMCA adds to it: at $\ell < 10$ its power is {glue:text}`gmca_evolving_low` above that of PCA for the evolving
# beam and {glue:text}`gmca_oscillating_low` times it for the oscillating one. At $k_\nu < 0.03$ it is {glue:text}`gmca_evolving_slow` above it and
# {glue:text}`gmca_oscillating_slow` times it, and the peak of the ripple is {glue:text}`gmca_oscillating_peak` times as high. It does not lose everywhere: with the
# oscillating beam its power at higher $\ell$ is {glue:text}`gmca_oscillating_fine` of that of PCA. The space of PCA leaves the least *total* variance, and that
# is dominated by few bright structures.
#
# Look at the degraded beam first, where one curve covers the other, and then at low $\ell$ and low $k_\nu$ of the other two, where GMCA is above PCA.
# The paper has an excess of GMCA with the evolving beam from intermediate $\ell$ down.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-angular", "caption": "Angular power spectrum of the cleaned maps for the three beams with the paper's numbers of components, PCA beside GMCA, and the ratio to the truth. For the degraded beam the two nearly coincide. The grey band is 10 %, and the axis of ratios is even near 1 and logarithmic far from it. (GMCA's share of the paper's Fig. 1.)"}}
both = {name: [PCA(n_sources=methods[0].n_sources), *methods] for name, methods in removers.items()}
angular_figure(study, both)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-frequency", "caption": "Frequency power spectrum of the cleaned maps for the three beams, PCA beside GMCA, and the ratio to the truth. For the degraded beam the two nearly coincide. The grey band is 10 %, and the axis of ratios is even near 1 and logarithmic far from it. (GMCA's share of the paper's Fig. 2.)"}}
frequency_figure(study, both)

# %% tags=["hide-input"]
show(study.band_numbers(both, tolerance=0.05))

# %% tags=["hide-input"]
low, fine = "C/C0, 1 < l < 10", f"C/C0, 10 < l < {min(200, study.l_top)}"
slow, peak = "P/P0, 0 < k < 0.03", "P/P0, highest near k = 0.31"


def over_pca(name, band):
    """The power in a band that GMCA leaves over what PCA leaves; NaN without such a band."""
    with_pca, with_gmca = (study.bands(beams[name], method) for method in both[beams[name]])
    return with_gmca.get(band, np.nan) / with_pca.get(band, np.nan)


bands = study.bands(beams["degraded"], both[beams["degraded"]][0])
quote(
    gmca_degraded_off=(100 * max(abs(over_pca("degraded", band) - 1) for band in bands), 1, "%"),
    gmca_evolving_low=(100 * (over_pca("evolving", low) - 1), 2, "%"),
    gmca_evolving_slow=(100 * (over_pca("evolving", slow) - 1), 2, "%"),
    gmca_oscillating_low=(over_pca("oscillating", low), 0.2),
    gmca_oscillating_slow=(over_pca("oscillating", slow), 0.1),
    gmca_oscillating_peak=(over_pca("oscillating", peak), 0.1),
    gmca_oscillating_fine=(over_pca("oscillating", fine), 0.05),
)

# %% [markdown]
# ## How it fails
#
# The space that GMCA finds depends on choices with no right answer: the penalty, the number of scales, the last threshold.
# None of them comes from the data. In the next figure they move the mean $C/C_0$ at $\ell < 10$ by {glue:text}`gmca_choices_spread` of the truth; see what they
# do with `beam=oscillating`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-gmca-choices", "caption": "Ratio of the angular power spectrum to the truth, in the beam shown in detail, for other choices of the method's own parameters and for PCA."}}
other_penalty, fewer_scales = "l0" if penalty == "l1" else "l1", max(1, n_scales - 1)
changes = {
    f"{penalty}, {n_scales} scales, {n_sigma:g} $\\sigma$": {},
    f"{other_penalty} penalty": {"penalty": other_penalty},
    f"{fewer_scales} scales": {"n_scales": fewer_scales},
}
variants = {name: gmca(n_sources, **change) for name, change in changes.items()} | {"PCA": pca}
curves = []
for n, (name, method) in enumerate(variants.items()):
    degrees, ratio, _, _ = study.ratios(selected, method)
    shown = degrees <= study.l_top
    look = {"color": "black"} if method is pca else looks[n % 5]
    curves.append((degrees[shown], ratio[shown], look | {"label": name}))
labels = {
    "xlabel": styles.AXES["angular"]["xlabel"],
    "ylabel": r"$C / C_0$",
    "xscale": "log",
    "title": beam,
}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 4)), n_sources=n_sources)

# %% tags=["hide-input"]
choices = [study.bands(selected, method)[low] for method in variants.values() if method is not pca]
quote(gmca_choices_spread=(100 * np.ptp(choices), 2, "%"))

# %% [markdown]
# ## What it costs
#
# An iteration passes over the cube twice, once for $\mathbf{A}^{+}\mathbf{X}$ and once for $\mathbf{A}$, and transforms $n_s$ maps to
# starlets and back; the cube itself is never transformed. PCA passes over the cube twice in all. So GMCA costs as many
# times more as it takes iterations.

# %% tags=["hide-input"]
show(
    {
        f"{name}: iterations": (study.separation(name, methods[0]).n_iterations, 10)
        for name, methods in removers.items()
    }
)

# %% tags=["hide-input"]
quote(gmca_iterations=(study.separation(selected, remover).n_iterations, 10))

# %% [markdown]
# ## What to take away
#
# - GMCA looks for sources that are sparse in wavelets, with no model of their spectra. It is the first method here that does not
#   remove the same space as PCA.
# - That freedom does not help against a beam that changes with frequency: with the evolving and the oscillating beam it leaves more at
#   low $\ell$ and at low $k_\nu$ than PCA. The paper finds the same for the evolving beam.
# - The mixing matrix becomes nearly degenerate and the sources cancel each other. The foreground as a whole is well defined, single sources
#   are not.
# - It passes over the cube about {glue:text}`gmca_iterations` times as often as PCA.
#
# ## Exercises
#
# **1.** Do hard thresholds ($\ell_0$) change what is left through the oscillating beam?
#
# ```sh
# himap run 06_gmca -p penalty=l0
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# They lessen the excess at low $\ell$ and the peak of the ripple, and both stay above those of PCA. For the degraded beam nothing of account changes:
# there three components hold the foreground, whichever way they are found.
#
# </details>
#
# **2.** One source more, through the oscillating beam: does GMCA still leave more than PCA?
#
# ```sh
# himap run 06_gmca -p beam=oscillating -p n_sources=6
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# No: with six sources both hold all of the foreground, and their spectra nearly agree. What GMCA leaves more than PCA is of the component that is missing.
#
# </details>
#
# **3.** Why may a source be brighter than the sky that it is a part of?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Because the columns of $\mathbf{A}$ are nearly parallel. To make up a spectrum that lies between them takes large sources of opposite sign, and only
# their sum is seen.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 06_gmca -p galaxy=templates -p template_dir=DIR      # the real Galaxy, from `himap templates DIR`
# ```
