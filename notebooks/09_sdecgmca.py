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
# # SDecGMCA: separation that knows the beam
#
# > - **Read first**: {doc}`06_gmca`.
# > - **Good to know**: spherical harmonics, and what a Tikhonov term does to least squares.
# > - **Tests** these claims of the paper; beside each the verdict at half its resolution, on the real Galaxy: {claim}`R1`, {claim}`V1`, {claim}`V6`.
# > - **Time and memory**: {cost}`09_sdecgmca`.
#
# PCA, FastICA and GMCA all assume that a source has *one* sky map, seen in every channel with some weight. A beam that changes
# with frequency breaks this: the same source is blurred differently in each channel, and every bright pixel acquires a
# spectrum of its own. {cite:t}`gkogkou2025` therefore apply a method that puts the beam into the model, SDecGMCA
# {cite:p}`carloni2021` (C21 below). In harmonic space a circular beam is one number $\hat H_\nu^\ell$ for each channel and multipole, and
# the mixture is (the paper's Eq. 21)
#
# ```{math}
# :label: eq-sdecgmca-mixture
# \hat{\mathbf{X}}^{\ell m} = \mathrm{diag}(\hat H^\ell)\,\mathbf{A}\,\hat{\mathbf{S}}^{\ell m} + \hat{\mathbf{N}}^{\ell m} .
# ```
#
# This notebook goes through the method step by step as the paper has it, runs it on the three beams, looks at what its last step does beyond $\ell = 200$, and
# asks how far its answer moves when nothing of importance changes. It moves: the iteration is chaotic, so that starts which differ by $10^{-10}$ end in different answers. So each result is that of an
# *ensemble* of restarts: figures have their median, the band with 16 to 84 % of them, and each of them as a thin line; where only one run can be shown, as in maps, it is the *medoid*, the restart whose residual maps are nearest to those of the others. Its last section has a method of our own for the same model, BeamSubspace.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 5  # sources, for the beam shown in detail
reading: str = "default"  # SDecGMCA: default, letter, code or follow-up
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
from himap.measures.diagnostics import Comparison
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
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
sky = {"galaxy": galaxy, "template_dir": template_dir, "small_scales": small_scales}
study = Study(preset=preset, overrides=survey, **sky, n_restarts=n_restarts)
removers = {each: [sdecgmca_for(each, reading=reading)] for each in beams.values()}
removers[selected] = [sdecgmca_for(selected, reading=reading, n_sources=n_sources)]
study.check(removers)
remover = removers[selected][0]
warnings.simplefilter("ignore", SeparationWarning)  # whether a run settled is printed with its numbers
quote(
    sdecgmca_reading=captions.of_sdecgmca(remover, study.survey.nside),
    sdecgmca_reading_short=captions.in_short(remover, study.survey.nside, n_restarts),
)

# %%
study.prepare(removers)
medoid = study.medoid(selected, remover)

