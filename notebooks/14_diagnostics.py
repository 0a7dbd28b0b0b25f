# ---
# jupyter:
#   himap:
#     figures: ["A.1", "A.2"]
#     section: "A"
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
# # Correlation and variance
#
# > - **Read first**: {doc}`10_results`.
# > - **Good to know**: correlation and linear regression.
# > - **Tests** (verdicts of {doc}`15_claims`): {claim}`A1`, {claim}`A2`.
# > - **Time and memory**: {cost}`14_diagnostics`.
#
# In channel-averaged power spectra ({doc}`10_results`) signal loss and foreground residual can cancel, and so
# can channels that are too bright and too faint. The appendix of {cite:t}`gkogkou2025` adds two diagnostics.
# The correlation of recovered and true *maps* in each channel is highest for SDecGMCA at all frequencies. The
# *variance* of the error of $C_\ell$ over channels is smallest for SDecGMCA at
# $10 \lesssim \ell \lesssim 200$. This chapter measures both for all six methods with the oscillating beam
# and several restarts of SDecGMCA ({doc}`27_restarts`). {glue:text}`diagnostics_reading`
# ([readings](sdecgmca-reading)).

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, meerkat or a file of widths or b_l
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
n_sources: int = 5  # sources of PCA, FastICA, GMCA and SDecGMCA
reading: str = "default"  # of SDecGMCA: default, letter, code, code-rounding, follow-up, instrument-noise
n_restarts: int = 4  # starts of SDecGMCA, which is chaotic: all of them are shown

# %% tags=["hide-input"]
import warnings

import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import of_restarts, one_run, quote, show_table
from himap.maps.low_rank import centred
from himap.measures.diagnostics import error_variance
from himap.paper import captions, pipeline
from himap.paper.methods import beam_called, methods_for
from himap.paper.study import Study, over_restarts
from himap.paper.study_figures import ensemble_style
from himap.removal.base import SeparationWarning

selected = beam_called(beam, ripple=ripple)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    n_restarts=n_restarts,
)
study.case(selected)  # an unknown beam is refused here
removers = {selected: methods_for(selected, n_sources, reading=reading)}
study.check(removers)
warnings.simplefilter("ignore", SeparationWarning)  # whether a run converged is in the table at the end
quote(diagnostics_reading=captions.in_short(removers[selected][3], study.survey.nside, n_restarts))

# %%
study.prepare(removers)

# %% tags=["hide-input"]
labels = {remover.name: styles.method_style(remover)["label"] for remover in removers[selected]}
assessments = {
    remover.name: [study.assessed(selected, member) for member in study.members(remover)]
    for remover in removers[selected]
}
looks = {
    remover.name: ensemble_style(styles.method_style(remover), study.ensemble(selected, remover))
    for remover in removers[selected]
}
component = [remover for remover in removers[selected] if hasattr(remover, "n_sources")]
freqs = study.survey.freqs

