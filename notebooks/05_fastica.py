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
# PCA makes sources uncorrelated ({doc}`04_pca`), a property that any rotation of maps of equal variance
# preserves. Independent component analysis (ICA) requires statistical independence. FastICA
# {cite:p}`hyvarinen1999` determines the rotation that is closest to it, and was applied early to 21 cm maps
# {cite:p}`chapman2012,wolz2014`. {cite:t}`gkogkou2025` show it and PCA as separate methods. This chapter
# shows that both have the same cleaned maps.

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
from himap.figures.numbers import one_run, quote, show
from himap.instrument.beams import named
from himap.paper.methods import paper_beams, table_1
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
removers = {
    beam: [FastICA(n_sources=table_1(beam)["n_sources"], contrast=contrast)] for beam in beams.values()
}
removers[selected] = [FastICA(n_sources=n_sources, contrast=contrast)]
study.check(removers)
remover = removers[selected][0]
pca = PCA(n_sources=n_sources)

# %% [markdown]
# ## The method
#
# The mixture is {eq}`eq-mixture`, $\mathbf{X} = \mathbf{A}\,\mathbf{S} + \mathbf{N}$.
#
# **Whitening.** The $n_s$ leading principal components are divided by their standard deviations,
#
# ```{math}
# :label: eq-white
# \mathbf{Z} = \mathbf{D}^{-1/2}\,\mathbf{U}^{\top}\,\mathbf{X} .
# ```
#
# Independent sources of unit variance are a rotation of these, $\mathbf{S} = \mathbf{W}\,\mathbf{Z}$ with
# $\mathbf{W}\mathbf{W}^{\top} = \mathbf{1}$.
#
# **Rotation.** A sum of independent variables is closer to a Gaussian than the variables are, so the sources
# are the *least Gaussian* projections of $\mathbf{Z}$. FastICA brings a contrast $\mathrm{E}[G(s)]$, such as
# $G(s) = \log\cosh s$, to an extremum by a fixed-point iteration with $g = G'$,
#
# ```{math}
# :label: eq-fastica
# \mathbf{w} \leftarrow \mathrm{E}\!\left[\mathbf{z}\, g(\mathbf{w}^{\top}\mathbf{z})\right]
#   - \mathrm{E}\!\left[g'(\mathbf{w}^{\top}\mathbf{z})\right]\mathbf{w},
# ```
#
# for all rows $\mathbf{w}$ of $\mathbf{W}$, made orthogonal after each step, from a random rotation. The
# mixing matrix is $\mathbf{A} = \mathbf{U}\,\mathbf{D}^{1/2}\,\mathbf{W}^{\top}$.

# %% [markdown]
# ## The rotation cancels
#
# The removed foreground is
#
# ```{math}
# :label: eq-ica-is-pca
# \mathbf{A}\,\mathbf{S} = \mathbf{U}\,\mathbf{D}^{1/2}\,\mathbf{W}^{\top}\,\mathbf{W}\,\mathbf{D}^{-1/2}\,\mathbf{U}^{\top}\,\mathbf{X}
#  = \mathbf{U}\,\mathbf{U}^{\top}\,\mathbf{X}.
# ```
#
# **The cleaned maps of FastICA are those of PCA with the same $n_s$**, for every $\mathbf{W}$, converged or
# not; a test confirms this for scikit-learn's `FastICA(n_components=n_s)`. They can differ only if
# the whitening keeps more components than are removed.

# %%
different = {
    name: study.residual(name, methods[0]) != study.residual(name, PCA(n_sources=methods[0].n_sources))
    for name, methods in removers.items()
}
show({f"{name}: pixels that differ from PCA": np.count_nonzero(cube) for name, cube in different.items()})

# %% [markdown]
# ## The removed components
#
# The spectra need not be orthogonal. With the defaults (the degraded beam) all three, unlike those of
# {numref}`fig-pca-mixing` and {numref}`fig-pca-sources`, resemble emission: they are positive and fall with
# frequency, with mean spectral indices {glue:text}`fastica_index_first`, {glue:text}`fastica_index_second`
# and {glue:text}`fastica_index_third`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-mixing", "caption": "Columns of the mixing matrix of FastICA, of unit length, ordered by the variance of their sources."}}
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

# %% [markdown]
# The first source resembles free-free emission (the thin plane, compact regions), the others synchrotron
# emission. They are still mixtures: free-free emission has another index ({doc}`01_simulations`), and some
# pixels of the plane are negative.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-sources", "caption": "The sources of FastICA, in mK summed over channels (spectra have unit length). Colours: central 96 % of the pixels."}}
sources_figure(study, selected, remover)

