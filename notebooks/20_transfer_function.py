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
# # Signal loss and error bars from mocks
#
# > - **Read first**: {doc}`04_pca`, {doc}`10_results`.
# > - **Good to know**: what an estimator and its bias are.
# > - **Time and memory**: {cost}`20_transfer_function`.
#
# Every method removes some HI and leaves some foreground. The paper measures their net effect against the
# truth, which an observation does not have. This chapter estimates both from **mocks**: skies of HI and noise
# with known truth, seen through the same beam. The method is a parametric bootstrap ({cite:t}`efron1979`). A
# mock $m$ replaces the HI and noise of the data; together with an estimated foreground $\hat f$ it is cleaned
# like the data, including peak masking. Each member gives a residual $r = \mathrm{clean}(\hat f + m)$, and an
# estimate $F_m$ of the power of the foreground residual, obtained from the member as $F$ is from the data.
# Their means give
#
# ```{math}
# T = \frac{\langle r\, m^* \rangle}{\langle |m|^2 \rangle} , \qquad
# b = \langle |r|^2 - F_m \rangle - T\, \langle |m|^2 \rangle , \qquad
# \hat P = \frac{P - F - b}{T} .
# ```
#
# $r$ and $m$ are harmonic or Fourier coefficients, $P$ is the power of the residual of the data, and $F$ the
# estimated power of its foreground residual. $T$ is the transfer function ({cite:t}`switzer2013`,
# {cite:t}`cunnington2023`), $b$ the power of the residual beyond $F_m$ and $T\, \langle |m|^2 \rangle$, and
# $\hat P$ the corrected spectrum. The truth $m$ is HI and noise, seen through the beam. The error bar is the
# root mean square of $\hat P / |m|^2 - 1$ over the members, each corrected with the others, times the factor
# of Student's $t$ distribution for their number. The paper has no such correction.
#
# **Which foreground?** The sources of a method lack some of the foreground, and the faintest contain some HI.
# If its own estimate were used as $\hat f$, the mocks would have no foreground residual, and the correction
# would subtract none. For all methods $\hat f$ is therefore made of smooth spectra, seen through the beam.
# Their covariance is the excess of the data over the mocks; components too faint for one band of multipoles
# are estimated from several. Each member has its own $\hat f$: first a covariance is drawn, as it would be
# estimated from other skies like this one, then a foreground from its posterior given the data
# ({cite:t}`wandelt2004`). The mean of this posterior, a Wiener filter, has less power than the foreground,
# especially if the foreground is no brighter than HI. The Gaussian field that is added to it is multiplied by
# the relative brightness of the mean, averaged over 3°: the faint components of our Galaxy are in its plane,
# too, and what methods with thresholds lose, such as BeamSubspace, depends on where they are. Beyond
# $\ell = 2 n_\mathrm{side}$, where errors of HEALPix can be brighter than HI, $\hat f$ has the spectra of
# the last band below.
#
# **Which part of it remains?** $F$, a function of $\ell$ and $k_\nu$, is the expected power of the foreground
# residual under the posterior above, with the spectra of the method held fixed. This residual is the part
# that a least-squares fit of these spectra, seen through the beam if the method uses it, does not describe,
# or that the filter of SmoothSpectra does not remove. Any further foreground residual of other methods is in
# $b$. For $F_m$ the member replaces the data, and HI and noise have the covariance of the other mocks.
#
# The foreground residual is by chance correlated with HI. If it is detected above HI and noise, this
# correlation is in both $P$ and $F$, and largely cancels. In the members it cancels only because each has its
# own $F_m$; with the same $F$ for all members the error bars would be too large, the more so the brighter the
# foreground residual. $b$ contains the mean deficit of $F$, the cross power of foreground residual and
# residual of the mock, and, unless the loss is that of a fixed projection, a negative part that exists
# without any foreground.
#
# `himap transfer` and `himap clean --mocks` do the same for a full sphere. Without `--beam` (possible for
# methods that need none), on part of the sky, or with gaps, $\hat f$ is the estimate of the method itself,
# and its foreground residual remains unknown. Two checks depend little on $\hat f$. The corrected power is
# compared with that of the residual in parts of the sky, extrapolated to zero foreground. The share of the
# power that neighbouring channels have in common, to which noise does not contribute, is compared with that
# of the mocks.
#
# Mocks can also be added to the data, $\hat m = \mathrm{clean}(d + m) - \mathrm{clean}(d)$
# ({doc}`22_how_many`, {doc}`25_side_by_side`). This gives the signal loss but not the foreground residual,
# and doubles the HI to which a method adapts.

