# ---
# jupyter:
#   himap:
#     figures: []
#     section: '2.2'
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
# # Beams and noise
#
# > - **Read first**: {doc}`01_simulations`.
# > - **Good to know**: what a convolution is.
# > - **Tests** (verdicts of {doc}`15_claims`): {claim}`V4`.
# > - **Time and memory**: {cost}`02_beams_and_noise`.
#
# A dish of diameter $D$ has a beam about $\lambda/D$ wide, which is narrower at the top of the band than at
# its bottom. This turns *angular* structure of the foregrounds into *spectral* structure, while their
# separation from HI relies on smoothness in frequency. The paper {cite:p}`gkogkou2025` (Sect. 2.2) uses three
# beams of increasing realism, and the noise of a survey with the dishes of SKA-Mid.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong

# %%
import numpy as np

from himap.core.survey import Survey
from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.instrument.beams.paper import Oscillating
from himap.instrument.noise import noise_sigma, system_temperature
from himap.maps import sphere
from himap.paper import pipeline
from himap.paper.methods import paper_beams
from himap.sky.galaxy import Galaxy
from himap.store.provenance import Provenance

sky = Survey.preset(preset, **survey)
beams = paper_beams(ripple=ripple)
milky_way = Galaxy(source=galaxy, template_dir=template_dir, small_scales=small_scales)
freqs = sky.freqs
dish = sky.dish_diameter


def stamped(figure, **parameters):
    """The figure with a line that says where it comes from."""
    return plotting.stamp(figure, Provenance.of(sky, galaxy=milky_way, preset=preset, parameters=parameters))


# %% [markdown]
# ## Three beams
#
# All are Gaussian, $B(\theta) = \exp(-\theta^2 / 2\sigma^2)$ with $\sigma = \mathrm{FWHM}/\sqrt{8 \ln 2}$. On the sphere such a beam multiplies harmonic coefficients,
#
# ```{math}
# :label: eq-transfer
# a_{\ell m} \to b_\ell\,a_{\ell m}, \qquad b_\ell = \exp\left(-\tfrac{1}{2}\,\ell(\ell+1)\,\sigma^2\right).
# ```
#
# - **Evolving**: $\mathrm{FWHM} = \lambda / D$ with $D = 13.5$ m.
# - **Degraded**: the maps of the evolving beam, signal and noise, smoothed to the resolution of the worst
#   channel, $\sigma_\mathrm{new}^2 = \sigma_\mathrm{worst}^2 - \sigma^2$. (The paper adds white noise after
#   all smoothing: `degraded:noise=white`.)
# - **Oscillating**: the width measured for MeerKAT by {cite:t}`matshawule2021`, with a ripple caused by
#   interference between primary and secondary reflector,
#
# ```{math}
# :label: eq-oscillating
# \mathrm{FWHM} = \frac{\lambda}{D} \left[\sum_{d=0}^{8} a_d\,\nu^d + A \sin\left(\frac{2\pi\nu}{T}\right)\right],
# \qquad T = 20\ \mathrm{MHz}.
# ```
#
# The paper gives $A = 0.1$ arcmin inside a dimensionless bracket. Of three readings of it
# ([conventions](../book/conventions.md)) `bracket` is the default, a ripple of 0.14 % of the width;
# `additive` and `additive_strong` add 0.1 and 0.5 arcmin to $\lambda/D$.
#
# The oscillating beam is wider than the evolving one at all frequencies, and wider than the degraded one
# below {glue:text}`beams_crossing`. Its ripple, faint in the left panel, has a period of 20 MHz in all
# readings.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-beam-widths", "caption": "Left: width of the three beams against frequency. Right: the ripple as a fraction of the width, in three readings of the paper's formula (the first two nearly coincide). Spacing 0.5 MHz; dots mark the channels of this run."}}
fine = np.arange(freqs[0], freqs[-1] + 0.25, 0.5)
width = {"degraded": np.full_like(fine, beams["degraded"].fwhm(freqs, dish_diameter=dish)[0])}
width |= {name: beams[name].fwhm(fine, dish_diameter=dish) for name in ("evolving", "oscillating")}
widths_panel = {
    "curves": [(fine, np.rad2deg(width[name]), styles.BEAM_STYLES[name]) for name in width],
    "xlabel": styles.CHANNELS,
    "ylabel": "FWHM [deg]",
}


