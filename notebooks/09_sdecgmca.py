# ---
# jupyter:
#   himap:
#     figures: ["Table 1"]
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
# # SDecGMCA: source separation with the beam in the model
#
# > - **Read first**: {doc}`06_gmca`.
# > - **Good to know**: spherical harmonics, and what a Tikhonov term does to least squares.
# > - **Tests** (verdicts of {doc}`15_claims`): {claim}`R1`, {claim}`V1`, {claim}`V6`.
# > - **Time and memory**: {cost}`09_sdecgmca`.
#
# PCA, FastICA and GMCA assume that a source has the same map in every channel. A beam that changes with
# frequency smooths it differently in each. {cite:t}`gkogkou2025` therefore apply SDecGMCA
# {cite:p}`carloni2021` (C21 below), which includes the beam in its model. In harmonic space an axisymmetric
# beam is a factor $\hat H_\nu^\ell$, and the mixture is (the paper's Eq. 21)
#
# ```{math}
# :label: eq-sdecgmca-mixture
# \hat{\mathbf{X}}^{\ell m} = \mathrm{diag}(\hat H^\ell)\,\mathbf{A}\,\hat{\mathbf{S}}^{\ell m} + \hat{\mathbf{N}}^{\ell m} .
# ```
#
# Starts that differ by $10^{-10}$ give different results unless the beam is degraded ({doc}`27_restarts`), so
# figures show an ensemble of restarts (median, 16 to 84 % band, restarts as thin lines). Maps show the
# {term}`medoid`, the restart whose residual is nearest to those of the others. Unless three beams are shown,
# the beam is the oscillating one by default.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 5  # sources, for the beam shown in detail
reading: str = "default"  # of SDecGMCA: default, letter, code, code-rounding, follow-up, instrument-noise
n_restarts: int = 4  # starts of SDecGMCA, which is chaotic: all of them are shown

# %%
import warnings

import numpy as np
from IPython.display import Markdown

from himap.figures import plotting, styles
from himap.figures.numbers import of_restarts, one_run, quote, show, show_table
from himap.figures.tables import Table
from himap.instrument.beams import named
from himap.instrument.noise import noise_sigma
from himap.maps import sphere
from himap.measures.diagnostics import Comparison, flagged_lines
from himap.paper import captions
from himap.paper.methods import TABLE_1, paper_beams, sdecgmca_for, table_1
from himap.paper.study import Study, over_restarts
from himap.paper.study_figures import (
    angular_figure,
    both_figure,
    channel_figure,
    ensemble_style,
    frequency_figure,
    mixing_figure,
    sources_figure,
)
from himap.removal.base import SeparationWarning
from himap.removal.beam_subspace import BeamSubspace
from himap.removal.blurred_mixture import BlurredMixture
from himap.removal.pca import PCA
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
sky = {"galaxy": galaxy, "template_dir": template_dir, "small_scales": small_scales}
study = Study(preset=preset, overrides=survey, **sky, n_restarts=n_restarts)
removers = {each: [sdecgmca_for(each, reading=reading)] for each in beams.values()}
removers[selected] = [sdecgmca_for(selected, reading=reading, n_sources=n_sources)]
study.check(removers)
remover = removers[selected][0]
warnings.simplefilter("ignore", SeparationWarning)  # whether a run converged is printed with its numbers
quote(
    sdecgmca_reading=captions.of_sdecgmca(remover, study.survey.nside),
    sdecgmca_reading_short=captions.in_short(remover, study.survey.nside, n_restarts),
)

# %%
study.prepare(removers)
medoid = study.medoid(selected, remover)