# %% [markdown]
# ## How it works
#
# **The aim** is few and sparse sources that explain the data (the paper's Eq. 22): with $\mathbf{\Phi}$ the starlet wavelets,
# $\mathcal{F}^{\dagger}$ the way from harmonics to pixels and $\mathbf{\Lambda}$ the thresholds,
#
# ```{math}
# :label: eq-sdecgmca-cost
# \min_{\mathbf{A}, \hat{\mathbf{S}}} \; \big\| \mathbf{\Lambda} \odot (\hat{\mathbf{S}}\, \mathcal{F}^{\dagger} \mathbf{\Phi}^{\top}) \big\|_1
#   + \sum_{\ell, m} \big\| \hat{\mathbf{X}}^{\ell m} - \mathrm{diag}(\hat H^\ell)\, \mathbf{A}\, \hat{\mathbf{S}}^{\ell m} \big\|_2^2 .
# ```
#
# **The start** is a mixing matrix of the principal components of the data, brought to the resolution of the worst channel at every $\ell$: there a source has
# one map again. Then two updates take turns.
#
# **S from A** is least squares at every $\ell$ with a Tikhonov term (Eq. 23 of the paper, Eq. 21 of C21),
#
# ```{math}
# :label: eq-sdecgmca-sources
# \hat{\mathbf{S}}^{\ell m} = \big( \mathbf{A}^{\top} \mathrm{diag}(\hat H^\ell)^2 \mathbf{A} + \mathrm{diag}(\epsilon_{\ell}) \big)^{-1}
#   \mathbf{A}^{\top} \mathrm{diag}(\hat H^\ell)\, \hat{\mathbf{X}}^{\ell m} ,
# ```
#
# whose $\epsilon$ keeps the inverse finite where the beam leaves too little. In the *warm-up* it follows the matrix, in the *refinement* the spectra of the
# last sources (strategies 3 and 4, Eqs. 26 and 27 of C21), both times the strength $c$:
#
# ```{math}
# :label: eq-sdecgmca-epsilon
# \epsilon_{\ell} = \max\!\Big( 0,\; c - \frac{\lambda_\mathrm{min}(\mathbf{A}^{\top} \mathrm{diag}(\hat H^\ell)^2 \mathbf{A})}{\lambda_\mathrm{min}(\mathbf{A}^{\top} \mathbf{A})} \Big)
# \qquad \text{and} \qquad
# \epsilon_{n, \ell} = c\, \frac{C_\ell^\mathrm{noise}}{C_\ell(\hat{\mathbf{S}}_n)} .
# ```
#
# **Thresholds.** The sources go to five starlet scales, where coefficients below three times their noise, by default that of the instrument carried through the inversion, are dropped (the paper
# says neither the three nor whose noise); of the others a share is kept that grows
# to $K_\mathrm{max}$ in the warm-up, less their threshold. In the refinement large coefficients have lower thresholds ($\ell_1$ reweighting).
#
# **A from S** is least squares in every channel over all harmonics; then a column whose sum is negative is turned, negative entries are set to zero, and columns get unit length (Eqs. 14 to 16 of C21):
#
# ```{math}
# :label: eq-sdecgmca-mixing
# \mathbf{A}_\nu = \Big( \sum_{\ell m} \hat H_\nu^\ell\, \hat X_\nu^{\ell m}\, \hat{\mathbf{S}}^{\ell m\,\top} \Big)
#   \Big( \sum_{\ell m} (\hat H_\nu^\ell)^2\, \hat{\mathbf{S}}^{\ell m} \hat{\mathbf{S}}^{\ell m\,\top} \Big)^{-1} .
# ```
#
# **The end.** Warm-up and refinement end when $\hat{\mathbf{S}}$ hardly changes, as the paper has it, or by count, as the code of C21 has it. The foreground is $\mathrm{diag}(\hat H^\ell)\, \mathbf{A}\, \hat{\mathbf{S}}$ with a
# last $\hat{\mathbf{S}}$ of {eq}`eq-sdecgmca-sources` without thresholds, found in the maps with their peaks masked and subtracted from those with their peaks (the paper says neither).
# The paper chooses three parameters by beam (its Table 1):

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
# Some of these steps can be read in more than one way, and what the authors' public code does is not always what the text says. So each choice has a name, and
# four sets of them are *readings*: the **letter**, with nothing that the text speaks against; the **code** of C21; the **follow-up**, that with what the later code of the paper's first author
# changes in the inversion; and the **default**, of those that do not fail the nearest to the letter. How that was decided, and what each reading reproduces, is in {doc}`16_readings`. Here: {glue:text}`sdecgmca_reading`.

# %% tags=["hide-input"]
head = ["What is to be decided", *READINGS]
body = [
    [option.question, *(option.choices[values[name]] for values in READINGS.values())]
    for name, option in OPTIONS.items()
]
Markdown("\n".join(Table(head, body).markdown()))

