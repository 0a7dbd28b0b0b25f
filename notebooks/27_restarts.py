# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/authors_*.json
#     - book/results/flags_*.json
#     - book/results/restarts_*.json
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
# # Restarts: one run is one draw
#
# > - **Read first**: {doc}`09_sdecgmca`.
# > - **Good to know**: what the condition number of a matrix is.
# > - **Time and memory**: {cost}`27_restarts`.
#
# SDecGMCA has no random numbers. Two runs on the same data should give the same result. They do, bit for bit, on one machine. But a change of the start in the tenth digit gives another mixing matrix, and another residual. This chapter
# measures how that change grows, where it comes from, how often the result is wrong, and what to do. All of it holds for the public code of {cite:t}`carloni2021` (C21) as for himap.
#
# **What the paper says.** The warm-up ends when the relative change of $\hat{\mathbf{S}}$ is below $10^{-2}$, the refinement when it is below $10^{-4}$ ({cite:t}`gkogkou2025`, Sect. 3.3). It “already delivers robust reconstructions on full-sky simulations”, without masks (Sect. 6).
# Neither restarts nor scatter are mentioned.
#
# **What was done.** The public code of C21 was run on the sky of himap's preset `ci` ($N_\mathrm{side} = 32$, 100 channels, $\ell \leq 64$, oscillating beam, five sources, parameters of the paper's Table 1). Nothing in it was changed but a name that
# newer versions of numpy no longer have. Each run starts from $\mathbf{A}\,(1 + 10^{-10} g)$ with $g$ normal, the first from $\mathbf{A}$ itself. That is *restart* $k$, and $k = 0$ is the plain start. himap makes the same steps in the reading `code`
# ({doc}`16_readings`), with thresholds on HEALPix pixels as there. Its runs are stored with the book, as are those of the authors' code; a few are made anew here.

# %% tags=["parameters"]
preset: str = "ci"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
reading: str = "default"  # SDecGMCA in the last section: default, letter, code or follow-up
n_sources: int = 5  # sources
n_restarts: int = 4  # starts of the runs that are made anew
results: list | None = None  # what `himap measure authors` wrote; null: that of the book
records: list | None = None  # what `himap measure restarts` wrote; null: those of the book
flags: list | None = None  # what `himap measure flags` wrote; null: those of the book
reference: str | None = None  # runs of the authors' code; null: those of the checkout

# %% tags=["hide-input"]
import warnings

import numpy as np
import pandas as pd
from IPython.display import Markdown

from himap.app.stored import RESULTS
from himap.figures import plotting
from himap.figures.numbers import one_run, quote, show, show_table
from himap.figures.tables import Table
from himap.measures.diagnostics import FAILING
from himap.measures.ensembles import compare_samples
from himap.paper import ensembles
from himap.paper.authors_code import read_authors_ensemble
from himap.paper.ensembles import MEASURES, VARIANTS, curves
from himap.paper.ensembles_figures import distributions_figure, growth_figure, variants_figure
from himap.paper.experiments import authors, find_experiment
from himap.paper.methods import paper_beams, sdecgmca_for
from himap.paper.record import Record
from himap.paper.restarts import flag_table
from himap.paper.study import Study
from himap.removal.base import SeparationWarning
from himap.removal.beam_subspace import BeamSubspace

warnings.simplefilter("ignore", SeparationWarning)
beam = paper_beams(ripple=ripple)["oscillating"]
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)
live = [sdecgmca_for(beam, reading=reading, n_sources=n_sources, restart=k) for k in range(n_restarts)]
study.check({beam: live})