# %% [markdown]
# ## Correlation of the maps
#
# The Pearson correlation coefficient of the recovered map $T$ and the true map $T^0$ over all pixels $p$ of a channel is (the paper's Eq. A.1)
#
# ```{math}
# :label: eq-diagnostics-pearson
# r(\nu) = \frac{\sum_p \delta T_{\nu,p}\, \delta T^0_{\nu,p}}
#               {\sqrt{\sum_p \delta T_{\nu,p}^2}\,\sqrt{\sum_p (\delta T^0_{\nu,p})^2}} , \qquad
# \delta T_{\nu,p} = T_{\nu,p} - \langle T_\nu \rangle_p .
# ```
#
# It is not sensitive to a constant factor in a channel. If the loss is a projection, a foreground residual of
# variance $f$ and a lost share $q$ of the signal variance (both in units of that variance) give
# $r = \sqrt{(1 - q)^2 / (1 - q + f)}$, about $1 - (q + f) / 2$. Multipoles beyond the last one of the
# inversion of SDecGMCA are included.
#
# For PCA, FastICA and GMCA $r$ oscillates with the period of the ripple at the low end of the band, where the
# ripple is foreground residual. Here restarts of SDecGMCA that do not fail have no such oscillation, and a
# higher $r$ in nearly all channels; if half of the restarts fail, the median oscillates too. At the paper's
# size a restart that does not fail also oscillates, weakly ({doc}`18_paper_size`). Here failures are
# identified with the truth.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-diagnostics-pearson", "caption": "Pearson correlation of the recovered and the true map against frequency, for six methods (the paper's Fig. A.1). Left: all. Right: the component methods, without the lowest values of single restarts. {glue:text}`diagnostics_reading` ([readings](sdecgmca-reading)). PCA and FastICA coincide."}}
correlations = {  # (n_members, n_channels) of an ensemble
    name: np.squeeze([one.correlation for one in members]) for name, members in assessments.items()
}
curves = [(freqs, values, looks[name]) for name, values in correlations.items()]
near = [curve for curve, remover in zip(curves, removers[selected], strict=True) if remover in component]
low = min(np.median(np.atleast_2d(values), axis=0).min() for _, values, _ in near)
common = {"xlabel": styles.CHANNELS, "ylabel": "Pearson $r$", "xlim": (freqs[0], freqs[-1])}
panels = [
    common
    | {
        "curves": curves,
        "ylim": (-0.4, 1.02),
        "title": "all six",
    },
    common
    | {
        "curves": near,
        "ylim": (low - 0.02, 1.005),
        "title": "the component methods",
    },
]
study.stamped(
    plotting.lines(panels, size=(5, 3.8), legend_above=True),
    beam=selected,
    n_sources=n_sources,
    reading=reading,
)

# %% tags=["hide-input"]
of_sd = np.atleast_2d(correlations["sdecgmca"])
quote(
    diagnostics_r_sd_median=of_restarts([(np.median(one), 0.01) for one in of_sd]),
    diagnostics_r_sd_lowest=of_restarts([(one.min(), 0.01) for one in of_sd]),
    diagnostics_r_pca_lowest=(correlations["pca"].min(), 0.02),
    diagnostics_r_gmca_lowest=(correlations["gmca"].min(), 0.02),
    diagnostics_r_polynomial_median=(np.median(correlations["polynomial"]), 0.01),
    diagnostics_r_parametric_highest=(correlations["parametric"].max(), 0.01),
)

# %% [markdown]
# In the median channel $r$ is {glue:text}`diagnostics_r_sd_median` for SDecGMCA and
# {glue:text}`diagnostics_r_polynomial_median` for the polynomial. The lowest value is
# {glue:text}`diagnostics_r_sd_lowest` for SDecGMCA, {glue:text}`diagnostics_r_pca_lowest` for PCA and
# {glue:text}`diagnostics_r_gmca_lowest` for GMCA; the highest value of the parametric fit is
# {glue:text}`diagnostics_r_parametric_highest`.
#
# ### Signal loss and foreground residual by channel
#
# The foreground residual is not correlated with HI. With the slope of the regression of the recovered on the
# true map, $b_\nu = \sum_p \delta T\, \delta T^0 / \sum_p (\delta T^0)^2$, the lost share of the signal is
# $q_\nu = 1 - b_\nu$, and if the loss is a projection, the foreground residual in units of the variance of
# the truth is $f_\nu = \langle \delta T^2 \rangle / \langle (\delta T^0)^2 \rangle - b_\nu$.
#
# A signal without correlation between channels loses $h_\nu = P_{\nu\nu}$, with $\mathbf{P}$ the projector on
# the removed spectra; $\sum_\nu h_\nu = n_s$. (For SDecGMCA the spectra are those smoothed by the beam, and
# $h_\nu$ is a mean over $\ell$ weighted with the power of the truth.) If the left and middle panels agree, a
# method loses the HI that its number of sources implies.

# %% tags=["hide-input"]
observation, true = study.observed(selected), study.truth(selected).angular
relative = observation.beams / observation.beams.max(axis=0)