# %% [markdown]
# No source is Gaussian, before or after the rotation.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-histograms", "caption": "Distribution of the pixels of the sources of PCA (left) and FastICA (right), less mean and over standard deviation. Black: a Gaussian. Curves have gaps where there is no pixel; the bright tails continue beyond 6."}}
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
# ## Dependence on the start
#
# The contrast can have several local extrema, and the foregrounds, which share the Galactic plane, are not
# independent. Six separations from different random rotations are compared; a correlation of 1 means that the
# same source is recovered. Of the five other runs {glue:text}`fastica_differ_degraded` differ from the first
# with three sources (degraded beam), {glue:text}`fastica_differ_evolving` with four (evolving) and
# {glue:text}`fastica_differ_oscillating` with five (oscillating); the smallest correlations are
# {glue:text}`fastica_same_degraded`, {glue:text}`fastica_same_evolving` and
# {glue:text}`fastica_same_oscillating`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-seeds", "caption": "Largest absolute correlation of each source of the first run with a source of another, for five other random rotations."}}
panels, iterations, smallest, differ = [], {}, {}, {}
for name, methods in removers.items():
    method = methods[0]
    components = study.separation(name, PCA(n_sources=method.n_sources)).sources
    white = (components / components.std(axis=1, keepdims=True)).astype(np.float32)
    runs = []
    for seed in range(6 if method.n_sources > 1 else 0):
        cleaned = method.clean(white, freqs=study.survey.freqs[: len(white)], rng=np.random.default_rng(seed))
        runs.append(cleaned.separation)
    points, smallest[str(name)], differ[str(name)] = [], 1.0, 0
    for n, run in enumerate(runs[1:]):
        alike = np.abs(np.corrcoef(runs[0].sources, run.sources)[: len(white), len(white) :]).max(axis=1)
        smallest[str(name)] = min(smallest[str(name)], *alike)
        differ[str(name)] += alike.min() < 0.95
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
    # Where the extremum is not unique, the last digits of sums decide which is reached.
    fastica_same_evolving=one_run((smallest["evolving"], 0.05)),
    fastica_same_oscillating=one_run((smallest["oscillating"], 0.05)),
    fastica_differ_degraded=one_run((differ["degraded"], 1)),
    fastica_differ_evolving=one_run((differ["evolving"], 1)),
    fastica_differ_oscillating=one_run((differ["oscillating"], 1)),
)

# %% [markdown]
# The number of iterations also depends on the start.

# %% tags=["hide-input"]
# The last digits of sums, which depend on threads and places in memory, decide when it stops.
show(
    one_run(
        {
            f"{name}: {word} number of iterations": (pick(counts), 1)
            for name, counts in iterations.items()
            if counts
            for word, pick in (("smallest", min), ("largest", max))
        }
    )
)

# %% [markdown]
# ## The cleaned maps
#
# The cleaned maps are those of {numref}`fig-pca-maps`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-maps", "caption": "A channel in the middle of the band, through the oscillating beam: observed, cleaned by FastICA, true (HI plus noise), and cleaned minus true. Channel means removed; colours span 1 to 99 % of the pixels, alike for cleaned and true; white: no error."}}
hardest = beams["oscillating"]  # whatever beam is shown in detail
channel_figure(study, hardest, removers[hardest][0])

# %% [markdown]
# ## The power spectra
#
# The curves of FastICA coincide with those of PCA, as both remove the same foreground.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-angular", "caption": "Angular power spectrum of the maps cleaned by PCA and FastICA, for the three beams, and the ratio to the truth. Grey band: 10 %; ratios are linear near 1, logarithmic beyond. (Part of the paper's Fig. 1.)"}}
both = {name: [PCA(n_sources=methods[0].n_sources), *methods] for name, methods in removers.items()}
angular_figure(study, both)

# %% [markdown]
# They also coincide along the line of sight.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-fastica-frequency", "caption": "Frequency power spectrum of the maps cleaned by PCA and FastICA, for the three beams, and the ratio to the truth. Grey band: 10 %; ratios are linear near 1, logarithmic beyond. (Part of the paper's Fig. 2.)"}}
frequency_figure(study, both)

# %% tags=["hide-input"]
show(study.band_numbers(removers))

# %% [markdown]
# ## Conclusions
#
# - FastICA removes the same space as PCA: cleaned maps, spectra and the number of components to choose are
#   the same.
# - Its sources resemble emission more closely, but are not physical components, as these are not independent.
# - The sources can depend on the random start; the removed foreground does not.
#
# ## Exercise
#
# Does another contrast change the sources and the cleaned maps?
#
# ```sh
# himap run 05_fastica -p contrast=cube
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The sources change, as their spectral indices show. By {eq}`eq-ica-is-pca` the cleaned maps are the same in
# every pixel.
#
# </details>