# %% tags=["parameters"]
preset: str = "ci"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, meerkat or a file of widths or b_l
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
methods: list = [["beam_subspace", 3], ["pca", 6]]  # pairs of a name and a number of sources
reading: str = "default"  # SDecGMCA: default, letter, code or follow-up
n_mocks: int = 6  # mocks, each with a seed of its own
results: list | None = None  # what `himap measure transfer` wrote; null: that of the book
larger: list | None = None  # the same at higher resolution
other_methods: list | None = None  # the same of other methods

# %%
import warnings

import numpy as np

from himap.app.stored import RESULTS
from himap.figures import plotting, styles
from himap.figures.numbers import quote, show_table
from himap.figures.tables import Table
from himap.measures.bootstrap import squared_pull
from himap.measures.diagnostics import Comparison
from himap.paper.experiment_figures import transfer_figure
from himap.paper.experiments.transfer import (
    EXPERIMENT,
    chance_of_right,
    chi_squared,
    coverage,
    skies,
    with_systematic,
)
from himap.paper.grid import make_products
from himap.paper.mocks import Mock, bootstrap, foreground_left, own_recovery, resampled
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
measured = EXPERIMENT.table([first_sky])
names = {remover: styles.numbered(remover.name, getattr(remover, "n_sources", 0)) for remover in removers}
shades = dict(zip(removers, styles.sequence(list(names.values())), strict=True))

# %% [markdown]
# ## Transfer functions

# %% tags=["hide-input"]
transfer = bootstrap(case, removers, mocks)
own = {remover: own_recovery(case, remover) for remover in removers}
left = {remover: foreground_left(case, remover, mocks) for remover in removers}
l_top = min(study.l_top, 200)


def over_l(found):
    """(l, T) in bins as wide as an eighth of l, or of one l, up to where pixels begin to matter."""
    edges = np.unique(np.round(2 * 1.125 ** np.arange(60)).astype(int))
    edges = edges[edges <= min(l_top, found.degrees[-1]) + 1]
    weights = 2 * found.degrees + 1
    bins = [slice(*pair) for pair in zip(edges[:-1], edges[1:], strict=True)]
    means = [np.average(found.angular[one], weights=weights[one]) for one in bins]
    return [np.average(found.degrees[one], weights=weights[one]) for one in bins], means


across = [(*over_l(transfer[remover]), shades[remover]) for remover in removers]
along = [(transfer[remover].k[1:], transfer[remover].frequency[1:], shades[remover]) for remover in removers]
shared = {"xscale": "log", "ylabel": r"$T$", "ylim": (0, 1.1)}
panels = [
    {"curves": across, "title": "across the sky", "xlabel": styles.AXES["angular"]["xlabel"]} | shared,
    {"curves": along, "title": "along the line of sight", "xlabel": styles.AXES["frequency"]["xlabel"]}
    | shared,
]

# %% [markdown]
# $T = 1$ means no loss. $T$ is smallest at the lowest $\ell$ and $k_\nu$, where HI resembles the foreground;
# for PCA it also has a minimum at the wavenumber of the ripple.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-functions", "caption": "Cross power of residual and mock over the power of the mock, by multipole (left, in bins) and wavenumber (right)."}}
study.stamped(plotting.lines(panels), beam=case.beam, n_mocks=n_mocks)

# %% [markdown]
# ## One sky, corrected
#
# The mocks do not contain the truth of this sky.