def lost_and_left(remover):
    """q_nu and f_nu, (n_channels,), of the truth at every multipole."""
    maps, truth = centred(study.residual(selected, remover)), centred(pipeline.truth(study.case(selected)))
    products = [np.sum(maps * other, axis=1, dtype=float) for other in (truth, maps)]
    slope, variance = products / np.sum(truth**2, axis=1, dtype=float)
    return 1 - slope, variance - slope


def share_taken(remover):
    """h_nu, (n_channels,)."""
    found = study.separation(selected, remover)
    mixing = found.mixing
    if "beams" not in remover.uses:
        return np.sum(np.linalg.qr(mixing)[0] ** 2, axis=1)
    last = min(relative.shape[1], true.cl.shape[1]) - 1 if found.lmax is None else found.lmax
    blurred = np.arange(2, last + 1)
    spaces = np.linalg.qr(relative.T[blurred, :, None] * mixing)[0]  # (n_l, n_channels, n_sources)
    weights = (2 * blurred + 1) * true.cl[:, blurred]
    return np.average(np.sum(spaces**2, axis=2).T, axis=1, weights=weights)


taken, signal_lost, foreground = {}, {}, {}
for remover in component:
    members, name = study.members(remover), remover.name
    taken[name] = np.squeeze([share_taken(member) for member in members])
    both = np.array([lost_and_left(member) for member in members])
    signal_lost[name], foreground[name] = np.squeeze(both[:, 0]), np.squeeze(both[:, 1])

# %% [markdown]
# In the right panel PCA, FastICA and GMCA have most foreground residual at the low end of the band. The
# residual of SDecGMCA differs between restarts by orders of magnitude.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-diagnostics-shares", "caption": "Contributions to 1 - r, for the component methods. Left: share of the signal lost in each channel. Middle: share of the channel in the space of the removed spectra, whose sum is the number of sources. Right: variance of the foreground residual over that of the truth, from 1e-3. {glue:text}`diagnostics_reading` ([readings](sdecgmca-reading)). PCA and FastICA coincide."}}
shared = {"xlabel": styles.CHANNELS, "xlim": (freqs[0], freqs[-1])}
top = 1.05 * max(np.median(np.atleast_2d(values), axis=0).max() for values in signal_lost.values())
panels = [
    shared
    | {
        "curves": [(freqs, values, looks[name]) for name, values in quantity.items()],
        "title": title,
        "ylabel": ylabel,
    }
    | limits
    for quantity, title, ylabel, limits in (
        (
            signal_lost,
            r"signal lost, $q_\nu$",
            "share of the variance",
            {"ylim": (0, top)},
        ),
        (
            taken,
            r"share in the space removed, $h_\nu$",
            "share of a channel",
            {"ylim": (0, top)},
        ),
        (
            {name: np.maximum(values, 1e-9) for name, values in foreground.items()},
            r"foreground residual, $f_\nu$",
            "variance over that of the truth",
            {"yscale": "log", "ylim": (1e-3, 3 * max(values.max() for values in foreground.values()))},
        ),
    )
]
study.stamped(
    plotting.lines(panels, columns=3, size=(3.9, 3.5), legend_above=True),
    beam=selected,
    n_sources=n_sources,
    reading=reading,
)


# %% tags=["hide-input"]
def places(channels):
    """The entry of channels of several restarts: their frequencies, MHz."""
    return one_run(", ".join(f"{freq:.0f}" for freq in np.unique(freqs[channels])))


rows = {}
for remover in component:
    quantities = [
        np.atleast_2d(each[remover.name]) for each in (correlations, signal_lost, taken, foreground)
    ]
    members = [
        {
            "lowest r": (r.min(), 0.02),
            "at [MHz]": (freqs[r.argmin()], study.survey.channel_width),
            "mean q": (q.mean(), 0.003),
            "r of q, h": (np.corrcoef(q, h)[0, 1], 0.05),
            "mean f": (f.mean(), max(0.05 * f.mean(), 0.002)),
        }
        for r, q, h, f in zip(*quantities, strict=True)
    ]
    rows[labels[remover.name]] = over_restarts(remover, members)
    if len(members) > 1:  # those of restarts have no median
        rows[labels[remover.name]]["at [MHz]"] = places(quantities[0].argmin(axis=1))

