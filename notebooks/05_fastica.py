# ---
# jupyter:
#   himap:
#     figures: []
#     section: 3.1.2
#   jupytext:
#     formats: ipynb,py:percent
#     notebook_metadata_filter: himap
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.19.6
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Fast independent component analysis
#
# > - **Read first**: {doc}`04_pca`.
# > - **Good to know**: independence of random variables, which is more than no correlation.
# > - **Time and memory**: {cost}`05_fastica`.
#
# The components of {doc}`04_pca` are uncorrelated, and that is a weak demand: any rotation of uncorrelated maps of equal
# variance gives maps that are uncorrelated again. Independent component analysis (ICA) asks for more. Synchrotron emission and
# point sources know nothing of each other, so knowing one map should tell *nothing* about the other,
# not only nothing linear. FastICA {cite:p}`hyvarinen1999` finds the rotation that comes closest to that. It was among the first
# blind methods tried on 21 cm maps {cite:p}`chapman2012,wolz2014`.
#
# This notebook shows how it does it, what sources it finds, and why none of this changes the cleaned maps.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "degraded"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 3  # components to remove, for the beam shown in detail
contrast: str = "logcosh"  # contrast function: logcosh, exp or cube

# %%
import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.instrument.beams import named
from himap.paper.methods import each_beam, paper_beams
from himap.paper.study import Study
from himap.paper.study_figures import (
    angular_figure,
    channel_figure,
    frequency_figure,
    mixing_figure,
    sources_figure,
)
from himap.removal.fastica import FastICA
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
removers = each_beam(lambda n: FastICA(n_sources=n, contrast=contrast), beams.values())
removers[selected] = [FastICA(n_sources=n_sources, contrast=contrast)]
study.check(removers)
remover = removers[selected][0]
pca = PCA(n_sources=n_sources)

# %% [markdown]
# ## How it works
#
# The mixture is that of {eq}`eq-mixture`, $\mathbf{X} = \mathbf{A}\,\mathbf{S} + \mathbf{N}$. The work is done in two steps.
#
# **Whitening.** Take the $n_s$ leading principal components and divide each by its standard deviation,
#
# ```{math}
# :label: eq-white
# \mathbf{Z} = \mathbf{D}^{-1/2}\,\mathbf{U}^{\top}\,\mathbf{X},
# ```
#
# so that all have unit variance and no correlation. If the sources are independent they have these properties too, hence
# they can only be a rotation of $\mathbf{Z}$: $\mathbf{S} = \mathbf{W}\,\mathbf{Z}$ with
# $\mathbf{W}\mathbf{W}^{\top} = \mathbf{1}$. All that is left to find is $\mathbf{W}$.
#
# **Rotation.** A sum of independent things is closer to a Gaussian than the things are. So the sources
# are the *least Gaussian* projections of $\mathbf{Z}$. FastICA measures this by a contrast $\mathrm{E}[G(s)]$ with, for instance,
# $G(s) = \log\cosh s$, and brings it to an extremum by a fixed-point iteration, with $g = G'$:
#
# ```{math}
# :label: eq-fastica
# \mathbf{w} \leftarrow \mathrm{E}\!\left[\mathbf{z}\, g(\mathbf{w}^{\top}\mathbf{z})\right]
#   - \mathrm{E}\!\left[g'(\mathbf{w}^{\top}\mathbf{z})\right]\mathbf{w},
# ```
#
# for all rows $\mathbf{w}$ of $\mathbf{W}$ at once, which are made orthogonal again after each step. The mixing matrix is
# $\mathbf{A} = \mathbf{U}\,\mathbf{D}^{1/2}\,\mathbf{W}^{\top}$. The iteration starts from a random rotation, drawn from the seed of the survey.

# %% [markdown]
# ## The rotation drops out
#
# What is removed is the product $\mathbf{A}\,\mathbf{S}$:
#
# ```{math}
# :label: eq-ica-is-pca
# \mathbf{A}\,\mathbf{S} = \mathbf{U}\,\mathbf{D}^{1/2}\,\mathbf{W}^{\top}\,\mathbf{W}\,\mathbf{D}^{-1/2}\,\mathbf{U}^{\top}\,\mathbf{X}
#  = \mathbf{U}\,\mathbf{U}^{\top}\,\mathbf{X}.
# ```
#
# **The cleaned maps of FastICA are those of PCA with the same $n_s$**, whatever $\mathbf{W}$ is, converged or not. This is no
# property of our code. scikit-learn's `FastICA(n_components=n_s)` keeps $n_s$ principal components when it whitens, and a test of
# this package compares both. The paper shows the two as separate methods; their cleaned maps can differ only if the whitening
# keeps more components than sources are removed.

# %%
different = {
    name: study.residual(name, methods[0]) != study.residual(name, PCA(n_sources=methods[0].n_sources))
    for name, methods in removers.items()
}
show({f"{name}: pixels that differ from PCA": np.count_nonzero(cube) for name, cube in different.items()})

