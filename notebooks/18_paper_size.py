# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/*.json
#     - book/results/*/figures.json
#     section: all
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
# # At the paper's size
#
# The chapters of this book are kept at the preset `quick`, so that anyone can run them again in minutes, and the ledger is measured at `laptop`, on
# {glue:text}`paper_size_realisations` realisations. This page shows the claims and the figures at the paper's own size, `nside` 256 and 500 channels of 1 MHz, on one
# realisation, with the real Galaxy and with the synthetic one that needs no downloads. The real one are templates of nside 64, refined by small scales that are drawn
# (`himap templates FOLDER` writes the files, {doc}`../book/conventions`), where the paper has PySM's own of nside 512. The HI box has 1024³ cells where the paper's has 2048³: a cell of it is
# {glue:text}`paper_size_cell` wide, a pixel at the far end {glue:text}`paper_size_pixel`.
#
# ```sh
# himap templates FOLDER --nside 64
# himap claims --preset paper -p n_realisations=1 -p galaxy=templates -p template_dir=FOLDER --jobs 2
# himap run --all --preset paper -p galaxy=templates -p template_dir=FOLDER --jobs 2
# ```
#
# Without `galaxy` and `template_dir` it is the synthetic Galaxy. How long that takes is in {doc}`19_scale`. These commands take hours, so what they found is stored with
# the book, in `book/results`, and read here.

# %% tags=["parameters"]
results: str | None = None  # folder of stored results; None: that of the book
smaller: str = "claims_laptop"  # the ledger of the book
real: str = "paper_templates"  # what is stored of the real Galaxy: a ledger and a folder of figures
synthetic: str = "paper_synthetic"  # and of the synthetic one

# %%
from pathlib import Path

import numpy as np
from IPython.display import Markdown

from himap.companion.stored import RESULTS, number_after
from himap.companion.stored_tables import ledgers_table, pictures
from himap.figures.numbers import quote
from himap.paper.ledger import read_ledger
from himap.paper.ledger_table import summary
from himap.sky.cosmology import Cosmology, redshift
from himap.survey import PRESETS

folder = Path(results or RESULTS)
ledgers = [
    read_ledger(folder / f"{name}.json") for name in (smaller, f"claims_{real}", f"claims_{synthetic}")
]

# %% [markdown]
# (ledgers)=
# ## The claims
#
# The sign says ✓ reproduced, ≈ in part (all that the sentence of the paper is about, but not all of it), ✗ not reproduced, – does not apply; the number is the one that the row describes, with its
# range over realisations. {doc}`15_claims` has the words of the paper and how they are read.

# %%
Markdown(ledgers_table(ledgers))

# %% [markdown]
# (changes)=
# ### What changes with the size
#
# With the real Galaxy (templates, nside 64), of the {glue:text}`paper_size_claims` claims {glue:text}`paper_size_reproduced` are reproduced at the paper's size, {glue:text}`paper_size_in_part` in
# part, {glue:text}`paper_size_failed` are not, and {glue:text}`paper_size_inapplicable` do not apply. The verdicts of {glue:text}`paper_size_changed` differ from those at `laptop`, all others are the same. The picture is that of
# {doc}`15_claims`, with four times the pixels and twice the channels to find the foreground with. Numbers below are of the first realisation at both sizes.
#
# - **SDecGMCA comes closer to the truth.** On the oscillating beam its *C*/*C*₀ is within 5 % at {glue:text}`paper_size_sd_within` of the multipoles
#   ({glue:text}`paper_size_sd_within_laptop` at `laptop`) and furthest off by {glue:text}`paper_size_sd_off`; the paper has less than 5 % (O3). The mean Pearson correlation rises
#   from {glue:text}`paper_size_sd_r_laptop` to {glue:text}`paper_size_sd_r`. It still has no excess and no peak (O2, O4 to O6), and still does best with
#   {glue:text}`paper_size_sd_best` sources (N1 to N3).
# - **PCA and FastICA on the evolving beam** are off by {glue:text}`paper_size_pca_off` at most, where they were by {glue:text}`paper_size_pca_off_laptop` (E2); the paper has about 10 %.
# - **GMCA leaves more.** On the evolving beam it is off by {glue:text}`paper_size_gmca_off` above *k* = 0.1 / MHz ({glue:text}`paper_size_gmca_off_laptop` at `laptop`; E4); on the
#   oscillating one, by a factor of {glue:text}`paper_size_gmca_peak` at the peak ({glue:text}`paper_size_gmca_peak_laptop`).
# - **The parametric fit** fails by a factor of {glue:text}`paper_size_par_least` at the least, where the paper has more than 100 and `laptop` {glue:text}`paper_size_par_least_laptop` (E1).
# - **Masking of peaks matters for SDecGMCA.** With the oscillating beam and without it, its total error is {glue:text}`paper_size_sd_unmasked` times what it is with it, at `laptop` {glue:text}`paper_size_sd_unmasked_laptop` times.
#   For the other methods it changes {glue:text}`paper_size_others_unmasked` at most, so B1, which speaks of all, stays not reproduced.
# - **Post-masking**: {glue:text}`paper_size_sd_flagged` of the lines of sight are flagged for SDecGMCA ({glue:text}`paper_size_sd_flagged_laptop` at `laptop`), and {glue:text}`paper_size_sd_in_plane` of these lie
#   within 15° of the plane ({glue:text}`paper_size_sd_in_plane_laptop`). The paper has most of them there (M1).
# - **Dimming the Galaxy** changes the total error of SDecGMCA by {glue:text}`paper_size_sd_dimmed` ({glue:text}`paper_size_sd_dimmed_laptop` at `laptop`).

