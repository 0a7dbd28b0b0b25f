# ---
# jupyter:
#   himap:
#     figures: []
#     section: 3.1.1
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
# # Principal component analysis
#
# > - **Read first**: {doc}`02_beams_and_noise`, {doc}`03_peak_masking`.
# > - **Good to know**: eigenvectors of a covariance matrix.
# > - **Time and memory**: {cost}`04_pca`.
#
# Foregrounds dominate the variance of the data and are described by few spectra, while HI changes from
# channel to channel. Principal component analysis (PCA) estimates these spectra from the covariance of the
# channels and removes them {cite:p}`alonso2015,cunnington2021`. {cite:t}`gkogkou2025` (Sect. 4.2) remove 3, 4
# and 5 components for the degraded, the evolving and the oscillating beam. This chapter does the same, in
# detail for one beam (by default the degraded) and then for all three.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "degraded"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 3  # components to remove, for the beam shown in detail

# %%
import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
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
from himap.removal.covariance import channel_covariance
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
removers = {beam: [PCA(n_sources=table_1(beam)["n_sources"])] for beam in beams.values()}
removers[selected] = [PCA(n_sources=n_sources)]
study.check(removers)
remover = removers[selected][0]

# %% [markdown]
# ## The method
#
# The maps, less the mean of each channel, are a matrix $\mathbf{X}$ of channels by pixels. PCA assumes the linear mixture
#
# ```{math}
# :label: eq-mixture
# \mathbf{X} = \mathbf{A}\,\mathbf{S} + \mathbf{N}
# ```
#
# of $n_s$ *sources* $\mathbf{S}$ (maps) with a *mixing matrix* $\mathbf{A}$ (spectra), where $\mathbf{N}$ is
# HI and noise. If the sources are uncorrelated, $\mathbf{A}$ diagonalises the covariance of the channels,
#
# ```{math}
# :label: eq-covariance
# \mathbf{C} = \frac{1}{n_\mathrm{pix}}\,\mathbf{X}\,\mathbf{X}^{\top} = \mathbf{U}\,\mathbf{D}\,\mathbf{U}^{\top} ,
# ```
#
# with eigenvectors $\mathbf{U}$ and variances $\mathbf{D}$. The $n_s$ eigenvectors of largest variance are
# $\mathbf{A}$, the sources are $\mathbf{S} = \mathbf{A}^{\top}\mathbf{X}$, and the cleaned maps are
#
# ```{math}
# :label: eq-pca-residual
# \mathbf{R} = \mathbf{X} - \mathbf{A}\,\mathbf{A}^{\top}\,\mathbf{X}.
# ```
#
# This projection removes everything along the $n_s$ spectra, **HI included**. If $n_s$ is too small,
# foreground remains; if it is too large, signal is removed. $\mathbf{A}$ and $\mathbf{S}$ are obtained from
# maps with masked peaks, but $\mathbf{A}\,\mathbf{S}$ is subtracted from the original maps
# ({doc}`03_peak_masking`), so the peaks are not removed.

# %% [markdown]
# ## The number of components
#
# Eigenvalues of the foreground fall by orders of magnitude from one to the next; those of HI plus noise
# (dotted; unknown in a real survey) form a plateau. The steeper the fall, the fewer components are needed.
# For the degraded, evolving and oscillating beam {glue:text}`pca_above_degraded`,
# {glue:text}`pca_above_evolving` and {glue:text}`pca_above_oscillating` eigenvalues exceed the largest of HI
# plus noise; if the paper removes fewer, foreground residual is expected.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-pca-eigenvalues", "caption": "The 15 largest eigenvalues of the channel covariance for the three beams, and of HI plus noise through the one that this chapter shows in detail, by default the degraded."}}
rank = np.arange(1, min(15, study.survey.n_channels) + 1)


def eigenvalues(maps):
    """The largest eigenvalues of the channel covariance, mK^2, descending."""
    return np.linalg.eigvalsh(channel_covariance(maps))[::-1][: len(rank)]


observed = {beam: eigenvalues(study.observed(beam).maps) for beam in removers}
curves = [(rank, values, styles.beam_style(beam) | {"marker": "."}) for beam, values in observed.items()]
truth = eigenvalues(study.observed(selected).truth)
curves.append((rank, truth, {"color": "black", "linestyle": ":", "label": f"HI + noise ({selected})"}))
labels = {"xlabel": "component", "ylabel": r"eigenvalue [mK$^2$]", "yscale": "log"}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 4)))

# %% tags=["hide-input"]
above = {
    name: np.count_nonzero(observed[beam] > eigenvalues(study.observed(beam).truth)[0])
    for name, beam in beams.items()
}
quote(
    pca_above_degraded=above["degraded"],
    pca_above_evolving=above["evolving"],
    pca_above_oscillating=above["oscillating"],
)

# %% [markdown]
# ## The removed components
#
# For a beam that does not change with frequency the spectra are smooth: the mean spectrum of the Galaxy, and
# its variations over the sky.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-pca-mixing", "caption": "The spectra that PCA removes: columns of the mixing matrix against frequency, each of unit length."}}
mixing_figure(study, selected, remover)

# %% [markdown]
# As the spectra are orthogonal and ordered by variance, no source is synchrotron or free-free emission.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-pca-sources", "caption": "The sources that PCA removes, in mK summed over channels (spectra have unit length). Colours: central 96 % of the pixels."}}
sources_figure(study, selected, remover)