# %% [markdown]
# ## What is removed
#
# Spectra and maps of the medoid of the restarts; another one has other columns, as the figures of what is left show.
# The columns fall with frequency and are nearly parallel, and the sources have both signs and cancel in part, as those of
# GMCA do. The last source is the faintest by far; what it follows decides what becomes of HI.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-mixing", "caption": "The spectra that SDecGMCA removes, of the medoid of its restarts: columns of the mixing matrix against frequency. Smooth columns can be foreground; one with structure from channel to channel follows HI and noise."}}
mixing_figure(study, selected, medoid)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-sources", "caption": "The sources that go with these spectra, mK. Colours span the central 96 % of the pixels."}}
sources_figure(study, selected, medoid)

# %% [markdown]
# ## What is left
#
# Ratios are those to the truth, HI plus noise, with all its multipoles; of a reading that ends at some $\ell$ the maps are compared with the truth up to there.
#
# In the maps look along the plane, where foreground would stand out of the difference. In the spectra look on which side of 1 the ratio is: the paper
# has an excess at low $\ell$ and low $k_\nu$ through the oscillating beam, and a small peak at the ripple. Then look at the band: what restarts do not agree on is no result.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-maps", "caption": "One channel in the middle of the band: observed, cleaned by SDecGMCA (the medoid of its restarts), the truth (HI plus noise), and what is wrong. Channel means removed; colours span 1 to 99 % of the pixels, the same for cleaned and truth; the difference is white where nothing is wrong."}}
channel_figure(study, selected, medoid)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-angular", "caption": "Angular power spectrum after SDecGMCA for the three beams, with the numbers of sources of the paper, and its ratio to the truth. {glue:text}`sdecgmca_reading_short` ([readings](sdecgmca-reading)); the legend says how many failed, for the three beams in turn. The grey band is 10 %. (SDecGMCA's share of the paper's Fig. 1.)"}}
angular_figure(study, removers)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-frequency", "caption": "Frequency power spectrum after SDecGMCA for the three beams, and its ratio to the truth. {glue:text}`sdecgmca_reading_short` ([readings](sdecgmca-reading)); the legend says how many failed, for the three beams in turn. The grey band is 10 %. (SDecGMCA's share of the paper's Fig. 2.)"}}
frequency_figure(study, removers)

# %% tags=["hide-input"]
numbers = study.band_numbers(removers, tolerance=0.05)
for each, methods in removers.items():
    failed = ["yes" if one.fails else "no" for one in study.ensemble(each, methods[0])]
    results = [study.assessed(each, member) for member in study.members(methods[0])]
    numbers[f"{each}: failed"] = over_restarts(remover, failed)
    numbers[f"{each}: iterations"] = over_restarts(remover, [(one.n_iterations, 1) for one in results])
    settled = ["yes" if one.converged else "no" for one in results]
    numbers[f"{each}: settled"] = over_restarts(remover, settled)
show(numbers)

# %% [markdown]
# ## The last step, and what lies beyond
#
# The paper inverts the beam up to $\ell = 200$ and cuts its curves there. What does the method take away beyond? Its text does not say what maps and $P(k)$ hold there, and three answers have names: with
# `beyond="cut"` nothing is estimated there and the residual ends, so that it lacks what the truth has beyond; with `"regularised"`
# {eq}`eq-sdecgmca-sources` goes on to $3\,N_\mathrm{side}$ with its $\epsilon$; with `"projection"` it goes on without. Up to the end all three are the same
# $\mathbf{A}$ and the same $\hat{\mathbf{S}}$.
#
# Up to the dotted line there is one curve. Beyond it look at “regularised”: the paper's spurious peak beyond $\ell = 200$ is what an $\epsilon$ above
# zero makes of the highest multipoles.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-beyond", "caption": "Ratio of the spectra to the truth for three answers to what happens beyond the last multipole of the inversion (dotted): frequency (left) and angular (right). Medians and bands of the restarts, which have the same mixing matrices in all three; the reading is that of the figures above. The axes of ratios are logarithmic. Beyond 2 nside (dotted as well) the pixels hold maps badly."}}
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
            np.squeeze([one.ratios[kind] for one in members]),
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
# Where $\epsilon$ is at work, the foreground is too small, and what is left too large: this is the paper's explanation of a peak beyond $\ell = 200$. The curve above has the $\epsilon$ of the last $\hat{\mathbf{S}}$ in
# this reading ([readings](sdecgmca-reading)); strategy 3, which the paper takes for the warm-up, may have none at these multipoles. The first at which it is above zero, of those looked at, with $c$ of Table 1 and the $\mathbf{A}$ of each restart (– if it is zero at all of them):

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
    name = f"{each}: first l to {len(epsilon) - 1} with an epsilon above zero"
    numbers[name] = over_restarts(remover, onsets)
