# ---
# jupyter:
#   himap:
#     figures: []
#     section: ''
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
# # Your own cube
#
# > - **Read first**: {doc}`04_pca`.
# > - **Good to know**: HEALPix maps and FITS files.
# > - **Time and memory**: {cost}`17_your_own_cube`.
#
# This chapter cleans a cube in an inconvenient format: a FITS file written by healpy, in kelvin, NESTED, with
# unsorted channels and part of the sky missing. The truth is used only at the end. On the command line:
#
# ```sh
# himap suggest cube.fits --freqs freqs.txt -o how_many.html
# himap clean cube.fits --freqs freqs.txt --method pca -p n_sources=6 -o cleaned.fits
# ```

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, meerkat or a file of widths or b_l
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
missing: float = 0.3  # share of the sky that is not seen
n_most: int = 9  # largest number of sources to try

# %% tags=["hide-input"]
import tempfile
import warnings
from pathlib import Path

import healpy as hp
import numpy as np

from himap.core.errors import InputError
from himap.cubes import beams_of, clean_cube, read_cube, save_cleaned, suggest
from himap.cubes.report import compared, maps_figure, modes_figure, spectra_figure
from himap.cubes.suggestion import advice, views_figure
from himap.figures.numbers import show, show_table
from himap.measures import diagnostics
from himap.measures.n_sources import STABLE
from himap.paper.methods import beam_called
from himap.paper.study import Study
from himap.removal.base import SeparationWarning

warnings.simplefilter("ignore", SeparationWarning)  # the reports say which methods settle
selected = beam_called(beam, ripple=ripple)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
)

# %% [markdown]
# ## The file
#
# The maps are those of {doc}`02_beams_and_noise`, seen through `beam`. The north of the sky is missing, as
# for a telescope in the south.

# %% tags=["hide-input"]
observation = study.observed(selected)
study.survey.check_untapered()
nside = study.survey.nside
rng = np.random.default_rng(1)
order = rng.permutation(len(observation.freqs))

galactic = hp.pix2ang(nside, np.arange(hp.nside2npix(nside)))
colatitude = hp.Rotator(coord=["G", "C"])(*galactic)[0]  # equatorial
gap = colatitude < np.quantile(colatitude, missing)

temporary = tempfile.TemporaryDirectory()  # deleted when this notebook ends
folder = Path(temporary.name)
for name, maps in (("cube", observation.maps), ("truth", observation.truth)):
    kelvin = np.where(gap, hp.UNSEEN, maps[order] / 1e3).astype(np.float32)
    nested = np.array([hp.reorder(channel, r2n=True) for channel in kelvin])
    hp.write_map(folder / f"{name}.fits", nested, nest=True, column_units="K", dtype=np.float32)
np.savetxt(folder / "freqs.txt", observation.freqs[order], fmt="%.6f")

# %% [markdown]
# ## Reading it
#
# `read_cube` sorts the channels, converts pixels to RING and temperatures to mK, and masks pixels that are
# not observed in every channel. Its `remarks` list what it assumed and omitted. It raises an error if
# required information is neither in the file nor can be inferred.

# %%
cube = read_cube(folder / "cube.fits", freqs=folder / "freqs.txt")
print(*cube.remarks, sep="\n")
print(f"{len(cube.freqs)} channels from {cube.freqs[0]:g} to {cube.freqs[-1]:g} MHz, nside {cube.nside}")

# %%
try:
    read_cube(folder / "cube.fits")
except InputError as error:
    print(str(error).replace(str(folder), "..."))

# %% [markdown]
# ## How many sources?
#
# Three criteria need no truth: the number of eigenvalues above the smooth decline of HI and noise, the
# minimum of an information criterion, and the number after which one more source changes the spectra little.
# `himap suggest` recommends the number on which the first two agree. If they disagree, it recommends for a
# beam-aware method the number of the second if the spectra are stable after it, and otherwise the range
# between the two. It recommends none if no number is stable or the second criterion still falls at the last
# one. On part of the sky the eigenvalues of a beam-aware method include those added by the beam, and only the
# second criterion is used. {doc}`22_how_many` measures how often each is right, on full skies.

# %% mystnb={"figure": {"name": "fig-own-suggestion", "caption": "Left: eigenvalues of the channel covariance, and the decline of HI and noise (dashed). Middle: Bayesian information criterion, linear below 2 and logarithmic above. Right: change of the spectra with one more source; the dashed line is 10 %."}}
suggestion = suggest(cube, "pca", n_sources=range(1, n_most + 1))
study.stamped(views_figure(suggestion), beam=selected, missing=missing)

# %% tags=["hide-input"]
print(advice(suggestion))
least = suggestion.n_sources[suggestion.criterion.argmin()]
show(
    {
        "eigenvalues above HI and noise": suggestion.n_bright,
        "number of sources of the least criterion": int(least),
        f"first number after which the spectra change by less than {100 * STABLE:g} %": suggestion.stable
        or "none",
    }
)

# %% [markdown]
# ## Cleaning
#
# PCA works on each line of sight, whichever pixels are missing. For methods that transform maps, unobserved
# pixels are inpainted ({doc}`24_masks`). `--mask` restricts the cleaning to part of the sky.

# %%
n_sources = suggestion.range[1] if suggestion.range else n_most
cleaned = clean_cube(cube, "pca", n_sources=n_sources)

# %% [markdown]
# The left panel shows which eigenvalues were removed. Spectra that oscillate with frequency (right) describe the ripple of the beam.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-own-modes", "caption": "Left: eigenvalues of the cube before and after cleaning. Right: removed spectra."}}
study.stamped(modes_figure(cleaned), beam=selected, n_sources=n_sources, missing=missing)

