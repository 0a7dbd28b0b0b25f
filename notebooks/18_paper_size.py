# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/claims_*.json
#     - book/results/readings*.json
#     - book/results/restarts*.json
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
# > - **Read first**: {doc}`15_claims`.
# > - **Time and memory**: {cost}`18_paper_size`.
#
# The chapters of this book are kept at the preset `quick`, so that anyone can run them again in minutes, and the ledger is measured at `laptop`, on
# {glue:text}`paper_size_realisations` realisations. This page shows the claims and the figures at the paper's own size, `nside` 256 and 500 channels of 1 MHz, on one
# realisation, with the real Galaxy and with the synthetic one that needs no downloads. The real one is made of templates of nside 64, refined by small scales that are drawn
# (`himap templates FOLDER` writes the files, {doc}`../book/conventions`), where the paper has PySM's own of nside 512. The HI box has 1024³ cells where the paper's has 2048³: a cell of it is
# {glue:text}`paper_size_cell` wide, a pixel at the far end {glue:text}`paper_size_pixel`.
#
# ```sh
# himap templates FOLDER --nside 64
# himap measure claims --preset paper -p n_realisations=1 -p galaxy=templates -p template_dir=FOLDER --jobs 2
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

# %% tags=["hide-input"]
from pathlib import Path

import numpy as np
from IPython.display import Markdown

from himap.app.causes import other_records
from himap.app.stored import RESULTS, read_ledger
from himap.app.stored_tables import differing, ledgers_table, pictures, verdicts_table
from himap.core.errors import InputError
from himap.core.survey import PRESETS
from himap.figures.numbers import quote
from himap.sky.cosmology import Cosmology, redshift

folder = Path(results or RESULTS)
ledgers, missing = [], []
for name in (smaller, f"claims_{real}", f"claims_{synthetic}"):
    try:
        ledgers.append(read_ledger(folder / f"{name}.json"))
    except InputError:  # none, or one of the claims as they were judged before
        missing.append(f"`{name}`")
others = other_records(ledgers[0][1], folder)

# %% [markdown]
# (ledgers)=
# ## The claims
#
# The sign says ✓ reproduced, ≈ in part (for some of the methods that the claim is about), ? undecided, ✗ not reproduced, – does not apply; the number is the one that the row describes, with its
# range from 16 to 84 % of the members. A claim can have several main parts: those that do not hold in 84 % of the members are named below it, with the share in which they do. {doc}`15_claims` has the words of the paper and how they are read.

# %% tags=["hide-input"]
told = f"There is no ledger {', '.join(missing)} of the claims as they are judged now: it is to be measured again."
Markdown(
    "\n\n".join([verdicts_table(ledgers), ledgers_table(ledgers, others=others), *[told] * bool(missing)])
)

# %% [markdown]
# (changes)=
# ### What changes with size and Galaxy
#
# From `laptop` to the paper's size there are four times the pixels and twice the channels to find the foreground with, and one realisation. From the real Galaxy (templates, nside 64) to the synthetic one HI, noise and
# beams are the same, so what differs is the foreground's doing, and for SDecGMCA what its iteration makes of a small change ({doc}`09_sdecgmca`). The claims whose verdict differs:

# %% tags=["hide-input"]
several = "There is only one ledger to show, so nothing to compare."
Markdown(ledgers_table(ledgers, differing) if len(ledgers) > 1 else several)

# %% tags=["hide-input"]
size = PRESETS["paper"]
far = Cosmology().comoving_distance(redshift(np.array([size.freq_min])))[0]
quote(
    paper_size_realisations=ledgers[0][0][0].n_skies,
    paper_size_cell=(size.box_size / size.box_cells, 0.1, "Mpc/h"),
    paper_size_pixel=(far * np.sqrt(4 * np.pi / size.n_pix), 1, "Mpc/h"),
)

# %% [markdown]
# (sizes)=
# ## The figures
#
# Each figure of the paper at its own size, with the real Galaxy (templates, nside 64) and with the synthetic one; the chapter that is named with it has it at the preset `quick`, and says what it shows. A click leads to
# the picture in full size; beside the figures of the chapters a button leads to them with both Galaxies at this size, to play with. The numbers of all curves are in `book/results/paper_templates/figures.json` and `book/results/paper_synthetic/figures.json`.

# %% tags=["hide-input"]
Markdown(pictures([real, synthetic], folder))

# %% [markdown]
# ## What to take away
#
# - The tables say which verdicts are those of the paper's size and which of a smaller sky, and what changes with size and with the Galaxy.
# - One realisation is one throw: a verdict that is not the same in all realisations at `laptop` ({doc}`15_claims`) may be another one on the next sky here.
#
# ## Exercises
#
# **1.** How large is one cube at this size, in float32?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# 12 · 256² = 786,432 pixels, times 500 channels, times 4 bytes: 1,572,864,000 bytes. Three beams, each with its truth and its maps before and after the masking of
# peaks, make nine of them.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 10_results --preset laptop                           # Figs. 1 and 2 on the way to this size, in minutes
# himap measure claims --preset laptop -p n_realisations=1 --jobs 2      # a ledger to put beside these
# himap run 18_paper_size -p results=FOLDER                      # this page, of results that you have measured
# ```