stored = [Record.load(authors.EXPERIMENT, path) for path in results or sorted(RESULTS.glob("authors_*.json"))]
ours = {record.made.galaxy.partition(" ")[0]: record.rows for record in stored}
theirs = read_authors_ensemble(
    reference or RESULTS.parents[1] / "tests" / "data" / "authors_ensemble.json"
).query("thresholds == 'mad' and sign == 'free' and alms == 'own'")
larger = theirs[theirs["preset"] == "laptop"]
theirs = {name: theirs[(theirs["preset"] == "ci") & (theirs["galaxy"] == name)] for name in ours}
NAMES = {"synthetic": "synthetic Galaxy", "templates": "real Galaxy"}
Markdown("\n\n".join(f"*{record.made.footer()}*" for record in stored))

# %% [markdown]
# (restarts-growth)=
# ## A change in the tenth digit
#
# Let $\theta$ be the largest angle between the space of the columns of $\mathbf{A}$ of a restart and that of the plain start, after the same number of iterations. It does not depend on the scale, the sign or the order of the columns. At the start $\sin\theta$ is
# $10^{-10}$. Where it is one, the two have a spectrum that is in one of them alone.
#
# Look at the first five iterations. The first one multiplies the change by {glue:text}`restarts_first_ours` (himap) and {glue:text}`restarts_first_theirs` (authors' code), medians over both Galaxies. The median is above a hundredth from iteration
# {glue:text}`restarts_order_ours` and {glue:text}`restarts_order_theirs` on. It stays there: it is not a transient of the first iterations.

# %% tags=["hide-input"]
angles = {
    code: pd.concat([curves(rows, "angle") for rows in ensembles_of.values()])
    for code, ensembles_of in (("ours", ours), ("theirs", theirs))
}
first = {code: (angle[1] / angle[0]).median() for code, angle in angles.items()}
order = {code: int((angle.median() > 0.01).idxmax()) for code, angle in angles.items()}
quote(
    restarts_first_ours=(first["ours"], 0.1 * first["ours"]),
    restarts_first_theirs=(first["theirs"], 0.1 * first["theirs"]),
    restarts_order_ours=order["ours"],
    restarts_order_theirs=order["theirs"],
)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-restarts-growth", "caption": "How a change of the start by 1e-10 grows: sine of the largest angle between the columns of the mixing matrix of a restart and those of the plain start, by iteration. Thin lines are restarts, the thick line their median. Left: himap, reading `code`. Right: the public code of C21. Both on the same maps (preset `ci`, oscillating beam, five sources)."}}
panels = {}
for name in ours:
    panels |= {f"himap, {NAMES[name]}": ours[name], f"authors' code, {NAMES[name]}": theirs[name]}
plotting.stamp(growth_figure(panels), stored[0].made)

# %% [markdown]
# (restarts-converged)=
# ## No run converges
#
# A chaotic iteration does not settle. The table has the share of the runs that meet the two stopping rules, and the last relative change of $\hat{\mathbf{S}}$, which should be below $10^{-4}$. Both codes end each stage by the number of its iterations, at
# 150 and 50. So do the eight runs of the authors' code on a finer sky (preset `laptop`, $N_\mathrm{side} = 128$, real Galaxy).

# %% tags=["hide-input"]
RUNS = {
    **{f"himap, {NAMES[name]}": one for name, one in ours.items()},
    **{f"authors' code, {NAMES[name]}": one for name, one in theirs.items()},
    "authors' code, real Galaxy, laptop": larger,
}
rows = []
for title, each in RUNS.items():
    met, change = curves(each, "converged"), curves(each, "change").iloc[:, -1]
    met = met.reindex(columns=[150.0, 200.0])
    counts = [
        f"{int(column.sum())} of {column.count()}" if column.count() else "–" for _, column in met.items()
    ]
    rows.append([title, *counts, f"{change.median():.2g}", f"{change.min():.2g} to {change.max():.2g}"])
Table(
    ["runs", "warm-up meets its rule", "refinement meets its rule", "last change", "range"],
    rows,
    align="lrrrr",
)