show_table(rows, columns=2)

# %% tags=["hide-input"]
LOW_END = freqs < 1000
of_sd, left_sd = (np.atleast_2d(each["sdecgmca"]) for each in (signal_lost, foreground))
quote(
    diagnostics_f_pca=(foreground["pca"].mean(), 0.02),
    diagnostics_f_gmca=(foreground["gmca"].mean(), 0.02),
    diagnostics_f_sd=of_restarts([(f.mean(), 0.02) for f in left_sd]),
    diagnostics_f_pca_low_end=(foreground["pca"][LOW_END].mean(), 0.1),
    diagnostics_f_gmca_low_end=(foreground["gmca"][LOW_END].mean(), 0.1),
    diagnostics_f_sd_low_end=of_restarts([(f[LOW_END].mean(), 0.02) for f in left_sd]),
    diagnostics_f_pca_above=(foreground["pca"][~LOW_END].mean(), 0.01),
    diagnostics_f_gmca_above=(foreground["gmca"][~LOW_END].mean(), 0.01),
    diagnostics_f_sd_above=of_restarts([(f[~LOW_END].mean(), 0.02) for f in left_sd]),
    diagnostics_q_pca=(100 * np.median(signal_lost["pca"]), 0.3, "%"),
    diagnostics_q_gmca=(100 * np.median(signal_lost["gmca"]), 0.3, "%"),
    diagnostics_q_sd=of_restarts([(100 * np.median(q), 0.5, "%") for q in of_sd]),
    diagnostics_q_least=(100 * n_sources / len(freqs), 0.1, "%"),
    diagnostics_q_sd_most=of_restarts([(100 * q.max(), 5, "%") for q in of_sd]),
    diagnostics_q_sd_at=places(of_sd.argmax(axis=1)),
    diagnostics_q_and_h=rows["SDecGMCA"]["r of q, h"],
)

# %% [markdown]
# | | PCA | GMCA | SDecGMCA |
# |---|---|---|---|
# | foreground residual $f_\nu$, mean | {glue:text}`diagnostics_f_pca` | {glue:text}`diagnostics_f_gmca` | {glue:text}`diagnostics_f_sd` |
# | below 1000 MHz | {glue:text}`diagnostics_f_pca_low_end` | {glue:text}`diagnostics_f_gmca_low_end` | {glue:text}`diagnostics_f_sd_low_end` |
# | above | {glue:text}`diagnostics_f_pca_above` | {glue:text}`diagnostics_f_gmca_above` | {glue:text}`diagnostics_f_sd_above` |
# | signal loss $q_\nu$, median | {glue:text}`diagnostics_q_pca` | {glue:text}`diagnostics_q_gmca` | {glue:text}`diagnostics_q_sd` |
#
# PCA and GMCA have most foreground residual at the low end of the band, where the Galaxy is brightest and the
# beam widest. Sources spread evenly over channels would remove {glue:text}`diagnostics_q_least` of the signal;
# SDecGMCA loses up to {glue:text}`diagnostics_q_sd_most`, at {glue:text}`diagnostics_q_sd_at` MHz. The
# correlation of $q_\nu$ with $h_\nu$ is {glue:text}`diagnostics_q_and_h`.
#
# In {doc}`11_ns_scan` the smallest error of SDecGMCA is at {glue:text}`11_ns_scan.ipynb::scan_best:s`
# sources, with a mean $r$ of {glue:text}`11_ns_scan.ipynb::scan_r_best:s`. With the number of sources used
# here, and more restarts, the mean $r$ is {glue:text}`diagnostics_r_sd`.
#
# ## Variance over channels
#
# The fractional error of $C_\ell$ in a channel, and its variance over the $N_\nu$ channels, are (the paper's Eqs. A.2 and A.3)
#
# ```{math}
# :label: eq-diagnostics-variance
# R_{\nu,\ell} = 1 - \frac{C_{\nu,\ell}}{C^0_{\nu,\ell}} , \qquad
# \sigma^2_\ell = \frac{1}{N_\nu} \sum_\nu \left( R_{\nu,\ell} - \langle R_{\nu,\ell} \rangle_\nu \right)^2 .
# ```
#
# The paper describes $R_\ell$ as averaged over channels and its variance as that over channels; only the
# latter is possible. The variance is zero for an error common to all channels, and a single channel can
# dominate it.
#
# Between the grey lines SDecGMCA is lowest in the paper; here it is lowest at
# {glue:text}`diagnostics_smallest` of these multipoles. The table lists means over these $\ell$ (geometric
# for the variance).


# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-diagnostics-variance", "caption": "Variance over channels of R = 1 - C/C0 of each channel against multipole, for six methods (the paper's Fig. A.2). Left: all. Right: the component methods. Grey lines: the range of the paper's claim, l from 10 to 200 or the end of the axis. {glue:text}`diagnostics_reading` ([readings](sdecgmca-reading)). PCA and FastICA coincide."}}
def both_cl(members):
    """l from 2 to 2 nside, or where the curve ends, C_l of each member and channel, and those of the truth."""
    powers, of_truth = [one.power_spectra.angular for one in members], study.truth(selected).angular
    degrees = powers[0].degrees
    inside = np.flatnonzero((degrees >= 2) & (degrees <= study.l_top))
    return degrees[inside], np.array([power.cl[:, inside] for power in powers]), of_truth.cl[:, inside]


spectra = {name: both_cl(members) for name, members in assessments.items()}
variances = {
    name: np.squeeze([error_variance(one, true_cl) for one in cl])
    for name, (_, cl, true_cl) in spectra.items()
}
LOW, HIGH = 10, min(200, *(degrees[-1] for degrees, _, _ in spectra.values()))
claimed = {name: (degrees >= LOW) & (degrees <= HIGH) for name, (degrees, _, _) in spectra.items()}
curves = [(spectra[name][0], values, looks[name]) for name, values in variances.items()]
near = [curve for curve, remover in zip(curves, removers[selected], strict=True) if remover in component]
common = {"xlabel": styles.AXES["angular"]["xlabel"], "xscale": "log", "yscale": "log"}
panels = []
for title, shown in (("all six", curves), ("the component methods", near)):
    low = min(values.min() for _, values, _ in shown) / 2
    high = max(values.max() for _, values, _ in shown) * 2
    marks = [
        ([at, at], [low, high], {"color": "0.5", "linestyle": ":", "linewidth": 1.2}) for at in (LOW, HIGH)
    ]
    panels.append(
        common
        | {"curves": shown + marks, "title": title, "ylim": (low, high), "ylabel": r"variance of $R_\ell$"}
    )
study.stamped(
    plotting.lines(panels, size=(5, 3.8), legend_above=True),
    beam=selected,
    n_sources=n_sources,
    reading=reading,
)


# %% tags=["hide-input"]
def squares_of(name, member):
    """R_l of each channel, and its squared deviation from the mean over channels, (n_channels, n_l)."""
    _, cl, true_cl = spectra[name]
    fractional = (1 - cl[member] / true_cl)[:, claimed[name]]
    return fractional, (fractional - fractional.mean(axis=0)) ** 2


def rivals(values, name):
    """The values of the five other methods, of SDecGMCA the median of its restarts, (5, n)."""
    return np.array([np.median(np.atleast_2d(one), axis=0) for other, one in values.items() if other != name])


on_claimed = {name: np.atleast_2d(values)[:, claimed[name]] for name, values in variances.items()}
rows = {}
for remover in removers[selected]:
    name, members = remover.name, []
    for n, assessed in enumerate(assessments[name]):
        r, variance = assessed.correlation, on_claimed[name][n]
        fractional, squares = squares_of(name, n)
        squares = np.sort(squares, axis=0)
        best, least = (
            r >= rivals(correlations, name).max(axis=0),
            variance <= rivals(on_claimed, name).min(axis=0),
        )
        variance = float(np.exp(np.log(variance).mean()))
        row = {
            "mean r": (r.mean(), 0.005),
            "channels highest": (100 * best.mean(), 5, "%"),
            "variance of R_l": (variance, 0.1 * variance),
            "l smallest": (100 * least.mean(), 5, "%"),
            "largest two channels": (100 * np.mean(squares[-2:].sum(axis=0) / squares.sum(axis=0)), 5, "%"),
            "mean R_l": (fractional.mean(), max(0.1 * abs(fractional.mean()), 0.005)),
            "converged": "yes" if assessed.converged else "no",
        }
        against_sd = ("channels highest", "l smallest")  # SDecGMCA is one of the six
        members.append({what: one_run(one) if what in against_sd else one for what, one in row.items()})
    rows[labels[name]] = over_restarts(remover, members)
