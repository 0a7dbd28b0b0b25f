# ---
# jupyter:
#   himap:
#     figures: ["1", "2"]
#     section: "4.2"
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
# # Six methods, three beams
#
# All methods of the chapters before on all three beams of {doc}`02_beams_and_noise`: the main result of
# {cite:t}`gkogkou2025`. Every method gets the same maps, with their peaks masked ({doc}`03_peak_masking`), and what it finds is
# subtracted from the maps as observed. The component methods remove 3, 4 and 5 components for the three beams, as in the paper.
#
# The truth is HI plus noise through the same beam. A curve above it is foreground that was left, a curve below it is signal that was lost;
# a ratio of 1 may also be some of each.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_degraded: int = 3  # components for the degraded beam
n_evolving: int = 4  # components for the evolving beam
n_oscillating: int = 5  # components for the oscillating beam
iteration: str = "stable"  # SDecGMCA: stable or published

# %%
import warnings

import numpy as np

from himap.figures import styles
from himap.figures.numbers import quote, show_table
from himap.paper.methods import methods_for, paper_beams
from himap.paper.study import Study
from himap.removal.base import SeparationWarning

beams = paper_beams(ripple=ripple)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    keep_cubes=False,
)
n_sources = {"degraded": n_degraded, "evolving": n_evolving, "oscillating": n_oscillating}
removers = {beams[name]: methods_for(beams[name], n, iteration=iteration) for name, n in n_sources.items()}
study.check(removers)
warnings.simplefilter("ignore", SeparationWarning)  # which methods did not settle is listed at the end
titles = {beams[name]: f"{name}, {n} components" for name, n in n_sources.items()}

# %% [markdown]
# ## Across the sky

# %% mystnb={"figure": {"name": "fig-results-angular", "caption": "Angular power spectrum, averaged over channels, of what six methods leave, for the degraded, evolving and oscillating beam, and its ratio to the truth below (the paper's Fig. 1). The grey band is 10 %; curves above 2 are cut off. PCA and FastICA remove the same foreground, so their curves coincide; with the degraded beam those of GMCA and SDecGMCA lie on them too. The fits have no number of components."}}
study.angular_figure(removers, titles=titles)

# %% [markdown]
# ## Along the line of sight

# %% mystnb={"figure": {"name": "fig-results-frequency", "caption": "Frequency power spectrum, averaged over lines of sight, of what six methods leave, for the three beams, and its ratio to the truth below (the paper's Fig. 2). The grey band is 10 %; curves above 2 are cut off, as is the parametric fit for the last two beams throughout. PCA and FastICA coincide."}}
study.frequency_figure(removers, titles=titles)

# %% [markdown]
# ## In numbers
#
# Means of both ratios over ranges of $\ell$ and of $k_\nu$ (in MHz$^{-1}$), and the highest P/P0 near $k_\nu = 2\pi/20$ MHz, where the ripple
# of the oscillating beam shows.

# %%
table = {
    f"{beam}, {styles.method_style(method)['label']}": {
        name: (value, 0.02 * max(1, value)) for name, value in study.bands(beam, method).items()
    }
    for beam, methods in removers.items()
    for method in methods
}
show_table(table)

# %% [markdown]
# Which of them say that they did not settle:

# %%
unsettled = [
    f"{beam}, {styles.method_style(method)['label']}"
    for beam, methods in removers.items()
    for method in methods
    if not study.assessed(beam, method).converged
]
print("; ".join(unsettled) or "none")

# %% tags=["hide-input"]
low, fine = "C/C0, 1 < l < 10", f"C/C0, 10 < l < {min(200, study.l_top)}"
slow, middle, fast = "P/P0, 0 < k < 0.03", "P/P0, 0.03 < k < 0.1", "P/P0, k > 0.1"
peak = "P/P0, highest near k = 0.31"
nothing = (np.nan, 0.02)  # a band without values


def entry(row, band):
    """One number of the table, with its tolerance."""
    return table[row].get(band, nothing)