# %% [markdown]
# (restarts-cause)=
# ## Where it comes from
#
# $\mathbf{A}$ is fitted to sources from which thresholds have removed small coefficients. Of those above the noise the share $K$ keeps the largest, and $K$ grows from zero. So in the first iteration a scale of a source has five coefficients that are not
# zero, the least that the code keeps, or few more. Fitted to that, the columns of $\mathbf{A}$ are nearly parallel: its condition number rises by many orders of magnitude in one iteration. Least squares with such a matrix
# amplifies a change by up to that factor, and the next thresholds decide by its result which coefficients stay.
#
# If this is the cause, the growth must end where the sources are not empty. The figure changes one thing at a time. *No $K$* keeps all coefficients above the noise, from the first iteration on ($K = 1$, one iteration of warm-up). *Instrument's noise* takes the
# noise of the thresholds from the instrument, carried through the inversion, in place of the median absolute deviation (MAD) of each scale.
#
# Without $K$ alone nothing is gained. The reason is the MAD: it is that of the source, signal included. A threshold of three times the scatter of a field removes nearly all of that field, whatever its noise. Both must go. With the noise
# of the instrument and without $K$ the iteration is stable if the signs of $\mathbf{A}$ are free, and it settles after {glue:text}`restarts_settled` iterations; the change of $10^{-10}$ stays below {glue:text}`restarts_stable`. With $\mathbf{A} \geq 0$ it grows slowly.

# %% tags=["hide-input"]
growth = {
    name: ensembles.variant_growth(study.case(beam), options, n_restarts, pixels="grid", n_sources=n_sources)
    for name, options in VARIANTS.items()
}

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-restarts-variants", "caption": "The same growth (left) and the condition number of the mixing matrix (right) for variants of the iteration, made anew here: the reading `code`, thresholds on an exact grid in place of HEALPix pixels. Thin lines are restarts, thick ones their medians. The iteration is stable where the thresholds leave most of the sources."}}
study.stamped(variants_figure(growth), beam=beam, n_sources=n_sources)

# %% [markdown]
# How empty the sources are is counted: the share of their starlet coefficients that the thresholds of the first iteration keep, for the fullest and for the emptiest source.

# %% tags=["hide-input"]
rows = {}
for name, options in VARIANTS.items():
    kept = 100 * ensembles.first_kept(study.case(beam), options | {"pixels": "grid", "n_sources": n_sources})
    angle, condition = (curves(growth[name], quantity).median() for quantity in ("angle", "condition"))
    rows[name] = {
        "kept, fullest": (kept.max(), 0.02 * kept.max(), "%"),
        "kept, emptiest": (kept.min(), 0.02 * kept.min(), "%"),
        "condition, iteration 1": one_run((condition[1], 0.1 * condition[1])),
        "sine, iteration 1": one_run((angle[1], 0.1 * angle[1])),
        "sine, the last": one_run((angle.iloc[-1], 0.1 * angle.iloc[-1])),
    }
show_table(rows, head="variant")

# %% [markdown]
# (restarts-distributions)=
# ## himap against the authors' code
#
# Two codes for a chaotic iteration cannot be compared run by run beyond its first iterations ({ref}`there they agree <readings-code>`). They can be compared as distributions. Below are those of the residual at $\ell \leq 64$, from
# {glue:text}`restarts_n_ours` restarts of himap or more, and {glue:text}`restarts_n_theirs` of the authors' code, on each Galaxy.
#
# The last $\hat{\mathbf{S}}$ comes from normal equations with eigenvalues that span more than nine decades. The public code raises those below $10^{-9}$ of the largest to that. The same $\mathbf{A}$ with a floor at $10^{-14}$, which is rounding, is shown beside it. A run *fails* if its mean
# $|C/C_0 - 1|$ is above 10 %, twice the 5 % of the paper. The floor of the last step makes most of the failures: it leaves foreground in the residual.