# %% [markdown]
# ## What is removed
#
# The same space, then, described by other axes. The spectra need no longer be orthogonal, and the sources are chosen for their
# distribution, not for their variance. Compare with {numref}`fig-pca-mixing` and {numref}`fig-pca-sources`: at the defaults all three
# spectra now look like emission, positive and falling with frequency, with mean spectral indices of {glue:text}`fastica_index_first`,
# {glue:text}`fastica_index_second` and {glue:text}`fastica_index_third`. The
# first, the flattest, goes with the thin plane and compact knots, as free-free emission would, the others with the diffuse sky, as
# synchrotron emission would. They are still mixtures: the index of free-free emission is -2.1, and some pixels of the plane have the wrong sign.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-mixing", "caption": "Columns of the mixing matrix of FastICA against frequency, each of unit length, ordered by the variance of their sources."}}
mixing_figure(study, selected, remover)


# %% tags=["hide-input"]
def spectral_index(spectrum):
    """Slope of a straight line through a spectrum in log-log; nan of one that changes its sign."""
    if (spectrum * spectrum[0] <= 0).any():
        return np.nan
    return np.polyfit(np.log(study.survey.freqs), np.log(np.abs(spectrum)), 1)[0]


indices = [spectral_index(spectrum) for spectrum in study.separation(selected, remover).mixing.T]
indices += [np.nan] * 3  # where there are fewer
quote(
    fastica_index_first=(indices[0], 0.02),
    fastica_index_second=(indices[1], 0.02),
    fastica_index_third=(indices[2], 0.02),
)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-sources", "caption": "The sources of FastICA, in mK summed over channels (a component of unit length in frequency). Colours span the central 96 % of the pixels."}}
sources_figure(study, selected, remover)

# %% [markdown]
# How far from Gaussian are they? The figure has the distribution of the pixels of each source in units of its
# standard deviation, beside those of PCA. Nothing in a foreground is Gaussian, before or after the rotation.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-histograms", "caption": "Distribution of the pixels of the sources of PCA (left) and FastICA (right), each less its mean and divided by its standard deviation. Black: a Gaussian. Curves have gaps where there is no pixel; the bright tails go on beyond 6."}}
edges = np.linspace(-6, 6, 61)
centres = (edges[1:] + edges[:-1]) / 2
gaussian = np.exp(-(centres**2) / 2) / np.sqrt(2 * np.pi)
colours, dashes = styles.COLOURS[:5], ["-", "--", "-.", ":"]


def histograms(title, sources):
    """A panel with the distribution of every source."""
    curves = [(centres, gaussian, {"color": "black", "linewidth": 1, "label": "Gaussian"})]
    for n, source in enumerate(sources):
        counts = (
            np.histogram((source - source.mean()) / source.std(), edges)[0] / len(source) / np.diff(edges)
        )
        look = {"color": colours[n % 5], "linestyle": dashes[n % 4], "label": f"component {n + 1}"}
        curves.append((centres, np.where(counts > 0, counts, np.nan), look))
    labels = {
        "xlabel": "(pixel - mean) / standard deviation",
        "ylabel": "density",
        "yscale": "log",
        "ylim": (1e-5, 20),
    }
    return {"title": title, "curves": curves, **labels}


panels = [
    histograms(title, study.separation(selected, method).sources)
    for title, method in {"PCA": pca, "FastICA": remover}.items()
]
study.stamped(plotting.lines(panels), beam=selected, n_sources=n_sources, contrast=contrast)

# %% [markdown]
# ## How it fails: no unique answer
#
# A real sky does not fulfil the assumption: its foregrounds share the plane of the Galaxy, so they are *not* independent, and the
# contrast has more than one local extremum. The next figure repeats the separation from six random rotations and
# compares the sources of each run with those of the first: for each, its correlation with the one that it resembles most. At 1 the source
# came back the same. At the defaults the three sources of the degraded beam do in all runs (no correlation is below {glue:text}`fastica_same_degraded`); with the four
# and five sources of the evolving and the oscillating beam some runs end elsewhere, with other sources for some of the components (the smallest correlations
# are {glue:text}`fastica_same_evolving` and {glue:text}`fastica_same_oscillating`). As {eq}`eq-fastica` needs nothing but $\mathbf{Z}$, the runs work on the principal components instead of the maps.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-seeds", "caption": "Largest absolute correlation of each source of the first run with a source of another run, for five runs that differ in the random rotation they start from. The cleaned maps are the same in all of them."}}
panels, iterations, smallest = [], {}, {}
for name, methods in removers.items():
    method = methods[0]
    components = study.separation(name, PCA(n_sources=method.n_sources)).sources
    white = (components / components.std(axis=1, keepdims=True)).astype(np.float32)
    runs = []
    for seed in range(6 if method.n_sources > 1 else 0):
        cleaned = method.clean(white, freqs=study.survey.freqs[: len(white)], rng=np.random.default_rng(seed))
        runs.append(cleaned.separation)
    points, smallest[str(name)] = [], 1.0
    for n, run in enumerate(runs[1:]):
        alike = np.abs(np.corrcoef(runs[0].sources, run.sources)[: len(white), len(white) :]).max(axis=1)
        smallest[str(name)] = min(smallest[str(name)], *alike)
        look = {"color": colours[n % 5], "marker": "osD^v"[n % 5], "label": f"run {n + 2}"}
        points.append((np.arange(1, len(white) + 1) + 0.08 * (n - 2), alike, look))
    iterations[name] = [run.n_iterations for run in runs]
    labels = {"xlabel": "source of run 1", "ylabel": "largest |correlation|", "ylim": (0.4, 1.03)}
    ticks = {"xticks": np.arange(1, len(white) + 1), "xlim": (0.5, len(white) + 0.5)}
    panels.append(
        {"title": name, "curves": [], "points": points, "legend": {"loc": "lower left"}, **labels, **ticks}
    )
