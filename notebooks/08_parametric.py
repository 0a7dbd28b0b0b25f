# ---
# jupyter:
#   himap:
#     figures: []
#     section: 3.2.2
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
# # Parametric fitting
#
# > - **Read first**: {doc}`07_polynomial`.
# > - **Good to know**: least squares with one nonlinear parameter.
# > - **Tests** (verdicts of {doc}`15_claims`): {claim}`V3`.
# > - **Time and memory**: {cost}`08_parametric`.
#
# {cite:t}`gkogkou2025` (Sect. 3.2.2) fit every line of sight $p$ with free-free emission of known index
# {cite:p}`bennett1992` and a second power law for all other emission,
#
# ```{math}
# :label: eq-parametric
# T(\nu) = \alpha_1(p) \left(\frac{\nu}{\nu_0}\right)^{-2.13} + \alpha_2(p) \left(\frac{\nu}{\nu_0}\right)^{\beta(p)} .
# ```
#
# The index of free-free emission in the simulations is $-2.14$, in the paper as here. The authors assume that
# point sources are absorbed by these terms, and report that the fit fails with the evolving and the
# oscillating beam. This chapter tests when the model holds.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "degraded"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
beta_min: float = -4.0  # steepest index of the second power law
beta_max: float = -2.2  # flattest index of the second power law

# %%
import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.instrument.beams import named
from himap.maps import sphere
from himap.paper import pipeline
from himap.paper.methods import paper_beams
from himap.paper.study import Study
from himap.paper.study_figures import angular_figure, channel_figure, frequency_figure
from himap.removal.parametric import Parametric

beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
)
remover = Parametric(beta_min=beta_min, beta_max=beta_max)
removers = dict.fromkeys([*beams.values(), selected], [remover])
study.check(removers)
observed = study.observed(selected)
freqs = observed.freqs
places = {"Galactic plane, l = 30, b = 0": (30, 0), "l = 30, b = 60": (30, 60)}
bounds = {"beta_min": beta_min, "beta_max": beta_max}

# %% [markdown]
# ## The method
#
# Given $\beta$, the model is linear, so the sum of squares is a function of $\beta$ alone,
#
# ```{math}
# :label: eq-variable-projection
# \chi^2(\beta) &= \min_{\alpha_1, \alpha_2} \sum_\nu \left[T(\nu) - \alpha_1 x^{-2.13} - \alpha_2 x^{\beta}\right]^2 \\
#   &= |T|^2 - (\mathbf{q}_1^{\top} T)^2 - (\mathbf{q}_2(\beta)^{\top} T)^2 , \qquad x = \nu/\nu_0 ,
# ```
#
# where $\mathbf{q}_1$ is the unit vector along the first power law and $\mathbf{q}_2(\beta)$ that along the
# part of the second orthogonal to it: *variable projection* {cite:p}`golub1973`. The library tabulates
# $\mathbf{q}_2$ as a Chebyshev series in $\beta$ and maximises with Newton's method. The paper mentions no
# weights, so all channels have equal weight.
#
# At $\beta = -2.13$ the terms are degenerate. The search is bounded to $-4 \leq \beta \leq -2.2$, and a line
# of sight whose best $\beta$ is a bound is **flagged**.
#
# Each curve has one minimum. With the degraded beam the minimum is close to the dotted line in the plane and
# on it at high latitude: the model fits. With the other two it is far above the line in the plane; at high
# latitude it is close to it, but at a biased $\beta$.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-search", "caption": "Rms residual along two lines of sight against the index of the second power law, for the three beams. Dotted: the standard deviation of HI plus noise."}}
x = freqs / remover.nu0
betas = np.linspace(beta_min, beta_max, 181)


def rms_residual(line, beta):
    """Root mean square of what the best amplitudes leave at a given index, mK."""
    laws = np.linalg.qr(np.stack([x**-2.13, x**beta], axis=1))[0]
    return np.sqrt(np.mean((line - laws @ (laws.T @ line)) ** 2))