# %% tags=["hide-input"]
def compared(remover, correct=False):
    """A `Comparison` of the residual with the truth, corrected or not."""
    found, one = transfer[remover], own[remover]
    inside = (found.degrees >= 2) & (found.degrees <= l_top)
    power = one.output.less(left[remover]) if correct else one.output
    angular, frequency = power.angular, power.frequency
    if correct:
        angular, frequency = found.corrected("angular", angular), found.corrected("frequency", frequency)
    return Comparison(
        degrees=found.degrees[inside],
        angular=np.maximum(angular[inside], 1e-9),
        true_angular=one.input.angular[inside],
        k=found.k[1:],
        frequency=np.maximum(frequency[1:], 1e-9),
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
# The corrected spectra (solid) scatter about the truth; the uncorrected ones (dotted) are below it across the
# sky and at low $k_\nu$.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-corrected", "caption": "Spectra of the residuals of the first two methods on the first sky, uncorrected (dotted) and corrected (solid), and ratios to the truth. Grey band: 10 %."}}
titles = {"frequency": "along the line of sight", "angular": "across the sky"}
panels = [plotting.comparison_panel(kind, curves, title=title) for kind, title in titles.items()]
study.stamped(plotting.spectrum(panels), beam=case.beam, n_mocks=n_mocks)

# %% [markdown]
# The table lists the power in bands over the truth, uncorrected and corrected. *Foreground* is the subtracted
# power, $(F + b)/T$: the foreground residual, its cross power with HI, and the negative part of $b$, so it
# can be below zero. How often the truth lies within the error bars is measured on many skies below.

# %% tags=["hide-input"]
rows = {}
for row in measured.itertuples():
    close = 0.02 * max(1, abs(row.corrected))
    rows[f"{styles.numbered(row.method, row.n_sources)}, {row.band}"] = {
        "uncorrected": (row.uncorrected, 0.02 * max(1, abs(row.uncorrected))),
        "corrected": (row.corrected, close),
        "error bar": (row.error_bar, max(0.2 * row.error_bar, 1e-3)),
        "foreground": (row.foreground, close),
    }
show_table(rows, columns=4)

# %% [markdown]
# ## By multipole and wavenumber
#
# The loss is at low $k_\nu$, in smooth spectra. The highest $k_\nu$ with a loss depends on $\ell$ through the
# beam.

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
    n_sources=getattr(first, "n_sources", None),
    n_mocks=n_mocks,
)

# %% [markdown]
# ## Sensitivity to the mocks
#
# The HI of the data may differ from that of the mocks. The figure shows $T$ of the first mock with an HI bias
# that is 30 % higher, with twice and half the HI, and as Gaussian fields with the same power spectra,
# relative to $T$ of the original, from one mock each. A line at 1 is a change without effect. The correlation
# of HI along frequency is not varied; it may matter more (see the end of the summary).

# %% tags=["hide-input"]
variants = {
    "bias × 1.3": {"bias": 1.3},
    "twice the HI": {"abundance": 2.0},
    "half the HI": {"abundance": 0.5},
    "Gaussian": {"gaussian": True},
}
changed_mocks = {label: Mock(seed=mocks[0].seed, **changed) for label, changed in variants.items()}
make_products([(resampled, (case, (first,), one, (one,))) for one in (mocks[0], *changed_mocks.values())])
usual = bootstrap(case, [first], mocks[:1])[first]
looks = [(styles.BLUE, "-"), (styles.VERMILION, "--"), (styles.GREEN, "-."), (styles.PURPLE, ":")]
sky, line, changes = [], [], {}
for (label, mock), (colour, dashes) in zip(changed_mocks.items(), looks, strict=True):
    other = bootstrap(case, [first], [mock])[first]
    style = {"label": label, "color": colour, "linestyle": dashes}
    (degrees, means), (_, reference) = over_l(other), over_l(usual)
    sky.append((degrees, np.divide(means, reference), style))
    k, ratio = usual.k[1:], other.frequency[1:] / usual.frequency[1:]
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

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-mocks", "caption": "Transfer function of the first method from a changed mock over that from the original. Curves beyond 3 % are cut off."}}
study.stamped(
    plotting.lines(panels), beam=case.beam, method=first.name, n_sources=getattr(first, "n_sources", None)
)

