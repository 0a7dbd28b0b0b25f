# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/claims_paper_templates.json
#     - book/results/endurance.json
#     - book/results/scaling.json
#     - book/results/steps_*.json
#     section: ''
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
# # Scale
#
# > - **Read first**: nothing; the steps are those of {doc}`01_simulations` to {doc}`10_results`.
# > - **Good to know**: a shell, and for the last section a cluster.
# > - **Time and memory**: {cost}`19_scale`.
#
# What the chain costs at the paper's own size (`nside` 256, 500 channels of 1 MHz, an HI box of 1024³ cells) on two cores, how that grows,
# how a long run is kept safe, and how to go to a cluster. The times were measured once, by the commands of {doc}`../book/contributing`, and are stored with the
# book, in `book/results`.

# %% tags=["parameters"]
results: str | None = None  # folder of stored results; None: that of the book
nside: int = 512  # of the survey to extrapolate to
n_channels: int = 2000  # its channels
box_cells: int = 2048  # cells along one side of its HI box
n_realisations: int = 100  # how many of it

# %% tags=["hide-input"]
from dataclasses import replace

from IPython.display import Markdown

from himap.app.stored import extrapolated, read_stored, times_of_all
from himap.app.stored_tables import endurance_table, growth_table, short, steps_table
from himap.core.survey import PRESETS
from himap.figures import plotting, styles
from himap.figures.axes import label_ends
from himap.figures.numbers import quote
from himap.figures.tables import Table
from himap.store.provenance import Provenance

paper, laptop, scaling = (read_stored(name, results) for name in ("steps_paper", "steps_laptop", "scaling"))
larger = {"nside": nside, "n_channels": n_channels, "box_cells": box_cells}
extrapolation = extrapolated(laptop, paper, scaling, n_realisations=n_realisations, **larger)

# %% [markdown]
# (steps-paper)=
# ## Every step at the paper's size
#
# Each step runs in a process of its own and starts from what the cache holds of the steps before it. *Memory* is the peak of the process and its
# children, mapped files included. The *floor* is what the transforms, the bytes and the operations that the step cannot do without would take on this
# machine, as it was measured before the first step, if nothing were lost and nothing overlapped. *Alternative* is the usual tool on the same data in the same run; above 1 it
# takes longer, and where it is too slow to run whole, a part of it is timed and scaled up. The *goals* are what himap was designed to reach on a machine
# that has nothing else to do; what misses its goal is in bold.

# %% tags=["hide-input"]
Markdown(steps_table(paper))

# %% [markdown]
# What the floors count, and why some steps are far from theirs:
#
# - **HI light cone**: fifteen passes over the box for five Fourier transforms, and two interpolations for each step of each ray. The floor counts these as
#   arithmetic; really each step collects sixteen numbers from all over the box, and that is what takes the time.
# - **Observations**: the coefficients of HI and noise (with two refinements), and for each beam one synthesis in float32 of what is faint and one in float64 of the foregrounds.
#   The foregrounds are a dozen spectral modes, not 500 maps, and the three beams share all analyses.
# - **Peak masking, polynomial**: the cube read twice and written once, and one projection of each line of sight on the polynomials. The step takes float64
#   copies of blocks of lines, looks for what stands out, and fits lines with peaks again without them.
# - **PCA, FastICA**: one covariance of the channels and two products with the cube; FastICA iterates on the few whitened maps only.
# - **Parametric**: two products of each line of sight with the curves of one index. The search compares 65 indices and bisects between them, on an interpolation of the curves.
# - **GMCA**: in each iteration two products with the cube, and starlets of the sources there and back. It has no usual alternative to be timed against.
# - **Harmonic analysis**: every channel once, which BeamSubspace and SDecGMCA share with any number of sources.
# - **BeamSubspace, SDecGMCA**: from those coefficients; two products with them in every iteration, and every scale of every source there and back. They too have no usual alternative.
# - **All measures**: $C_\ell$, $P(k)$, Pearson r and the errors of lines of sight of one separation. What is left differs from the truth by a few spectra times maps; only these are transformed.

# %% [markdown]
# (whole)=
# ### All of it, one after another
#
# What one realisation of the claims takes at the paper's size, on the real Galaxy and with `--jobs 2`: the light cone and the observations of the table above, and the
# ledger once they are there. The chapters with figures come on top; what they took when they were last made at this size is on {doc}`the status page <../book/status>`.

# %% tags=["hide-input"]
parts = times_of_all(paper, read_stored("claims_paper_templates", results)["about"])
rows = [[part, f"{short(seconds / 60)} min"] for part, seconds in parts.items()]
rows.append(["all", f"{sum(parts.values()) / 60:.0f} min"])
Markdown("\n".join(Table(["Part", "Time"], rows).markdown()))