panels = []
for place, (lon, lat) in places.items():
    pixel = sphere.pixel_at(study.survey.nside, lon, lat)
    curves = []
    for name in beams:
        line = study.observed(beams[name]).maps[:, pixel].astype(float)
        curves.append((betas, [rms_residual(line, beta) for beta in betas], styles.BEAM_STYLES[name]))
    floor = observed.truth.std()
    curves.append(
        (betas[[0, -1]], [floor, floor], {"color": "black", "linestyle": ":", "label": "HI + noise"})
    )
    panels.append(
        {
            "curves": curves,
            "title": place,
            "xlabel": r"$\beta$",
            "ylabel": "rms residual [mK]",
            "yscale": "log",
        }
    )
study.stamped(plotting.lines(panels))

# %% [markdown]
# ## The parameters
#
# $\alpha_1$ follows the true free-free emission in the Galactic plane, but not in individual clouds off it.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-sources", "caption": "Parameters of the fit at mid-band: the amplitudes of free-free emission (alpha 1) and of the second power law (alpha 2), its index beta, and the simulated free-free emission, before the beam. Colours: central 96 % of the pixels."}}
result = study.separation(selected, remover)
free_free = next(
    part for part in pipeline.components_of_sky(study.survey.sky, study.milky_way) if "free" in part.name
)
first, second, index = result.sources
maps = {
    r"$\alpha_1$": first,
    r"$\alpha_2$": second,
    r"$\beta$": index,
    "true free-free emission": free_free.map(remover.nu0),
}
units = dict(zip(maps, ["mK", "mK", "", "mK"], strict=True))
study.stamped(plotting.sky_maps(maps, unit=units, limits=(2, 98)), beam=selected, **bounds)

# %% [markdown]
# $\alpha_1$ shows the Galactic plane, but is biased at high latitudes: its median is
# {glue:text}`parametric_alpha` with the degraded beam, that of the true free-free emission
# {glue:text}`parametric_free_free`. The two power laws are nearly degenerate over less than an octave, and
# the sum of synchrotron emission and radio galaxies has a spectral curvature that the free-free term absorbs.
# Only the *sum*, which is subtracted, is well constrained.
#
# The derivatives with respect to the amplitudes are nearly identical; that with respect to the index changes
# sign.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-mixing", "caption": "Derivatives of the spectrum with respect to alpha 1, alpha 2 and beta, at the median parameters of the sky: the columns of the mixing matrix, each over its largest value."}}
names = [r"$\alpha_1$", r"$\alpha_2$", r"$\beta$"]
colours = [styles.BLUE, styles.ORANGE, styles.GREEN]
curves = [
    (freqs, column / np.abs(column).max(), {"label": label, "color": colour, "linestyle": style})
    for column, label, colour, style in zip(result.mixing.T, names, colours, ["-", "--", "-."], strict=True)
]
labels = {"xlabel": styles.CHANNELS, "ylabel": "derivative of T, scaled"}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 4)), beam=selected)

# %% tags=["hide-input"]
numbers = {}
for name in beams:
    fit = study.separation(beams[name], remover)
    numbers |= {
        f"{name}: median of alpha_1": (float(np.median(fit.sources[0])), 1.0, "mK"),
        f"{name}: median of alpha_2": (float(np.median(fit.sources[1])), 1.0, "mK"),
        f"{name}: median of beta": (float(np.median(fit.sources[2])), 0.005),
        f"{name}: lines of sight with alpha_1 < 0": (100 * float(np.mean(fit.sources[0] < 0)), 0.3, "%"),
        f"{name}: flagged lines of sight": (100 * float(fit.flagged.mean()), 0.05, "%"),
        f"{name}: steps of the search": (fit.n_iterations, 1.0),
    }
numbers["true free-free emission, median"] = (float(np.median(free_free.map(remover.nu0))), 0.1, "mK")
show(numbers)

# %% tags=["hide-input"]
quote(
    parametric_alpha=numbers["degraded: median of alpha_1"],
    parametric_free_free=numbers["true free-free emission, median"],
    parametric_flagged_evolving=numbers["evolving: flagged lines of sight"],
    parametric_flagged_oscillating=numbers["oscillating: flagged lines of sight"],
    parametric_steps=numbers["degraded: steps of the search"],
)