def furthest(labels, *bands):
    """Largest distance from 1 of some bands for some methods with the degraded beam, in percent."""
    values = [entry(f"degraded, {label}", band)[0] for label in labels for band in bands]
    return 100 * np.nanmax(np.abs(np.array(values) - 1)), 1, "%"


def least(beam, label):
    """Smallest of the numbers of a row of the table."""
    return min(table[f"{beam}, {label}"].values())


quote(
    results_degraded_off=furthest(
        ("PCA", "FastICA", "GMCA", "SDecGMCA", "parametric"), low, fine, middle, fast
    ),
    results_degraded_slow=entry("degraded, PCA", slow),
    results_degraded_polynomial=entry("degraded, polynomial", low),
    results_evolving_parametric=least("evolving", "parametric"),
    results_evolving_pca_slow=entry("evolving, PCA", slow),
    results_evolving_gmca_slow=entry("evolving, GMCA", slow),
    results_oscillating_pca_low=entry("oscillating, PCA", low),
    results_oscillating_gmca_low=entry("oscillating, GMCA", low),
    results_oscillating_pca_fine=entry("oscillating, PCA", fine),
    results_oscillating_gmca_fine=entry("oscillating, GMCA", fine),
    results_oscillating_pca_peak=entry("oscillating, PCA", peak),
    results_oscillating_gmca_peak=entry("oscillating, GMCA", peak),
    results_oscillating_sd_low=entry("oscillating, SDecGMCA", low),
    results_oscillating_sd_fine=entry("oscillating, SDecGMCA", fine),
    results_oscillating_sd_peak=entry("oscillating, SDecGMCA", peak),
)

# %% [markdown]
# ## What to take away
#
# - **Degraded beam.** One resolution everywhere: in the bands of the table the component methods and the parametric fit are off by
#   {glue:text}`results_degraded_off` at most, but for $k_\nu < 0.03$ MHz$^{-1}$, where signal is lost with the foregrounds (PCA keeps
#   {glue:text}`results_degraded_slow` of the power). The polynomial of order 6 does not quite follow the Galactic plane: its mean $C/C_0$ at $\ell < 10$ is
#   {glue:text}`results_degraded_polynomial`.
# - **Evolving beam.** The parametric fit leaves {glue:text}`results_evolving_parametric` times the power of the truth in its best band. The component methods hold; those
#   that do not know the beam leave some foreground at $k_\nu < 0.1$ MHz$^{-1}$ (mean $P/P_0$ below 0.03 MHz$^{-1}$: PCA {glue:text}`results_evolving_pca_slow`, GMCA
#   {glue:text}`results_evolving_gmca_slow`) and at high $\ell$.
# - **Oscillating beam.** Both fits fail. PCA, FastICA and GMCA leave an excess at low $\ell$ (mean $C/C_0$ of PCA {glue:text}`results_oscillating_pca_low`, of GMCA
#   {glue:text}`results_oscillating_gmca_low`) and at high $\ell$ ({glue:text}`results_oscillating_pca_fine` and {glue:text}`results_oscillating_gmca_fine`), and a
#   peak at $k_\nu = 2\pi/20$ MHz ({glue:text}`results_oscillating_pca_peak` and {glue:text}`results_oscillating_gmca_peak` times the truth). SDecGMCA, which knows the beam,
#   leaves neither ({glue:text}`results_oscillating_sd_low`, {glue:text}`results_oscillating_sd_fine` and {glue:text}`results_oscillating_sd_peak`). What it loses at low
#   $\ell$ it loses to sources that the sky does not have: with three instead of five the loss is that of the degraded beam ({doc}`09_sdecgmca`).
# - PCA and FastICA are one method as far as the cleaned maps are concerned ({doc}`05_fastica`).
#
# This is one sky with a synthetic Galaxy, at the preset `quick`: a quarter of the paper's resolution in pixels and in frequency. {doc}`18_paper_size` has the
# paper's size, with the real Galaxy (templates, nside 64) and with this one.
#
# Three commands worth trying:
#
# ```sh
# himap run 10_results -p n_oscillating=6                      # one component more for the hardest case
# himap run 10_results -p ripple=additive_strong               # a ripple five times stronger
# himap run 10_results --preset laptop                         # twice the resolution
# ```