# %% tags=["hide-input"]
laptop, paper, drawn = ({entry.claim["id"]: entry for entry in entries} for entries, _ in ledgers)
changed = [claim for claim in paper if paper[claim].verdict != laptop[claim].verdict]
verdicts = list(summary(paper.values()).values())
size = PRESETS["paper"]
cosmology = Cosmology()
far = cosmology.comoving_distance(redshift(np.array([size.freq_min])))[0]


def percent(claim, words, ledger=paper, tolerance=1, *, whole=1, less=0):
    """A share that a claim names behind `words`, or its distance from `less`, in percent."""
    return abs(number_after(words, ledger[claim]) / whole - less) * 100, tolerance, "%"


def value(claim, words, ledger=paper, tolerance=1, *, since=""):
    """A number that a claim names behind `words`, and these behind `since`."""
    return number_after(words, ledger[claim], since=since), tolerance


off = "Largest |C/C0 - 1|: PCA"
within, in_plane = "within 5 % at", "are flagged;"
left_in = "oscillating:"
unmasked = [
    number_after(f"{name} ", paper["B1"], since=left_in) for name in ("PCA", "ICA", "GMCA", "POL", "PAR")
]
quote(
    paper_size_realisations=len(next(iter(laptop.values())).findings),
    paper_size_cell=(size.box_size / size.box_cells, 0.1, "Mpc/h"),
    paper_size_pixel=(far * np.sqrt(4 * np.pi / size.n_pix), 1, "Mpc/h"),
    paper_size_claims=len(paper),
    paper_size_reproduced=verdicts[0],
    paper_size_in_part=verdicts[1],
    paper_size_failed=verdicts[2],
    paper_size_inapplicable=verdicts[3],
    paper_size_changed=" and ".join(changed),
    paper_size_sd_within=percent("O3", within, whole=100),
    paper_size_sd_within_laptop=percent("O3", within, laptop, whole=100),
    paper_size_sd_off=percent("O3", "furthest off, by", tolerance=0.1),
    paper_size_sd_r=value("A1", "SD", tolerance=0.001),
    paper_size_sd_r_laptop=value("A1", "SD", laptop, 0.001),
    paper_size_sd_best=int(number_after("is at n_s =", paper["N1"])),
    paper_size_pca_off=percent("E2", off),
    paper_size_pca_off_laptop=percent("E2", off, laptop),
    paper_size_gmca_off=percent("E4", "GMCA"),
    paper_size_gmca_off_laptop=percent("E4", "GMCA", laptop),
    paper_size_gmca_peak=value("O4", "GMCA"),
    paper_size_gmca_peak_laptop=value("O4", "GMCA", laptop),
    paper_size_par_least=value("E1", "from"),
    paper_size_par_least_laptop=value("E1", "from", laptop),
    paper_size_sd_unmasked=value("B1", "SD", tolerance=0.1, since=left_in),
    paper_size_sd_unmasked_laptop=value("B1", "SD", laptop, 0.01, since=left_in),
    paper_size_others_unmasked=(100 * max(abs(ratio - 1) for ratio in unmasked), 0.1, "%"),
    paper_size_sd_flagged=percent("M1", "", whole=100, tolerance=0.1),
    paper_size_sd_flagged_laptop=percent("M1", "", laptop, whole=100, tolerance=0.1),
    paper_size_sd_in_plane=percent("M1", in_plane, whole=100),
    paper_size_sd_in_plane_laptop=percent("M1", in_plane, laptop, whole=100),
    paper_size_sd_dimmed=percent("G1", "SD", less=1),
    paper_size_sd_dimmed_laptop=percent("G1", "SD", laptop, less=1),
)