# %% tags=["hide-input"]
FLOORS = {1e-9: "floor of the code", 1e-14: "floor at rounding"}
quote(
    restarts_n_ours=min(curves(rows, "change").shape[0] for rows in ours.values()),
    restarts_n_theirs=min(curves(rows, "change").shape[0] for rows in theirs.values()),
)
rows = []
for title, each in RUNS.items():
    errors = curves(each, "mean error")[list(FLOORS)]
    rows.append([title, *(f"{(errors[floor] > FAILING).sum()} of {len(errors)}" for floor in FLOORS)])
Table(["runs that fail", *FLOORS.values()], rows, align="lrr")

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-restarts-distributions", "caption": "Share of the runs below a value, synthetic Galaxy, for himap (solid) and the authors' code (dashed), with the two floors of the last step: mean ratios to the truth in two bands of multipoles and two of wavenumbers (1/MHz), the highest ratio near the ripple, the share of the sky that the paper's criterion flags, and the condition number of the mixing matrix. P/P0 has the truth at all multipoles; these runs end at 64. Flagged lines are against the truth up to there."}}
name, *others = ours
plotting.stamp(
    distributions_figure({"himap": ours[name], "authors' code": theirs[name]}, FLOORS), stored[0].made
)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-restarts-distributions-real", "caption": "The same on the real Galaxy."}}
name = (others or [name])[0]
plotting.stamp(
    distributions_figure({"himap": ours[name], "authors' code": theirs[name]}, FLOORS), stored[-1].made
)

# %% [markdown]
# The two-sample test of Kolmogorov and Smirnov asks whether both can come from one distribution. The table has its $p$ for each quantity, from permutations of the runs. The last row is of all quantities at
# once: the $p$ of the mean distance of their distribution functions.

# %% tags=["hide-input"]
columns = {}
for name in ours:
    for floor, title in FLOORS.items():
        found = compare_samples(*(ensembles.samples(one[name], floor) for one in (ours, theirs)))
        columns[f"{NAMES[name]}, {title}"] = [*found[1], found[2]]
table = pd.DataFrame(columns, index=[*MEASURES, "condition", "all"])
quote(restarts_p_least=(min(table.iloc[-1]), 0.01))
Table(
    ["quantity", *table],
    [[name, *(f"{p:.2f}" for p in row)] for name, row in zip(table.index, table.to_numpy(), strict=True)],
    align="l" + "r" * table.shape[1],
)

# %% [markdown]
# The least $p$ of the last row is {glue:text}`restarts_p_least`. What follows about himap's SDecGMCA is therefore not about a bug of himap.

# %% [markdown]
# (restarts-failures)=
# ## How often it fails
#
# The above is one sky at one size. Here a run fails by the mean at $10 < \ell < 200$, or up to the end of the maps. The tables have the share of the runs that fail, and the interval of its probability (Wilson, two sigma). Members are
# skies times restarts. Readings are those of {doc}`16_readings`; `code-rounding` is `code` with the floor of the last step at rounding. The number of sources is that of Table 1 in each column.

# %% tags=["hide-input"]
RESTARTS = find_experiment("restarts")
measured = [Record.load(RESTARTS, path) for path in records or sorted(RESULTS.glob("restarts_*.json"))]
sizes = {}
for one in measured:
    sizes.setdefault(f"{one.made.preset}, {NAMES[one.made.galaxy.partition(' ')[0]]}", []).append(one.rows)
sizes = {size: pd.concat(several) for size, several in sizes.items()}
READ = ("default", "letter", "code", "code-rounding", "follow-up", "instrument-noise")
NONE = "no record is stored with this book"


def share(row):
    """How many fail, of how many, and the interval, of a row of `ensembles.failures`."""
    return f"{row.failed}/{row.members} ({100 * row.low:.0f}–{100 * row.high:.0f} %)"


def by_column(rows, index, column):
    """A table of `share`, a row for each `index`, a column for each value of `column`."""
    shown = {}
    for row in ensembles.failures(rows).itertuples():
        shown.setdefault(getattr(row, index), {})[getattr(row, column)] = share(row)
    return shown