# %% [markdown]
# Foreground residual would appear in the rms along the Galactic plane.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-own-maps", "caption": "Residual in the channel in the middle of the band, and its rms over all channels. Unobserved pixels are white."}}
study.stamped(maps_figure(cleaned), beam=selected, n_sources=n_sources, missing=missing)

# %% [markdown]
# The command writes these figures to a page. `save_cleaned` writes the cube with the channels, pixels and
# unit of the input in float32, and the foreground in float64 if float32 would lose HI, as below 100 MHz.

# %%
save_cleaned(cleaned, folder / "cleaned.fits")
written = hp.read_map(folder / "cleaned.fits", field=0, nest=None)
print(sorted(path.name for path in folder.glob("cleaned*")))
unseen = np.mean(written == hp.UNSEEN)
print(f"first column: the channel at {observation.freqs[order[0]]:g} MHz, {unseen:.0%} not seen")

# %% [markdown]
# ## Comparison with the truth
#
# For a simulation the truth shows how accurate the result is (`--truth` on the command line). Ratios below 1
# are signal loss: largest at small $k_\nu$ and low $\ell$, and visible at the ripple of the beam. Ratios
# above the grey band would be foreground residual.

# %% mystnb={"figure": {"name": "fig-own-spectra", "caption": "Angular (left) and frequency (right) power spectrum of the residual on the observed sky, and the ratio to the truth. Grey band: 10 %. C_l are decoupled from the mask and binned."}}
truth = read_cube(folder / "truth.fits", freqs=folder / "freqs.txt")
study.stamped(spectra_figure(compared(cleaned, truth)), beam=selected, n_sources=n_sources, missing=missing)

# %% [markdown]
# The errors for each number of sources show whether the suggested number was right:


# %% tags=["hide-input"]
def errors_of(comparison):
    """Means of both ratios over bands, and the peak, for `show_table`."""
    angular, frequency = comparison.angular_ratio, comparison.frequency_ratio
    low = diagnostics.inside(comparison.degrees, angular, 0, 10).mean()
    high = diagnostics.inside(comparison.degrees, angular, 10, 2 * nside).mean()
    smooth = diagnostics.inside(comparison.k, frequency, 0, 0.05).mean()
    peak = diagnostics.inside(comparison.k, frequency, *diagnostics.BUMP).max()
    return {
        "C/C0, l < 10": (low, 0.02 * max(1, low)),
        "C/C0, beyond": (high, 0.02 * max(1, high)),
        "P/P0, k < 0.05": (smooth, 0.02 * max(1, smooth)),
        "highest P/P0 near k = 0.31": (peak, 0.02 * max(1, peak)),
    }


tried = range(max(n_sources - 2, 1), n_sources + 3)
show_table({f"{n} sources": errors_of(compared(clean_cube(cube, "pca", n_sources=n), truth)) for n in tried})

# %% [markdown]
# ## The whole sky, with the beam
#
# BeamSubspace includes the beam in its model. It cleans the same sky without the gap, with the number of
# eigenvalues that exceed HI and noise at one resolution; PCA has the number from above. On the command line:
# `himap clean whole.fits --freqs freqs.txt --method beam_subspace --beam oscillating -p n_sources=3 -o cleaned.fits`.

# %%
hp.write_map(folder / "whole.fits", observation.maps[order] / 1e3, column_units="K", dtype=np.float32)
hp.write_map(folder / "sky.fits", observation.truth[order] / 1e3, column_units="K", dtype=np.float32)
whole, sky = (read_cube(folder / f"{name}.fits", freqs=folder / "freqs.txt") for name in ("whole", "sky"))
windows = beams_of(whole, selected)
known = suggest(whole, "beam_subspace", n_sources=range(1, n_most + 1), beams=windows).n_bright or 1
rows = {}
for label, left in {
    f"BeamSubspace, {known} sources": clean_cube(whole, "beam_subspace", beams=windows, n_sources=known),
    f"PCA, {n_sources} sources": clean_cube(whole, "pca", n_sources=n_sources),
}.items():
    rows[label] = errors_of(compared(left, sky))
show_table(rows)

# %% [markdown]
# ## Images, weights and flags
#
# FITS image cubes (two sky axes in any projection, one of frequency, in K or mK) are read as they are and
# written with the same header. PCA, FastICA, the two fits, the Gaussian process and GMCA clean them; the
# other methods need the sphere. The page shows $P(k_\perp, k_\parallel)$ in comoving Mpc/h, where foreground
# residual is at the smallest $k_\parallel$; for HEALPix, `--patches` shows it as a mean over flat patches.
#
# ```sh
# himap clean image.fits --method pca -p n_sources=3 -o cleaned.fits
# himap clean image.fits --method pca -p n_sources=3 --weights hits.fits --flags rfi.fits -o cleaned_by_hits.fits
# ```
#
# A pixel that is missing in one channel is excluded in all, except with `--weights` (hits or inverse
# variances) or `--flags` (1 where a voxel is bad). On the command line, PCA and the fits also use pixels that
# lack some channels if these pixels are more than 1 % of those observed (in Python
# `read_cube(..., scattered=True)`); see {doc}`26_a_survey`. {doc}`../book/simulators` covers cubes of other
# codes.
#
# ## What follows
#
# - **The number of sources** can be estimated without the truth if HI and noise are well below the
#   foregrounds: here the criteria agree, and the table of errors confirms them. With one source fewer the
#   ripple of the beam remains; each additional source removes signal on large scales.
# - **A beam-aware method** needs no additional sources for the effect of the beam.
#
# ## Exercise
#
# How many sources does a cube with a single resolution need, and do the criteria agree? Run
# `himap run 17_your_own_cube -p beam=degraded`.
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Fewer than through the oscillating beam, and all criteria give the same number.
#
# </details>
