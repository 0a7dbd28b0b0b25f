# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/beam_errors_quick_*.json
#     - book/results/methods_*.json
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
# # What should I use on my data?
#
# > - **Read first**: {doc}`../book/glossary` for the words; {doc}`10_results`, {doc}`20_transfer_function` and {doc}`22_how_many` for the reasons.
# > - **Time and memory**: {cost}`25_side_by_side`.
#
# This chapter compares the paper's method, PCA, and the methods added in this book, with the three beams and
# over many skies. The last section recommends a method for each kind of data. $C/C_0$ and $P/P_0$ are the
# power of the residual over that of the truth.
#
# SDecGMCA and the first PCA have the numbers of sources of the paper's Table 1. The second PCA and
# BeamSubspace have the numbers that `himap suggest` recommends without the truth ({doc}`22_how_many`).
# SmoothSpectra has more than it needs ({doc}`23_thresholds`), and GNILC determines its number at each scale
# ({cite:t}`olivari2016`). SDecGMCA is run once on each sky, in the default reading ({doc}`16_readings`); its
# scatter includes that of restarts ({doc}`27_restarts`). All methods are compared by their median over skies,
# as failed runs of SDecGMCA dominate its mean.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
beams: list = ["degraded", "evolving", "oscillating"]  # of the data, by name
methods: list = [
    ["sdecgmca", [3, 4, 5]],
    ["pca", [3, 4, 5]],
    ["pca", [3, 5, 6]],
    ["beam_subspace", 3],
    ["smooth_spectra", 4],
    ["gnilc", None],
]  # pairs of a name and a number of sources, or one for each beam
corrected: list = ["pca", "beam_subspace", "smooth_spectra"]  # by mocks, in the record
n_mocks: int = 3  # mocks, each with a seed of its own, of `himap measure methods`
reading: str = "default"  # of SDecGMCA: default, letter, code, code-rounding, follow-up, instrument-noise
results: list | None = None  # what `himap measure methods` wrote; null: that of the book
iterated: list | None = None  # the same of methods whose correction takes long
larger: list | None = None  # the same at laptop

# %% tags=["hide-input"]
import warnings
from dataclasses import replace

import numpy as np

from himap.app.stored import RESULTS
from himap.figures import plotting, styles
from himap.figures.numbers import quote
from himap.figures.tables import Table
from himap.paper.experiment_figures import methods_figure, methods_table, signed
from himap.paper.experiments import beam_errors
from himap.paper.experiments.methods import EXPERIMENT, distances, failures, skies
from himap.paper.record import Record
from himap.paper.study import Study
from himap.removal.base import SeparationWarning

warnings.simplefilter("ignore", SeparationWarning)
(first_sky,) = skies(
    preset=preset,
    survey=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    ripple=ripple,
    beams=beams,
    methods=methods,
    reading=reading,
    n_realisations=1,
)
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)

# %% [markdown]
# ## One sky

# %%
first = EXPERIMENT.table([first_sky])

# %% [markdown]
# With the oscillating beam PCA with the paper's number has foreground residual (above 1). The others have
# signal loss (below 1), including SDecGMCA if its run does not fail. A run can also fail with the evolving
# beam. In all figures ratios are linear near 1 and logarithmic beyond, and the grey band is 10 %.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-first-angular", "caption": "C/C0 of each method, on the first sky, through each beam. Numbers of sources as in the legend, one for each beam where they differ. SDecGMCA: one run in the default reading."}}
study.stamped(methods_figure({"": first}, "angular"))

# %% [markdown]
# There is signal loss at the lowest wavenumbers and, with the oscillating beam and too few components, the
# ripple near $k_\nu = 0.31$.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-first-frequency", "caption": "P/P0 of each method, on the first sky, through each beam. SDecGMCA: one run in the default reading."}}
study.stamped(methods_figure({"": first}, "frequency"))

# %% [markdown]
# (side-record)=
# ## Over many skies
#
# At the lowest $\ell$ a sky has few modes. The following results are from {glue:text}`side_skies` skies with
# each Galaxy, stored with the book:
#
# ```sh
# himap measure methods --preset quick --jobs 2
# ```
#
# and again with `-p galaxy=templates -p template_dir=FOLDER`.

# %% tags=["hide-input"]
GALAXIES = ("synthetic", "templates")


def stored(paths, which):
    """The records in some files, or those of the book, one for each Galaxy."""
    paths = paths or [RESULTS / f"methods_{which}_{name}.json" for name in GALAXIES]
    return [Record.load(EXPERIMENT, path) for path in paths]


def tables_of(records):
    return [one.rows for one in records]


