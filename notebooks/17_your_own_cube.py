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
# All that the other chapters do to simulated maps can be done to maps of your own. This one makes a cube in a format that such maps come in, with all that makes
# them awkward: a FITS file as healpy writes it, in kelvin, NESTED, with channels in no order, and with a part of the sky missing. Then it forgets how the cube was
# made, asks how many sources to remove, removes them, and looks at the result; the truth is taken out again only at the end.
#
# On the command line the whole chapter is
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
from himap.instrument.beams import named
from himap.measures import diagnostics
from himap.paper.methods import paper_beams
from himap.paper.study import Study
from himap.removal.base import SeparationWarning

warnings.simplefilter("ignore", SeparationWarning)  # the reports say which methods settle
beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
)

# %% [markdown]
# ## A file as one gets it
#
# The maps are those of {doc}`02_beams_and_noise`, seen through `beam`, by default the oscillating one. What is
# missing is all that is too far north for a telescope in the south.

# %% tags=["hide-input"]
observation = study.observed(selected)
nside = study.survey.nside
rng = np.random.default_rng(1)
order = rng.permutation(len(observation.freqs))

galactic = hp.pix2ang(nside, np.arange(hp.nside2npix(nside)))
colatitude = hp.Rotator(coord=["G", "C"])(*galactic)[0]  # equatorial
gap = colatitude < np.quantile(colatitude, missing)

folder = Path(tempfile.mkdtemp())
for name, maps in (("cube", observation.maps), ("truth", observation.truth)):
    kelvin = np.where(gap, hp.UNSEEN, maps[order] / 1e3).astype(np.float32)
    nested = np.array([hp.reorder(channel, r2n=True) for channel in kelvin])
    hp.write_map(folder / f"{name}.fits", nested, nest=True, column_units="K", dtype=np.float32)
np.savetxt(folder / "freqs.txt", observation.freqs[order], fmt="%.6f")

# %% [markdown]
# ## Reading it
#
# `read_cube` sorts the channels, turns pixels to RING and temperatures to mK, and masks what is not seen in every channel. What it took for granted or left out is
# among its `remarks`; what a file does not tell, and cannot be guessed, it asks for.

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
# Without the truth there are three things to look at. Foregrounds are few and bright, so their eigenvalues stand above the slow decline of those of HI and noise. An
# information criterion weighs what one more source explains against the numbers that it costs. And as long as foreground is left, the recovered spectra fall steeply with each source;
# once they hardly move, the result does not hang on the choice any more.
#
# Read all three for the same thing: where the eigenvalues meet the dashed line, where the criterion is least, and where the change falls below its
# line. If they name one number, it is a good one.

# %% mystnb={"figure": {"name": "fig-own-suggestion", "caption": "How many sources PCA should remove. Left: eigenvalues of the channel covariance, and the decline of HI and noise. Middle: Bayesian information criterion, on an axis that is linear below 1 and logarithmic above. Right: change of the spectra with one more source; below the dashed line it is less than 10 %."}}
suggestion = suggest(cube, "pca", n_sources=range(1, n_most + 1))
study.stamped(views_figure(suggestion), beam=selected, missing=missing)

# %% tags=["hide-input"]
print(advice(suggestion))
least = suggestion.n_sources[suggestion.criterion.argmin()]
show(
    {
        "eigenvalues that stand out": suggestion.n_bright,
        "number of sources of the least criterion": int(least),
        "first number after which the spectra hardly move": suggestion.stable or "none",
    }
)

# %% [markdown]
# ## Cleaning
#
# The methods that take every line of sight as it comes do not mind the gap. Those that transform whole maps, GMCA and the ones that know the beam among them, go on with the maps smoothly where nothing is seen ({doc}`24_masks` says at what
# cost). A smaller part of the sky than the cube has is asked for with `--mask`.

# %%
n_sources = suggestion.range[1] if suggestion.range else n_most
cleaned = clean_cube(cube, "pca", n_sources=n_sources)

# %% [markdown]
# After cleaning the first eigenvalues are gone and the others are as they were. Of the spectra the first are smooth; those that swing carry the ripple
# of the beam.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-own-modes", "caption": "Left: eigenvalues of the cube as it came and cleaned; the last ones after cleaning, as many as there were sources, are zero but for rounding. Right: spectra of the sources that were removed."}}
study.stamped(modes_figure(cleaned), beam=selected, n_sources=n_sources, missing=missing)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-own-maps", "caption": "What is left in the channel in the middle of the band, and the rms of all channels. White is not seen."}}
study.stamped(maps_figure(cleaned), beam=selected, n_sources=n_sources, missing=missing)

# %% [markdown]
# Structure along the Galactic plane in the rms would be foreground. The command writes these figures, and the spectra, to a page beside the cleaned cube; `save_cleaned`
# writes the cube itself: channels, pixels and unit as they came, so that it can take the place of the old one.

# %%
save_cleaned(cleaned, folder / "cleaned.fits")
written = hp.read_map(folder / "cleaned.fits", field=0, nest=None)
print(sorted(path.name for path in folder.glob("cleaned*")))
unseen = np.mean(written == hp.UNSEEN)
print(f"first column: the channel at {observation.freqs[order[0]]:g} MHz, {unseen:.0%} not seen")