# %% [markdown]
# (skies)=
# ### What changes with the Galaxy
#
# With the synthetic Galaxy {glue:text}`paper_size_drawn_reproduced` are reproduced, {glue:text}`paper_size_drawn_in_part` in part, {glue:text}`paper_size_drawn_failed` are not, {glue:text}`paper_size_drawn_inapplicable` do not apply. HI, noise and beams
# are the same, so what differs is the foreground's doing. The verdicts of {glue:text}`paper_size_drawn_changed` do:
#
# - **The evolving beam is harder.** PCA and FastICA are off by {glue:text}`paper_size_drawn_pca_off` at most ({glue:text}`paper_size_pca_off` on the real Galaxy); GMCA's excess at
#   10 < ℓ < 40, {glue:text}`paper_size_gmca_excess` there, is {glue:text}`paper_size_drawn_gmca_excess` here, as in the paper (E3). The parametric fit fails by a factor of
#   {glue:text}`paper_size_drawn_par_least` at the least ({glue:text}`paper_size_par_least`), which is the paper's more than 100 (E1).
# - **The oscillating beam** leaves PCA and FastICA with a mean excess of {glue:text}`paper_size_drawn_pca_excess` at ℓ < 10 ({glue:text}`paper_size_pca_excess`), less than what counts
#   as one (O2), and GMCA with the highest peak of the three ledgers, {glue:text}`paper_size_drawn_gmca_peak` times the truth near *k* = 0.31 / MHz ({glue:text}`paper_size_gmca_peak`).
# - **SDecGMCA** is nearly the same on both: within 5 % at {glue:text}`paper_size_drawn_sd_within` of the multipoles, mean Pearson correlation {glue:text}`paper_size_drawn_sd_r`,
#   {glue:text}`paper_size_drawn_sd_best` sources best, {glue:text}`paper_size_drawn_sd_flagged` of its lines flagged and {glue:text}`paper_size_drawn_sd_in_plane` of them within 15° of the plane.
#   Its residual is the smallest at {glue:text}`paper_size_drawn_sd_smallest` of the multipoles, no longer at all of them (A2).

# %% tags=["hide-input"]
drawn_verdicts = list(summary(drawn.values()).values())
drawn_changed = [claim for claim in paper if paper[claim].verdict != drawn[claim].verdict]
excess = "l < 10 and"
quote(
    paper_size_drawn_reproduced=drawn_verdicts[0],
    paper_size_drawn_in_part=drawn_verdicts[1],
    paper_size_drawn_failed=drawn_verdicts[2],
    paper_size_drawn_inapplicable=drawn_verdicts[3],
    paper_size_drawn_changed=", ".join(drawn_changed),
    paper_size_drawn_pca_off=percent("E2", off, drawn),
    paper_size_gmca_excess=percent("E3", excess, less=1),
    paper_size_drawn_gmca_excess=percent("E3", excess, drawn, less=1),
    paper_size_drawn_par_least=value("E1", "from", drawn),
    paper_size_pca_excess=percent("O2", "PCA", less=1),
    paper_size_drawn_pca_excess=percent("O2", "PCA", drawn, less=1),
    paper_size_drawn_gmca_peak=value("O4", "GMCA", drawn),
    paper_size_drawn_sd_within=percent("O3", within, drawn, whole=100),
    paper_size_drawn_sd_r=value("A1", "SD", drawn, 0.001),
    paper_size_drawn_sd_best=int(number_after("is at n_s =", drawn["N1"])),
    paper_size_drawn_sd_flagged=percent("M1", "", drawn, whole=100, tolerance=0.1),
    paper_size_drawn_sd_in_plane=percent("M1", in_plane, drawn, whole=100),
    paper_size_drawn_sd_smallest=percent("A2", "smallest at", drawn, whole=100),
)

# %% [markdown]
# (sizes)=
# ## The figures
#
# Each figure of the paper at its own size, with the real Galaxy (templates, nside 64) and with the synthetic one; the chapter that is named with it has it at the preset `quick`, and says what it shows. A click leads to
# the picture in full size. The numbers of all curves are in `book/results/paper_templates/figures.json` and `book/results/paper_synthetic/figures.json`.

# %%
Markdown(pictures([real, synthetic], folder))

# %% [markdown]
# ## What to take away
#
# - At the paper's own size the picture is the one of the smaller skies: where a claim does not hold there, it hardly ever holds here.
# - SDecGMCA gains most from finer maps and channels, and differs least between the two Galaxies.
# - Which Galaxy it is matters for the methods that leave foreground, not for the one that leaves little.
#
# Three commands worth trying:
#
# ```sh
# himap run 10_results --preset laptop                           # Figs. 1 and 2 on the way to this size, in minutes
# himap claims --preset laptop -p n_realisations=1 --jobs 2      # a ledger to put beside these
# himap run 18_paper_size -p results=FOLDER                      # this page, of results that you have measured
# ```