def figure_of(records, kind, **options):
    """The figure of some records, with what made them."""
    titled = {one.made.galaxy.partition(" ")[0]: one.rows for one in records}
    footer = "\n".join(in_short(one.made).footer() for one in records)
    return plotting.stamp(methods_figure(titled, kind, **options), footer)


def in_short(made):
    """A provenance without what the legend and the text say, which is too long for a line."""
    own = tuple(pair for pair in made.overrides if pair[0] not in ("beams", "methods"))
    return replace(made, overrides=own)


def deviations(records):
    header, rows = methods_table(tables_of(records))
    return Table(header, rows, align="l" + "r" * (len(header) - 1))


records = stored(results, "quick")

# %% [markdown]
# A narrow band means little scatter between skies. Skies on which SDecGMCA fails widen its band upwards.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-angular", "caption": "C/C0 of each method: median over skies (lines) and range of two thirds of them (bands); synthetic Galaxy (top) and real Galaxy (bottom). SDecGMCA: one run on each sky."}}
figure_of(records, "angular")

# %% [markdown]
# Ratios below 1 at the lowest wavenumbers are signal loss; a peak near $k_\nu = 0.31$ is the ripple of the
# beam.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-frequency", "caption": "P/P0 of each method: median over skies (lines) and range of two thirds of them (bands); synthetic Galaxy (top) and real Galaxy (bottom). SDecGMCA: one run on each sky."}}
figure_of(records, "frequency")

# %% [markdown]
# The signal loss, largest at the lowest $k_\nu$, varies little from sky to sky, so mocks can measure it
# ({doc}`20_transfer_function`). The next two figures show the same spectra divided by the transfer function
# from {glue:text}`side_mocks` mocks: the loss is corrected, but the foreground residual (above 1) is not.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-corrected-angular", "caption": "C/C0 divided by the transfer function: median over skies (lines) and range of two thirds of them (bands); synthetic Galaxy (top) and real Galaxy (bottom)."}}
figure_of(records, "angular", corrected=True)

# %% [markdown]
# The loss at the lowest wavenumbers is corrected, but the peak near $k_\nu = 0.31$ is not.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-corrected-frequency", "caption": "P/P0 divided by the transfer function: median over skies (lines) and range of two thirds of them (bands); synthetic Galaxy (top) and real Galaxy (bottom)."}}
figure_of(records, "frequency", corrected=True)

# %% [markdown]
# ## In numbers
#
# The table lists the deviation of the median over skies from 1 in the worst of five bands, three within
# $10 \leq \ell < 100$ and two at $k_\nu > 0.03$, for the Galaxy with the larger deviation. It is negative for
# signal loss and positive for foreground residual. At single $\ell$ and $k_\nu$, such as the peak at the
# ripple in the figures, it may be larger.

# %% tags=["hide-input"]
deviations(records)


# %% [markdown]
# A method fails on a sky if its mean $|C/C_0 - 1|$ is more than 10 % at $10 < \ell < 200$. Number of failures
# on {glue:text}`side_total` skies with both Galaxies:


# %% tags=["hide-input"]
def failing(records):
    """On how many skies each method fails through each beam."""
    counts = failures(tables_of(records))
    beams, names = (list(dict.fromkeys(key[n] for key in counts)) for n in (0, 1))
    methods = sorted({key[1:] for key in counts}, key=lambda one: (names.index(one[0]), one[1]))
    rows = [
        (styles.numbered(name, str(n or "")), *(counts.get((beam, name, n), "–") for beam in beams))
        for name, n in methods
    ]
    return Table(["fails on", *beams], rows, align="l" + "r" * len(beams))


failing(records)

# %% [markdown]
# GMCA, whose correction is slow, with a transfer function for the oscillating beam:
#
# ```sh
# himap measure methods --preset quick -p 'beams=["oscillating"]' -p 'methods=[["gmca", 5]]' -p 'corrected=["gmca"]' --jobs 2
# ```
#
# A single run of SDecGMCA is not corrected: with mocks in the data the next run is a different draw, whose
# cross power with the mocks can be negative.

# %% tags=["hide-input"]
deviations(stored(iterated, "iterated"))

# %% [markdown]
# (side-larger)=
# ## With twice the resolution
#
# The same at `laptop` (`nside` 128, 250 channels), through the oscillating beam, on {glue:text}`side_larger_skies` skies with each Galaxy:
#
# ```sh
# himap measure methods --preset laptop -p 'beams=["oscillating"]' -p 'methods=[["sdecgmca", 5], ["pca", 5], ["pca", 6], ["beam_subspace", 3], ["smooth_spectra", 4]]' --jobs 2
# ```
#
# Components that suffice at `quick` may not suffice with more pixels and channels, especially at the highest
# $\ell$.

