# ---
# jupyter:
#   himap:
#     figures: ["Table 1"]
#     section: "3.3"
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
# # SDecGMCA: separation that knows the beam
#
# PCA, FastICA and GMCA all assume that a source has *one* sky map, seen in every channel with some weight. A beam that changes
# with frequency breaks this: the same source is blurred differently in each channel, and every bright pixel acquires a
# spectrum of its own. {cite:t}`gkogkou2025` therefore apply a method that puts the beam into the model, SDecGMCA
# {cite:p}`carloni2021` (C21 below). In harmonic space a circular beam is one number $\hat H_\nu^\ell$ for each channel and multipole, and
# the mixture is
#
# ```{math}
# :label: eq-sdecgmca-mixture
# \hat{\mathbf{X}}^{\ell m} = \mathrm{diag}(\hat H^\ell)\,\mathbf{A}\,\hat{\mathbf{S}}^{\ell m} + \hat{\mathbf{N}}^{\ell m} .
# ```
#
# This notebook runs it on the three beams, shows what it takes away, and spends half of its length on a question that the paper
# leaves open: how far its answer can be trusted.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 5  # sources, for the beam shown in detail
iteration: str = "stable"  # stable or published: how the mixing matrix is found

# %%
import warnings

import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.instrument.beams import named
from himap.instrument.noise import noise_maps, noise_sigma
from himap.maps import sphere
from himap.measures.power_spectra import frequency_power, recovered_angular_power
from himap.paper import pipeline
from himap.paper.methods import TABLE_1, paper_beams, sdecgmca_for
from himap.paper.study import Study
from himap.removal import harmonic
from himap.removal.analysis import analysed
from himap.removal.base import SeparationWarning
from himap.removal.sdecgmca.mixture import BlurredMixture
from himap.removal.sdecgmca.sparse_sources import SparseSources

beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
)
removers = {each: [sdecgmca_for(each, iteration=iteration)] for each in beams.values()}
removers[selected] = [sdecgmca_for(selected, iteration=iteration, n_sources=n_sources)]
study.check(removers)
remover = removers[selected][0]
warnings.simplefilter("ignore", SeparationWarning)  # whether a run settled is printed with its numbers

# %% [markdown]
# ## How it works
#
# **One resolution.** $H$ is the beam over the best beam of all channels. The sources live at that best resolution, and $H \le 1$ says
# how much of them each channel still sees. In the worst channel little is left of small scales, which is why no method
# can go on to any $\ell$: {cite:t}`gkogkou2025` stop at 200, here at the smaller of 200 and $2\,N_\mathrm{side}$.

