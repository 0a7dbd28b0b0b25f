# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/endurance.json
#     - book/results/scaling.json
#     - book/results/steps_*.json
#     - book/results/whole_paper.json
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
# > - **Good to know**: a shell and, for the last section, a cluster.
# > - **Time and memory**: {cost}`19_scale`.
#
# This chapter lists the time and memory of each step at the paper's size (`nside` 256, 500 channels of 1 MHz,
# an HI box of 1024³ cells) on two cores, their growth, the protection of long runs, and the use of a cluster.
# {doc}`../book/contributing` has the commands that measured them.

# %% tags=["parameters"]
results: str | None = None  # folder of stored results; None: that of the book
nside: int = 512  # of the survey to extrapolate to
n_channels: int = 4000  # its channels
box_cells: int = 2048  # cells along one side of its HI box
n_realisations: int = 100  # how many of it

# %% tags=["hide-input"]
from dataclasses import replace

from IPython.display import Markdown

from himap.app.stored import extrapolated, read_stored
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
# Each step starts from the cached results of those before it. *Memory* is the peak of the process and its
# children, mapped files included. The *floor* is the time of the unavoidable transforms, memory traffic and
# operations on this machine. *Alternative* is the usual tool on the same data (above 1: slower); if it is too
# slow, a part is timed and scaled. *Goals* are for a machine without other load; missed goals are bold.

# %% tags=["hide-input"]
Markdown(steps_table(paper))

# %% [markdown]
# The floors count:
#
# - **HI light cone**: fifteen passes over the box for five Fourier transforms, and two interpolations per
#   step of each ray; gathering their sixteen scattered numbers takes most of the time but is not counted.
# - **Observations**: the coefficients of HI and noise (with two refinements), and for each beam one synthesis
#   in float32 for HI and noise and one in float64 for the foregrounds, a dozen spectral modes.
# - **Peak masking, polynomial**: two reads and one write of the cube, one projection of each line of sight;
#   lines with peaks are fitted again.
# - **PCA, FastICA**: one covariance of the channels and two products with the cube.
# - **Parametric**: two products of each line of sight with the curves of one index, out of 65 that are
#   compared and interpolated.
# - **GMCA**: in each iteration two products with the cube, and forward and inverse starlets of the sources.
# - **Harmonic analysis, BeamSubspace, SDecGMCA**: every channel once for both methods; in each iteration two
#   products with the coefficients, and forward and inverse transforms of every scale of every source.
# - **All measures**: $C_\ell$, $P(k)$, Pearson $r$ and the errors of lines of sight, from transforms of the
#   few spectra times maps by which the residual differs from the truth.

# %% [markdown]
# (whole)=
# ### The whole paper
#
# From an empty cache, with the real Galaxy and {glue:text}`scale_jobs` processes, this includes the light
# cone, three observations, all methods and every figure. There are {glue:text}`scale_restarts` restarts of
# SDecGMCA for each beam and with the plane dimmed, but one for the scan of $n_s$ and the ledger. *Memory* is
# the peak of all processes, mapped files included; shared memory counts once.

# %% tags=["hide-input"]
whole = read_stored("whole_paper", results)
parts = [*whole["commands"], {"step": "all"} | whole]
rows = [[one["step"], f"{short(one['seconds'] / 60)} min", f"{one['memory_gb']:.1f} GB"] for one in parts]
Markdown("\n".join(Table(["Part", "Time", "Memory"], rows).markdown()))

# %% [markdown]
# With the scan of $n_s$ up to 20 the claims need 80 separations, compared with 18 for Figs. 1 and 2: six
# methods in seven cases, other $\sigma$ of the peak masking, variants of SDecGMCA, and the scan.

# %% [markdown]
# ## The same at half that size

# %% tags=["hide-input"]
Markdown(steps_table(laptop))

# %% [markdown]
# (growth)=
# ## How the cost grows
#
# The exponent $p$ of time $\propto x^p$ is measured between the two largest of three sizes. The HI box also
# grows with `nside`, four cells per unit. On a shared machine a fixed task is timed before and after each
# measurement, and times are scaled to the fastest pace.
#
# The slope of a line is the exponent.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-scale-growth", "caption": "Time of every step against nside (100 channels, left) and against the number of channels (nside 128, right), at three sizes each."}}
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
# CRIME, the simulator of the paper, was run for comparison with the light cone
# ({ref}`simulations-resolution`). The CPU time of himap was 0.93 of CRIME's with a box of 512³ cells and 0.85
# with 1024³: for twice the cells along a side it grew by a factor of 8.4, that of CRIME by a factor of 9.2.
# Memory is alike. The public code of SDecGMCA's authors took 200 to 215 s on one core for a run at half the
# paper's size. In the same hour himap took 12 to 18 s, on a number of cores that was not noted. These times
# were measured once and cannot be reproduced from this repository, which contains neither code.