# %% [markdown]
# ## The method
#
# **Cost function** (Eq. 22): the data are described by few, sparse sources, with the starlet wavelets
# $\mathbf{\Phi}$, the transform from harmonics to pixels $\mathcal{F}^{\dagger}$ and the thresholds
# $\mathbf{\Lambda}$,
#
# ```{math}
# :label: eq-sdecgmca-cost
# \min_{\mathbf{A}, \hat{\mathbf{S}}} \; \big\| \mathbf{\Lambda} \odot (\hat{\mathbf{S}}\, \mathcal{F}^{\dagger} \mathbf{\Phi}^{\top}) \big\|_1
#   + \sum_{\ell, m} \big\| \hat{\mathbf{X}}^{\ell m} - \mathrm{diag}(\hat H^\ell)\, \mathbf{A}\, \hat{\mathbf{S}}^{\ell m} \big\|_2^2 .
# ```
#
# **Start.** $\mathbf{A}$ holds the principal components of the data at the lowest resolution. Then two
# updates alternate.
#
# **Update of S**: least squares at every $\ell$ with a Tikhonov term (Eq. 23 of the paper, Eq. 21 of C21),
#
# ```{math}
# :label: eq-sdecgmca-sources
# \hat{\mathbf{S}}^{\ell m} = \big( \mathbf{A}^{\top} \mathrm{diag}(\hat H^\ell)^2 \mathbf{A} + \mathrm{diag}(\epsilon_{\ell}) \big)^{-1}
#   \mathbf{A}^{\top} \mathrm{diag}(\hat H^\ell)\, \hat{\mathbf{X}}^{\ell m} ,
# ```
#
# where $\epsilon$ keeps the inverse finite if the beam is small. $\hat H$ is the beam; in the example of C21
# it is divided by that of the best channel at each $\ell$. $\epsilon$ depends on $\mathbf{A}$ and the beam in
# the *warm-up*, and on the spectra of the last sources in the *refinement* (strategies 3 and 4, Eqs. 26 and
# 27 of C21), with the strength $c$, the smallest eigenvalue $\lambda_\mathrm{min}$ of a matrix and the power
# $C_\ell^\mathrm{noise}$ of the noise:
#
# ```{math}
# :label: eq-sdecgmca-epsilon
# \epsilon_{\ell} = \max\!\Big( 0,\; c - \frac{\lambda_\mathrm{min}(\mathbf{A}^{\top} \mathrm{diag}(\hat H^\ell)^2 \mathbf{A})}{\lambda_\mathrm{min}(\mathbf{A}^{\top} \mathbf{A})} \Big)
# \qquad \text{and} \qquad
# \epsilon_{n, \ell} = c\, \frac{C_\ell^\mathrm{noise}}{C_\ell(\hat{\mathbf{S}}_n)} .
# ```
#
# **Thresholds.** The sources are decomposed into five starlet scales. Coefficients below three times their
# noise are set to zero (the paper gives neither the factor nor the noise). Of the others the largest are
# kept, and reduced by their threshold, which in the refinement is lower for large coefficients ($\ell_1$
# reweighting). The share that is kept grows to $K_\mathrm{max}$ during the warm-up.
#
# **Update of A**: least squares in every channel over all harmonics (over the detail scales in the code of
# C21). Then negative entries are set to zero (an option that is off in that code), and columns are scaled to
# unit length (Eqs. 14 to 16 of C21):
#
# ```{math}
# :label: eq-sdecgmca-mixing
# \mathbf{A}_\nu = \Big( \sum_{\ell m} \hat H_\nu^\ell\, \hat X_\nu^{\ell m}\, \hat{\mathbf{S}}^{\ell m\,\top} \Big)
#   \Big( \sum_{\ell m} (\hat H_\nu^\ell)^2\, \hat{\mathbf{S}}^{\ell m} \hat{\mathbf{S}}^{\ell m\,\top} \Big)^{-1} .
# ```
#
# **End.** Each stage ends when $\hat{\mathbf{S}}$ changes by less than a tolerance (the paper), or after a
# number of iterations (the code of C21); here whichever comes first. The foreground is
# $\mathrm{diag}(\hat H^\ell)\, \mathbf{A}\, \hat{\mathbf{S}}$ with a last $\hat{\mathbf{S}}$ of
# {eq}`eq-sdecgmca-sources` without thresholds. Three parameters depend on the beam (the paper's Table 1):