# %% [markdown]
# ## The residual
#
# With the degraded beam the residual is at the level of HI. With the evolving beam, sources near a line of
# sight fade or brighten with frequency, unlike a power law; the residual is smooth and, in the plane, large.
# The oscillating beam adds its ripple.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-lines", "caption": "Residual of the parametric fit along two lines of sight (Galactic latitude 0, top, and 60 degrees, bottom), for the three beams, and HI plus noise. The scales differ."}}
panels = []
for place, (lon, lat) in places.items():
    pixel = sphere.pixel_at(study.survey.nside, lon, lat)
    for name in beams:
        residual = study.residual(beams[name], remover)[:, pixel]
        truth = study.observed(beams[name]).truth[:, pixel]
        panels.append(
            {
                "curves": [
                    (freqs, residual, {"color": styles.VERMILION, "label": "residual"}),
                    (freqs, truth, {"color": "black", "linestyle": "--", "label": "truth"}),
                ],
                "title": f"{place}\n{name}",
                "xlabel": styles.CHANNELS,
                "ylabel": "T [mK]",
            }
        )
study.stamped(plotting.lines(panels, columns=3, size=(3.6, 3.2)), **bounds)

# %% [markdown]
# In a map through the oscillating beam HI is faint compared with the residual in the plane.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-maps", "caption": "A channel in the middle of the band, through the oscillating beam: observed, cleaned by the parametric fit, true (HI plus noise), and cleaned minus true. Channel means removed; colours span 1 to 99 % of the pixels, alike for cleaned and true; white: no error."}}
hardest = beams["oscillating"]  # whatever beam is shown in detail
channel_figure(study, hardest, remover)

# %% [markdown]
# ## The power spectra
#
# In the bands of the table the power is {glue:text}`parametric_evolving_least` to
# {glue:text}`parametric_evolving_most` times that of the truth with the evolving beam, and
# {glue:text}`parametric_oscillating_least` to {glue:text}`parametric_oscillating_most` times with the
# oscillating beam.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-angular", "caption": "Angular power spectrum of the maps cleaned by the parametric fit, for the three beams, and its ratio to the truth on a logarithmic axis. Grey band: 10 %. (Part of the paper's Fig. 1.)"}}
angular_figure(study, removers)

# %% [markdown]
# Along the line of sight, the power is also close to the truth only with the degraded beam, except for a loss
# at the smallest $k_\nu$.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-frequency", "caption": "Frequency power spectrum of the maps cleaned by the parametric fit, for the three beams, and its ratio to the truth on a logarithmic axis. Grey band: 10 %. (Part of the paper's Fig. 2.)"}}
frequency_figure(study, removers)

# %% tags=["hide-input"]
show(study.band_numbers(removers))

# %% tags=["hide-input"]
evolving, oscillating = (study.bands(beams[name], remover).values() for name in ("evolving", "oscillating"))
quote(
    parametric_evolving_least=(min(evolving), 0.02 * min(evolving)),
    parametric_evolving_most=(max(evolving), 0.02 * max(evolving)),
    parametric_oscillating_least=(min(oscillating), 0.02 * min(oscillating)),
    parametric_oscillating_most=(max(oscillating), 0.02 * max(oscillating)),
)

