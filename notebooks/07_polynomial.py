# ---
# jupyter:
#   himap:
#     figures: []
#     section: 3.2.1
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
# # Polynomial fitting
#
# > - **Read first**: {doc}`03_peak_masking`, {doc}`04_pca`.
# > - **Good to know**: least squares.
# > - **Time and memory**: {cost}`07_polynomial`.
#
# The methods of the last chapters look at the whole sky at once and let it tell which spectra to remove. The
# simplest alternative looks at one line of sight at a time: draw a smooth curve through its spectrum, and call
# what is left HI. {cite:t}`gkogkou2025` take a polynomial of order 6,
#
# ```{math}
# :label: eq-polynomial
# T_\mathrm{fg}(\nu, p) = \sum_{n=0}^{6} a_n(p)\,\nu^n .
# ```
#
# It needs no covariance, no beam, no statistics, and not even a second pixel. It assumes one thing only: that foregrounds
# are so smooth that seven numbers describe them to one part in $10^5$ or better.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "degraded"  # the beam shown in detail: degraded, evolving, oscillating, meerkat or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
order: int = 6  # order of the polynomial
n_sigma: float = 5.0  # channels further from the first fit are left out of the second

# %%
import numpy as np

from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.instrument.beams import named
from himap.maps import sphere
from himap.paper.methods import paper_beams
from himap.paper.study import Study
from himap.paper.study_figures import angular_figure, channel_figure, frequency_figure
from himap.removal.peaks import smooth_baselines
from himap.removal.polynomial import Polynomial

beams = paper_beams(ripple=ripple)
selected = beams.get(beam) or named(beam)
study = Study(
    preset=preset,
    overrides=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
)
remover = Polynomial(order=order, n_sigma=n_sigma)
removers = dict.fromkeys([*beams.values(), selected], [remover])
study.check(removers)
observed = study.observed(selected)
freqs = observed.freqs

# %% [markdown]
# ## How it works
#
# All lines of sight share the same channels, so all fits are one matrix product. In powers of a frequency in MHz
# that product would be numerical noise: $\nu^0$ and $\nu^6$ differ by 18 orders of magnitude. The library
# uses polynomials $q_n(\nu)$ that are *orthonormal over the channels* instead. They span the same space, so the fit is the same, and the
# coefficients are plain projections:
#
# ```{math}
# :label: eq-polynomial-projection
# T_\mathrm{fg} = \mathbf{Q}\,\mathbf{Q}^{\top}\,T , \qquad \mathbf{Q}^{\top}\mathbf{Q} = 1 .
# ```
#
# Compare this with {eq}`eq-pca-residual`: it is PCA with a mixing matrix that was chosen before looking at
# the data. A bright HI source bends the curve, so channels more than $5\,\sigma$ away from it are left out of a second fit, as in
# {doc}`03_peak_masking`.
#
# The polynomial of order $n$ has $n$ zeros in the band: the higher the order, the faster what it can follow, and none of these is as fast as the
# ripple.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-mixing", "caption": "The spectra that the fit removes: polynomials of rising order, orthonormal over the channels."}}
colours = [*styles.COLOURS, "black"]
curves = []
for n, column in enumerate(study.separation(selected, remover).mixing.T[:7]):
    style = {"label": f"order {n}", "color": colours[n], "linestyle": ["-", "--", "-.", ":"][n % 4]}
    curves.append((freqs, column, style))
labels = {
    "xlabel": styles.CHANNELS,
    "ylabel": "mixing coefficient",
    "legend": {"ncols": 4, "loc": "upper center"},
    "ylim": (-0.3, 0.5),
}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 4)), order=order)

# %% [markdown]
# The coefficients are maps. The first is the mean brightness of each line of sight, the second its slope, and so on. Each
# new one is fainter than the one before, and with a beam that does not change with frequency they all look like the Galaxy.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-sources", "caption": "Coefficient maps of the polynomials of order 0, 1, 3 and the highest, in K summed over channels (polynomials have unit length). Colours span the central 96 % of the pixels."}}
chosen = sorted({0, 1, min(3, order), order})
sources = {f"order {n}": study.separation(selected, remover).sources[n] / 1000 for n in chosen}
study.stamped(plotting.sky_maps(sources, unit="K", limits=(2, 98)), beam=selected, order=order)

# %% [markdown]
# ## How smooth is smooth enough?
#
# No polynomial *is* a power law. Over this band the best of order 6 follows $\nu^{-2.7}$ to {glue:text}`polynomial_parts` parts in 100 000, which
# sounds excellent until one remembers how faint HI is: HI and noise are {glue:text}`polynomial_contrast` times fainter than a foreground of 10 K, a bright line
# of sight in the Galactic plane. The figure shows the worst error over the band for such a foreground. Each order gains a factor between
# {glue:text}`polynomial_gain_least` and {glue:text}`polynomial_gain_most`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-orders", "caption": "Largest error of the best polynomial to a power law of 10 K at mid-band, against the order of the polynomial; the dotted line is the standard deviation of HI plus noise."}}
orders = np.arange(1, 11)
middle = 0.5 * (freqs[0] + freqs[-1])
no_clip = float(len(freqs))  # no channel can be that many standard deviations away
indices = [-2.13, -2.7, -3.2]
laws = 1e4 * (freqs[:, None] / middle) ** np.array(indices)