def ripple_alone(nu, reading):
    """The width over its mean across one period of 20 MHz, minus one."""
    shifts = np.arange(-10, 10) + 0.5
    inside = np.clip(nu[:, None] + shifts, 850, 1420)
    fwhm = Oscillating(ripple=reading).fwhm
    return fwhm(nu, dish_diameter=dish) / fwhm(inside, dish_diameter=dish).mean(axis=1) - 1


window = fine[(fine > 1100) & (fine < 1180)]
channels = freqs[(freqs > 1100) & (freqs < 1180)]
ripple_styles = {
    "bracket": {"color": styles.GREEN, "linestyle": "-."},
    "additive": {"color": styles.PURPLE, "linestyle": ":"},
    "additive_strong": {"color": styles.VERMILION, "linestyle": "-"},
}
ripple_panel = {
    "curves": [
        (window, 100 * ripple_alone(window, name), style | {"label": name.replace("_", " ")})
        for name, style in ripple_styles.items()
    ],
    "points": [(channels, 100 * ripple_alone(channels, ripple), {"color": ripple_styles[ripple]["color"]})],
    "xlabel": styles.CHANNELS,
    "ylabel": "ripple of the width [%]",
    "ylim": (-1, 1.5),
    "legend": {"loc": "upper right", "ncols": 3},
}
stamped(plotting.lines([widths_panel, ripple_panel]), ripple=ripple)

# %% tags=["hide-input"]
narrower = fine[width["oscillating"] < width["degraded"]]
quote(beams_crossing=(min(narrower, default=np.nan), 2, "MHz"))

# %% [markdown]
# The transfer functions of the evolving and the oscillating beam differ between the two panels. In the
# highest channel the degraded beam suppresses scales that the other two preserve.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-beam-transfer", "caption": "Transfer functions of the three beams in the lowest and the highest channel."}}
transfers = {name: beam.of_survey(sky) for name, beam in beams.items()}
degrees = np.arange(sky.lmax + 1)
panels = [
    {
        "curves": [
            (degrees, transfer.total[channel], styles.BEAM_STYLES[name])
            for name, transfer in transfers.items()
        ],
        "title": f"{freqs[channel]:.1f} MHz",
        "xlabel": styles.AXES["angular"]["xlabel"],
        "ylabel": r"$b_\ell$",
        "ylim": (0, 1.02),
    }
    for channel in (0, -1)
]
stamped(plotting.lines(panels), ripple=ripple)

# %% [markdown]
# A beam can also be a file of widths or $b_\ell$ (`himap run 04_pca -p beam=widths.txt`), `meerkat` (widths
# from holography), or a class ({doc}`../book/add_a_beam`).