# %% [markdown]
# ## With a truth
#
# On simulations, such as those of CRIME or CoLoRe, the same file without foregrounds tells how good the result is (`--truth` on the command line).
#
# What is below 1 went with the sources: most at the smallest $k_\nu$ and at the lowest $\ell$, and some at the ripple of the beam. Nothing stands above the grey band that would be
# foreground.

# %% mystnb={"figure": {"name": "fig-own-spectra", "caption": "Angular (left) and frequency (right) power spectrum of the cleaned part of the sky, with the ratio to the truth below, where the grey band is 10 %. With a mask C_l are decoupled, in bins."}}
truth = read_cube(folder / "truth.fits", freqs=folder / "freqs.txt")
study.stamped(spectra_figure(compared(cleaned, truth)), beam=selected, n_sources=n_sources, missing=missing)

# %% [markdown]
# And did the advice help? Here are the errors for each number of sources; nobody with a real sky could make this table.


# %% tags=["hide-input"]
def errors_of(comparison):
    """Means of both ratios over bands, and the peak, for `show_table`."""
    angular, frequency = comparison.angular_ratio, comparison.frequency_ratio
    low = diagnostics.band_mean(comparison.degrees, angular, 0, 10)
    high = diagnostics.band_mean(comparison.degrees, angular, 10, 2 * nside)
    smooth = diagnostics.band_mean(comparison.k, frequency, 0, 0.05)
    peak = diagnostics.band_max(comparison.k, frequency, *diagnostics.BUMP)
    return {
        "C/C0, l < 10": (low, 0.02 * max(1, low)),
        "C/C0, beyond": (high, 0.02 * max(1, high)),
        "P/P0, k < 0.05": (smooth, 0.02 * max(1, smooth)),
        "highest P/P0 near k = 0.31": (peak, 0.02 * max(1, peak)),
    }


tried = range(max(n_sources - 2, 1), n_sources + 3)
show_table({f"{n} sources": errors_of(compared(clean_cube(cube, "pca", n_sources=n), truth)) for n in tried})

# %% [markdown]
# ## The whole sky, and a method that knows the beam
#
# BeamSubspace has the beam in its model, and is told it. Here it cleans the same cube without the gap, with as many sources as eigenvalues stand out at one resolution; beside it PCA with the number from above.
# On the command line: `himap clean whole.fits --freqs freqs.txt --method beam_subspace --beam oscillating -p n_sources=3`.

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
# Radio telescopes give image cubes: FITS with two axes of the sky, in some projection, and one of frequency. They are taken as they are, in K or mK, with
# frequencies that rise or fall, and what is written has the same header; a folder of such files is one band. Pixels that one channel does not see are left out in all,
# and come back as NaN. PCA, FastICA, the polynomial and parametric fits and the Gaussian process look at lines of sight and need no more than that; GMCA takes its starlets
# in the plane, of the seen pixels alone; the other methods look at multipoles, and say that they need the sphere. The page shows the maps in their own projection, and the power across and along the line of sight, $P(k_\perp, k_\parallel)$, in
# comoving Mpc/h, where foreground that is left lies at the smallest $k_\parallel$. For HEALPix `--patches` shows the same, as the mean over flat patches of the sky.
#
# ```sh
# himap clean image.fits --method pca -p n_sources=3 -o cleaned.fits
# himap clean image.fits --method pca -p n_sources=3 --weights hits.fits --flags rfi.fits -o cleaned.fits
# ```
#
# With `--weights` (hits, or inverse variances) and `--flags` (1 where a voxel is bad) a voxel that is missing is missing in its channel alone; {doc}`26_a_survey` goes
# through a survey of that kind. {doc}`../book/simulators` says which command reads what the simulators of the field write.
#
# ## What to take away
#
# - **One command** takes a cube in the form that it has, and gives it back in the same form, cleaned.
# - **The number of sources** can be found without the truth where HI and noise are well below the foregrounds: with the defaults of this chapter the views agree, and the table says
#   that they are right. One source fewer leaves the ripple of the oscillating beam; each one more costs some signal at large scales.
# - **A method that knows the beam**, such as BeamSubspace, spends no sources on what the beam adds ({doc}`11_ns_scan` scans it with `-p method=beam_subspace`); on a part of the
#   sky it is worse within two widths of the beam from its edge ({doc}`24_masks`). On a whole sky `suggest` counts for it eigenvalues at one resolution, where the beam adds none.
#
# ## Exercises
#
# **1.** How many sources does a cube of one resolution need, and do the views agree?
#
# ```sh
# himap run 17_your_own_cube -p beam=degraded                  # a common beam: how many sources then?
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Fewer than through the oscillating beam, and all views name the same number. The table of errors says that it is right: with fewer, foreground is left by orders of magnitude;
# with more, signal is lost. The others were spent on what the beam adds.
#
# </details>
#
# **2.** The eigenvalues of cleaned maps end in zeros, as many as sources were removed. Why?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The cleaned maps are $(\mathbf{1} - \mathbf{A}\mathbf{A}^{\top})\,\mathbf{X}$, and the columns of $\mathbf{A}$ are eigenvectors of their covariance
# with eigenvalue 0: in $n_s$ directions there is nothing left.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 17_your_own_cube -p missing=0.6                    # less than half of the sky
# himap suggest cube.h5 --method beam_subspace --beam meerkat  # a method that knows the beam, on a cube of yours
# ```