show(numbers)

# %% [markdown]
# ## How far to trust it
#
# An answer that changes when nothing of importance changes is no answer. So we change what should not matter. Of SDecGMCA that is the start of $\mathbf{A}$, by $10^{-10}$: on the left the restarts in the reading of this
# notebook, in the middle in another one. BeamSubspace settles from any start; on the right it is given a noise level 0.1 % too low and too high. To see it on the real Galaxy run this
# notebook with `galaxy=templates`; {doc}`16_readings` has every reading on it, on more than one sky.

# %% tags=["hide-input"]
other = "letter" if reading != "letter" else "default"
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

# %% [markdown]
# Where curves lie on each other nothing depends on the start, or on the noise level. Where they part, each of them is one of many answers.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-sensitivity", "caption": "C/C0 when what should not matter is changed, each run a thin line, with their median and 16 to 84 % band. Left: restarts of SDecGMCA in the reading of this notebook. Middle: in another one. Right: BeamSubspace with three noise levels that differ by 0.1 %. Titles name the readings. A panel whose curves leave 0.4 to 1.6 has a logarithmic axis."}}
panels = []
for (kind, results), colour in zip(runs.items(), (styles.VERMILION, styles.BLUE, styles.INDIGO), strict=True):
    drawn = np.array([one.angular_ratio for one in results])
    near = drawn.min() > 0.4 and drawn.max() < 1.6
    look = ensemble_style({"label": kind.partition(",")[0], "color": colour}, results)
    curves = [(results[0].degrees, np.squeeze(drawn), look)]
    axes = {"xlabel": styles.AXES["angular"]["xlabel"], "ylabel": r"$C / C_0$", "xscale": "log"}
    scale = {"ylim": (0.4, 1.6)} if near else {"yscale": "log"}
    panels.append({"curves": curves, "title": kind, "xlim": (2, study.l_top)} | axes | scale)
study.stamped(plotting.lines(panels, columns=3, size=(3.6, 3.4)), beam=selected, n_sources=n_sources)