# %% tags=["hide-input"]
rows = {
    f"{name}: {label}": f"{values[key]:g}"
    for name, values in TABLE_1.items()
    for key, label in (("n_sources", "n_s"), ("regularisation", "c"), ("share", "K_max"))
}
show(rows)

# %% [markdown]
# (sdecgmca-reading)=
# ## What the paper leaves open
#
# The text can be implemented in several ways, and the public code of C21 deviates from it. A set of choices
# is a *reading*; {doc}`../book/conventions` defines them and {doc}`16_readings` compares them. The default,
# [selected by a rule](readings-default), follows the text up to the last multipole, except for three points
# common to all readings: strategy 3 is Eq. 26 of C21, which the paper cites but describes differently; $K$ is
# a share of the coefficients above the noise; and iterations also end after a given number. Captions state
# the reading. Here {glue:text}`sdecgmca_reading`.

# %% tags=["hide-input"]
head = ["Choice", *READINGS]
body = [
    [option.question, *(option.choices[values[name]] for values in READINGS.values())]
    for name, option in OPTIONS.items()
]
Markdown("\n".join(Table(head, body).markdown()))

# %% [markdown]
# ## The foreground model
#
# The columns of $\mathbf{A}$ have no negative entries and are nearly parallel. In the medoid none varies
# strongly from channel to channel, as the spectrum of HI would.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-mixing", "caption": "Columns of the mixing matrix of SDecGMCA (medoid of the restarts). A smooth column can be foreground; one with structure from channel to channel follows HI and noise."}}
mixing_figure(study, selected, medoid)

# %% [markdown]
# The sources partly cancel, as for GMCA: some are negative where others are positive.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-sources", "caption": "The sources of the first four of these columns, in mK summed over channels (spectra have unit length). Colours: central 96 % of the pixels."}}
sources_figure(study, selected, medoid, most=4)

# %% [markdown]
# ## The residual
#
# The error can contain foreground residual along the Galactic plane and, in restarts that fail, also in other
# parts of the sky ({doc}`12_post_masking`); elsewhere it has the scales of HI. The figure shows the medoid.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-maps", "caption": "A channel in the middle of the band: observed, recovered by SDecGMCA (medoid of the restarts), truth (HI plus noise), and recovered minus true. Channel means removed; colours span 1 to 99 % of the pixels, alike for recovered and truth; white: no error."}}
channel_figure(study, selected, medoid)

# %% [markdown]
# With the degraded beam these restarts agree and $C/C_0$ is below 1; with the real Galaxy at `laptop`
# {glue:text}`15_claims.ipynb::claims_failing_degraded:s` fail. With the other two a restart may fail,
# with foreground residual at many multipoles. Restarts that do not fail lose most at the lowest $\ell$ and
# are near 1 above; the paper has an excess at the lowest $\ell$ with the oscillating beam.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-angular", "caption": "Angular power spectrum recovered by SDecGMCA for the three beams, and its ratio to the truth at all multipoles. {glue:text}`sdecgmca_reading_short` ([readings](sdecgmca-reading)); the legend has the failed restarts for each beam. Grey band: 10 %. (Part of the paper's Fig. 1.)"}}
angular_figure(study, removers)

# %% [markdown]
# In the paper SDecGMCA suppresses the peak at the ripple most, and has an excess at low $k_\nu$ like that of
# PCA. Here restarts that fail with the oscillating beam can have both; the others lose power at low $k_\nu$,
# and their peak is small.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-frequency", "caption": "Frequency power spectrum recovered by SDecGMCA for the three beams, and its ratio to the truth at all multipoles. {glue:text}`sdecgmca_reading_short` ([readings](sdecgmca-reading)); the legend has the failed restarts for each beam. Grey band: 10 %. (Part of the paper's Fig. 2.)"}}
frequency_figure(study, removers)