# %% [markdown]
# ## Noise
#
# The receiver noise is white and Gaussian. With $N_\mathrm{dishes}$ dishes observing a fraction
# $f_\mathrm{sky}$ of the sky for $t_\mathrm{obs}$,
#
# ```{math}
# :label: eq-noise
# \begin{aligned}
# \sigma_N(\nu) &= T_\mathrm{sys}(\nu)\;\sqrt{\frac{4\pi\; f_\mathrm{sky}}{\Delta\nu\;\, t_\mathrm{obs}\;\, N_\mathrm{dishes}\;\, \Omega_\mathrm{beam}}}\;, \\[1.5ex]
# T_\mathrm{sys}(\nu) &= T_\mathrm{instr} + 66\,\mathrm{K}\, \left(\frac{300\,\mathrm{MHz}}{\nu}\right)^{2.55},
# \end{aligned}
# ```
#
# with $\Omega_\mathrm{beam} = 1.133\,\mathrm{FWHM}^2$ and $\mathrm{FWHM} = \lambda/D$. The survey is the
# paper's (Sect. 2.2): 197 dishes of 13.5 m, 20,000 h, the full sky and $T_\mathrm{instr} = 25$ K; the
# paper's channels are 1 MHz wide. As in the paper $\sigma_N$ is applied per *pixel*, whatever its size, so coarser
# maps have a higher noise power $N_\ell = \sigma_N^2\,\Omega_\mathrm{pix}$. The paper also calls $\sigma_N$ a
# variance: `noise_reading=variance` ([conventions](../book/conventions.md)).
#
# The system temperature falls with frequency, but the noise rises, because the beam narrows faster.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-noise", "caption": "System temperature (left) and noise per pixel and channel (right). Dashed: noise in the paper's channels of 1 MHz."}}
fine_survey = Survey.preset(preset, **{**survey, "n_channels": round(sky.freq_max - sky.freq_min)})
panels = [
    {
        "curves": [(freqs, system_temperature(freqs, sky.t_instr), {"color": styles.BLUE})],
        "xlabel": styles.CHANNELS,
        "ylabel": r"$T_\mathrm{sys}$ [K]",
    },
    {
        "curves": [
            (freqs, 1e3 * noise_sigma(sky), {"color": styles.BLUE, "label": f"{sky.channel_width:g} MHz"}),
            (
                fine_survey.freqs,
                1e3 * noise_sigma(fine_survey),
                {"color": "black", "linestyle": "--", "label": "1 MHz (paper)"},
            ),
        ],
        "xlabel": styles.CHANNELS,
        "ylabel": r"$\sigma_N$ [$\mu$K]",
        "ylim": (0, None),
    },
]
stamped(plotting.lines(panels))

# %% [markdown]
# ## The effect of the beam on a foreground
#
# A smooth spectrum (third order in log-log) is subtracted from the foreground along a line of sight close to
# the Galactic plane. Through the degraded beam the residual is negligible. Through the evolving beam it is a
# slow trend of {glue:text}`beams_trend` rms, as the narrowing beam includes less of the plane. The
# oscillating beam adds a ripple with the period of 20 MHz, an rms difference of adjacent channels of
# {glue:text}`beams_jump` (HI plus noise on this line: {glue:text}`beams_signal`), and a slower wave of
# {glue:text}`beams_wave`. These are parts per million of the foreground, whose mean is
# {glue:text}`beams_foreground`. A method that removes smooth spectra leaves such ripples in the residual.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-beam-spectra", "caption": "Deviation of the foreground from a smooth spectrum for a line of sight 3 degrees off the Galactic plane through the three beams, and HI plus noise in it, mean removed. The scales differ."}}
observations = {
    name: pipeline.observation(pipeline.Case(survey=sky, galaxy=milky_way, beam=beam))
    for name, beam in beams.items()
}
pixel = sphere.pixel_at(sky.nside, 30.0, 3.0)


def unsmoothness(spectrum):
    """A spectrum over its cubic fit in log-log, minus one."""
    x, y = np.log(freqs / freqs.mean()), np.log(spectrum)
    return np.exp(y - np.polynomial.Polynomial.fit(x, y, 3)(x)) - 1


foreground = {
    name: observation.maps[:, pixel].astype(float) - observation.truth[:, pixel]
    for name, observation in observations.items()
}
deviation = {name: unsmoothness(spectrum) for name, spectrum in foreground.items()}
panels = []
for name, observation in observations.items():
    beside = observation.truth[:, pixel] - observation.truth[:, pixel].mean(dtype=float)
    smooth = foreground[name] / (1 + deviation[name])
    panels.append(
        {
            "curves": [
                (
                    freqs,
                    deviation[name] * smooth,
                    styles.BEAM_STYLES[name] | {"label": "foreground", "linestyle": "-"},
                ),
                (freqs, beside, {"color": "black", "linewidth": 0.8, "label": "HI + noise"}),
            ],
            "title": name,
            "xlabel": styles.CHANNELS,
            "ylabel": "T [mK]" if not panels else "",
        }
    )
stamped(plotting.lines(panels, columns=3, size=(3.1, 3)), ripple=ripple)

