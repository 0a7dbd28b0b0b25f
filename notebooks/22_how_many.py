# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/n_sources_quick_synthetic.json
#     - book/results/n_sources_quick_templates.json
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
# # How many sources, without the truth
#
# > - **Read first**: {doc}`11_ns_scan`, {doc}`20_transfer_function`.
# > - **Good to know**: what a likelihood is.
# > - **Time and memory**: {cost}`22_how_many`.
#
# Blind methods need the number of sources. The paper chooses it with the truth ({doc}`11_ns_scan`) and
# concludes that it should come from the data. This chapter measures how often criteria without the truth give
# the *right* number, defined as the one for which the worst band of $C_\ell/C_{\ell,0}$
# ($10 \leq \ell < 100$) and $P/P_0$ ($k_\nu > 0.03$) is closest to 1.
#
# | criterion | recommends |
# |---|---|
# | BIC | the minimum of $\langle \ln \sigma_\nu^2 \rangle_\nu + n_\mathrm{par} \ln N / (N N_\nu)$, with $\sigma_\nu^2$ the variance of the residual in a channel, $n_\mathrm{par}$ the number of entries of $A$ ($n_s N_\nu$) and $S$ ($n_s N$), and $N$ pixels; {cite:t}`schwarz1978` |
# | AIC | the same with 2 in place of $\ln N$; {cite:t}`akaike1974` |
# | eigenvalues | the number of eigenvalues of the channel covariance that exceed the line of HI and noise by a factor of 3; for a beam-aware method, of maps at one resolution |
# | stability | the first number after which one more source changes neither spectrum by 10 % or more in the mean over its scales |
# | mocks | the same with 3 %, for spectra corrected for signal loss ({doc}`20_transfer_function`), which only foreground changes |
# | evidence | the maximum Bayesian evidence of probabilistic PCA ({cite:t}`minka2000`), from scikit-learn |
#
# `himap suggest` shows BIC, eigenvalues and stability. All counts are for full skies; partial skies were not
# tested.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
beams: list = ["oscillating", "evolving", "degraded"]  # of the data, by name; the first one is shown
noises: list = [1.0, 10.0]  # factors on the noise, 1 first; only for `himap measure n_sources`
methods: list = ["pca", "beam_subspace"]  # that have a number of sources
n_sources_max: int = 8  # numbers from 1 to this one are tried
n_mocks: int = 2  # mocks, each with a seed of its own
results: list | None = None  # what `himap measure n_sources` wrote; null: that of the book

# %% tags=["hide-input"]
import itertools

import numpy as np
import pandas as pd

from himap.app.stored import RESULTS
from himap.figures import plotting, styles
from himap.figures.numbers import quote
from himap.figures.tables import Table
from himap.measures.n_sources import STABLE, eigenvalue_line
from himap.paper.choice import SETTLED, eigenvalues, source_number_criteria
from himap.paper.experiments.n_sources import CRITERIA, EXPERIMENT, skies
from himap.paper.record import Record
from himap.paper.study import Study

# %%
(first_sky,) = skies(
    preset=preset,
    survey=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    ripple=ripple,
    beams=beams[:1],
    noises=[1.0],
    methods=methods,
    n_sources_max=n_sources_max,
    n_mocks=n_mocks,
    n_realisations=1,
)
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)
((case, removers),) = first_sky.methods.items()

# %% [markdown]
# ## One sky

# %% tags=["hide-input"]
table = EXPERIMENT.table([first_sky])
looks = [
    (styles.BLUE, "-", "o"),
    (styles.VERMILION, "--", "s"),
    (styles.GREEN, "-.", "^"),
    (styles.PURPLE, ":", "D"),
]
panels = [
    {
        "title": "eigenvalues and the line of HI and noise",
        "yscale": "log",
        "ylabel": "variance [mK$^2$]",
        "curves": [],
    },
    {"title": "BIC", "yscale": "symlog", "ylabel": "BIC per voxel minus its minimum", "curves": []},
    {"title": "change with one source more", "yscale": "log", "ylabel": "relative change", "curves": []},
    {"title": "distance from the truth", "yscale": "log", "ylabel": "worst band, |ratio - 1|", "curves": []},
]
for name, (colour, dashes, marker) in zip(methods, itertools.cycle(looks), strict=False):
    several = [one for one in removers if one.name == name]
    views = source_number_criteria(case, several, first_sky.mocks)
    values = eigenvalues(case, "beams" in several[0].uses)
    label = styles.numbered(name, None)
    look = {"color": colour, "linestyle": dashes, "marker": marker, "markersize": 4, "label": label}
    faint = look | {"linewidth": 0.8, "fillstyle": "none", "label": f"{label}, corrected"}
    shown, line = values[:20], eigenvalue_line(values)[:20]
    panels[0]["curves"] += [
        (range(1, len(shown) + 1), shown, look),
        (range(1, len(shown) + 1), line, {"color": colour, "linewidth": 0.8, "label": f"_{label}, line"}),
    ]
    for panel, column, style in (
        (1, "bic", look),
        (2, "change", look),
        (2, "corrected_change", faint),
        (3, "error", look),
        (3, "corrected_error", faint),
    ):
        curve = views[column].dropna()
        panels[panel]["curves"].append((curve.index, curve.to_numpy(), style))
