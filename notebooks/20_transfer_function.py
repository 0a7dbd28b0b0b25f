# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/transfer_*.json
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
# # What was lost, and how to get it back
#
# > - **Read first**: {doc}`04_pca`, {doc}`10_results`.
# > - **Good to know**: what an estimator and its bias are.
# > - **Time and memory**: {cost}`20_transfer_function`.
#
# Every method takes some HI away with the foreground. The paper measures how much against the truth; nobody with a telescope can. What observers do instead is to put a **mock** $m$, HI that they know, into their data $d$, clean
# both together, and look how much of it comes back ({cite:t}`switzer2013`, {cite:t}`cunnington2023`):
#
# ```{math}
# \hat m = \mathrm{clean}(d + m) - \mathrm{clean}(d) , \qquad
# T_\mathrm{auto} = \frac{\langle |\hat m|^2 \rangle}{\langle |m|^2 \rangle} , \qquad
# T_\mathrm{cross} = \frac{\langle \hat m\, m^* \rangle}{\langle |m|^2 \rangle} .
# ```
#
# A power spectrum of the cleaned maps over $T$ is then an estimate of that of the truth, and the scatter of mocks that are corrected by each other is its error bar. The paper has neither; this chapter asks whether they hold: where, for
# which method, and how well the mock has to be known. Here a mock is the truth of another sky, HI and noise seen through the same beam, as in {doc}`10_results`.
#
# Why two definitions, and not one and its square? What a projection keeps it keeps whole, so that $T_\mathrm{auto} = T_\mathrm{cross}$, and an auto spectrum is divided by $T$ once. The two differ where a mock changes what is taken of the
# *data*: that power comes back with the mock, has nothing in common with it, and is not in the data without it. So $T_\mathrm{cross}$ is what $T$ means here, as for {cite:t}`cunnington2023`, and the other stands beside it.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, meerkat or a file of widths or b_l
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
methods: list = [["beam_subspace", 3], ["pca", 6], ["pca", 8]]  # pairs of a name and a number of sources
reading: str = "default"  # SDecGMCA: default, letter, code or follow-up
n_mocks: int = 3  # mocks, each with a seed of its own
results: list | None = None  # what `himap measure transfer` wrote; null: that of the book
larger: list | None = None  # the same at laptop

# %%
import warnings

import numpy as np
import pandas as pd

from himap.app.stored import RESULTS
from himap.figures import plotting, styles
from himap.figures.numbers import quote, show_table
from himap.figures.tables import Table
from himap.measures.diagnostics import Comparison
from himap.measures.transfer import TransferFunction
from himap.paper.experiment_figures import transfer_figure
from himap.paper.experiments.transfer import EXPERIMENT, coverage, skies
from himap.paper.mocks import Mock, own_recovery, transfer_functions
from himap.paper.record import Record
from himap.paper.study import Study
from himap.paper.study_figures import both_figure
from himap.removal.base import SeparationWarning

warnings.simplefilter("ignore", SeparationWarning)
(first_sky,) = skies(
    preset=preset,
    survey=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    beam=beam,
    ripple=ripple,
    methods=methods,
    reading=reading,
    n_mocks=n_mocks,
    n_realisations=1,
)
((case, removers),) = first_sky.methods.items()
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)
mocks = first_sky.mocks
names = {remover: styles.numbered(remover.name, getattr(remover, "n_sources", 0)) for remover in removers}
shades = dict(zip(removers, styles.sequence(list(names.values())), strict=True))

# %% [markdown]
# ## Transfer functions

# %% tags=["hide-input"]
transfer = transfer_functions(case, removers, mocks)
own = {remover: own_recovery(case, remover) for remover in removers}
l_top = min(study.l_top, 200)