def worst_error(lines, order):
    """Largest distance of each line of sight from its polynomial, mK."""
    fit = smooth_baselines(lines, freqs, order=order, n_sigma=no_clip)
    return np.abs(lines - fit.basis @ fit.first).max(axis=0)


errors = np.array([worst_error(laws, n) for n in orders])
curves = [
    (
        orders,
        errors[:, n],
        {"label": rf"$\nu^{{{index}}}$", "color": colours[n], "linestyle": ["-", "--", "-."][n]},
    )
    for n, index in enumerate(indices)
]
signal = float(observed.truth.std())
curves.append(
    (orders, np.full(len(orders), signal), {"color": "black", "linestyle": ":", "label": "HI + noise"})
)
labels = {"xlabel": "order", "ylabel": "largest error [mK]", "yscale": "log"}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 4)), beam=selected)

# %% tags=["hide-input"]
gains = errors[:-1] / errors[1:]
quote(
    polynomial_parts=(1e5 * errors[orders == 6, indices.index(-2.7)].item() / 1e4, 0.1),
    polynomial_contrast=(1e4 / signal, 10000),
    polynomial_gain_least=(gains.min(), 0.1),
    polynomial_gain_most=(gains.max(), 0.1),
)

# %% [markdown]
# ## What is left
#
# One line of sight in the Galactic plane, one at high latitude, three beams. In the plane the fit leaves
# a wave of its own even for the degraded beam, the error of the figure above. For the oscillating beam the ripple
# drowns HI in the plane, and is about as bright as HI at the low end of the band far from it: it has 25 periods in the band, and a
# polynomial of order 6 at most six zeros.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-lines", "caption": "What the polynomial leaves of two lines of sight, for the three beams, and the truth less its own polynomial. Top: Galactic latitude 0; bottom: latitude 60 degrees. Note the scales."}}
panels = []
for place, latitude in (("Galactic plane, l = 30, b = 0", 0), ("l = 30, b = 60", 60)):
    pixel = sphere.pixel_at(study.survey.nside, 30, latitude)
    for name in beams:
        residual = study.residual(beams[name], remover)[:, pixel]
        truth = study.observed(beams[name]).truth[:, [pixel]]
        fit = smooth_baselines(truth, freqs, order=order, n_sigma=no_clip)
        flattened = (truth - fit.basis @ fit.first)[:, 0]
        panels.append(
            {
                "curves": [
                    (freqs, residual, {"color": styles.VERMILION, "label": "left by the fit"}),
                    (freqs, flattened, {"color": "black", "linestyle": "--", "label": "truth, flattened"}),
                ],
                "title": f"{place}\n{name}",
                "xlabel": styles.CHANNELS,
                "ylabel": "T [mK]",
            }
        )
study.stamped(plotting.lines(panels, columns=3, size=(3.6, 3.2)), order=order)

# %% [markdown]
# The map of one channel has it in another form: what is left through the oscillating beam is the Galactic plane.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-maps", "caption": "One channel in the middle of the band, through the oscillating beam: what was observed, what the polynomial leaves, the truth (HI plus noise), and what it leaves minus the truth. Channel means removed; colours span 1 to 99 % of the pixels, the same for cleaned and truth; the difference is white where nothing is wrong."}}
hardest = beams["oscillating"]  # whatever beam is shown in detail
channel_figure(study, hardest, remover)

