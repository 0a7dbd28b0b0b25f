# ---
# jupyter:
#   himap:
#     figures: []
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
# # A survey: uneven hits, and gaps
#
# > - **Read first**: {doc}`17_your_own_cube`, {doc}`20_transfer_function`.
# > - **Time and memory**: {cost}`26_a_survey`.
#
# A survey observes the middle of a patch longer than its edge, and loses channels and voxels to interference.
# This chapter simulates a patch about as large as a field of MeerKLASS, in the same band
# ({cite:t}`cunnington2023`, {cite:t}`meerklass2025`) and with a Gaussian beam of MeerKAT's width. It is
# cleaned by PCA and polynomials: with weights and flags, with flags alone, and with neither. On the command
# line:
#
# ```sh
# himap clean cube.h5 --weights hits.fits --flags flags.npy --method pca -p n_sources=3 --keep-peaks -o cleaned.h5
# ```
#
# With weights $w$, 0 in missing voxels, the components minimise
#
# ```{math}
# \min_{m, A, S} \sum_{\nu, p} w_\nu(p) \Big( x_\nu(p) - m_\nu - \sum_j A_{\nu j} S_j(p) \Big)^2 .
# ```
#
# If the weights depend only on the pixel, this is a single eigenproblem. If voxels are missing, they are
# filled iteratively with the model until the residual converges ({cite:t}`tipping1999`,
# {cite:t}`bailey2012`). A polynomial is fitted by weighted least squares to the observed voxels of a line of
# sight. Gaps have no residual.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {
    "freq_min": 971.0,
    "freq_max": 1075.0,
    "n_dishes": 64,
    "t_obs": 62.0,
    "f_sky": 0.0074,
}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "meerkat"  # degraded, evolving, oscillating, rippled, meerkat, meerkat_lobes or a file
patch: dict = {}  # fields of the patch that differ from its defaults, such as seed or voxels
n_sources: int = 3  # of PCA
order: int = 3  # of the polynomial
n_mocks: int = 3  # for the transfer function
bin_width: int = 24  # multipoles in a bin

# %%
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import healpy as hp
import numpy as np

from himap.core.checks import whole_number, with_fields
from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube
from himap.figures import plotting, styles
from himap.figures.numbers import quote, show, show_table
from himap.instrument.beams import named
from himap.measures import diagnostics
from himap.paper.patch import Patch, PatchPower, interpolated, noise_by_hits, patch_sky
from himap.paper.pipeline import hi_seen
from himap.paper.study import Study

selected, field = named(beam), with_fields(Patch, patch)
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)
nside, n_channels = study.survey.nside, study.survey.n_channels
_ = whole_number("bin_width", bin_width, 1, 2 * nside), whole_number("n_mocks", n_mocks, 1, 1000)

# %% [markdown]
# ## The survey
#
# Dishes scan at one elevation while the sky drifts. Hit counts are highest where many scans overlap, and the
# noise falls with their square root. A few channels are flagged completely, others in bursts, and some voxels
# individually (`himap.paper.patch.Patch`). Compare the edge of the patch with its middle.

# %% tags=["hide-input"]
hits = field.hits(nside)
flags = field.flags(nside, n_channels)
inside = hits > 0
if inside.sum() <= n_channels:
    raise InputError(
        f"the patch has {inside.sum()} pixels at nside={nside} and PCA needs more of them than there are channels, "
        f"{n_channels}: give a larger nside, fewer n_channels, or a larger width and height in patch."
    )
foreground, signal = patch_sky(study.case(selected))
noise = noise_by_hits(study.survey, hits, study.survey.rng("noise by hits"))
truth = signal + noise
maps = foreground + truth


def shown(pixels):
    """A map of the patch, NaN outside."""
    return np.where(inside, pixels, np.nan)


maps_of_hits = {
    "hits": shown(hits),
    "share of the channels that is flagged [%]": shown(100 * flags.mean(axis=0)),
}

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-survey-hits", "caption": "Hits of the pixels, relative to the largest (left), and the share of the channels that is flagged on each line of sight (right)."}}
study.stamped(plotting.sky_maps(maps_of_hits, box=field.box, unit=""), beam=selected, patch=patch)

# %% [markdown]
# Channels at 100 % are not in the cube.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-survey-flags", "caption": "Share of the pixels of the patch that is flagged in each channel."}}
flagged = 100 * flags[:, inside].mean(axis=1)
panel = {
    "curves": [(study.survey.freqs, flagged, {"color": styles.BLUE})],
    "xlabel": styles.CHANNELS,
    "ylabel": "flagged [%]",
}
study.stamped(plotting.lines([panel], columns=1, size=(7.2, 2.8)), beam=selected, patch=patch)