def over_l(remover, of=transfer):
    """(l, T) in bins as wide as an eighth of l, or of one l, up to where pixels begin to matter."""
    found = of[remover]
    edges = np.unique(np.round(2 * 1.125 ** np.arange(60)).astype(int))
    edges = edges[edges <= min(l_top, found.degrees[-1]) + 1]
    weights = 2 * found.degrees + 1
    bins = [slice(*pair) for pair in zip(edges[:-1], edges[1:], strict=True)]
    means = [np.average(found.angular[one], weights=weights[one]) for one in bins]
    return [np.average(found.degrees[one], weights=weights[one]) for one in bins], means


across = [(*over_l(remover), shades[remover]) for remover in removers]
along = [(transfer[remover].k[1:], transfer[remover].frequency[1:], shades[remover]) for remover in removers]
shared = {"xscale": "log", "ylabel": r"$T$", "ylim": (0, 1.1)}
panels = [
    {"curves": across, "title": "across the sky", "xlabel": styles.AXES["angular"]["xlabel"]} | shared,
    {"curves": along, "title": "along the line of sight", "xlabel": styles.AXES["frequency"]["xlabel"]}
    | shared,
]

# %% [markdown]
# At 1 all of a mock comes back. $T$ falls at the lowest $\ell$ and at the smallest $k_\nu$, where HI resembles what is removed, and the more so the
# more spectra a method takes. A dip at the ripple is HI that went with components that carry it.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-functions", "caption": "Which share of the power of mocks comes back, by multipole (left, in bins) and by wavenumber along frequency (right). A method that takes more spectra keeps less of both."}}
study.stamped(plotting.lines(panels), beam=case.beam, n_mocks=n_mocks)

# %% [markdown]
# ## One sky, corrected
#
# The power of the residual of the first sky over that of the truth, before and after it is divided by $T$. The mocks do not know this truth.


# %% tags=["hide-input"]
def compared(remover, correct=False):
    """A `Comparison` of the residual with the truth, divided by T if it is to be corrected."""
    found, one = transfer[remover], own[remover]
    inside = (found.degrees >= 2) & (found.degrees <= l_top)
    angular, frequency = one.output.angular, one.output.frequency
    return Comparison(
        degrees=found.degrees[inside],
        angular=(angular if not correct else angular / np.maximum(found.angular, 1e-9))[inside],
        true_angular=one.input.angular[inside],
        k=found.k[1:],
        frequency=(frequency if not correct else frequency / found.frequency)[1:],
        true_frequency=one.input.frequency[1:],
    )


first, *others = removers
pairs = [first, *others[:1]]
curves = []
for remover, colour in zip(pairs, (styles.INDIGO, styles.ORANGE), strict=False):
    before = {"label": f"{names[remover]}, uncorrected", "color": colour, "linestyle": ":"}
    after = {"label": f"{names[remover]}, corrected", "color": colour, "linestyle": "-"}
    curves += [(before, compared(remover)), (after, compared(remover, correct=True))]

# %% [markdown]
# Dotted is the residual, solid the same corrected: the ratios should move to 1, and do where only HI is missing.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-corrected", "caption": "Spectra of the residuals of the first two methods on the first sky, as they are (dotted) and divided by the transfer function (solid), and their ratios to the truth. The grey band is 10 %."}}
both_figure(study, case.beam, curves, n_mocks=n_mocks)

# %% tags=["hide-input"]
columns = {"uncorrected": "uncorrected", "over T cross": "corrected", "over T auto": "corrected_auto"}
rows = {
    f"{styles.numbered(row.method, row.n_sources)}, {row.band}": {
        column: (getattr(row, name), 0.02 * max(1, abs(getattr(row, name))))
        for column, name in columns.items()
    }
    for row in EXPERIMENT.table([first_sky]).itertuples()
}
show_table(rows)

# %% [markdown]
# What is left of foreground is no loss, and no transfer function takes it away: it is divided by $T$ as well, and stands out most where $T$ is least, at the lowest $k_\nu$. And a method that takes more spectra than the foreground has
# begins to take those of this very HI. There the two definitions part: a mock that is added changes which spectra these are.
#
# ## By multipole and wavenumber
#
# The loss is one of low $k_\nu$: of spectra that are smooth. How far it reaches depends on $\ell$ through the beam.