study.stamped(plotting.lines(panels, columns=3, size=(3.6, 3.2)), contrast=contrast)

# %% tags=["hide-input"]
quote(
    fastica_same_degraded=(smallest["degraded"], 0.01),
    fastica_same_evolving=(smallest["evolving"], 0.05),
    fastica_same_oscillating=(smallest["oscillating"], 0.05),
)

# %% [markdown]
# The number of iterations depends on the start as well. One iteration costs a product of an $n_s \times n_s$ matrix with $n_s$
# maps and as many hyperbolic tangents, far less than the covariance matrix that comes before.

# %% tags=["hide-input"]
show(
    {
        # The last digits of sums, which depend on threads and places in memory, decide when it stops.
        f"{name}: {word} number of iterations": (pick(counts), max(5, 0.1 * pick(counts)))
        for name, counts in iterations.items()
        if counts
        for word, pick in (("smallest", min), ("largest", max))
    }
)

# %% [markdown]
# ## What is left
#
# The cleaned map of one channel beside the truth and their difference: the same map as that of PCA in {numref}`fig-pca-maps`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-maps", "caption": "One channel in the middle of the band, through the oscillating beam: what was observed, what FastICA leaves, the truth (HI plus noise), and what it leaves minus the truth. Channel means removed; colours span 1 to 99 % of the pixels, the same for cleaned and truth; the difference is white where nothing is wrong."}}
hardest = beams["oscillating"]  # whatever beam is shown in detail
channel_figure(study, hardest, removers[hardest][0])

# %% [markdown]
# ## The power spectra
#
# Both spectra of the cleaned maps with those of PCA, which they cover.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-angular", "caption": "Angular power spectrum of the cleaned maps for the three beams with the paper's numbers of components, PCA beside FastICA, and the ratio to the truth. The two remove the same foreground, so their curves coincide. The grey band is 10 %, and the axis of ratios is even near 1 and logarithmic far from it. (FastICA's share of the paper's Fig. 1.)"}}
both = {name: [PCA(n_sources=methods[0].n_sources), *methods] for name, methods in removers.items()}
angular_figure(study, both)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-frequency", "caption": "Frequency power spectrum of the cleaned maps for the three beams, PCA beside FastICA, whose curves coincide, and the ratio to the truth. The grey band is 10 %, and the axis of ratios is even near 1 and logarithmic far from it. (FastICA's share of the paper's Fig. 2.)"}}
frequency_figure(study, both)

# %% tags=["hide-input"]
show(study.band_numbers(removers))

# %% [markdown]
# ## What to take away
#
# - FastICA rotates the leading principal components until they are as far from Gaussian as they can be. It removes the same
#   space as PCA, so the cleaned maps, the spectra and the number of components to choose are those of PCA, pixel by pixel.
#   Where this book shows both, one curve lies on the other.
# - What it adds is a reading of the foregrounds: its sources look more like emission than those of PCA. They are not
#   physical components, for these are not independent of each other.
# - The sources may depend on the random start, as those of four and five components do here; what is removed does not.
# - It costs what PCA costs and some iterations on $n_s$ maps.
#
# ## Exercises
#
# **1.** Another contrast measures the distance from a Gaussian differently. Are the sources the same? Are the cleaned maps?
#
# ```sh
# himap run 05_fastica -p contrast=cube
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The sources are others, as their spectral indices show. The cleaned maps are the same in every pixel: {eq}`eq-ica-is-pca` holds for every rotation.
#
# </details>
#
# **2.** With the oscillating beam and five components, is the first source nearer to free-free emission?
#
# ```sh
# himap run 05_fastica -p beam=oscillating -p n_sources=5
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Its index is flatter than before, and flatter than that of free-free emission itself: with more components the rotation has more freedom, and what it
# finds is a mixture all the same.
#
# </details>
#
# **3.** Does the real Galaxy make the answer unique?
#
# ```sh
# himap run 05_fastica -p galaxy=templates -p template_dir=DIR   # the real Galaxy, from `himap templates DIR`
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Not for the evolving and the oscillating beam: there some runs still end with other sources, though less far from each other. The cleaned maps are
# those of PCA again.
#
# </details>