cases, lines = ("degraded", "evolving", "oscillating", "dimmed"), []
for size, rows in sizes.items():
    chosen = rows[rows["reading"].isin(READ) & rows["case"].isin(cases)]
    lines += [
        [size, one, *(row.get(case, "") for case in cases)]
        for one, row in by_column(chosen, "reading", "case").items()
    ]
head = ["sky", "reading", "degraded", "evolving", "oscillating", "oscillating, plane dimmed"]
Table(head, lines or [[NONE, *[""] * 5]], align="llrrrr")

# %% [markdown]
# The same through the oscillating beam with other numbers of sources:

# %% tags=["hide-input"]
counts, lines = (2, 3, 4, 5, 6, 7, 8, 10, 15, 20), []
for size, rows in sizes.items():
    chosen = rows[rows["reading"].isin(READ) & rows["case"].isin(["oscillating", "scan"])]
    lines += [
        [size, one, *(row.get(count, "") for count in counts)]
        for one, row in by_column(chosen, "reading", "n_sources").items()
    ]
Table(["sky", "reading", *map(str, counts)], lines or [[NONE, *[""] * 11]], align="ll" + "r" * len(counts))

# %% [markdown]
# (restarts-flags)=
# ## Without the truth
#
# Nobody has the truth of an observation. Is there a number of a run that tells whether it failed? For each the table has the share of the failed runs that its flag finds, the share of the sound ones that it accuses, the chance that a failed run has
# the larger number than a sound one (one half is a coin), and what follows if one chooses, of the restarts of a sky, the one with the least of it: how often that one fails. With the distance that is the *medoid*, the restart that
# differs least from the others. A flag that is set in every run, sound or not, flags nothing.

# %% tags=["hide-input"]
FLAGS = find_experiment("flags")
flagged = [Record.load(FLAGS, path) for path in flags or sorted(RESULTS.glob("flags_*.json"))]
rows = [
    [f"{one.made.preset}, {NAMES[one.made.galaxy.partition(' ')[0]]}", *row]
    for one in flagged
    for row in flag_table(one.rows).to_numpy().tolist()
]
head = ["sky", "flag", "hit rate", "false alarms", "ranked right", "least of it fails"]
Table(head, rows or [[NONE, *[""] * 5]], align="llrrrr")

# %% [markdown]
# (restarts-way-out)=
# ## The way out
#
# - **A stable iteration.** `SDecGMCA(thresholds="analytic", share=1, n_warmup=1, sign="free")`: the noise of the instrument, no $K$, no constraint on signs. It settles, and restarts agree. It has a price, in the table: more HI is lost at low $\ell$,
#   about as much as by BeamSubspace with as many sources. With few sources less is lost.
# - **Another method for the same model.** BeamSubspace ({doc}`09_sdecgmca`) has the same mixture and no chaos.
# - **Restarts.** An ensemble, its median and its range, in place of one run: `SDecGMCA(restart=k)` in Python, for a cube the option `--restarts` of `himap clean`.
#
# The table has the median over {glue:text}`restarts_n_live` restarts made here, and the lowest and highest of them, for the reading of this notebook, the stable iteration, and BeamSubspace. The reading carries the regularised inversion beyond the last multipole ({doc}`09_sdecgmca`), and at this coarse resolution that alone puts $P/P_0$ of SDecGMCA above 1 at low $k_\nu$.

# %% tags=["hide-input"]
STABLE = {"thresholds": "analytic", "share": 1.0, "n_warmup": 1, "sign": "free"}
stable = [
    sdecgmca_for(beam, reading=reading, n_sources=n_sources, restart=k, **STABLE) for k in range(n_restarts)
]
methods = {
    f"SD, {reading}": live,
    "SD, stable": stable,
    "BeamSubspace": [BeamSubspace(n_sources=n_sources)],
    "BeamSubspace, 3": [BeamSubspace(n_sources=3)],
}
columns = {}
for title, several in methods.items():
    bands = pd.DataFrame([study.bands(beam, one) for one in several])
    low, middle, high = bands.min(), bands.median(), bands.max()
    columns[title] = {
        name: one_run(f"{middle[name]:.2f} ({low[name]:.2f}–{high[name]:.2f})")
        if several is live
        else (middle[name], 0.01 * max(1, middle[name]))
        for name in bands
    }