show_table(rows, columns=2)

# %% tags=["hide-input"]
sd = rows["SDecGMCA"]
of_sd = [squares_of("sdecgmca", n)[1].sum(axis=1) for n in range(len(assessments["sdecgmca"]))]
nearest = min(row["variance of R_l"][0] for label, row in rows.items() if label != "SDecGMCA")
times_smaller = [nearest / np.exp(np.log(values).mean()) for values in on_claimed["sdecgmca"]]
in_two = [row["largest two channels"][0] for row in rows.values()]
quote(
    diagnostics_r_sd=sd["mean r"],
    diagnostics_r_pca=rows["PCA"]["mean r"],
    diagnostics_r_gmca=rows["GMCA"]["mean r"],
    diagnostics_highest=sd["channels highest"],
    diagnostics_highest_pca=rows["PCA"]["channels highest"],
    diagnostics_smallest=sd["l smallest"],
    diagnostics_variance_ratio=of_restarts([(ratio, 0.1 * ratio) for ratio in times_smaller]),
    diagnostics_in_two=one_run((np.mean(in_two), 5, "%")),
    diagnostics_top_share=of_restarts([(100 * one.max() / one.sum(), 5, "%") for one in of_sd]),
    diagnostics_top_channel=places([one.argmax() for one in of_sd]),
)

# %% [markdown]
# SDecGMCA has the smallest variance at {glue:text}`diagnostics_smallest` of these multipoles; the smallest
# geometric mean of the other methods is {glue:text}`diagnostics_variance_ratio` times as large. Two channels
# contribute {glue:text}`diagnostics_in_two` of the variance (mean over methods); for SDecGMCA a single
# channel contributes {glue:text}`diagnostics_top_share` of the squares (restarts:
# {glue:text}`diagnostics_top_channel` MHz).

# %% [markdown]
# ## Conclusions
#
# - **Correlation** (A1): the mean $r$ is {glue:text}`diagnostics_r_sd` for SDecGMCA,
#   {glue:text}`diagnostics_r_pca` for PCA and FastICA and {glue:text}`diagnostics_r_gmca` for GMCA. SDecGMCA
#   is highest in {glue:text}`diagnostics_highest` of the channels, PCA in
#   {glue:text}`diagnostics_highest_pca`.
# - **Variance** (A2): SDecGMCA is lowest at {glue:text}`diagnostics_smallest` of the multipoles.
# - With the real Galaxy at `laptop` A1 holds in {glue:text}`15_claims.ipynb::claims_a1_share:s` of the members
#   (skies and restarts) and A2 in {glue:text}`15_claims.ipynb::claims_a2_share:s`.
# - Regression on the truth separates foreground residual from signal loss, which neither diagnostic does.
#
# ## Exercises
#
# **1.** With six sources, do restarts of SDecGMCA that do not fail still have the highest correlation?
#
# ```sh
# himap run 14_diagnostics -p n_sources=6
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The difference nearly vanishes: with six sources PCA and GMCA also describe the foreground. With five they
# leave foreground residual.
#
# </details>
#
# **2.** A method recovers half of the true temperature in every pixel and nothing else. What are $r$, $C/C_0$ and the variance of $R_\ell$?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# $r = 1$, $C/C_0 = 0.25$, and $R_\ell = 0.75$ in every channel, so its variance is 0. Only the ratio of the
# spectra shows the error.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 14_diagnostics -p reading=code                     # another reading of SDecGMCA
# himap run 14_diagnostics -p beam=degraded -p n_sources=3     # the same resolution in all channels
# ```