# %% [markdown]
# In numbers: means of both ratios over bands, the median, of restarts with the 16 to 84 %, and the lowest and highest of the runs. Another rounding moves the iteration of SDecGMCA as another start does: with another processor each run is
# another one, and nothing compares them ([conventions](../book/conventions.md)).

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
# At the multipole where it moves most, the highest C/C0 of the left panel is {glue:text}`sdecgmca_moves` times the lowest, that of the reading “{glue:text}`sdecgmca_other`”
# {glue:text}`sdecgmca_other_moves` times, and that of BeamSubspace {glue:text}`sdecgmca_subspace_moves` times. Of {glue:text}`sdecgmca_restarts` restarts {glue:text}`sdecgmca_failed` failed in the reading of this notebook and
# {glue:text}`sdecgmca_other_failed` in the other. There are two sides to it. Runs that scatter little can be further from the truth than others that
# scatter much: compare the medians, not only the bands. And a run that is right says nothing of a method that fails from the next start: a result of SDecGMCA is
# worth reporting with its scatter, as {doc}`15_claims` and {doc}`16_readings` do.
#
# ## Another method for the same model: BeamSubspace
#
# SDecGMCA fits $\mathbf{A}$ to the data with sources of which the thresholds have taken something. The largest sources are many times brighter than HI, and cancel each other to that precision in every channel; what
# is cut from one of them stays in the data, blurred differently by each beam, and $\mathbf{A}$ bends to describe it. BeamSubspace, which is ours and not the paper's,
# has the same mixture, a start of the same kind and thresholds on the same starlets. It has no constraint on signs and no $\epsilon$, takes the beam over that of the best channel, and subtracts the *whole* sources before it asks what is left for $\mathbf{A}$:
#
# ```{math}
# :label: eq-sdecgmca-correction
# \sum_{\ell m} \hat H_\nu^\ell \left( \hat X_\nu^{\ell m} - \hat H_\nu^\ell\, \mathbf{A}_\nu \hat{\mathbf{S}}^{\ell m} \right) \hat{\mathbf{T}}^{\ell m\,\top} = 0 ,
# ```
#
# with $\hat{\mathbf{T}}$ the thresholded sources, which only choose *where* to look. Without noise the true $\mathbf{A}$ solves it whatever the thresholds leave out. Its foreground is the projection on the
# space of the blurred spectra at every $\ell$, without $\epsilon$ and without an end. It stands beside SDecGMCA, never in its place.
#
# The two lose HI at different scales: compare the ratios at low $\ell$, at the smallest $k_\nu$, and at the ripple.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-sdecgmca-subspace", "caption": "Frequency (left) and angular (right) power spectrum after SDecGMCA and after BeamSubspace with as many sources, and their ratio to the truth. {glue:text}`sdecgmca_reading_short` ([readings](sdecgmca-reading)). The grey band is 10 %."}}
pair = [remover, BeamSubspace(n_sources=n_sources)]
ensembles = {method: study.ensemble(selected, method) for method in pair}
curves = [
    (ensemble_style(styles.method_style(method), members), members) for method, members in ensembles.items()
]
both_figure(study, selected, curves, n_sources=n_sources, reading=reading)

# %% [markdown]
# ## What to take away
#
# - SDecGMCA puts the beam into the mixture, and finds sources and spectra in turns: sparse sources, least squares, an $\epsilon$ where the beam leaves too little.
# - The text leaves choices; each has a name here, and wherever a result of SDecGMCA is shown the reading is said.
# - The inversion ends at some $\ell$. What happens beyond is a choice, and the figure shows what depends on it.
# - It trusts its beam, and its iteration is chaotic: one run is one draw. Report an ensemble, and how many of it failed.
#
# ## Exercises
#
# **1.** Is the method better off with fewer sources through the oscillating beam?
#
# ```sh
# himap run 09_sdecgmca -p n_sources=3                       # fewer sources, through the oscillating beam
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# At low $\ell$ and at the smallest $k_\nu$ it is nearer to 1, for fewer sources take less HI, where they hold the foreground. Look at how many restarts fail and at the width of the band: a median between runs that fail and runs that do not is not yet a result.
#
# </details>
#
# **2.** Take the reading of the public code. What changes through which beam?
#
# ```sh
# himap run 09_sdecgmca -p reading=code                      # the public code of C21
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Through the degraded beam little. Through the oscillating beam it is another answer, and how much foreground it leaves depends on the start.
#
# </details>
#
# **3.** One source, and at some $\ell$ the beam is $0.05$ in all channels. What is $\epsilon_\ell$ of strategy 3 with $c = 0.01$, and which share of
# the foreground is found?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# With one column of unit length $\mathbf{A}^{\top} \mathrm{diag}(\hat H)^2 \mathbf{A} = 0.0025$, so $\epsilon = 0.01 - 0.0025 = 0.0075$.
# {eq}`eq-sdecgmca-sources` then finds $0.0025 / (0.0025 + 0.0075) = 1/4$ of the source: three quarters of the foreground stay in the maps. This is how
# a peak beyond the last multipole comes about.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 09_sdecgmca -p galaxy=templates -p template_dir=maps   # the real Galaxy
# ```