# %% tags=["hide-input"]
quote(
    transfer_changed_l=(100 * max(one for one, _, _ in changes.values()), 0.3, "%"),
    transfer_changed_k=(100 * max(one for _, one, _ in changes.values()), 0.3, "%"),
    transfer_changed_low_k=(100 * max(one for _, _, one in changes.values()), 1, "%"),
)

# %% [markdown]
# For the first method these changes alter $T$ by up to {glue:text}`transfer_changed_l` at $\ell \geq 10$, by
# up to {glue:text}`transfer_changed_k` at $k_\nu > 0.03$ MHz$^{-1}$, and by up to
# {glue:text}`transfer_changed_low_k` at smaller $k_\nu$; at lower $\ell$ curves can be off the axis. This can
# exceed the error bars below, which assume that the mocks have the correct power.
#
# (transfer-record)=
# ## Coverage over many skies
#
# An error bar is correct if the truth is within it in 68 % of the cases. This was measured with different
# mocks for every sky:
#
# ```sh
# himap measure transfer --preset ci -p n_mocks=12 -p 'methods=[["beam_subspace", 3], ["smooth_spectra", 4], ["pca", 6]]' --jobs 2
# ```
#
# and the same with `-p galaxy=templates -p template_dir=FOLDER`.
#
# In the table, *scatter* is the standard deviation of the corrected ratio over skies, *error bar* the mean of
# the expected ones, and *foreground* the mean of the foreground residual that was subtracted. *Within 1σ*
# counts the skies on which the truth is within the error bar, with the binomial 95 % interval of that share;
# *χ²* is the mean squared pull, (corrected $-$ truth) over the error bar, expected to be
# {glue:text}`transfer_expected_pull` with error bars from {glue:text}`transfer_mocks` mocks. Bands of one sky
# are not independent, so intervals of several bands together are somewhat too narrow. This coverage holds if
# HI and beam are those of the mocks; there is one real Galaxy. In the figures, bars are standard errors of
# the means.

# %% tags=["hide-input"]


def stored(paths, *kinds):
    """The records in some files, or those of the book."""
    paths = paths or [path for one in kinds for path in sorted(RESULTS.glob(f"transfer_{one}_*.json"))]
    return [Record.load(EXPERIMENT, path) for path in paths]


def shown(records):
    """The figure of some records."""
    return plotting.stamp(
        transfer_figure({f"{one.made.preset}, {one.made.galaxy} Galaxy": one.rows for one in records}),
        "\n".join(one.made.footer() for one in records),
    )


def summarised(records):
    """Their table."""
    summaries = [EXPERIMENT.summary(one.rows) for one in records]
    rows = [
        (f"{one.made.preset}, {one.made.galaxy}", *row)
        for one, summary in zip(records, summaries, strict=True)
        for row in summary.itertuples(index=False)
    ]
    return Table(
        ["size, Galaxy", *summaries[0].columns], rows, align="lll" + "r" * (summaries[0].shape[1] - 2)
    )


records = stored(results, "ci")

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-record", "caption": "Means over skies of power over that of the truth in bands, uncorrected (open) and corrected (filled; bars: standard errors of the means). Axes hold all corrected means; uncorrected ones may lie beyond. Grey lines: 1 %."}}
shown(records)

# %% tags=["hide-input"]
summarised(records)

# %% [markdown]
# (transfer-larger)=
# ## At higher resolution
#
# The same at `quick` and, with fewer skies, at `laptop`.

# %% tags=["hide-input"]
finer = stored(larger, "quick", "laptop")

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-larger", "caption": "Means over skies at quick and laptop of power over that of the truth in bands, uncorrected (open) and corrected (filled; bars: standard errors of the means). Axes hold all corrected means; uncorrected ones may lie beyond. Grey lines: 1 %."}}
shown(finer)

# %% tags=["hide-input"]
summarised(finer)

# %% [markdown]
# (transfer-others)=
# ## Other methods and numbers of sources
#
# At `quick`.