# %% tags=["hide-input"]
finer = stored(larger, "laptop")
quote(side_larger_skies=min(len(one.seeds) for one in finer))

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-larger-angular", "caption": "C/C0 of each method at laptop through the oscillating beam: median over skies (lines) and range of two thirds of them (bands); synthetic Galaxy (left) and real Galaxy (right). SDecGMCA: one run on each sky."}}
figure_of(finer, "angular")

# %% [markdown]
# PCA with six components has a peak at the ripple of the beam that is absent at `quick`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-side-larger-frequency", "caption": "P/P0 of each method at laptop through the oscillating beam: median over skies (lines) and range of two thirds of them (bands); synthetic Galaxy (left) and real Galaxy (right). SDecGMCA: one run on each sky."}}
figure_of(finer, "frequency")

# %% [markdown]
# Deviations as above, and the number of {glue:text}`side_larger_total` skies on which each method fails
# ({doc}`27_restarts` for SDecGMCA):

# %% tags=["hide-input"]
deviations(finer)

# %% tags=["hide-input"]
failing(finer)

# %% tags=["hide-input"]
knowing = [
    Record.load(beam_errors.EXPERIMENT, RESULTS / f"beam_errors_quick_{name}.json").rows for name in GALAXIES
]
limits = [beam_errors.tolerated(rows) for rows in knowing]
excess = [beam_errors.worst_excess(rows) for rows in knowing]
found, found_finer = distances(tables_of(records)), distances(tables_of(finer))


def at(beam, method, n_sources, corrected=False):
    """How far a method is from the truth, as in the table, without its sign."""
    value = found.get((beam, method, n_sources, corrected), np.nan)
    return signed(abs(value)).removeprefix("+")


def percent(share):
    """A share, such as of power, as a text."""
    return f"{100 * share:.2g}\N{NO-BREAK SPACE}%"


def with_width_wrong(n_sources, error=0.01):
    """Foreground residual of BeamSubspace in the worst band if the width is wrong by so much."""
    return percent(max(one["beam_subspace", n_sources, "width", error] for one in excess))


def n_failed(records, *methods, beam="oscillating"):
    """Number of failures of methods, pairs (name, number of sources), through a beam."""
    counts = failures(tables_of(records)).items()
    return sum(n for (through, *method), n in counts if through == beam and tuple(method) in methods)


many = max(n_sources for method, n_sources, *_ in excess[0] if method == "beam_subspace")
quote(
    side_skies=len(records[0].seeds),
    side_mocks=dict(records[0].made.overrides)["n_mocks"],
    side_same=at("degraded", "pca", 3),
    side_same_corrected=at("degraded", "pca", 3, True),
    side_known=at("oscillating", "beam_subspace", 3),
    side_known_corrected=at("oscillating", "beam_subspace", 3, True),
    side_paper=at("oscillating", "sdecgmca", 5),
    side_paper_evolving=at("evolving", "sdecgmca", 4),
    side_unknown_smooth=at("evolving", "pca", 5),
    side_unknown_smooth_corrected=at("evolving", "pca", 5, True),
    side_unknown=at("oscillating", "pca", 6),
    side_unknown_corrected=at("oscillating", "pca", 6, True),
    side_few=at("oscillating", "pca", 5),
    side_harmless=at("oscillating", "smooth_spectra", 4),
    side_harmless_corrected=at("oscillating", "smooth_spectra", 4, True),
    side_gnilc=at("oscillating", "gnilc", 0),
    side_failed_evolving=n_failed(records, ("sdecgmca", 4), beam="evolving"),
    side_failed=n_failed(records, ("sdecgmca", 5)),
    side_total=sum(len(one.seeds) for one in records),
    side_larger_failed=n_failed(finer, ("sdecgmca", 5)),
    side_larger_failed_pca=n_failed(finer, ("pca", 6)),
    side_larger_failed_aware=n_failed(finer, ("beam_subspace", 3), ("smooth_spectra", 4)),
    side_larger_total=sum(len(one.seeds) for one in finer),
    side_larger_unknown=signed(found_finer.get(("oscillating", "pca", 6, True), np.nan)),
    side_width=percent(min(one["beam_subspace", 3, "width"] for one in limits)),
    side_ripple=percent(min(one["beam_subspace", 3, "ripple"] for one in limits)),
    side_wrong_few=with_width_wrong(3),
    side_wrong_many=with_width_wrong(many),
    side_many=many,
)