# %% [markdown]
# ## The cleaned maps
#
# The difference shows foreground residual along the Galactic plane and around its centre; at high latitude
# foreground residual and signal loss are of similar size ({doc}`12_post_masking`).

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-pca-maps", "caption": "A channel in the middle of the band, through the oscillating beam: observed, cleaned by PCA, true (HI plus noise), and cleaned minus true. Channel means removed; colours span 1 to 99 % of the pixels, alike for cleaned and true; white: no error."}}
hardest = beams["oscillating"]  # whatever beam is shown in detail
channel_figure(study, hardest, removers[hardest][0])

# %% [markdown]
# ## The power spectra
#
# With the degraded beam the ratios are below 1, as the components contain signal. With the
# oscillating beam they are above 1, most at the lowest (as in the paper) and highest $\ell$.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-pca-angular", "caption": "Angular power spectrum, averaged over channels, of the cleaned maps for the three beams, and its ratio to the truth. Grey band: 10 %; ratios are linear near 1, logarithmic beyond. (Part of the paper's Fig. 1.)"}}
angular_figure(study, removers)

# %% [markdown]
# The excess at small $k_\nu$ with the oscillating beam and the narrow peak at the wavenumber of the ripple,
# also found in the paper, are foreground that five components do not describe.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-pca-frequency", "caption": "Frequency power spectrum, averaged over lines of sight, of the cleaned maps for the three beams, and its ratio to the truth. Grey band: 10 %; ratios are linear near 1, logarithmic beyond. (Part of the paper's Fig. 2.)"}}
frequency_figure(study, removers)

# %% [markdown]
# The table lists means of the ratios over bands, and the highest ratio near
# $k_\nu = 2\pi/(20\,\mathrm{MHz}) \approx 0.31\,\mathrm{MHz}^{-1}$, the wavenumber of the ripple.

# %% tags=["hide-input"]
show(study.band_numbers(removers))


# %% tags=["hide-input"]
def band(name, start, method=None):
    """The number of the table whose band begins with `start`, to quote; nan where the run has no such band."""
    bands = study.bands(beams[name], method or removers[beams[name]][0])
    value = next((value for label, value in bands.items() if label.startswith(start)), np.nan)
    return value, 0.02 * max(1, value)


_, angular, _, frequency = study.ratios(beams["evolving"], removers[beams["evolving"]][0])
six = PCA(n_sources=6)
quote(
    pca_n_degraded=removers[beams["degraded"]][0].n_sources,
    pca_n_evolving=removers[beams["evolving"]][0].n_sources,
    pca_n_oscillating=removers[beams["oscillating"]][0].n_sources,
    pca_angular_degraded=band("degraded", "C/C0, 10"),
    pca_middle_degraded=band("degraded", "P/P0, 0.03"),
    pca_low_degraded=band("degraded", "P/P0, 0 "),
    pca_first_evolving=(frequency[0], 0.02),
    pca_second_evolving=(frequency[1], 0.04),
    pca_last_evolving=(angular[-1], 0.02),
    pca_largest_scales=band("oscillating", "C/C0, 1 "),
    pca_angular_oscillating=band("oscillating", "C/C0, 10"),
    pca_middle_oscillating=band("oscillating", "P/P0, 0.03"),
    pca_ripple=band("oscillating", "P/P0, highest"),
    pca_ripple_of_six=band("oscillating", "P/P0, highest", six),
    pca_low_of_six=band("oscillating", "P/P0, 0 ", six),
    pca_largest_scales_of_six=band("oscillating", "C/C0, 1 ", six),
)

# %% [markdown]
# ## Conclusions
#
# All numbers are from this run.
#
# - **Degraded beam, {glue:text}`pca_n_degraded` components**: the mean $C/C_0$ is
#   {glue:text}`pca_angular_degraded` at $\ell > 10$, and $P/P_0$ {glue:text}`pca_middle_degraded` at
#   $0.03 < k_\nu < 0.1$ MHz$^{-1}$. At smaller $k_\nu$, where HI is as smooth as the foregrounds, it is
#   {glue:text}`pca_low_degraded`.
# - **Evolving beam, {glue:text}`pca_n_evolving` components**: $P/P_0$ is {glue:text}`pca_first_evolving` at
#   the smallest $k_\nu$, a signal loss, and {glue:text}`pca_second_evolving` at the next, a foreground
#   residual; $C/C_0$ is {glue:text}`pca_last_evolving` at $\ell = 2\,N_\mathrm{side}$.
# - **Oscillating beam, {glue:text}`pca_n_oscillating` components**: $C/C_0$ is
#   {glue:text}`pca_largest_scales` at $\ell < 10$ and {glue:text}`pca_angular_oscillating` at $\ell > 10$,
#   $P/P_0$ is {glue:text}`pca_middle_oscillating` at $0.03 < k_\nu < 0.1$ MHz$^{-1}$ and
#   {glue:text}`pca_ripple` at the wavenumber of the ripple. With six components the latter is
#   {glue:text}`pca_ripple_of_six`, but signal is removed: $P/P_0$ is {glue:text}`pca_low_of_six` below $0.03$
#   MHz$^{-1}$, and $C/C_0$ is {glue:text}`pca_largest_scales_of_six` at $\ell < 10$.
#
# ## Exercise
#
# With one more component than in the paper for the oscillating beam, what happens to the peak at the ripple,
# and at what cost?
#
# ```sh
# himap run 04_pca -p beam=oscillating -p n_sources=6
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The peak and the excess at low $\ell$ vanish: both were the same component of the foreground. The cost is
# signal loss: the ratios are below 1 on large scales and at small $k_\nu$.
#
# </details>