# %% tags=["hide-input"]
show(
    {
        "area": (float(inside.mean() * 41253), 2.0, "deg²"),
        "pixels": int(inside.sum()),
        "channels that are flagged": int((flagged == 100).sum()),
        "other voxels that are flagged": (float(flagged[flagged < 100].mean()), 0.1, "%"),
        "rms of the foreground less its mean": (
            float(np.sqrt(foreground[:, inside].var(axis=1).mean())),
            2.0,
            "mK",
        ),
        "rms of HI": (float(signal[:, inside].std()), 0.001, "mK"),
        "rms of the noise": (float(noise[:, inside].std()), 0.003, "mK"),
    }
)

# %% [markdown]
# ## The files, and the cube
#
# Hits are a HEALPix map for all channels, flags an array of voxels. Maps are NaN where nothing was observed.

# %%
temporary = tempfile.TemporaryDirectory()  # deleted when this notebook ends
folder = Path(temporary.name)
with h5py.File(folder / "cube.h5", "w") as file:
    disturbed = np.where(flags, 1e4, maps)
    file["maps"] = np.where(inside, disturbed, np.nan).astype(np.float32)
    file["freqs"] = study.survey.freqs
    file.attrs.update(unit="mK", order="RING")
hp.write_map(folder / "hits.fits", hits, dtype=np.float32)
np.save(folder / "flags.npy", flags)

cube = read_cube(folder / "cube.h5", weights=folder / "hits.fits", flags=folder / "flags.npy")
print(*cube.remarks, sep="\n")

# %% [markdown]
# ## Cleaning
#
# The truth is HI and noise, and most of its power is noise (see both rms above). A deviation of the residual
# from the truth is a larger share of the power of HI.
#
# *Weights and flags* uses both; in *flags alone* all observed voxels have the same weight; in *neither* gaps
# are interpolated linearly in frequency and then treated as observed. Compare the residuals with the truth.

# %%
WAYS = {"weights and flags": "-", "flags alone": "--", "neither": ":"}


def of_way(way, maps=cube.maps):
    """The cube, or one with other maps, as one of `WAYS` has it."""
    if way == "neither":
        return replace(cube, maps=interpolated(maps, cube.missing), weights=None)
    weights = cube.weights if way == "weights and flags" else (~cube.missing).astype(float)
    return replace(cube, maps=maps, weights=weights)


methods = {
    styles.numbered("pca", n_sources): ("pca", {"n_sources": n_sources}),
    f"polynomial of order {order}": ("polynomial", {"order": order}),
}


def residual_of(method, way, maps=cube.maps):
    """The residual of a method in all channels and pixels, 0 where nothing is seen."""
    name, parameters = methods[method]
    cleaned = clean_cube(of_way(way, maps), name, peaks=False, **parameters)
    return on_grid(cleaned.residual)


def on_grid(residual):
    out = np.zeros(maps.shape, dtype=np.float32)
    out[np.ix_(cube.layout.channels, cube.mask)] = residual
    return out


residuals = {(method, way): residual_of(method, way) for method in methods for way in WAYS}