# %% [markdown]
# (what-to-use)=
# ## What should I use?
#
# The numbers are from the table at `quick`, for the oscillating beam unless stated. PCA and BeamSubspace have
# the number of sources of `himap suggest`; SmoothSpectra has one more than BeamSubspace, and GNILC determines
# its own. *Deviation* is that of the power from the truth in the worst of the five bands; *corrected by
# mocks* is after division by the transfer function of mocks that are added to the data. `himap clean --mocks`
# and `himap transfer` instead replace HI and noise by mocks; for a full sky without gaps and with a known
# beam they also subtract the foreground residual that they detect ({doc}`20_transfer_function`).
#
# | data | method | deviation | corrected by mocks |
# |---|---|---|---|
# | maps of one resolution in all channels | PCA, the simplest; without correction beam-aware methods gain nothing | {glue:text}`side_same` | {glue:text}`side_same_corrected` |
# | beam known with side lobes and ripple: errors of its width below {glue:text}`side_width` where all channels share them, below {glue:text}`side_ripple` where they oscillate with frequency | BeamSubspace | {glue:text}`side_known` | {glue:text}`side_known_corrected` |
# | unknown beam that changes smoothly | PCA | {glue:text}`side_unknown_smooth` | {glue:text}`side_unknown_smooth_corrected` |
# | unknown beam that oscillates with frequency | PCA with one component more than the paper's, and further ones with a finer resolution | {glue:text}`side_unknown` | {glue:text}`side_unknown_corrected` |
# | known beam, number of sources uncertain | SmoothSpectra ({doc}`23_thresholds`) | {glue:text}`side_harmless` | {glue:text}`side_harmless_corrected` |
# | number of sources unknown | GNILC, which determines it from an assumed covariance of HI and noise | {glue:text}`side_gnilc` | – |
# | a mask, or a part of the sky | the same; where the edge is long, PCA ({doc}`24_masks`) | – | – |
# | uneven hits, flags or gaps | PCA or a fit ({doc}`26_a_survey`) | – | – |
#
# - **SDecGMCA and PCA**: in the median over skies SDecGMCA is far closer to the truth than PCA with the same
#   five components ({glue:text}`side_paper` and {glue:text}`side_few`). This includes $0.03 < k_\nu < 0.1$
#   MHz$^{-1}$, where the paper finds it no better (O5, "at low $k_\nu$", in {doc}`15_claims`). With one more
#   component PCA comes close ({glue:text}`side_unknown`). With the evolving beam SDecGMCA deviates by
#   {glue:text}`side_paper_evolving`.
# - **SDecGMCA fails** on {glue:text}`side_failed` of {glue:text}`side_total` skies with the oscillating beam
#   and on {glue:text}`side_failed_evolving` with the evolving one, where the methods recommended above do not
#   fail at `quick`: compare several restarts ({doc}`27_restarts`).
# - **After correction SmoothSpectra is the closest** with the oscillating beam, if that is known
#   ({glue:text}`side_harmless_corrected`; {doc}`20_transfer_function` gives the coverage of its error bars).
# - **Resolution**: at `laptop` six components are too few for PCA, which fails on
#   {glue:text}`side_larger_failed_pca` of {glue:text}`side_larger_total` skies and deviates by
#   {glue:text}`side_larger_unknown` after correction; more were not tried there, and each removes more HI.
#   SDecGMCA fails on {glue:text}`side_larger_failed` there, BeamSubspace and SmoothSpectra on
#   {glue:text}`side_larger_failed_aware`.
# - **The beam**: if its width is wrong by 1 %, BeamSubspace has a foreground residual of
#   {glue:text}`side_wrong_few` with three sources and {glue:text}`side_wrong_many` with
#   {glue:text}`side_many` ({doc}`21_beam_errors`). `himap sensitivity` measures this for a cube, without the
#   truth.
# - **Choose the number of sources first**: correcting the loss does not remove foreground residual.
#
# ```sh
# himap suggest cube.h5 --method beam_subspace --beam oscillating
# himap clean cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 --mocks 10 --mock-noise 0.04 -o cleaned.h5
# himap sensitivity cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 -o beam.html
# ```
#
# ## Exercise
#
# A corrected spectrum is too high at small $k_\nu$ and at one narrow $k_\nu$. What is the likely cause?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Foreground residual from a ripple of the beam with the period $2\pi/k_\nu$. Both excesses should disappear with one more source, as in {doc}`04_pca`.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 25_side_by_side -p 'beams=["meerkat"]' -p 'methods=[["pca", 5], ["beam_subspace", 4]]'
# himap run 25_side_by_side -p 'methods=[["pca", 5], ["gmca", 5], ["gaussian_process", null]]'
# ```