for limit in (STABLE, SETTLED):
    panels[2]["curves"].append(((1, n_sources_max), (limit, limit), {"color": "0.7", "linewidth": 0.8}))
for panel in panels:
    panel["xlabel"] = "number of sources" if panel is not panels[0] else "number of the eigenvalue"
    panel["xticks"] = range(1, n_sources_max + 1) if panel is not panels[0] else range(2, 21, 2)

# %% [markdown]
# For each method the panels should agree on one number, at which the eigenvalues reach their line, BIC is
# smallest, the spectra become stable, and the error, which needs the truth, is smallest. A beam-aware method
# needs fewer sources.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-how-many-views", "caption": "Criteria by the number of sources: eigenvalues of the channel covariance (at one resolution for a beam-aware method) and the line of HI and noise; BIC, linear below 2 and logarithmic above; change of the spectra with one more source, uncorrected and corrected by mocks (grey lines: 10 % and 3 %); and, with the truth, the deviation from 1 in the worst band."}}
study.stamped(plotting.lines(panels, legend_above=True), beam=case.beam, n_mocks=n_mocks)

# %% tags=["hide-input"]
Table(
    ["method", "criterion", "recommended", "best", "bias with it", "with the best"],
    [
        (
            styles.numbered(row.method, None),
            CRITERIA[row.criterion],
            row.recommended or "none",
            row.best,
            "not tried" if np.isnan(row.bias) else f"{row.bias:.2f}",
            f"{row.least_bias:.2f}",
        )
        for row in table.itertuples()
    ],
    align="llrrrr",
)

# %% [markdown]
# (how-many-record)=
# ## Over skies, beams and noise
#
# The stored results are for {glue:text}`many_skies` skies, three beams, the noise of the instrument and ten
# times that noise, and the synthetic and the real Galaxy (templates, nside 64).
#
# ```sh
# himap measure n_sources --preset quick -p n_realisations=3 --jobs 2
# ```
#
# The columns count observations by the difference between the recommended and the right number. *Bias* is the
# median over observations of the deviation from 1 in the worst band, with the recommended number (where it
# was tried), and *least bias* that with the right one.

# %% tags=["hide-input"]
paths = results or [RESULTS / f"n_sources_quick_{name}.json" for name in ("synthetic", "templates")]
records = [Record.load(EXPERIMENT, path) for path in paths]

# %% tags=["hide-input"]
summaries = [EXPERIMENT.summary(one.rows) for one in records]
Table(
    ["Galaxy", *summaries[0].columns],
    [
        (one.made.galaxy, *row)
        for one, summary in zip(records, summaries, strict=True)
        for row in summary.itertuples(index=False)
    ],
    align="lll" + "r" * 8,
)


# %% tags=["hide-input"]
def right(criterion, noise=None):
    """The share of observations in which a criterion is right, of all records."""
    own = rows[rows["criterion"] == criterion]
    if noise is not None:
        own = own[own["noise"].round(3) == noise]
    return f"{(own['recommended'] == own['best']).sum()} of {len(own)}"


rows = pd.concat([one.rows for one in records])
levels = sorted(rows["noise"].round(3).unique())
quote(
    many_bic=right("bic"),
    many_bic_quiet=right("bic", noise=levels[0]),
    many_bic_noisy=right("bic", noise=levels[-1]),
    many_aic=right("aic"),
    many_eigenvalues=right("eigenvalues"),
    many_stability=right("stability"),
    many_mocks=right("mocks"),
    many_minka=right("minka"),
    many_skies=len(records[0].seeds),
)

# %% [markdown]
# ## What follows
#
# - **BIC** is right in {glue:text}`many_bic` cases ({glue:text}`many_bic_quiet` with the noise of the
#   instrument, {glue:text}`many_bic_noisy` with the largest noise), **eigenvalues** in
#   {glue:text}`many_eigenvalues`. If the two agree, `himap suggest` gives that number. Otherwise it gives,
#   for a beam-aware method, that of BIC if the spectra are stable after it, and else a range, or none if no
#   number is stable or BIC still falls at the last one.
# - **Stability** is right in {glue:text}`many_stability` cases. But every source removes HI, so the spectra
#   never stop changing, and the tolerable change depends on the survey.
# - **Mocks** are right in {glue:text}`many_mocks`, and otherwise recommend more sources: the correction
#   recovers the HI that a further source removes.
# - **AIC** ({glue:text}`many_aic`) and **evidence** ({glue:text}`many_minka`) count HI as components, because
#   its channels are correlated and both assume white noise. GNILC ({cite:t}`olivari2016`) uses AIC on maps
#   whitened by the covariance of HI, which has to be assumed.
# - The right number depends on the method and the beam: with the number for PCA a beam-aware method loses
#   more HI, and with that for a beam-aware method PCA has foreground residual.
#
# ```sh
# himap suggest cube.h5 --method beam_subspace --beam oscillating -o how_many.html
# ```
#
# ## Exercise
#
# Try at most six sources. Which criteria still give a number for PCA, and what does AIC give?
#
# ```sh
# himap run 22_how_many -p n_sources_max=6
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# BIC, the eigenvalues and the evidence, as before. Stability and mocks give none, because they compare with one more source, which was not tried. AIC gives the largest number that was tried.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 22_how_many -p 'beams=["meerkat_lobes"]'             # side lobes: more components for PCA
# himap run 22_how_many -p 'methods=["gmca", "fastica"]'
# ```