# %% [markdown]
# The claims take most: they measure what 72 separations leave (six methods in seven cases, SDecGMCA beyond $\ell = 200$ with three beams, 8 with other regularisations and restarts of it, and 19 of the scan of $n_s$), where Figs. 1 and 2 have 18. No cleaned cube is made for it: a method gives a few spectra times maps, and
# so does its error.

# %% [markdown]
# ## The same at half that size

# %% tags=["hide-input"]
Markdown(steps_table(laptop))

# %% [markdown]
# (growth)=
# ## How the cost grows
#
# The exponent $p$ of time $\propto x^p$ between the two largest of three sizes. With `nside` the HI box grows as well, four cells per unit of `nside`.
# A machine that others share changes its pace within minutes, so a fixed piece of work is timed before and after every measurement, and all times are those at the
# quickest pace seen.
#
# On logarithmic axes a power law is a straight line, and its slope the exponent. Which line is on top at the right end is what a larger survey waits
# for.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-scale-growth", "caption": "Time of every step against nside (100 channels) and against the number of channels (nside 128), at three sizes each."}}
looks = [("black", "-"), (styles.BLUE, "--"), (styles.VERMILION, "-.")]  # of neighbours
with_nside = scaling["found"]["nside"]
slowest_first = sorted(with_nside, key=lambda name: -with_nside[name]["seconds"][-1])
panels = []
for way, label in {"nside": "nside", "n_channels": "channels"}.items():
    found = scaling["found"][way]
    curves = []
    for n, name in enumerate(slowest_first):
        colour, dashes = looks[n % len(looks)]
        style = {"label": f"_{name}", "color": colour, "linestyle": dashes, "marker": "."}
        curves.append((found[name]["sizes"], found[name]["seconds"], style))
    sizes = sorted({size for run in found.values() for size in run["sizes"]})
    ticks = {"xscale": "log", "xticks": sizes, "xticklabels": sizes, "xlabel": label}
    panels.append(ticks | {"curves": curves, "title": f"with {label}"})
    panels[-1] |= {"ylabel": "time [s]", "yscale": "log"}
figure = plotting.lines(panels, size=(4.6, 4.6))
for axes in figure.axes:
    axes.xaxis.minorticks_off()  # the sizes are all there is
    label_ends(axes)
plotting.stamp(figure, Provenance.of_stored(scaling["about"]))

# %% tags=["hide-input"]
Markdown(growth_table(scaling))

# %% [markdown]
# `python -m benchmarks --preset laptop`, or any other preset, and `python -m benchmarks.scaling` make these tables on your machine;
# {doc}`../book/contributing` has the whole commands.
#
# ## Long runs
#
# ```sh
# himap run --all --preset paper --jobs 2 --max-memory 20GB
# himap cache info
# ```
#
# - **Stopped?** Run the same command again. Every product (a light cone, an observation, what a method found, a spectrum) is written whole or not at all,
#   with a checksum; what is there is used, what was cut short or altered is reported and made again. The result equals that of an undisturbed run bit for bit.
# - **Memory** is estimated before anything is computed, and what does not fit is refused, for the light cone with a box that would. `--max-memory`
#   (the variable `HIMAP_MAX_MEMORY`) says what may be used; the default is what is free. `--jobs 2` cleans two cubes at once and needs twice as much for it.
# - **Disk**: a cube of the paper's size is {glue:text}`scale_cube`; the ledger keeps those of one case (a beam, dimmed or not) of one realisation while it works. Cubes can be deleted at any time, with
#   `himap cache clear pipeline.observation` for instance; `himap measure claims` deletes those that it made itself once they are measured, but not
#   those that an interrupted run left.
#
# (kills)=
# ### What was tried
#
# Processes were killed at random points, alone or with all that they had started, and started again until they were done. Everything that they wrote was held
# against an undisturbed run, bit by bit. *Failed* are runs started again that did not end well, and ends without a clear sentence; *other results* were not the same bits; *left behind* is what then lay about: files beside outputs, in the cache and
# in temporary folders, shared memory, and processes. On a full disk a command ends with a sentence that names the file, or does without what it could not keep.

# %%
Markdown(endurance_table(read_stored("endurance", results)))