# %% [markdown]
# ## The power spectra
#
# The degraded and the evolving beam look alike: foreground is left at the lowest $\ell$, and along the line of sight a loss at the smallest $k_\nu$ is
# followed by a hump. With the oscillating beam the excess grows with $\ell$, and $P$ is far above the truth at nearly every $k_\nu$, most at the
# ripple. The paper says both: that this fit does not notice the evolving beam, and that it fails with the oscillating one.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-angular", "caption": "Angular power spectrum of the maps cleaned by polynomials, for the three beams, and its ratio to the truth, on a logarithmic axis. The grey band is 10 %. (The share of polynomial fitting in the paper's Fig. 1.)"}}
angular_figure(study, removers)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-frequency", "caption": "Frequency power spectrum of the maps cleaned by polynomials, for the three beams, and its ratio to the truth, on a logarithmic axis. The grey band is 10 %. (The share of polynomial fitting in the paper's Fig. 2.)"}}
frequency_figure(study, removers)

# %% tags=["hide-input"]
show(study.band_numbers(removers))

# %% [markdown]
# ## How it fails
#
# Would a higher order help? What is wrong with the cleaned maps is the sum of two things, the foreground that is left and the
# signal that is lost, and each is a sum of squares of coefficients: those of the foreground beyond the order, and those
# of the signal up to it. So one fit of the highest order gives the errors of all.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-polynomial-scan", "caption": "Root mean square of the foreground that polynomials leave, for the three beams, and of the signal that they take, against their order, in units of the truth. Channel means removed, no clipping. Where foreground and signal cross, the sum of both errors is near its lowest; with the oscillating beam they never do. The axis is that of the order plus one. The degraded and the evolving beam coincide but at the lowest orders."}}
top = int(0.6 * len(freqs))
scan = np.arange(top + 1)


def coefficients(maps):
    """Variance over the sky of the coefficients of each order, and of what is left beyond the highest."""
    fit = smooth_baselines(maps, freqs, order=top, n_sigma=no_clip)
    rest = sum((row - weights @ fit.first).var() for row, weights in zip(maps, fit.basis, strict=True))
    return fit.first.var(axis=1), rest


curves, numbers = [], {}
for name in beams:
    observation = study.observed(beams[name])
    foreground, beyond = coefficients(observation.maps - observation.truth)
    signal, rest = coefficients(observation.truth)
    power = signal.sum() + rest
    foreground_left = np.sqrt((beyond + np.cumsum(foreground[::-1])[::-1] - foreground) / power)
    signal_lost = np.sqrt(np.cumsum(signal) / power)
    curves.append(
        (scan + 1, foreground_left, styles.BEAM_STYLES[name] | {"label": f"foreground left, {name}"})
    )
    error = np.hypot(foreground_left, signal_lost)
    at_order = error[min(order, top)]
    numbers[f"{name}: error of order {order}"] = (at_order, 0.02 * max(1, at_order))
    numbers[f"{name}: lowest error"] = (error.min(), 0.02 * max(1, error.min()))
    numbers[f"{name}: order of it"] = (int(error.argmin()), 1.0)
curves.append(
    (scan + 1, signal_lost, {"color": "black", "linestyle": ":", "label": "signal lost (oscillating)"})
)
labels = {"xlabel": "order + 1", "ylabel": "rms error / rms truth", "xscale": "log", "yscale": "log"}
study.stamped(plotting.lines([{"curves": curves, **labels}], columns=1, size=(6.4, 4)))

# %% tags=["hide-input"]
show(numbers)

# %% tags=["hide-input"]
quote(
    polynomial_best_degraded=numbers["degraded: order of it"],
    polynomial_best_evolving=numbers["evolving: order of it"],
    polynomial_error_degraded=numbers[f"degraded: error of order {order}"],
    polynomial_lowest_degraded=numbers["degraded: lowest error"],
    polynomial_top_left=(foreground_left[-1], 0.02 * foreground_left[-1]),
    polynomial_top_lost=(signal_lost[-1], 0.02),
)

# %% [markdown]
# With the degraded and the evolving beam there is a best order, {glue:text}`polynomial_best_degraded` for the one and {glue:text}`polynomial_best_evolving`
# for the other, close to the paper's. Beyond it another order takes more of the signal than of the foreground. For the degraded beam the error is then {glue:text}`polynomial_lowest_degraded` of the
# truth, where it is {glue:text}`polynomial_error_degraded` at the order of this notebook. With the oscillating beam there is none: at the highest order shown,
# three fifths of the number of channels, the foreground is still {glue:text}`polynomial_top_left` times the whole signal, of which
# {glue:text}`polynomial_top_lost` is lost as well (all rms).

# %% [markdown]
# ## What to take away
#
# - Cheap: a fit is one matrix product, no iteration, the same for one line of sight and for the whole sky.
# - Order 6 removes seven spectral shapes from every line of sight, so it loses more signal at the smallest $k_\nu$ than PCA with
#   three ({doc}`10_results`). And it still leaves foreground in the Galactic plane, which shows as an excess at $\ell < 10$ and at $k_\nu$ between 0.03 and 0.1 MHz$^{-1}$.
# - It does not notice the evolving beam: along a line of sight the beam changes slowly, and slow is what a polynomial can follow.
# - It fails with the oscillating beam by orders of magnitude, at all but the lowest $\ell$ and $k_\nu$: a ripple is
#   not smooth, and nothing in one line of sight tells it from HI. That the same ripple is all over the sky is
#   the information that PCA uses and a fit by line of sight does not.
#
# ## Exercises
#
# **1.** Does order 8 leave less foreground in the Galactic plane? What does it cost?
#
# ```sh
# himap run 07_polynomial -p order=8
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Yes: the excess at $\ell < 10$ through the degraded and the evolving beam is gone, and the error of the maps is smaller. But $C/C_0$ is now below 1 in both bands of the table, and of $P$ at the smallest $k_\nu$ hardly anything is left. Through the oscillating beam the fit fails as before.
#
# </details>
#
# **2.** Without clipping, does a peak matter to this fit?
#
# ```sh
# himap run 07_polynomial -p n_sigma=50             # no clipping
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# Hardly. A little more power is lost at the smallest $k_\nu$, and $C/C_0$ stays the same: seven coefficients bend little towards one channel.
#
# </details>
#
# **3.** The ripple has 25 periods in the band. Which order could follow it at all, and what would that do to HI?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# A sine of 25 periods has 50 zeros, and a polynomial of order $n$ has at most $n$: it takes order 50 at least. As many spectra are then taken from HI
# as well, and the scan above shows that even this does not do.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 07_polynomial -p beam=oscillating       # the maps and coefficients of the failure
# ```