# %% [markdown]
# The rms of HI plus noise is {glue:text}`beams_rms_degraded` with the degraded beam, which smooths the noise
# too, {glue:text}`beams_rms_evolving` with the evolving and {glue:text}`beams_rms_oscillating` with the
# oscillating one.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-observed-maps", "caption": "HI plus noise through the three beams in the channel in the middle of the band, mean removed, same colours."}}
channel = sky.n_channels // 2
truth = {name: observation.truth[channel] for name, observation in observations.items()}
maps = {name: pixels - pixels.mean() for name, pixels in truth.items()}
span = tuple(np.percentile(list(maps.values()), (1, 99)))
stamped(plotting.sky_maps(maps, span=span), ripple=ripple)

# %% [markdown]
# ## The truth, and the numbers
#
# The *truth* to which all methods are compared is HI through the beam plus noise. The noise does not pass
# through the beam; only in the degraded case is it smoothed together with the signal.

# %% tags=["hide-input"]
wiggle = {name: 1e6 * np.std(np.diff(deviation[name])) for name in observations}
hi_wiggle = 1e6 * np.std(np.diff(observations["oscillating"].truth[:, pixel] / foreground["oscillating"]))
rms = {name: (1e3 * pixels.std(dtype=float), 0.05, "µK") for name, pixels in truth.items()}
show(
    {
        "FWHM at the lowest channel, evolving": (np.rad2deg(width["evolving"][0]), 1e-4, "deg"),
        "FWHM at the lowest channel, oscillating": (np.rad2deg(width["oscillating"][0]), 1e-4, "deg"),
        "noise at the lowest channel": (1e3 * noise_sigma(sky)[0], 1e-3, "µK"),
        "noise at the highest channel": (1e3 * noise_sigma(sky)[-1], 1e-3, "µK"),
        "rms of the truth in the middle of the band, degraded": rms["degraded"],
        "rms of the truth in the middle of the band, evolving": rms["evolving"],
        "rms of the truth in the middle of the band, oscillating": rms["oscillating"],
        "channel-to-channel jump, evolving": (wiggle["evolving"], 1, "ppm"),
        "channel-to-channel jump, oscillating": (wiggle["oscillating"], 5, "ppm"),
        "channel-to-channel jump, HI plus noise": (hi_wiggle, 1, "ppm"),
    }
)

# %% tags=["hide-input"]
period = max(round(20 / sky.channel_width), 1)  # of the ripple, in channels
slow = {
    name: 1e6 * np.convolve(deviation[name], np.full(period, 1 / period), mode="valid").std()
    for name in observations
}
quote(
    beams_foreground=(foreground["evolving"].mean() / 1e3, 0.01, "K"),
    beams_signal=(hi_wiggle, 1, "ppm"),
    beams_rms_degraded=rms["degraded"],
    beams_rms_evolving=rms["evolving"],
    beams_rms_oscillating=rms["oscillating"],
    beams_jump=(wiggle["oscillating"], 5, "ppm"),
    beams_trend=(slow["evolving"], 1, "ppm"),
    beams_wave=(slow["oscillating"], 5, "ppm"),
)

# %% [markdown]
# ## Conclusions
#
# - A beam that changes with frequency turns angular structure of the foreground into spectral structure.
# - Smoothing to the worst resolution prevents that, if the beam is known, at the cost of small scales.
# - Close to the Galactic plane a ripple of a tenth of a per cent in the width causes a ripple in the
#   foreground that exceeds HI, at $k_\nu = 2\pi/(20\,\mathrm{MHz}) = 0.31\,\mathrm{MHz}^{-1}$.
#
# ## Exercise
#
# In the strongest reading of the ripple, does the difference between channels grow in proportion, and what
# happens to the slower wave?
#
# ```sh
# himap run 02_beams_and_noise -p ripple=additive_strong
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# It grows by less. Without the polynomial of {eq}`eq-oscillating`, which causes the slower wave, the beam is
# narrower and includes less of the plane; the wave nearly vanishes.
#
# </details>