show_table({name: {title: one[name] for title, one in columns.items()} for name in bands})

# %% tags=["hide-input"]
runs = [study.assessed(beam, one) for one in stable]
spread = pd.DataFrame([study.bands(beam, one) for one in stable])
largest = growth["no $K$, instrument's noise"].query("quantity == 'angle'")["value"].max()
quote(
    restarts_n_live=n_restarts,
    restarts_settled=int(np.median([run.n_iterations for run in runs])),
    restarts_stable=one_run((10 ** np.ceil(np.log10(largest)), largest)),
)
show(
    {
        "stable iteration: restarts that meet both stopping rules": sum(run.converged for run in runs),
        "stable iteration: largest relative difference between restarts, of all bands": one_run(
            f"{(spread.max() / spread.min() - 1).max():.0e}"
        ),
    }
)

# %% [markdown]
# A live run is not compared with a stored one: another processor gives another draw. What can be compared is whether the runs made here come from the stored ensemble. The cell says for each quantity whether one of them
# at least is within its range, widened by half on a logarithmic axis: with four that fails by chance less than once in ten thousand times.

# %% tags=["hide-input"]
same_sky = (preset, survey, ripple, n_sources) == ("ci", {}, "bracket", 5) and galaxy in ours
if same_sky:
    here = pd.DataFrame(
        authors.member(study.case(beam), authors.of_code(beam, restart=k, pixels="grid"))
        for k in range(n_restarts)
    )
    verdicts = {
        f"{name}, {title}": ensembles.any_within(
            [one[floor] for one in here[name]], curves(ours[galaxy], name)[floor]
        )
        for name in MEASURES
        for floor, title in FLOORS.items()
    }
    print("\n".join(f"{name}: {'within' if inside else 'outside'}" for name, inside in verdicts.items()))
else:
    print("no ensemble of this sky is stored")

# %% [markdown]
# ## What to take away
#
# - The iteration of SDecGMCA is chaotic, in its authors' code as in himap. A result of it is a draw, and is worth reporting with its scatter over restarts.
# - The cause is not rounding, which only triggers it. It is that $\mathbf{A}$ is fitted to nearly empty sources: by $K$, and by thresholds from the MAD of the sources themselves.
# - Both codes agree as distributions.
# - Where many runs fail, a floor of eigenvalues at $10^{-9}$ in the last step is the first thing to look at. It is one line.
# - The stopping rules are not met. That alone can be seen without the truth, and is worth a warning.
#
# ## Exercises
#
# **1.** A change of $10^{-10}$ grows tenfold in each iteration. After how many is it of order one, in double precision, if only rounding triggers it?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Rounding is $10^{-16}$: after sixteen. No precision helps for long: twice as many digits cost twice as many iterations, and there are two hundred.
#
# </details>
#
# **2.** A source is Gaussian noise. Which share of its coefficients is above three times the scatter that its MAD gives? And if there is a faint Gaussian signal in it?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# $0.27$ % of them, in both cases: the MAD is of signal and noise together, so that the threshold grows with the signal. Only what is sparse passes.
#
# </details>
#
# **3.** None of 8 restarts fails. How large may the probability of failure be?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# With a probability $p$ that happens in $(1 - p)^8$ of the cases. That is 5 % for $p = 0.31$: eight good runs do not exclude that every third one fails.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 27_restarts -p n_restarts=8
# himap run 27_restarts -p galaxy=templates -p template_dir=maps
# himap measure authors --preset ci -p n_restarts=24 -p n_realisations=1 -o authors.json   # the ensemble of this chapter
# ```