# %% [markdown]
# ## Which lines of sight fail
#
# The curve of the degraded beam falls to the left of the dotted line, where the error is below the signal,
# the other two to the right.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-parametric-sky", "caption": "Share of the sky whose rms error over channels is larger than each value, for the three beams. Channel means removed. Dotted: the standard deviation of HI plus noise."}}
curves, numbers = [], {}
for name in beams:
    squares = study.assessed(beams[name], remover).line_errors
    rms = np.sqrt(squares)
    power = np.mean([truth.var(dtype=float) for truth in study.observed(beams[name]).truth])
    levels = np.geomspace(0.003, 1000, 300)
    above = 1 - np.searchsorted(np.sort(rms), levels) / len(rms)
    curves.append((levels, 100 * np.where(above > 0, above, np.nan), styles.BEAM_STYLES[name]))
    relative = {
        "rms error / rms truth": np.sqrt(squares.mean() / power),
        "rms error without flagged lines / rms truth": np.sqrt(
            squares[~study.separation(beams[name], remover).flagged].mean() / power
        ),
        "error exceeded on the worst 1 % of the lines of sight": np.percentile(rms, 99) / np.sqrt(power),
    }
    worst = squares >= np.percentile(squares, 99)
    numbers |= {f"{name}: {what}": (value, 0.03 * value) for what, value in relative.items()}
    numbers |= {
        f"{name}: rms error of the median line of sight / rms truth": (
            float(np.median(rms) / np.sqrt(power)),
            0.05,
        ),
        f"{name}: lines of sight with an error above the truth": (100 * np.mean(squares > power), 1.0, "%"),
        f"{name}: squared error in the worst 1 %": (100 * squares[worst].sum() / squares.sum(), 1.0, "%"),
    }
floor = (
    [np.sqrt(power)] * 2,
    [100 / len(rms), 100],
    {"color": "black", "linestyle": ":", "label": "HI + noise"},
)
labels = {"xlabel": "rms error [mK]", "ylabel": "lines of sight above [%]", "xscale": "log", "yscale": "log"}
study.stamped(plotting.lines([{"curves": [*curves, floor], **labels}], columns=1, size=(6.4, 4)), **bounds)

# %% tags=["hide-input"]
show(numbers)

# %% tags=["hide-input"]
above = "lines of sight with an error above the truth"
exceeded = "error exceeded on the worst 1 % of the lines of sight"
share, unflagged = "squared error in the worst 1 %", "rms error without flagged lines / rms truth"
quote(
    parametric_worse_degraded=(numbers[f"degraded: {above}"][0], 0.1, "%"),
    parametric_worse_evolving=numbers[f"evolving: {above}"],
    parametric_worse_oscillating=numbers[f"oscillating: {above}"],
    parametric_worst_evolving=numbers[f"evolving: {exceeded}"],
    parametric_worst_oscillating=numbers[f"oscillating: {exceeded}"],
    parametric_share_evolving=numbers[f"evolving: {share}"],
    parametric_share_oscillating=numbers[f"oscillating: {share}"],
    parametric_good_evolving=numbers[f"evolving: {unflagged}"],
    parametric_good_oscillating=numbers[f"oscillating: {unflagged}"],
)

# %% [markdown]
# The error exceeds the signal on {glue:text}`parametric_worse_degraded` of the lines of sight with the
# degraded, {glue:text}`parametric_worse_evolving` with the evolving and
# {glue:text}`parametric_worse_oscillating` with the oscillating beam. With the latter two the worst 1 % have
# errors of more than {glue:text}`parametric_worst_evolving` and {glue:text}`parametric_worst_oscillating`
# times the signal, and contribute {glue:text}`parametric_share_evolving` and
# {glue:text}`parametric_share_oscillating` of the squared error. Flags identify only the extremes: without
# the flagged lines the error is {glue:text}`parametric_good_evolving` and
# {glue:text}`parametric_good_oscillating` times the signal.

# %% [markdown]
# ## Conclusions
#
# - With the degraded beam, where the model holds, three parameters recover HI as well as PCA does
#   ({doc}`10_results`).
# - With a beam that changes with frequency the fit fails by orders of magnitude in both spectra, although the
#   search converges everywhere, in about {glue:text}`parametric_steps` steps, and only
#   {glue:text}`parametric_flagged_evolving` (evolving) and {glue:text}`parametric_flagged_oscillating`
#   (oscillating) of the lines of sight are flagged. The size of the residual reveals the failure.
#
# ## Exercise
#
# Do wider bounds reduce the number of flags and the error?
#
# ```sh
# himap run 08_parametric -p beta_min=-6
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# At `quick` there are fewer flags, but an even larger excess at low $\ell$ with the evolving and the oscillating beam.
#
# </details>