# %% tags=["hide-input"]
numbers = study.band_numbers(removers, tolerance=0.05)
for each, methods in removers.items():
    failed = ["yes" if one.fails else "no" for one in study.ensemble(each, methods[0])]
    results = [study.assessed(each, member) for member in study.members(methods[0])]
    numbers[f"{each}: failed"] = over_restarts(remover, failed)
    numbers[f"{each}: iterations"] = over_restarts(remover, [(one.n_iterations, 1) for one in results])
    converged = ["yes" if one.converged else "no" for one in results]
    numbers[f"{each}: converged"] = over_restarts(remover, converged)
show(numbers)

# %% [markdown]
# (sdecgmca-end)=
# ## Beyond the last multipole
#
# The paper inverts the beam up to $\ell = 200$, reports a spurious peak beyond, and cuts its curves there.
# With `beyond="cut"` nothing is estimated there, and the residual lacks that power. With `"regularised"`
# {eq}`eq-sdecgmca-sources` is continued to $3\,N_\mathrm{side}$ with its $\epsilon$, with `"projection"`
# without it.
#
# $C/C_0$ coincides up to the dotted line. Beyond it “regularised” has an excess. This is not the paper's
# peak, as $\epsilon$ is 0 there on these maps (last table), but the numerical error described below.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-beyond", "caption": "P/P0 (left) and C/C0 (right) for three treatments of the multipoles beyond the last of the inversion (dotted). Medians of the restarts, whose scatter is in the figures above. Logarithmic axes; HEALPix maps are inaccurate beyond 2 nside (dotted too where it differs)."}}
LOOKS = {
    "cut": {"color": styles.VERMILION, "linestyle": "-"},
    "regularised": {"color": styles.BLUE, "linestyle": "--"},
    "projection": {"color": styles.GREEN, "linestyle": ":", "linewidth": 2},
}
top = 3 * study.survey.nside - 1
answers = {}
for how in LOOKS if READINGS[reading]["last"] != "unregularised" else ("cut", "projection"):
    method = sdecgmca_for(selected, reading=reading, n_sources=n_sources, beyond=how)
    answers[how] = [
        Comparison.of(study.assessed(selected, member).power_spectra, study.truth(selected), l_top=top)
        for member in study.members(method)
    ]
ends = sorted({min(remover.lmax, study.l_top), study.l_top})
curves = {
    kind: [
        (
            getattr(members[0], x),
            np.median([one.ratios[kind] for one in members], axis=0),
            LOOKS[how] | {"label": how},
        )
        for how, members in answers.items()
    ]
    for kind, x in (("frequency", "k"), ("angular", "degrees"))
}
mark = {"color": "0.4", "linestyle": ":", "linewidth": 1}
curves["angular"] += [([end, end], [0.5, 2], mark) for end in ends]
panels = [
    {
        "curves": drawn,
        "xlabel": styles.AXES[kind]["xlabel"],
        "ylabel": ylabel,
        "xscale": "log",
        "yscale": "log",
    }
    for (kind, drawn), ylabel in zip(curves.items(), (r"$P / P_0$", r"$C / C_0$"), strict=True)
]
study.stamped(plotting.lines(panels), beam=selected, n_sources=n_sources, reading=reading)

# %% [markdown]
# For each treatment, the table lists the rms error of the maps, their mean correlation $r$ with the truth
# ({doc}`14_diagnostics`), and the lines of sight that {doc}`12_post_masking` flags.

# %% tags=["hide-input"]
near_plane = np.abs(sphere.pixel_latitude(study.survey.nside)) < 15


def maps_of(method):
    """Numbers of the maps of each member of a method."""
    rows = []
    for one in (study.assessed(selected, member) for member in study.members(method)):
        lines = flagged_lines(one.line_errors)
        row = {
            "rms error": (1e3 * np.sqrt(one.line_errors.mean()), 0.5, "µK"),
            "mean r": (one.correlation.mean(), 0.005),
            "flagged [%]": (100 * lines.mean(), 0.02),
            "of these within 15° of the plane [%]": (100 * near_plane[lines].mean(), 1),
        }
        rows.append(row)
    return over_restarts(method, rows)