# %% tags=["hide-input"]
channel = int(cube.layout.channels[len(cube.freqs) // 2])
freq = study.survey.freqs[channel]
good = inside & ~flags[channel]
first, *_ = methods


def at(pixels):
    """One channel less its mean, NaN where it is not seen."""
    return np.where(good, pixels - pixels[good].mean(), np.nan)


pictures = {
    "before": at(maps[channel]),
    "HI and noise": at(truth[channel]),
    "residual, weights and flags": at(residuals[first, "weights and flags"][channel]),
    "residual, neither": at(residuals[first, "neither"][channel]),
}
low, high = np.nanpercentile(pictures["HI and noise"], (1, 99))
span = {title: (low, high) for title in pictures if title != "before"}
errors_at = {way: at(residuals[first, way][channel] - truth[channel]) for way in WAYS}
widest = np.nanpercentile(np.abs(list(errors_at.values())), 99)

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-survey-maps", "caption": "A channel in the middle of the band: as observed; the truth; the residual of PCA with weights and flags, and with neither; all but the first on one colour scale. Unobserved pixels are white."}}
study.stamped(
    plotting.sky_maps(pictures, box=field.box, span=span), beam=selected, patch=patch, channel=f"{freq:g} MHz"
)

# %% [markdown]
# The errors (residual minus truth) are shown on a finer scale. With weights or flags they are HI and noise
# removed by the components; with neither, foreground residual from the interpolation.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-survey-errors", "caption": "The same channel: residual of PCA less the truth, with weights and flags, with flags alone, and with neither, on one colour scale."}}
study.stamped(
    plotting.sky_maps(errors_at, box=field.box, span=(-widest, widest), diverging=True),
    beam=selected,
    patch=patch,
    channel=f"{freq:g} MHz",
)

# %% [markdown]
# ## Spectra
#
# Pixels are weighted by their hits, and gaps are 0, in both truth and residual. In a small patch with few
# modes more of HI resembles the foreground by chance than on the full sky, mostly on the largest scales.
# Compare the three cases in each panel; a ratio above 1 is foreground residual.

# %% tags=["hide-input"]
power = PatchPower(
    weights=hits,
    seen=inside & ~flags,
    channel_width=study.survey.channel_width,
    bin_width=bin_width,
)
alms_of_truth = power.alms(truth)
true = power(truth, alms_of_truth)
spectra, wrong = {}, {}
for key, one in residuals.items():
    alms = power.alms(one)
    spectra[key], wrong[key] = power(one, alms), power(one - truth, alms - alms_of_truth)


COLOURS = dict(zip(WAYS, (styles.BLUE, styles.ORANGE, styles.VERMILION), strict=True))


def panels_of(over, label, curve):
    """Panels of spectra over those of the truth, {(method, way): {kind: ratio}}: a row for each method.

    `curve` makes one of a ratio: what stands between its x and its style.
    """
    return [
        {
            "curves": [
                (
                    true[kind][0],
                    *curve(over[method, way][kind]),
                    {"color": COLOURS[way], "linestyle": dashes, "label": way},
                )
                for way, dashes in WAYS.items()
            ],
            "title": method,
            "xlabel": styles.AXES[kind]["xlabel"],
            "ylabel": label,
        }
        for method in methods
        for kind in ("angular", "frequency")
    ]


def ratios_figure(over, label):
    """Of ratios that should be 1; there is one sky, and no spread."""
    panels = panels_of(over, label, lambda ratio: (ratio, ratio, ratio))
    return plotting.ratios(panels, columns=2, size=(4.6, 3.2))


def over_truth(found):
    return {key: {kind: one[kind][1] / true[kind][1] for kind in true} for key, one in found.items()}


# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-survey-left", "caption": "C/C0 (left) and P/P0 (right) of the residual, for each method (rows); linear near 1 and logarithmic beyond. Grey band: 10 %."}}
study.stamped(ratios_figure(over_truth(spectra), "residual / truth"), beam=selected, patch=patch)

# %% [markdown]
# Foreground residual and signal loss do not cancel in the power of the error.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-survey-wrong", "caption": "Power of the error (residual less truth) over that of HI and noise, angular (left) and frequency (right), for each method (rows)."}}
panels = panels_of(over_truth(wrong), "error / truth", lambda ratio: (ratio,))
scales = {"xscale": "log", "yscale": "log", "ylim": (0.01, 20)}
study.stamped(plotting.lines([panel | scales for panel in panels]), beam=selected, patch=patch)

# %% [markdown]
# ## Corrected by mocks
#
# Mocks of HI with other seeds, and noise by hits, are added to the cube with the same gaps, and cleaned with
# it. (`himap transfer` instead replaces its HI and noise by mocks, {doc}`20_transfer_function`; mocks that it
# draws have equal noise in every pixel.) The power of the residual is divided by their recovered share. This
# corrects the signal loss, so a curve above 1 is foreground residual.

# %%
drawn = np.random.default_rng(7)
others = [replace(study, overrides=survey | {"seed": study.survey.seed + 1 + n}) for n in range(n_mocks)]
mocks = [
    (hi_seen(other.case(selected)) + noise_by_hits(other.survey, hits, drawn))[
        np.ix_(cube.layout.channels, cube.mask)
    ]
    for other in others
]
put_in = [on_grid(mock) for mock in mocks]
of_mocks = [power.alms(mock) for mock in put_in]
shares = {}
for key in residuals:
    returned = [residual_of(*key, cube.maps + mock) - residuals[key] for mock in mocks]
    shares[key] = power.share(put_in, returned, of_mocks)

corrected = {
    key: {kind: spectra[key][kind][1] / shares[key][kind] / true[kind][1] for kind in true}
    for key in residuals
}

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-survey-corrected", "caption": "C/C0 (left) and P/P0 (right) divided by the transfer function, for each method (rows); linear near 1 and logarithmic beyond. Grey band: 10 %."}}
study.stamped(ratios_figure(corrected, "corrected / truth"), beam=selected, patch=patch, n_mocks=n_mocks)

# %% [markdown]
# Means over multipoles and over ranges of $k_\nu$ (in MHz$^{-1}$) of the residual, corrected and uncorrected,
# and of the error, each over the truth:


# %% tags=["hide-input"]
def means(over):
    """Means of ratios in bands, for `show_table`."""
    k = true["frequency"][0]
    values = {
        "C, all l": over["angular"].mean(),
        "C, without the first bin": over["angular"][1:].mean(),
        "P, k < 0.3": diagnostics.inside(k, over["frequency"], 0, 0.3).mean(),
        "P, k > 0.3": diagnostics.inside(k, over["frequency"], 0.3, np.inf).mean(),
    }
    return {name: (float(value), 0.03 * max(1, abs(float(value)))) for name, value in values.items()}


ratios, errors = over_truth(spectra), over_truth(wrong)
show_table(
    {f"{method}, {way}": means(ratios[method, way]) for method, way in residuals}, head="residual / truth"
)

# %% tags=["hide-input"]
show_table(
    {f"{method}, {way}": means(corrected[method, way]) for method, way in residuals}, head="corrected / truth"
)

# %% tags=["hide-input"]
show_table(
    {f"{method}, {way}": means(errors[method, way]) for method, way in residuals}, head="error / truth"
)


# %% tags=["hide-input"]
def worst(found, method, way):
    """How far the ratio of a method is from 1 in the worst of the bands, %."""
    off = 100 * max(abs(value - 1) for value, _ in means(found[method, way]).values())
    return (off, max(1, 0.1 * off), "%")


def band(found, method, way, name):
    """The ratio in one band, %."""
    value = 100 * means(found[method, way])[name][0]
    return (value, max(1, 0.05 * value), "%")


fit = list(methods)[-1]
quote(
    survey_pca=first,
    survey_missing=(float(100 * cube.missing.mean()), 0.1, "%"),
    survey_weighted=band(errors, first, "weights and flags", "P, k > 0.3"),
    survey_flagged=band(errors, first, "flags alone", "P, k > 0.3"),
    survey_neither=band(errors, first, "neither", "P, k > 0.3"),
    survey_weighted_low=band(ratios, first, "weights and flags", "P, k < 0.3"),
    survey_flagged_low=band(ratios, first, "flags alone", "P, k < 0.3"),
    survey_neither_low=band(ratios, first, "neither", "P, k < 0.3"),
    survey_weighted_corrected=worst(corrected, first, "weights and flags"),
    survey_flagged_corrected=worst(corrected, first, "flags alone"),
    survey_neither_corrected=worst(corrected, first, "neither"),
    survey_fit=fit,
    survey_fit_low=band(ratios, fit, "weights and flags", "P, k < 0.3"),
    survey_fit_corrected=worst(corrected, fit, "weights and flags"),
)

# %% [markdown]
# ## What follows
#
# For {glue:text}`survey_pca` on this sky, as shares of the power of HI and noise (means as in the tables:
# single bins deviate more, as the figure shows):
#
# | | residual at $k_\nu < 0.3$ MHz$^{-1}$ | error at $k_\nu > 0.3$ MHz$^{-1}$ | corrected: deviation of the worst mean |
# |---|---|---|---|
# | weights and flags | {glue:text}`survey_weighted_low` | {glue:text}`survey_weighted` | {glue:text}`survey_weighted_corrected` |
# | flags alone | {glue:text}`survey_flagged_low` | {glue:text}`survey_flagged` | {glue:text}`survey_flagged_corrected` |
# | neither | {glue:text}`survey_neither_low` | {glue:text}`survey_neither` | {glue:text}`survey_neither_corrected` |
#
# - **Flag the gaps**, {glue:text}`survey_missing` of this cube. Interpolation across gaps has errors far
#   above HI, which a few components cannot describe.
# - **Weights have little effect here.** They keep the noise of the edge out of the components, but these then
#   adapt more closely to fewer pixels: correct the signal loss.
# - **A method loses signal in a small patch**, where few pixels determine its components; mocks with the same
#   gaps measure it.
# - **Fits are less sensitive to gaps**, except at the smallest $k_\nu$ after correction, and insensitive to
#   pixel weights, since each line of sight is fitted separately. The residual of the {glue:text}`survey_fit`
#   has {glue:text}`survey_fit_low` of the power at $k_\nu < 0.3$ MHz$^{-1}$ with this beam; corrected, its worst
#   mean deviates by {glue:text}`survey_fit_corrected`.
#
# Your own mocks, HI and noise by hits as here, correct the loss; give about ten, each with `--mocks`. On part
# of the sky or with gaps they do not measure the foreground residual, and the coverage of the error bars is
# unknown: it was measured for full skies ({doc}`20_transfer_function`).
#
# ```sh
# himap transfer cube.h5 --weights hits.fits --flags flags.npy --method pca -p n_sources=3 --keep-peaks --mocks mock1.h5 --mocks mock2.h5 -o transfer.html
# ```
#
# ## Exercise
#
# Hits fall by a factor of four from the middle of a patch to its edge. By what factors do the noise and the
# weight change?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The noise scales with the inverse square root of the hits and is twice as large at the edge. Its inverse
# variance, the weight, is a quarter of that in the middle.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 26_a_survey -p n_sources=5
# himap run 26_a_survey -p beam=degraded -p order=4
# himap run 26_a_survey -p 'patch={"voxels": 0.2, "n_bursts": 0}'
# ```