# %% [markdown]
# ## Long runs
#
# ```sh
# himap run --all --preset paper --jobs 2 --max-memory 20GB
# himap cache info
# ```
#
# - **Interrupted?** Run the same command again. Products are written completely or not at all, with a
#   checksum; the result equals that of an undisturbed run bit for bit.
# - **Memory** is estimated first, and a run that does not fit is refused. `--max-memory` (or
#   `HIMAP_MAX_MEMORY`) sets the limit; the default is the free memory. `--jobs 2` cleans two cubes at once
#   and needs twice the memory.
# - **Disk**: a cube of the paper's size is {glue:text}`scale_cube`. The ledger keeps the cubes of one case
#   while it works, and those of an interrupted run; `himap cache clear pipeline.observation` deletes cubes at
#   any time.
#
# (kills)=
# ### Tests of interruption
#
# Processes were killed at random times and restarted until they finished; their results were compared bit by
# bit with an undisturbed run. *Failed* counts restarts that did not finish, and exits without a clear
# message; *left behind* counts files, shared memory and processes that were not removed. On a full disk a
# command ends with a message, or continues without storing.

# %%
Markdown(endurance_table(read_stored("endurance", results)))

# %% [markdown]
# ## On a cluster
#
# With `--dask`, `himap measure` and `himap run` distribute products over the workers of a running
# [Dask](https://distributed.dask.org) scheduler. All machines must share the cache folder, the templates and
# the version of himap. If a worker dies, another takes over its products. With SLURM,
# [dask-jobqueue](https://jobqueue.dask.org) starts scheduler and workers:
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
# ```sh
# export HIMAP_CACHE=/scratch/me/himap HIMAP_MAX_MEMORY=24GB
# himap measure claims --preset paper -p n_realisations=20 --dask tcp://10.0.0.7:35791
# ```
#
# - `cores=1` matters: a worker with eight threads of Dask would clean eight cubes at once. Dask limits matrix
#   products to one core unless the prologue sets these variables.
# - `HIMAP_MAX_MEMORY` is the limit of one worker; without it each worker uses the free memory of its node,
#   whatever SLURM has granted.
# - The cubes of all realisations of a command are on disk until their claims are measured; portions
#   (`-p seed=2045 -p n_realisations=20`, ...) need less.

# %% [markdown]
# (cluster)=
# ### nside {glue:text}`scale_nside`, {glue:text}`scale_n_channels` channels, {glue:text}`scale_n_realisations` realisations
#
# For Figs. 1 and 2: six methods, three beams, both spectra. *Times* is how often a step runs in each
# realisation; *memory* is the estimate of himap.

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
# The exponent with channels is measured. The exponent with `nside` follows from the two tables of steps,
# divided by the factor for twice the channels, and is at least 0 (SDecGMCA ends at the same $\ell$ at both
# sizes). These extrapolations, by factors of {glue:text}`scale_further` in `nside` and
# {glue:text}`scale_more` in channels, are for the oscillating beam and from a shared machine, in channels
# from small maps, and are uncertain by a factor of two or more. The cubes of one realisation take
# {glue:text}`scale_disk` times the disk space of the paper's size.
#
# Dask does not divide a product: a worker holds complete cubes of {glue:text}`scale_large_cube` each at this
# size. The step with the largest memory therefore sets that of a worker, {glue:text}`scale_worker`. Use one
# worker per node, with `memory` and `HIMAP_MAX_MEMORY` above that, and its cores in the variables of the
# prologue. There are two consecutive stages: {glue:text}`scale_cases` observations, of which those of the
# same sky wait for its light cone, and {glue:text}`scale_cleanings` independent cleanings. With
# {glue:text}`scale_nodes` such workers of two cores both take {glue:text}`scale_days`, if the shared disk
# keeps up.

# %% tags=["hide-input"]
size = PRESETS["paper"]
bytes_of_a_cube = 4 * size.n_channels * size.n_pix
asked = replace(size, **larger)
N_BEAMS, N_METHODS, N_NODES = 3, 6, 20  # of Figs. 1 and 2; jobs of the cluster above
quote(
    scale_jobs=dict(whole["about"]["overrides"])["jobs"],
    scale_restarts=dict(whole["about"]["overrides"])["n_restarts"],
    scale_nside=nside,
    scale_n_channels=n_channels,
    scale_n_realisations=n_realisations,
    scale_cube=(bytes_of_a_cube / 1e9, 0.1, "GB"),
    scale_further=f"{nside / size.nside:g}",
    scale_more=f"{n_channels / size.n_channels:g}",
    scale_large_cube=(4 * asked.n_channels * asked.n_pix / 1e9, 1, "GB"),
    scale_worker=(max(one["gigabytes"] for one in extrapolation), 10, "GB"),
    scale_cases=N_BEAMS * n_realisations,
    scale_cleanings=N_BEAMS * N_METHODS * n_realisations,
    scale_nodes=N_NODES,
    scale_days=(sum(one["core_hours"] for one in extrapolation) / (2 * N_NODES) / 24, 0.5, "days"),
    scale_disk=f"{asked.n_channels * asked.n_pix / (size.n_channels * size.n_pix):g}",
)

# %% [markdown]
# ## What follows
#
# - At the paper's size every step takes at most minutes on two cores.
# - Most steps are at least as fast as the usual tools.
#
# ## Exercise
#
# The light cone needs a box of four cells per unit of $N_\mathrm{side}$. With which powers of
# $N_\mathrm{side}$ do its memory and that of a cube of maps grow?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The box has $(4\,N_\mathrm{side})^3$ cells, so 3; a cube has $12\,N_\mathrm{side}^2$ pixels in each channel,
# so 2. Beyond some size the box is the limit.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 19_scale -p nside=1024 -p n_channels=1000            # another survey, another number of core hours
# python -m benchmarks --preset quick                            # every step on your machine, in minutes
# python -m benchmarks.scaling                                   # the exponents
# ```