rows = {
    f"SDecGMCA, {how}": maps_of(sdecgmca_for(selected, reading=reading, n_sources=n_sources, beyond=how))
    for how in answers
}
rows["PCA"] = maps_of(PCA(n_sources=n_sources))
show_table(rows)

# %% tags=["hide-input"]
continued, projected = (rows.get(f"SDecGMCA, {how}") for how in ("regularised", "projection"))
quote(
    sdecgmca_error_continued=continued["rms error"] if continued else one_run("–"),
    sdecgmca_r_continued=continued["mean r"] if continued else one_run("–"),
    sdecgmca_error_projected=projected["rms error"],
    sdecgmca_r_projected=projected["mean r"],
)

# %% [markdown]
# With `"regularised"` maps have a pattern of arcs and a lattice along the base pixels of HEALPix. It is
# numerical: HEALPix transforms are not exact beyond $\ell = 2\,N_\mathrm{side}$, so maps of the bright
# foreground made from its coefficients differ from the observed maps. The pattern has the smooth spectrum of
# the foreground, and adds to $P$ at the smallest $k_\nu$. `"projection"` subtracts part of the observed maps
# and lacks this pattern: the rms error is {glue:text}`sdecgmca_error_projected` instead of
# {glue:text}`sdecgmca_error_continued`, and the mean $r$ {glue:text}`sdecgmca_r_projected` instead of
# {glue:text}`sdecgmca_r_continued`. With `"cut"` the error includes the truth beyond the last multipole.
#
# The paper explains the peak by $\epsilon$, which biases the foreground low and the residual high (see the
# exercise). In the default reading $\epsilon$ beyond the last multipole would be that of strategy 3. For $c$
# of Table 1 and the $\mathbf{A}$ of each restart, the first multipole with $\epsilon > 0$ is (–: none in
# these maps, which do not reach $\ell = 200$):

# %% tags=["hide-input"]
numbers = {}
for each, methods in removers.items():
    windows = each.of_survey(study.survey).total
    problem = BlurredMixture(modes=None, beams=windows, floor=0)
    onsets = []
    for member in study.members(methods[0]):
        mixing = study.assessed(each, member).mixing
        epsilon = problem.epsilon_of_matrices(mixing, table_1(each)["regularisation"])[:, 0]
        onsets.append(f"l = {np.flatnonzero(epsilon)[0]}" if epsilon.any() else "–")
    name = f"{each}: first l up to {len(epsilon) - 1} with epsilon > 0"
    numbers[name] = over_restarts(remover, onsets)
show(numbers)

# %% [markdown]
# ## Sensitivity to the start
#
# The start is changed by $10^{-10}$ in the reading of this chapter (left) and in another (middle). For
# BeamSubspace, whose dependence on the start is not tested here, the noise level is changed by 0.1 % (right).
# Curves that differ are possible results for the same data.