# %% tags=["hide-input"]
further = stored(other_methods, "others")

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-transfer-others", "caption": "Means over skies of power over that of the truth in bands, uncorrected (open) and corrected (filled; bars: standard errors of the means), of other methods at quick. Axes hold all corrected means; uncorrected ones may lie beyond. Grey lines: 1 %."}}
shown(further)

# %% tags=["hide-input"]
summarised(further)

# %% tags=["hide-input"]
SMALL = ("C/C0, 10-19", "C/C0, 20-39", "C/C0, 40-99", "C/C0, 100-200", "P/P0, 0.03-0.1", "P/P0, k > 0.1")


def of_method(record, name):
    """The rows of a method."""
    return record.rows[record.rows["method"] == name]


def furthest(record, name, column="corrected"):
    """How far the mean over skies is from 1 in the worst band of l >= 10 and k > 0.03, %."""
    rows = of_method(record, name)
    means = rows[rows["band"].isin(SMALL)].groupby("band")[column].mean()
    worst = 100 * (means - 1).abs().max()
    return "not measured" if np.isnan(worst) else (worst, 0.3 * max(1, worst / 10), "%")


def calibration(rows):
    """How often the truth is within the error bar, with its interval; the median squared pull of bands."""
    if not len(rows):
        return "not measured", "not measured"
    hits, trials, low, high = coverage(rows)
    pull = np.median([chi_squared(band) for _, band in rows.groupby("band")])
    return f"{100 * hits / trials:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)", (float(pull), 0.1)


everything = [*records, *finer, *further]
of_bands = [
    coverage(band)
    for record in (*records, *further, *(one for one in finer if one.made.preset == "quick"))
    for _, band in record.rows.groupby(["method", "n_sources", "band"], sort=False)
]
rows = {}
for record in everything:
    for name, n_sources in record.rows[["method", "n_sources"]].drop_duplicates().to_numpy():
        of = "real" if record.made.galaxy.startswith("templates") else "synthetic"
        total = with_systematic(of_method(record, name))
        cells = *calibration(of_method(record, name)), *calibration(total)
        heads = "coverage", "squared pull", "with systematic", "squared pull with it"
        growth = (total["error_bar"] / of_method(record, name)["error_bar"]).median()
        rows[f"{record.made.preset}, {of} Galaxy, {styles.numbered(name, n_sources)}"] = {
            "before": furthest(record, name, "uncorrected"),
            "after": furthest(record, name),
            **dict(zip(heads, cells, strict=True)),
            "wider by": (growth, 0.1),
        }
quote(
    transfer_skies=min(len(one.seeds) for one in records),
    transfer_mocks=(n_members := dict(records[0].made.overrides)["n_mocks"]),
    transfer_expected_pull=(squared_pull(n_members), 0.01),
    transfer_fewest=min(len(one.seeds) for one in finer),
    transfer_cells=len(of_bands),
    transfer_right=sum(low <= 0.68 <= high for _, _, low, high in of_bands),
    transfer_right_expected=round(sum(chance_of_right(trials) for _, trials, *_ in of_bands)),
)

# %% [markdown]
# ## Summary
#
# All results are for the oscillating beam, with {glue:text}`transfer_mocks` mocks for each sky and
# {glue:text}`transfer_skies` skies with each Galaxy ({glue:text}`transfer_fewest` at `laptop`). *Before* and
# *after* are the deviations of the mean over skies from the truth in the worst band of $\ell \geq 10$ and
# $k_\nu > 0.03$; at lower $\ell$ and $k_\nu$ they are mostly larger (tables above). The coverage is over all
# bands; the squared pull is the median of bands. *With systematic* the error bar includes, in quadrature, all
# of the subtracted foreground residual, and is *wider by* that factor (median).
#
# In {glue:text}`transfer_right` of {glue:text}`transfer_cells` cases at `ci` and `quick` (combinations of
# size, Galaxy, method and band) the interval of the coverage contains 68 %; with correct error bars it would
# do so in about {glue:text}`transfer_right_expected`. At `laptop` there are too few skies for single bands.

# %% tags=["hide-input"]
show_table(rows, columns=4)