# %% mystnb={"figure": {"name": "fig-sdecgmca-beams", "caption": "The beam relative to the best channel, for the channels with the most and the least resolution and one between, against multipole. The dotted line is where the mixing matrix stops being shaped."}}
observed = study.observed(selected)
relative = observed.beams / observed.beams.max(axis=0)
order = np.argsort(observed.beams[:, study.l_top])
colours = [styles.BLUE, styles.ORANGE, styles.GREEN]
curves = [
    (
        np.arange(1, study.l_top),
        relative[channel, 1 : study.l_top],
        {"label": f"{observed.freqs[channel]:.0f} MHz", "color": colour, "linestyle": line},
    )
    for channel, colour, line in zip(order[[-1, len(order) // 2, 0]], colours, ["-", "--", "-."], strict=True)
]
last = min(remover.lmax, study.l_top)
curves.append(([last, last], [0, 1.05], {"color": "black", "linestyle": ":"}))
panel = {
    "curves": curves,
    "xlabel": styles.AXES["angular"]["xlabel"],
    "ylabel": r"$\hat H_\nu^\ell$",
    "ylim": (0, 1.05),
}
study.stamped(plotting.lines([panel], columns=1, size=(6.4, 3.6)), beam=selected)

# %% [markdown]
# **Turns.** Given $\mathbf{A}$, the sources follow from least squares at every $\ell$, with a Tikhonov term $\epsilon$ where the beam leaves too
# little to invert. Their starlet coefficients below a threshold are noise and are dropped: foregrounds are *sparse*, bright in few
# places. Given the sources, $\mathbf{A}$ follows from least squares in every channel. And so on, from a start that is already good: the principal
# components of the data blurred to the worst beam, where a source has one map again.
#
# **The end.** The foreground is $\mathrm{diag}(\hat H^\ell)\mathbf{A}\hat{\mathbf{S}}$ with $\hat{\mathbf{S}}$ from plain least squares, no threshold and no $\epsilon$: at each
# $\ell$ the data are projected on the space that the blurred spectra span. Only that space matters.
#
# **Parameters.** The paper chooses three of them by beam (its Table 1):

# %%
rows = {
    f"{name}: {label}": f"{values[key]:g}"
    for name, values in TABLE_1.items()
    for key, label in (("n_sources", "n_s"), ("regularisation", "c"), ("share", "K_max"))
}
show(rows)

# %% [markdown]
# ## What is removed

# %% mystnb={"figure": {"name": "fig-sdecgmca-mixing", "caption": "The spectra that SDecGMCA removes, at one resolution: columns of the mixing matrix against frequency. The first three are smooth. The others have no foreground left to describe and follow HI: the spikes are structure in the nearest channels, where HI varies most."}}
study.mixing_figure(selected, remover)

# %% mystnb={"figure": {"name": "fig-sdecgmca-sources", "caption": "The sources that go with these spectra, at the resolution of the best channel, in mK summed over channels. Colours span the central 96 % of the pixels."}}
study.sources_figure(selected, remover)

# %% [markdown]
# ## What is left

# %% mystnb={"figure": {"name": "fig-sdecgmca-maps", "caption": "One channel in the middle of the band: observed, cleaned by SDecGMCA, the truth (HI plus noise), and what is wrong. Channel means removed; colours span 1 to 99 % of the pixels, the same for cleaned and truth."}}
study.channel_figure(selected, remover)

# %% mystnb={"figure": {"name": "fig-sdecgmca-angular", "caption": "Angular power spectrum after SDecGMCA for the three beams, with the numbers of sources of the paper, and its ratio to the truth. The grey band is 10 %. (SDecGMCA's share of the paper's Fig. 1.)"}}
study.angular_figure(removers)

# %% mystnb={"figure": {"name": "fig-sdecgmca-frequency", "caption": "Frequency power spectrum after SDecGMCA for the three beams, and its ratio to the truth. The grey band is 10 %. (SDecGMCA's share of the paper's Fig. 2.)"}}
study.frequency_figure(removers)

# %% [markdown]
# The same numbers in bands, with those for three sources through the oscillating beam. Three is what the sky itself
# needs; the beam adds none, because the model holds it.

# %%
numbers = study.band_numbers(removers)
with_three = sdecgmca_for(beams["oscillating"], iteration=iteration, n_sources=3)
for name, value in study.bands(beams["oscillating"], with_three).items():
    numbers[f"oscillating, 3 sources: {name}"] = (value, 0.02)
for each, methods in removers.items():
    numbers[f"{each}: settled"] = study.assessed(each, methods[0]).converged
show(numbers)

# %% tags=["hide-input"]
oscillating = beams["oscillating"]
_, _, k, frequency = study.ratios(oscillating, with_three)
deviation = np.abs(frequency - 1)[k > 0.1]
brightest = study.cleaned(selected, remover).sources[0].std() / np.sqrt(study.survey.n_channels)  # rms, mK
contrast = brightest / observed.truth.std()
quote(
    sdecgmca_iterations=(study.cleaned(oscillating, removers[oscillating][0]).n_iterations, 3),
    sdecgmca_low=numbers["oscillating, SDecGMCA: C/C0, 1 < l < 10"],
    sdecgmca_three_low=numbers["oscillating, 3 sources: C/C0, 1 < l < 10"],
    sdecgmca_three_fine=(100 * deviation.max(), 0.5, "%"),
    sdecgmca_largest=(contrast, 0.05 * contrast),
)

# %% [markdown]
# ## How far to trust it
#
# An answer that changes when nothing of importance changes is no answer. So we change what should not matter, here for the oscillating
# beam: the noise level that the thresholds are told, by 0.1 %; and the noise itself, another realisation of the same strength. The iteration as C21 and the paper describe
# it (`iteration="published"`) is compared with the one that this book uses (`"stable"`).

# %%
case = study.case(beams["oscillating"])
observation = study.observed(beams["oscillating"])
sigma = noise_sigma(case.survey)
masked = study.peak_masked(beams["oscillating"]).maps
other = noise_maps(case.survey, np.random.default_rng(1)) - noise_maps(case.survey, case.survey.rng("noise"))
alms = {"own": pipeline.truth_alms(case)}
alms["other"] = alms["own"] + sphere.analyse(other)


def ratios(which, *, level=1.0, noise="own"):
    """C/C0 and P/P0 of one run with another noise level, or with other noise."""
    method = sdecgmca_for(beams["oscillating"], iteration=which, noise=tuple(level * sigma))
    extra = other if noise == "other" else 0
    maps, known = observation.maps + extra, {"freqs": observation.freqs, "beams": observation.beams}
    residual = method.clean(maps, **known, separate_on=masked + extra).residual
    truth, width = observation.truth + extra, case.survey.channel_width
    recovered = recovered_angular_power(residual, truth, alms[noise]).mean
    return (
        recovered[2:] / sphere.power_spectrum(alms[noise]).mean(axis=0)[2:],
        (frequency_power(residual, width).power / frequency_power(truth, width).power)[1:],
    )


changes = {
    "as it is": {},
    "noise level + 0.1 %": {"level": 1.001},
    "other noise": {"noise": "other"},
}
runs = {
    which: {name: ratios(which, **change) for name, change in changes.items()}
    for which in ("published", "stable")
}

# %% mystnb={"figure": {"name": "fig-sdecgmca-sensitivity", "caption": "C/C0 after SDecGMCA for the oscillating beam, when nothing of importance changes. Left: the published iteration. Right: the stable one; its curves lie on each other."}}
looks = [(styles.BLUE, "-"), (styles.ORANGE, "--"), (styles.GREEN, ":")]
degrees = np.arange(2, 2 + len(runs["stable"]["as it is"][0]))
panels = [
    {
        "curves": [
            (degrees, angular, {"label": name, "color": colour, "linestyle": line})
            for (name, (angular, _)), (colour, line) in zip(results.items(), looks, strict=True)
        ],
        "title": which,
        "xlabel": styles.AXES["angular"]["xlabel"],
        "ylabel": r"$C / C_0$",
        "xscale": "log",
        "xlim": (2, study.l_top),
        "ylim": (0.4, 1.6),
    }
    for which, results in runs.items()
]
study.stamped(plotting.lines(panels), beam="oscillating")

# %% [markdown]
# In numbers: the largest difference between any two of the runs, of the mean C/C0 over three ranges of $\ell$, and of P/P0 where the
# ripple shows.

# %%
k = 2 * np.pi * np.fft.rfftfreq(case.survey.n_channels, case.survey.channel_width)[1:]
near_ripple = (k > 0.25) & (k < 0.38)


def spread(values):
    """Largest minus smallest."""
    return float(np.ptp(np.array(values)))


numbers = {}
for which, results in runs.items():
    for low, high in ((2, 10), (10, 30), (30, study.l_top)):
        inside = (degrees >= low) & (degrees < high)
        value = spread([angular[inside].mean() for angular, _ in results.values()])
        numbers[f"{which}: spread of C/C0, {low} <= l < {high}"] = (
            value,
            0.005 if which == "stable" else 0.3,
        )
    if near_ripple.any():
        value = spread([frequency[near_ripple].mean() for _, frequency in results.values()])
        numbers[f"{which}: spread of P/P0 near k = 0.31"] = (value, 0.005 if which == "stable" else 0.3)
show(numbers)

# %% tags=["hide-input"]
published, stable = (runs[which]["as it is"][0] for which in ("published", "stable"))
quote(
    sdecgmca_published_low=(published[degrees < 10].mean(), 0.1),
    sdecgmca_stable_low=(stable[degrees < 10].mean(), 0.02),
    sdecgmca_apart=(np.abs(published - stable)[(degrees >= 10) & (degrees < study.l_top)].max(), 0.05),
)

# %% [markdown]
# The tolerance of the published iteration's numbers is as wide as it must be: on another computer, whose last digits differ, they come
# out differently. How far it strays depends on the sky: run this notebook with `galaxy=templates`. It need not be further from the truth: its mean
# $C/C_0$ below $\ell = 10$ is {glue:text}`sdecgmca_published_low` here, that of the stable one {glue:text}`sdecgmca_stable_low`; from there on the two differ by
# {glue:text}`sdecgmca_apart` at most at any multipole. With three sources, as above, that of the stable one is {glue:text}`sdecgmca_three_low`.
#
# ## Why, and what the stable iteration does about it
#
# The largest source is {glue:text}`sdecgmca_largest` times brighter than HI and noise (rms, through the beam shown in detail), and the sources overlap: they *cancel* each other to that precision in
# every channel. A threshold cuts some of one source where it leaves the others, and the cancellation is gone. Through one
# beam this would average out. Through beams that differ it does not: what was cut stays in the data,
# blurred differently in each channel, and the least-squares $\mathbf{A}$ bends to describe it.
#
# The cure is to subtract the *whole* sources before asking what is left for $\mathbf{A}$,
#
# ```{math}
# :label: eq-sdecgmca-correction
# \sum_{\ell m} \hat H_\nu^\ell \left( \hat X_\nu^{\ell m} - \hat H_\nu^\ell\, \mathbf{A}_\nu \hat{\mathbf{S}}^{\ell m} \right) \hat{\mathbf{T}}^{\ell m\,\top} = 0 ,
# ```
#
# with $\hat{\mathbf{T}}$ the thresholded sources, which now only choose *where* to look. Whatever they leave out, the true $\mathbf{A}$ solves
# {eq}`eq-sdecgmca-correction` in the absence of noise. To see it, take a sky without HI and noise, start from its own
# spectra, and make one step of either kind.

# %%
foreground = observation.maps - observation.truth
lmax = min(remover.lmax, study.l_top)
modes = analysed(foreground - foreground.mean(axis=1, keepdims=True)).upto(lmax)
ratio = observation.beams[:, : lmax + 1] / observation.beams[:, : lmax + 1].max(axis=0)
pure = BlurredMixture(modes, ratio, sigma**2 * 4 * np.pi / case.survey.n_pix)
method = sdecgmca_for(beams["oscillating"])
cleaned = method.clean(foreground, freqs=observation.freqs, beams=observation.beams)
start = cleaned.separation.mixing


def residual_of(mixing):
    """rms of the foreground that the space of `mixing` leaves, over the rms of HI and noise."""
    sources = harmonic.project(harmonic.safe_inverse(pure.matrices(mixing)), pure.modes)
    rms = np.sqrt(np.sum(pure.residual(mixing, sources) ** 2) / (4 * np.pi * case.survey.n_channels))
    return rms / observation.truth.std()


inverses = harmonic.safe_inverse(pure.matrices(start))
sources = harmonic.project(inverses, pure.modes)
numbers = {"foreground left over HI and noise, start": (residual_of(start), 0.01)}
for share in (0.3, 0.7):
    sparse = SparseSources(lmax, remover.n_scales, n_sigma=3, analytic=True)
    kept = sparse(sources, pure.noise_of(inverses), share)
    residual = pure.residual(start, sources)
    fitted, corrected = pure.fit(kept, sparse.detail), pure.corrected(start, residual, sources, kept)
    numbers[f"published step, {share:.0%} kept"] = (residual_of(fitted), 0.5)
    numbers[f"stable step, {share:.0%} kept"] = (residual_of(corrected), 0.01)
show(numbers)

# %% [markdown]
# The rest is the noise of HI in $\mathbf{A}$, which no iteration can remove: it is the loss of power that every blind method suffers.
#
# ## What it costs, and how it fails
#
# An iteration needs one transform of each source and scale, and products with the data that are matrix products at each $\ell$. The stable
# iteration settles in {glue:text}`sdecgmca_iterations` of them on the oscillating beam, the published one takes up to 200. The last step, the projection at every
# $\ell$, needs a few dozen transforms however many channels there are.
#
# - Near $\ell = 3\,N_\mathrm{side}$ the pixels hold a field badly, and so do the transforms. What is bright is therefore analysed by least squares; with plain
#   quadrature the leaks raise P/P0 near $k_\nu = 0.3$.
# - A beam that is not the true one is a ripple in every source: the method trusts what it is given.
# - More sources than the sky has are spent on HI. Through the oscillating beam, with 5 the power at $\ell < 10$ falls to {glue:text}`sdecgmca_low` of the
#   truth, with 3 to {glue:text}`sdecgmca_three_low`.
#
# ## What to take away
#
# - With the beam in the model three sources are enough for the oscillating beam too, and both spectra are those of the degraded beam: the ripple is gone,
#   to {glue:text}`sdecgmca_three_fine` at $k_\nu > 0.1$.
# - The paper's 4 and 5 sources are needed by methods that do not know the beam. Here they cost signal at low $\ell$ and low $k_\nu$.
# - The published iteration is sensitive because thresholds break the cancellation of large sources through different beams. Subtracting whole sources cures it.
#
# Three commands worth trying:
#
# ```sh
# himap run 09_sdecgmca -p n_sources=3                       # what the sky itself needs
# himap run 09_sdecgmca -p iteration=published               # the iteration as published
# himap run 09_sdecgmca -p ripple=additive_strong            # a ripple five times stronger
# ```