# %% tags=["hide-input"]
other = "code" if reading != "code" else "default"
kinds = {
    f"SDecGMCA, {one}": sdecgmca_for(selected, n_sources=n_sources, reading=one) for one in (reading, other)
}
study.prepare({selected: list(kinds.values())})
runs = {kind: study.ensemble(selected, method) for kind, method in kinds.items()}
runs["BeamSubspace"] = [
    study.compared(
        selected,
        BeamSubspace(n_sources=n_sources, noise=tuple((level * noise_sigma(study.survey)).tolist())),
    )
    for level in (1, 0.999, 1.001)
]

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-sensitivity", "caption": "C/C0 after changes that should not matter: runs (thin), their median and 16 to 84 % band. Left: SDecGMCA in the reading of this chapter. Middle: in another. Right: BeamSubspace with noise levels that differ by 0.1 %."}}
everything = [one.angular_ratio for results in runs.values() for one in results]
lowest, highest = np.min(everything), np.max(everything)
panels = []
for (kind, results), colour in zip(runs.items(), (styles.VERMILION, styles.BLUE, styles.INDIGO), strict=True):
    drawn = np.array([one.angular_ratio for one in results])
    look = ensemble_style({"label": kind.partition(",")[0], "color": colour}, results)
    curves = [(results[0].degrees, np.squeeze(drawn), look)]
    axes = {"xlabel": styles.AXES["angular"]["xlabel"], "ylabel": r"$C / C_0$", "xscale": "log"}
    scale = {"yscale": "log", "ylim": (0.9 * lowest, 1.1 * highest)}
    panels.append({"curves": curves, "title": kind, "xlim": (2, study.l_top)} | axes | scale)
study.stamped(plotting.lines(panels, columns=3, size=(3.6, 3.4)), beam=selected, n_sources=n_sources)

# %% [markdown]
# Means of both ratios over bands, with their range; another processor gives different values
# ([conventions](../book/conventions.md)).

# %% tags=["hide-input"]
rows, worst = {}, {}
for kind, results in runs.items():
    bands = [one.wide_band_means() for one in results]
    for name in bands[0]:
        values = [band[name] for band in bands]
        tolerance = 0.001 * max(1, np.median(values))
        ends = {"lowest": (min(values), tolerance), "highest": (max(values), tolerance)}
        if kind == "BeamSubspace":
            row = {"median": (np.median(values), tolerance)} | ends
        else:
            row = {"median": of_restarts([(value, tolerance) for value in values])} | one_run(ends)
        rows[f"{kind}: {name}"] = row
    curves = np.array([one.angular_ratio for one in results])
    factor = np.max(curves.max(axis=0) / curves.min(axis=0))
    worst[kind] = (factor, 0.2) if kind == "BeamSubspace" else one_run((factor, 0.2))
show_table(rows)

# %% tags=["hide-input"]
own, second, subspace = worst.values()
quote(
    sdecgmca_moves=own,
    sdecgmca_other=other,
    sdecgmca_other_moves=second,
    sdecgmca_subspace_moves=subspace,
    sdecgmca_restarts=n_restarts,
    sdecgmca_failed=one_run((sum(one.fails for one in runs[f"SDecGMCA, {reading}"]), 1)),
    sdecgmca_other_failed=one_run((sum(one.fails for one in runs[f"SDecGMCA, {other}"]), 1)),
)