# %% [markdown]
# - **The foreground residual is estimated without the truth and subtracted** (in column *foreground*). It is
#   largest for GMCA; on the few skies at `laptop` it is also large for PCA.
# - **The correction assumes smooth foregrounds, the correct beam and the correct shape of HI.** The power of
#   the estimated foreground is the excess of the data over the mocks, whose amplitude is scaled to the data
#   in modes that are not smooth in frequency. It therefore depends only on their shape in $k_\nu$, whereas
#   $T$ also depends on their amplitude. The error bar includes its uncertainty, since it is estimated anew
#   from each member.
# - **The subtracted power is quoted as a systematic error**, as it depends on these assumptions, and added in
#   quadrature. That is too cautious for most methods here, especially for GMCA and for BeamSubspace with
#   three sources on the real Galaxy.
# - **A source in which HI is as bright as the foreground is corrected less well.** What BeamSubspace with
#   four sources loses on the real Galaxy depends on where the uncertain part of $\hat f$ is: as an isotropic
#   field, it gave error bars that are much too small. Drawn where the foreground is bright, it still leaves
#   the mean corrected power too low at the lowest $k_\nu$ and too high at the lowest $\ell$, but by less than
#   an error bar; the reason is not known. On the synthetic Galaxy no deviation of its means is clear. With
#   three sources the means at the lowest $\ell$ and $k_\nu$ are off by less than an error bar; at `ci` they
#   are nevertheless too high at the lowest $k_\nu$ by more than chance explains.
# - **In the `.csv` of the commands** `sigma` and `sample` are relative, `systematic` (the subtracted power)
#   is in the unit of the spectrum; the columns `error_1` and so on list the error of each mock, and
#   `himap.measures.bootstrap.covariance` gives their covariance between bands. It can be inverted for fewer
#   bands than mocks, and the inverse is biased high ({cite:t}`hartlap2007`).
# - **Lost modes are replaced by those of the mocks.** If the transfer function is far from one, HI that is
#   smoother in frequency than the mocks loses more than they predict, and its excess over them in smooth
#   spectra is subtracted as foreground. The error bars include neither; the systematic error includes the
#   latter. Use mocks with the correct HI (`--mocks FILE`).
# - **The truth is that of the same sky**, so the error bars contain sample variance and noise only of the
#   part that is lost, or subtracted with the foreground. The commands below list the total separately.
#
# For your cube:
#
# ```sh
# himap transfer cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 --mocks 10 --mock-noise 0.04 -o transfer.html
# himap transfer cube.h5 --method pca --beam oscillating -p n_sources=6 --mocks mock1.h5 --mocks mock2.h5 --truth hi.h5 -o transfer.html
# ```
#
# If you use your own mocks, give about ten, each with `--mocks`: error bars from fewer are poor.
#
# ## Exercises
#
# **1.** Does the number of mocks limit the result? Use twelve.
#
# ```sh
# himap run 20_transfer_function -p n_mocks=12
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The corrected power hardly changes at $\ell \geq 10$, but some error bars change by up to about a factor of
# two, since error bars from few mocks are uncertain. The deviation of PCA at $5 \leq \ell < 10$ remains.
#
# </details>
#
# **2.** In a bootstrap $r = 0.9\, m + e$, where $e$ is uncorrelated with $m$ and has the power
# $0.05\, \langle |m|^2 \rangle$, and all $F$ are 0. What are $T$ and $b$, and what is $\hat P$ for a residual
# with power $P$?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# $T = 0.9$, $\langle |r|^2 \rangle = (0.81 + 0.05) \langle |m|^2 \rangle$, so
# $b = -0.04\, \langle |m|^2 \rangle$, and $\hat P = (P + 0.04\, \langle |m|^2 \rangle) / 0.9$. For a fixed
# orthogonal projection that leaves no foreground $\langle |r|^2 \rangle = T \langle |m|^2 \rangle$ in
# $C_\ell$ averaged over channels, and $b = 0$; with foreground $F + b$ is then its residual power and its
# cross power with the residual of the mock.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 20_transfer_function -p beam=degraded                                    # the easiest beam
# himap run 20_transfer_function -p 'methods=[["beam_subspace", 3], ["gmca", 5]]'    # other methods
# ```