# %% [markdown]
# ## On a cluster
#
# With `--dask`, `himap measure claims` and `himap run` share independent products among the workers of a [Dask](https://distributed.dask.org) scheduler that is already there.
# Cubes do not travel: each worker keeps what it makes in the cache folder and reads from there. So that folder, and that of the templates, must be ones that all
# machines see, and all need the same himap. What a worker that dies was making goes to another one, and the result is the same as without Dask.
#
# On a cluster with SLURM, [dask-jobqueue](https://jobqueue.dask.org) starts scheduler and workers (`pip install dask-jobqueue`):
#
# ```python
# from dask_jobqueue import SLURMCluster
#
# cluster = SLURMCluster(
#     account="me",
#     queue="normal",
#     walltime="12:00:00",
#     cores=1,  # threads of Dask: one product at a time...
#     job_cpu=2,  # ...on two cores
#     memory="24GB",
#     job_script_prologue=["export OMP_NUM_THREADS=2 DUCC0_NUM_THREADS=2 NUMBA_NUM_THREADS=2"],
# )
# cluster.adapt(maximum_jobs=20)  # jobs that end are replaced
# print(cluster.scheduler_address)  # keep this process alive while you work
# ```
#
# In another terminal, with the address that was printed:
#
# ```sh
# export HIMAP_CACHE=/scratch/me/himap HIMAP_MAX_MEMORY=24GB
# himap measure claims --preset paper -p n_realisations=20 --dask tcp://10.0.0.7:35791
# ```
#
# - `cores=1` matters: a worker with eight threads of Dask would clean eight cubes at once.
# - Dask tells workers to use one core for matrix products unless the job says otherwise, hence the variables in its prologue.
# - `HIMAP_MAX_MEMORY` is what *one worker* may use, and travels to it; without it each takes what is free on its node, whatever SLURM has granted.
# - On a cluster the cubes of all realisations of one command are on disk until their claims are measured. In portions, `-p seed=2045 -p n_realisations=20` and so on, they need less.

# %% [markdown]
# (cluster)=
# ### nside {glue:text}`scale_nside`, {glue:text}`scale_n_channels` channels, {glue:text}`scale_n_realisations` realisations
#
# What Figs. 1 and 2 need: six methods, three beams, both spectra. *Times* is how often a step is done in each realisation. *Memory* is what himap asks for before it begins.
# The ledger measures what 72 separations leave of each realisation where these two figures have 18.

# %% tags=["hide-input"]
rows = [
    [
        one["step"],
        f"{short(one['minutes'])} min",
        one["times"],
        f"{one['core_hours']:,.0f}",
        f"{one['gigabytes']:.0f} GB",
    ]
    for one in extrapolation
]
rows.append(["all", "", "", f"{sum(one['core_hours'] for one in extrapolation):,.0f}", ""])
head = ["Step", "Once, two cores", "Times", f"Core hours, {n_realisations} realisations", "Memory"]
Markdown("\n".join(Table(head, rows).markdown()))

# %% [markdown]
# The exponent with channels is the one above. The exponent with `nside` comes from the two tables of steps: what is left of the ratio of their times when the doubled
# channels are taken out. These are extrapolations, {glue:text}`scale_further` times in `nside` and {glue:text}`scale_more` times in channels, and no better than a factor of two:
#
# - The exponents with channels are those of small maps, where GMCA, SDecGMCA, FastICA and the spectra spend most of their time on a few maps of sources and not on channels.
# - The two tables were measured within an hour on a machine whose pace varies by tens of percent.
# - The methods were timed on the oscillating beam. More than two cores for one product have not been measured.
#
# The cubes of one realisation take {glue:text}`scale_disk` times the disk that they do at the paper's size.

# %% tags=["hide-input"]
size = PRESETS["paper"]
bytes_of_a_cube = 4 * size.n_channels * size.n_pix
asked = replace(size, **larger)
quote(
    scale_nside=nside,
    scale_n_channels=n_channels,
    scale_n_realisations=n_realisations,
    scale_cube=(bytes_of_a_cube / 1e9, 0.1, "GB"),
    scale_further=f"{nside / size.nside:g}",
    scale_more=f"{n_channels / size.n_channels:g}",
    scale_disk=f"{asked.n_channels * asked.n_pix / (size.n_channels * size.n_pix):g}",
)

# %% [markdown]
# ## What to take away
#
# - At the paper's size every step of the chain fits a machine with two cores; the light cone and the observations are made once and shared by all methods.
# - Most steps stay near the usual tools or ahead of them, and above their floor for the reasons given under the first table.
# - What can be kept is kept, so that a run that was stopped, or that shares products with an earlier one, does only what is missing.
#
# ## Exercises
#
# **1.** The light cone needs a box of four cells per unit of $N_\mathrm{side}$. Which exponent of $N_\mathrm{side}$ would its memory have, and which
# that of a cube of maps?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The box has $(4\,N_\mathrm{side})^3$ cells, so 3; a cube has $12\,N_\mathrm{side}^2$ pixels in each channel, so 2. Beyond some size the box is what
# does not fit.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 19_scale -p nside=1024 -p n_channels=1000            # another survey, another number of core hours
# python -m benchmarks --preset quick                            # every step on your machine, in minutes
# himap run --all --preset laptop --jobs 2                       # the whole book at half the paper's resolution
# ```