# %% [markdown]
# At the most sensitive multipole the highest $C/C_0$ is {glue:text}`sdecgmca_moves` times the lowest (left),
# in the reading “{glue:text}`sdecgmca_other`” {glue:text}`sdecgmca_other_moves` times; so few restarts cannot
# rank the readings. For BeamSubspace, whose noise level was changed instead, it is
# {glue:text}`sdecgmca_subspace_moves` times. Of {glue:text}`sdecgmca_restarts` restarts
# {glue:text}`sdecgmca_failed` failed in the reading of this chapter and {glue:text}`sdecgmca_other_failed` in
# the other; {ref}`restarts-failures` gives the probability of failure. A stable result is not necessarily
# accurate: at $\ell < 10$ the mean $C/C_0$ of BeamSubspace is {glue:text}`sdecgmca_subspace_low`.
#
# ## BeamSubspace
#
# SDecGMCA fits $\mathbf{A}$ to thresholded sources, which exceed HI by orders of magnitude. The part that a
# threshold removes remains in the data, smoothed differently in each channel, and biases $\mathbf{A}$.
# BeamSubspace, which is not in the paper, has the same mixture without $\epsilon$ or sign constraint, and
# estimates $\mathbf{A}$ from the residual of the sources before thresholding:
#
# ```{math}
# :label: eq-sdecgmca-correction
# \sum_{\ell m} \hat H_\nu^\ell \left( \hat X_\nu^{\ell m} - \hat H_\nu^\ell\, \mathbf{A}_\nu \hat{\mathbf{S}}^{\ell m} \right) \hat{\mathbf{T}}^{\ell m\,\top} = 0 ,
# ```
#
# where the thresholded sources $\hat{\mathbf{T}}$ are only weights: without noise the true $\mathbf{A}$ is a
# solution for any thresholds. The foreground is the projection on the smoothed spectra at every $\ell$.
#
# BeamSubspace loses more at low $\ell$ than restarts of SDecGMCA that do not fail: the mean $C/C_0$ at
# $\ell < 10$ is {glue:text}`sdecgmca_subspace_low`, and {glue:text}`sdecgmca_low` for SDecGMCA (all
# restarts). In the same order, $P/P_0$ at $k_\nu < 0.03$ MHz$^{-1}$ is {glue:text}`sdecgmca_subspace_slow`
# and {glue:text}`sdecgmca_slow`, and its highest value near $k_\nu = 0.31$ MHz$^{-1}$ is
# {glue:text}`sdecgmca_subspace_peak` and {glue:text}`sdecgmca_peak`. Ranges of SDecGMCA include restarts that
# fail; at low $k_\nu$ the others can lose more than BeamSubspace.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-subspace", "caption": "Frequency (left) and angular (right) power spectrum recovered by SDecGMCA and by BeamSubspace with as many sources, and the ratio to the truth. {glue:text}`sdecgmca_reading_short` ([readings](sdecgmca-reading)). Grey band: 10 %."}}
pair = [remover, BeamSubspace(n_sources=n_sources)]
ensembles = {method: study.ensemble(selected, method) for method in pair}
curves = [
    (ensemble_style(styles.method_style(method), members), members) for method, members in ensembles.items()
]
both_figure(study, selected, curves, n_sources=n_sources, reading=reading)

# %% tags=["hide-input"]
nothing = (np.nan, 0.02)  # a band without values
of_sd, of_subspace = (study.band_entries(selected, method, tolerance=0.05) for method in pair)
low, slow, peak = "C/C0, 1 < l < 10", "P/P0, 0 < k < 0.03", "P/P0, highest near k = 0.31"
quote(
    sdecgmca_low=of_sd.get(low, nothing),
    sdecgmca_slow=of_sd.get(slow, nothing),
    sdecgmca_peak=of_sd.get(peak, nothing),
    sdecgmca_subspace_low=of_subspace.get(low, nothing),
    sdecgmca_subspace_slow=of_subspace.get(slow, nothing),
    sdecgmca_subspace_peak=of_subspace.get(peak, nothing),
)

# %% [markdown]
# ## Conclusions
#
# - SDecGMCA includes the beam in its mixture, and needs an accurate one ({doc}`21_beam_errors`).
# - $P(k_\nu)$ depends on the treatment beyond the last multipole; on these maps the regularised inversion
#   there causes a numerical error.
# - The iteration is chaotic: results need their scatter over restarts, and the number that failed.
#
# ## Exercise
#
# With one source and a beam of $0.05$ in all channels, what is $\epsilon_\ell$ of strategy 3 for $c = 0.01$,
# and what share of the foreground is recovered?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# With a column of unit length $\mathbf{A}^{\top} \mathrm{diag}(\hat H)^2 \mathbf{A} = 0.0025$, so $\epsilon = 0.01 - 0.0025 = 0.0075$. {eq}`eq-sdecgmca-sources` recovers $0.0025 / (0.0025 + 0.0075) = 1/4$ of the source: three quarters of the
# foreground remain in the residual.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 09_sdecgmca -p n_sources=3                             # fewer sources
# himap run 09_sdecgmca -p reading=code                            # the steps of the public code
# himap run 09_sdecgmca -p galaxy=templates -p template_dir=maps   # the real Galaxy
# ```