# %% tags=["hide-input"]
width = max(2, l_top // 32)
edges = np.arange(2, min(l_top, transfer[first].degrees[-1]) + 1, width)
share, k = transfer[first].cylindrical(edges), transfer[first].k
shown = (k > 0) & (k < 0.25)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-cylindrical", "caption": "The transfer function of the first method by multipole, in bins, and wavenumber along frequency."}}
study.stamped(
    plotting.image(
        share[:, shown],
        x=k[shown],
        y=(edges[:-1] + edges[1:]) / 2,
        xlabel=styles.AXES["frequency"]["xlabel"],
        ylabel=styles.AXES["angular"]["xlabel"],
        unit="$T$",
        limits=(0, 99),
    ),
    beam=case.beam,
    method=first.name,
    n_sources=first.n_sources,
    n_mocks=n_mocks,
)

# %% [markdown]
# ## Is the answer that of the mock?
#
# A mock has a cosmology, and the data may have another one. The first mock once more: with a bias of HI that is higher by 30 %, with twice and with half the HI, and as Gaussian fields with the same powers in every channel and pair of
# channels, but without peaks. Shown is $T$ over that of the mock as it was.

# %% tags=["hide-input"]
variants = {
    "bias × 1.3": {"bias": 1.3},
    "twice the HI": {"abundance": 2.0},
    "half the HI": {"abundance": 0.5},
    "Gaussian": {"gaussian": True},
}
usual = {first: TransferFunction(mocks=transfer[first].mocks[:1])}
looks = [(styles.BLUE, "-"), (styles.VERMILION, "--"), (styles.GREEN, "-."), (styles.PURPLE, ":")]
sky, line, changes = [], [], {}
for (label, changed), (colour, dashes) in zip(variants.items(), looks, strict=True):
    other = transfer_functions(case, [first], [Mock(seed=mocks[0].seed, **changed)])
    style = {"label": label, "color": colour, "linestyle": dashes}
    (degrees, means), (_, reference) = over_l(first, other), over_l(first, usual)
    sky.append((degrees, np.divide(means, reference), style))
    k, ratio = usual[first].k[1:], other[first].frequency[1:] / usual[first].frequency[1:]
    line.append((k, ratio, style))
    high, low = np.array(degrees) >= 10, k > 0.03
    changes[label] = (
        np.abs(sky[-1][1][high] - 1).max(),
        np.abs(ratio[low] - 1).max(),
        np.abs(ratio[~low] - 1).max(initial=0),
    )
limits = {"xscale": "log", "ylim": (0.97, 1.03), "ylabel": r"$T / T_\mathrm{usual}$"}
panels = [
    {"curves": sky, "title": "across the sky", "xlabel": styles.AXES["angular"]["xlabel"], **limits},
    {
        "curves": line,
        "title": "along the line of sight",
        "xlabel": styles.AXES["frequency"]["xlabel"],
        **limits,
    },
]

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-mocks", "caption": "The transfer function of the first method from a mock that is changed, over that from the same mock as it was. Curves beyond 3 % are cut off."}}
study.stamped(plotting.lines(panels), beam=case.beam, method=first.name, n_sources=first.n_sources)

# %% tags=["hide-input"]
quote(
    transfer_changed_l=(100 * max(one for one, _, _ in changes.values()), 0.3, "%"),
    transfer_changed_k=(100 * max(one for _, one, _ in changes.values()), 0.3, "%"),
    transfer_changed_low_k=(100 * max(one for _, _, one in changes.values()), 1, "%"),
)

# %% [markdown]
# For the first method these change $T$ by up to {glue:text}`transfer_changed_l` at $\ell \geq 10$, by up to {glue:text}`transfer_changed_k` at $k_\nu > 0.03$, and below by up to {glue:text}`transfer_changed_low_k`.
#
# (transfer-record)=
# ## Over many skies
#
# One sky says little of an estimator. What follows was measured before, on many, and stored with the book:
#
# ```sh
# himap measure transfer --preset quick -p n_mocks=6 -p 'methods=[["beam_subspace", 3], ["beam_subspace", 4], ["pca", 6], ["pca", 8]]' --jobs 2
# ```
#
# and the same once more with `-p galaxy=templates -p template_dir=FOLDER`.
#
# Each sky is corrected with the same mocks. Shown is the mean over skies in bands of $\ell$ and $k_\nu$. The *scatter* is the standard deviation over skies of the corrected ratio, *expected* is what the mocks predict for it, and the last column
# counts the skies on which the truth is within one standard deviation of that prediction, with the binomial 95 % interval of that share: of true error bars those are 68 %. Because all skies share their mocks they are not independent, and the intervals are rather too narrow.

# %% tags=["hide-input"]
GALAXIES = ("synthetic", "templates")


def stored(paths, size):
    """The records in some files, or those of the book."""
    paths = paths or [RESULTS / f"transfer_{size}_{name}.json" for name in GALAXIES]
    return [Record.load(EXPERIMENT, path) for path in paths]


def shown(records):
    """The figure of some records."""
    return plotting.stamp(
        transfer_figure({f"{one.made.galaxy} Galaxy": one.rows for one in records}),
        "\n".join(one.made.footer() for one in records),
    )


def summarised(records):
    """Their table."""
    summaries = [EXPERIMENT.summary(one.rows) for one in records]
    rows = [
        (one.made.galaxy, *row)
        for one, summary in zip(records, summaries, strict=True)
        for row in summary.itertuples(index=False)
    ]
    return Table(["Galaxy", *summaries[0].columns], rows, align="lll" + "r" * (summaries[0].shape[1] - 2))


records = stored(results, "quick")

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-record", "caption": "Means over skies of power over that of the truth in bands, uncorrected (open) and divided by the transfer function (filled; the bars are one standard deviation of a single sky). What is wrong by more than 20 % is not drawn. The grey lines are 1 % off."}}
shown(records)

# %% tags=["hide-input"]
summarised(records)

# %% [markdown]
# (transfer-larger)=
# ## With twice the resolution
#
# At `laptop`, of 128 in $N_\mathrm{side}$ and 250 channels, and with SmoothSpectra ({doc}`23_thresholds`) among the methods, on {glue:text}`transfer_larger_skies` skies with each Galaxy, with {glue:text}`transfer_larger_mocks` mocks:
#
# ```sh
# himap measure transfer --preset laptop -p n_mocks=3 -p 'methods=[["beam_subspace", 3], ["smooth_spectra", 4], ["pca", 6]]' --jobs 2
# ```
#
# Look whether a filled point is where it was: mocks measure signal loss at any size, and they do not measure the foreground residual.

# %% tags=["hide-input"]
finer = stored(larger, "laptop")

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-larger", "caption": "As the figure before, at laptop."}}
shown(finer)

# %% tags=["hide-input"]
summarised(finer)

# %% tags=["hide-input"]
SMALL = ("C/C0, 10-19", "C/C0, 20-39", "C/C0, 40-99", "C/C0, 100-200", "P/P0, 0.03-0.1", "P/P0, k > 0.1")
LARGE = ("C/C0, 2-4", "C/C0, 5-9")


def furthest(records, method, bands, column="corrected"):
    """How far the mean over skies is from 1 in the worst of some bands, the worst of some records, %."""
    own = [of_method(one, method, bands).groupby("band")[column].mean() for one in records]
    worst = 100 * (pd.concat(own) - 1).abs().max()
    return "not measured" if np.isnan(worst) else (worst, 0.3 * max(1, worst / 10), "%")


def within(records, method):
    """Share of skies and bands of each record in which the truth is within the error bar, and its interval, %."""
    texts = []
    for one in records:
        own = of_method(one, method, (*SMALL, *LARGE))
        if not len(own):
            return "not measured"
        hits, trials, low, high = coverage(own)
        texts.append(f"{100 * hits / trials:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)")
    return ", ".join(texts)


def of_method(record, method, bands):
    """The rows of a method in some bands."""
    rows = record.rows
    name, n_sources = method
    return rows[(rows["method"] == name) & (rows["n_sources"] == n_sources) & rows["band"].isin(bands)]


three, four, six, eight = ("beam_subspace", 3), ("beam_subspace", 4), ("pca", 6), ("pca", 8)
smooth = ("smooth_spectra", 4)
quote(
    transfer_bs_left=furthest(records, three, SMALL, "uncorrected"),
    transfer_bs_small=furthest(records, three, SMALL),
    transfer_bs_large=furthest(records, three, LARGE),
    transfer_bs_within=within(records, three),
    transfer_more_left=furthest(records, four, SMALL, "uncorrected"),
    transfer_more_small=furthest(records, four, SMALL),
    transfer_more_large=furthest(records, four, LARGE),
    transfer_more_within=within(records, four),
    transfer_few_left=furthest(records, six, SMALL, "uncorrected"),
    transfer_few_small=furthest(records, six, SMALL),
    transfer_few_large=furthest(records, six, LARGE),
    transfer_few_within=within(records, six),
    transfer_many_left=furthest(records, eight, SMALL, "uncorrected"),
    transfer_many_small=furthest(records, eight, SMALL),
    transfer_many_large=furthest(records, eight, LARGE),
    transfer_many_within=within(records, eight),
    transfer_skies=min(len(one.seeds) for one in records),
    transfer_mocks=dict(records[0].made.overrides)["n_mocks"],
    transfer_larger_bs_left=furthest(finer, three, SMALL, "uncorrected"),
    transfer_larger_bs_small=furthest(finer, three, SMALL),
    transfer_larger_bs_large=furthest(finer, three, LARGE),
    transfer_larger_bs_within=within(finer, three),
    transfer_larger_smooth_left=furthest(finer, smooth, SMALL, "uncorrected"),
    transfer_larger_smooth_small=furthest(finer, smooth, SMALL),
    transfer_larger_smooth_large=furthest(finer, smooth, LARGE),
    transfer_larger_smooth_within=within(finer, smooth),
    transfer_larger_few_left=furthest(finer, six, SMALL, "uncorrected"),
    transfer_larger_few_small=furthest(finer, six, SMALL),
    transfer_larger_few_large=furthest(finer, six, LARGE),
    transfer_larger_few_within=within(finer, six),
    transfer_larger_skies=min(len(one.seeds) for one in finer),
    transfer_larger_mocks=dict(finer[0].made.overrides)["n_mocks"],
    transfer_more_auto=furthest(records, four, SMALL, "corrected_auto"),
    transfer_many_auto=furthest(records, eight, SMALL, "corrected_auto"),
)

# %% [markdown]
# ## What to take away
#
# Over {glue:text}`transfer_skies` skies with the synthetic and as many with the real Galaxy at `quick`, through the oscillating beam, {glue:text}`transfer_mocks` mocks. A number is how far the mean over skies is from the
# truth in the worst band of $\ell \geq 10$ and $k_\nu > 0.03$, of the Galaxy where that is more, and in brackets in the worst band of $\ell < 10$:
#
# | method | as it is left | corrected | | within the error bar, synthetic Galaxy, real Galaxy |
# |---|---|---|---|---|
# | BeamSubspace, 3 sources | {glue:text}`transfer_bs_left` | {glue:text}`transfer_bs_small` | ({glue:text}`transfer_bs_large`) | {glue:text}`transfer_bs_within` |
# | BeamSubspace, 4 sources | {glue:text}`transfer_more_left` | {glue:text}`transfer_more_small` | ({glue:text}`transfer_more_large`) | {glue:text}`transfer_more_within` |
# | PCA, 6 components | {glue:text}`transfer_few_left` | {glue:text}`transfer_few_small` | ({glue:text}`transfer_few_large`) | {glue:text}`transfer_few_within` |
# | PCA, 8 components | {glue:text}`transfer_many_left` | {glue:text}`transfer_many_small` | ({glue:text}`transfer_many_large`) | {glue:text}`transfer_many_within` |
#
# And at `laptop`, over {glue:text}`transfer_larger_skies` skies with each Galaxy:
#
# | method | as it is left | corrected | | within the error bar, synthetic Galaxy, real Galaxy |
# |---|---|---|---|---|
# | BeamSubspace, 3 sources | {glue:text}`transfer_larger_bs_left` | {glue:text}`transfer_larger_bs_small` | ({glue:text}`transfer_larger_bs_large`) | {glue:text}`transfer_larger_bs_within` |
# | SmoothSpectra, 4 sources | {glue:text}`transfer_larger_smooth_left` | {glue:text}`transfer_larger_smooth_small` | ({glue:text}`transfer_larger_smooth_large`) | {glue:text}`transfer_larger_smooth_within` |
# | PCA, 6 components | {glue:text}`transfer_larger_few_left` | {glue:text}`transfer_larger_few_small` | ({glue:text}`transfer_larger_few_large`) | {glue:text}`transfer_larger_few_within` |
#
# - **$T_\mathrm{cross}$ is the one to divide by.** By $T_\mathrm{auto}$ the third column of the first table would be {glue:text}`transfer_more_auto` for BeamSubspace with four sources, and {glue:text}`transfer_many_auto` for PCA with eight: these take spectra of
#   this very HI, and a mock changes which. By $T_\mathrm{cross}$ what they lose comes back like the loss of any other.
# - **What is left of foreground no transfer function takes away**: it is divided by $T$ too. That is what is still too high in the tables above. More sources are no way out as such: what they
#   lose can be corrected in the mean, but its scatter grows.
# - **Correcting is no privilege of methods that know the beam.** PCA loses more, and more of it can be corrected, where it leaves no foreground; the tables say how well.
# - **The error bars are those of the loss alone.** They know nothing of the foreground that is left, neither of its mean nor of how it resembles the HI by chance. The last column would be 68 % if nothing but the loss mattered: they are a
#   lower bound.
#
# On a cube of one's own:
#
# ```sh
# himap transfer cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 --mocks 10 -o transfer.html
# himap transfer cube.h5 --method pca -p n_sources=5 --mocks mock1.h5 --mocks mock2.h5 --truth hi.h5 -o transfer.html
# ```
#
# ## Exercises
#
# **1.** Is what is corrected limited by the number of mocks? Take ten.
#
# ```sh
# himap run 20_transfer_function -p n_mocks=10                                       # better known
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# At $\ell \geq 10$ hardly anything moves. What is missing at $5 \leq \ell \leq 9$ stays missing: that is no scatter of the mocks but this one sky,
# whose HI resembles the foreground by chance, and its mocks do not. Only many skies tell whether the correction is right in the mean.
#
# </details>
#
# **2.** What comes back of a mock is $\hat m = 0.9\, m + e$, with $e$ unlike $m$ and of power $0.05\, \langle |m|^2 \rangle$. What are
# $T_\mathrm{cross}$ and $T_\mathrm{auto}$, and which is to be divided by?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# $T_\mathrm{cross} = 0.9$ and $T_\mathrm{auto} = 0.81 + 0.05 = 0.86$. $e$ came with the mock and is not in the data without it, so that nothing of it
# may be counted as HI that came back; a projection, which keeps whole what it keeps, would have $T_\mathrm{auto} = T_\mathrm{cross}$.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 20_transfer_function -p beam=degraded                                    # the easiest beam
# himap run 20_transfer_function -p 'methods=[["beam_subspace", 3], ["gmca", 5]]'    # other methods
# ```
