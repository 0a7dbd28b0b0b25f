# ---
# jupyter:
#   himap:
#     figures: []
#     section: '2.1'
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
# # The simulated sky
#
# > - **Read first**: nothing; the words are in {doc}`../book/glossary`.
# > - **Good to know**: redshift, and what an angular power spectrum is.
# > - **Tests** these claims of the paper; beside each the verdict at half its resolution, on the real Galaxy: {claim}`F1`.
# > - **Time and memory**: {cost}`01_simulations`.
#
# Neutral hydrogen (HI) emits at 1420.4 MHz. What reaches us at a frequency $\nu$ left at redshift
# $1 + z = 1420.4\ \mathrm{MHz} / \nu$, so a radio map of every frequency channel is a map of the hydrogen at another
# distance: *intensity mapping*, without seeing a single galaxy. Between 900 and 1400 MHz we look back to $z = 0.58$.
#
# In front of it shines the Galaxy, ten thousand times brighter. This notebook makes both: the signal, and the
# foregrounds, as {cite:t}`gkogkou2025` do in their Sect. 2.1. Every component draws its random numbers from a stream of its own, so
# one can be changed while the others stay.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates

# %%
import numpy as np

from himap.core.survey import Survey
from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.maps import sphere
from himap.paper import pipeline
from himap.sky import point_sources
from himap.sky.cosmology import HIModel, redshift
from himap.sky.galaxy import Galaxy
from himap.store.provenance import Provenance

sky = Survey.preset(preset, **survey)
freqs = sky.freqs
middle = sky.n_channels // 2
milky_way = Galaxy(source=galaxy, template_dir=template_dir, small_scales=small_scales)


def stamped(figure, source=milky_way):
    """The figure with a line that says where it comes from."""
    return plotting.stamp(figure, Provenance.of(sky, galaxy=source, preset=preset))


# %% [markdown]
# ## The signal: HI
#
# The mean brightness temperature of the 21 cm line after reionization follows from the Einstein coefficient of the
# transition and the amount of hydrogen {cite:p}`furlanetto2006`,
#
# ```{math}
# :label: eq-mean-temperature
# \bar{T}(z) = \frac{3\,h_\mathrm{P}\,c^3 A_{10}}{32\pi\,k_\mathrm{B}\,m_\mathrm{H}\,\nu_{21}^2}\,
# \frac{(1+z)^2}{H(z)}\,\Omega_\mathrm{HI}(z)\,\rho_\mathrm{c},
# \qquad \Omega_\mathrm{HI}(z) = 4 \times 10^{-4}\,(1+z)^{0.6},
# ```
#
# {glue:text}`simulations_theory` in the middle of the band. Its fluctuations trace matter with the bias $b_\mathrm{HI}(z) = 0.3\,(1+z) + 0.6$ {cite:p}`martin2012,carucci2020`.
#
# The simulation follows CRIME {cite:p}`alonso2014`. A Gaussian field $\delta_G$ with the linear matter power spectrum of CAMB {cite:p}`lewis2000`
# fills a periodic box of $3\ h^{-1}$ Gpc with us in the middle. At distance $r$ we see it as it was at $z(r)$: smaller by the growth factor
# $D(z)$. A lognormal transformation {cite:p}`coles1991` makes a density that is never negative,
#
# ```{math}
# :label: eq-lognormal
# 1 + \delta_\mathrm{HI} = \exp\left(b D\,\delta_G - \tfrac{1}{2}\,b^2 D^2 \sigma_G^2\right).
# ```
#
# Hydrogen also moves: with the linear velocity of the same box it appears displaced along the line of sight by $f D\,\psi_r$, with
# $\boldsymbol{\psi}_k = i\,\boldsymbol{k}\,\delta_k/k^2$ and the growth rate $f$ {cite:p}`kaiser1987`, which makes clusters look flattened and
# boosts the power. Rays through the box, a few for each pixel, then collect the displaced hydrogen into the frequency
# channels; what leaves one channel enters its neighbour.
#
# The line is {eq}`eq-mean-temperature`, each dot the mean of one simulated map. Both fall with frequency: higher frequencies are
# later times, when the factor $(1+z)^2/H(z)$ and the share of hydrogen are smaller. Look where the dots leave the line: near the top of the band a channel is a small shell around us, and one large structure in it moves
# the mean of its map.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-hi-mean", "caption": "Mean HI brightness temperature of every channel: the simulation and the mean of theory. What scatters around the line is large-scale structure; the nearest channels hold little of the Universe and scatter most."}}
hi = pipeline.hi(sky)
theory = HIModel().mean_temperature(redshift(freqs))
mean = hi.mean(axis=1, dtype=float)
curves = [
    (freqs, 1e3 * theory, {"color": "black", "label": "theory"}),
    (freqs, 1e3 * mean, {"color": styles.BLUE, "linestyle": "none", "marker": ".", "label": "simulation"}),
]
panel = {"curves": curves, "xlabel": styles.CHANNELS, "ylabel": r"mean temperature [$\mu$K]"}
stamped(plotting.lines([panel], columns=1, size=(6.8, 3.6)), "no")

# %% [markdown]
# The maps show one far and one near channel, the figure after them all channels along one great circle. A structure covers a larger angle the nearer it
# is, so the spots grow from one map to the other, and to the right of the cut. Along frequency the pattern is another one after few channels: that is
# why HI is jagged along a line of sight.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-hi-maps", "caption": "HI in a far and a near channel. Structures of one size look larger the nearer they are. Each map has colours of its own."}}
near = int(0.9 * sky.n_channels)
maps = {
    f"{freqs[channel]:.0f} MHz, z = {redshift(freqs[channel]):.2f}": 1e3 * hi[channel]
    for channel in (middle // 4, near)
}
stamped(plotting.sky_maps(maps, unit=r"$\mu$K"), "no")

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-hi-slice", "caption": "The light cone cut open: HI along the Galactic equator against frequency, that is, distance. Far away (left) structures span few pixels, close by (right) many."}}
longitude = np.linspace(-180, 180, 720)
equator = sphere.pixel_at(sky.nside, longitude, 0.0)
cone = 1e3 * hi[:, equator].T
stamped(
    plotting.image(
        cone,
        x=freqs,
        y=longitude,
        xlabel=styles.CHANNELS,
        ylabel="Galactic longitude [deg]",
        unit=r"$\mu$K",
        limits=(1, 99.5),
    ),
    "no",
)

# %% [markdown]
# ## The foregrounds
#
# ### The Galaxy
#
# Relativistic electrons in the Galactic magnetic field emit *synchrotron* radiation, hot ionised gas *free-free* radiation. Both are
# power laws in frequency,
#
# ```{math}
# :label: eq-power-law
# T(\nu, p) = T(\nu_0, p)\,\left(\frac{\nu}{\nu_0}\right)^{\beta(p)},
# ```
#
# with an index near $-3$ that varies over the sky for synchrotron and $-2.14$ everywhere for free-free. The paper takes the maps of PySM
# {cite:p}`thorne2017,zonca2021`: the 408 MHz survey {cite:p}`haslam1982,remazeilles2015` and an index map {cite:p}`miville2008`. Here the parameter `galaxy` chooses among
#
# - `pysm3`, the paper's maps, which PySM downloads at first use;
# - `templates`, FITS maps of your own, of any resolution, or PySM's at the one that `himap templates FOLDER --nside 64` asks for. Maps coarser than the simulation are refined in harmonic space, on the logarithm of the
#   temperature so that nothing rings below zero, and small scales are added as a Gaussian field that continues the template's spectrum, modulated by the
#   large-scale brightness {cite:p}`miville2007,thorne2017`;
# - `synthetic`, the default, which needs nothing: a Galaxy of discs seen from inside, radio loops and lognormal structure, calibrated on the
#   statistics of the real maps.
#
# Three maps of the Galaxy and one of other galaxies, each on colours of its own. Synchrotron and free-free emission crowd along the plane, point
# sources are the same everywhere. The index of synchrotron emission changes from place to place: because of this the foregrounds are more than one
# spectrum times one map.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-galaxy", "caption": "The Galaxy of this run: synchrotron at 408 MHz, its spectral index, and free-free emission at 30 GHz (logarithmic but for the index), and the point sources at 1.4 GHz."}}
synchrotron, free_free, sources = pipeline.components(sky, milky_way)
titles = ["synchrotron, 408 MHz", "synchrotron index", "free-free, 30 GHz", "point sources, 1.4 GHz"]
values = [
    synchrotron.amplitude / 1e3,
    np.broadcast_to(synchrotron.index, synchrotron.amplitude.shape),
    free_free.amplitude * 1e3,
    sources.amplitude,
]
stamped(
    plotting.sky_maps(
        dict(zip(titles, values, strict=True)),
        unit=dict(zip(titles, ["K", "", r"$\mu$K", "mK"], strict=True)),
        log=dict(zip(titles, [True, False, True, True], strict=True)),
    )
)

# %% [markdown]
# How good is the stand-in? {numref}`fig-galaxy-beside` shows it beside the real maps. A run with the real templates, or with PySM, makes this
# picture anew; the one here was made by
# `himap run 01_simulations -p galaxy=templates -p template_dir=FOLDER` with PySM's maps at nside 64, which `himap templates FOLDER` writes.
# {numref}`fig-galaxy-statistics` compares the statistics that the synthetic Galaxy was calibrated on: medians over bands of latitude, and $C_\ell$. It lacks the
# coherent clouds of the real sky (Cygnus, Orion, the Gum nebula), and a single seed scatters around the mean of many.
#
# ```{figure} ../book/_static/galaxy_beside.png
# :name: fig-galaxy-beside
# The real Galaxy (left) and the synthetic one (right) on the same colours: synchrotron at 408 MHz {cite:p}`remazeilles2015` and free-free emission at 30 GHz
# {cite:p}`draine2011`, in mK, nside 64.
# ```

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-galaxy-statistics", "caption": "The synthetic Galaxy (lines, of this seed) and the real sky (dots, nside 64): the median of bands of Galactic latitude, and angular power spectra, of synchrotron emission at 408 MHz and free-free emission at 30 GHz."}}
STATISTICS = {
    "edges": [0, 2, 5, 10, 20, 40, 90],
    "synchrotron": [65, 48, 34, 24, 16, 12],
    "free-free": [1130, 328, 132, 56, 16, 2.6],
    "degrees": [2, 5, 10, 20, 50, 100],
    "synchrotron C_l": [646, 62, 28, 4.6, 0.35, 0.051],
    "free-free C_l": [1.6e5, 3.4e4, 2.7e4, 1.2e4, 2.9e3, 7.0e2],
}
stand_in = Galaxy().components(64, sky.rng("galaxy"))
latitude = np.abs(sphere.pixel_latitude(64))
edges = np.array(STATISTICS["edges"])
inside = [(latitude >= low) & (latitude < high) for low, high in zip(edges[:-1], edges[1:], strict=True)]
centres = 0.5 * (edges[1:] + edges[:-1])
panels = []
for component, name, scale, unit in zip(
    stand_in, ["synchrotron", "free-free"], [1e-3, 1e3], ["K", r"$\mu$K"], strict=True
):
    pixels = scale * component.amplitude
    medians = np.array([np.median(pixels[band]) for band in inside])
    cl = sphere.power_spectrum(sphere.analyse(pixels - pixels.mean()))
    colour = {"synchrotron": styles.BLUE, "free-free": styles.ORANGE}[name]
    panels.append(
        {
            "curves": [(centres, medians, {"color": colour, "label": "synthetic"})],
            "points": [(centres, np.array(STATISTICS[name]), {"color": "black", "label": "real sky"})],
            "title": name,
            "xlabel": "|b| [deg]",
            "ylabel": f"median [{unit}]",
            "yscale": "log",
        }
    )
    panels.append(
        {
            "curves": [(np.arange(2, 129), cl[2:129], {"color": colour, "label": "synthetic"})],
            "points": [
                (STATISTICS["degrees"], STATISTICS[f"{name} C_l"], {"color": "black", "label": "real sky"})
            ],
            "title": name,
            "xlabel": styles.AXES["angular"]["xlabel"],
            "ylabel": rf"$C_\ell$ [{unit}$^2$]",
            "xscale": "log",
            "yscale": "log",
        }
    )
stamped(plotting.lines(panels), "synthetic")

# %% tags=["hide-input"]
if galaxy == "synthetic":
    beside = None
else:
    maps, span = {}, {}
    for theirs, ours in zip(
        (synchrotron, free_free), Galaxy().components(sky.nside, sky.rng("galaxy")), strict=True
    ):
        label = f"{theirs.name}: {milky_way.label}"
        pair = {label: theirs.amplitude, f"{theirs.name}: synthetic": ours.amplitude}
        maps |= pair
        span |= dict.fromkeys(pair, np.percentile(ours.amplitude, (1, 99)))
    beside = stamped(plotting.sky_maps(maps, log=True, span=span), f"{milky_way.label} and synthetic")
beside

# %% [markdown]
# ### Radio galaxies
#
# The logarithm of the counts of radio sources per flux $S$ and solid angle, times $S^{2.5}$, is a fifth-order polynomial in $\log S$ {cite:p}`battye2013`. Sources fainter than 10 mJy are too many to
# draw one by one; they make a field {cite:p}`olivari2016` with the mean and the spectrum
#
# ```{math}
# :label: eq-sources
# \bar{T} = \frac{\lambda^2}{2 k_\mathrm{B}} \int S\,\frac{\mathrm{d}N}{\mathrm{d}S}\,\mathrm{d}S,
# \qquad
# C_\ell = 1.8 \times 10^{-4}\,\ell^{-1.2}\,\bar{T}^2
# + \left(\frac{\lambda^2}{2 k_\mathrm{B}}\right)^{2} \int S^2\,\frac{\mathrm{d}N}{\mathrm{d}S}\,\mathrm{d}S .
# ```
#
# Sources between 10 mJy and 1 Jy are put on the sky one by one, about {glue:text}`simulations_sources` of them; brighter ones are taken as known and removed. The spectral index of each pixel is
# drawn from a normal distribution of mean $-2.7$ and width 0.2. No flux is counted twice: mean and clustering are those of the faint sources alone.
#
# On the left the thick part is what is drawn one by one. On the right, the clustering of the faint sources falls with $\ell$, and the spectrum of the
# map becomes level: sources that are scattered at random have the same power at all $\ell$. At large $\ell$ most of the power is theirs.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-counts", "caption": "Left: source counts, scaled by the power of the flux that is flat for a Euclidean universe; the sources of the thick part are drawn one by one. Right: angular power spectra of the faint sources, clustering and Poisson, and of the map with the injected sources."}}
flux = np.geomspace(1e-6, 1, 200)
bright = flux >= point_sources.FLUX_FAINT
counts = flux**2.5 * point_sources.source_counts(flux)
degrees = np.arange(2, 2 * sky.nside)
clustering = point_sources.clustering_spectrum(
    degrees[-1], point_sources.mean_temperature(point_sources.FLUX_FAINT)
)[2:]
poisson = np.full(len(degrees), point_sources.poisson_spectrum(point_sources.FLUX_FAINT))
source_cl = sphere.power_spectrum(sphere.analyse(sources.amplitude - sources.amplitude.mean()))[degrees]
panels = [
    {
        "curves": [
            (flux, counts, {"color": styles.BLUE, "label": "faint: a field"}),
            (
                flux[bright],
                counts[bright],
                {"color": styles.VERMILION, "linewidth": 3, "label": "drawn one by one"},
            ),
        ],
        "xlabel": "flux S [Jy]",
        "ylabel": r"$S^{2.5}\,\mathrm{d}N/\mathrm{d}S$ [Jy$^{1.5}$ sr$^{-1}$]",
        "xscale": "log",
        "yscale": "log",
    },
    {
        "curves": [
            (degrees, clustering, {"color": styles.BLUE, "label": "faint: clustering"}),
            (degrees, poisson, {"color": styles.ORANGE, "linestyle": "--", "label": "faint: Poisson"}),
            (degrees, source_cl, {"color": "black", "linewidth": 0.8, "label": "map, with injected sources"}),
        ],
        "xlabel": styles.AXES["angular"]["xlabel"],
        "ylabel": styles.AXES["angular"]["ylabel"],
        "xscale": "log",
        "yscale": "log",
    },
]
stamped(plotting.lines(panels))

# %% [markdown]
# ## Everything together
#
# Two lines of sight tell the story of this book. In the middle of the band the foregrounds are {glue:text}`simulations_over_hi_away` times as bright as
# the mean of HI on the one away from the plane, and {glue:text}`simulations_over_hi_plane` times on the one in it, and they are smooth; HI is faint, and jagged.
#
# Left the line in the plane, right the one away from it; the axis of temperature is logarithmic. All foregrounds are nearly straight. In the plane free-free emission is as bright as synchrotron emission, and falls more slowly;
# away from it point sources come second.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-lines-of-sight", "caption": "Brightness temperature against frequency along two lines of sight, in the Galactic plane and away from it, component by component."}}
component_styles = {
    "synchrotron": {"color": styles.BLUE, "linestyle": "-"},
    "free-free": {"color": styles.ORANGE, "linestyle": "--"},
    "point sources": {"color": styles.GREEN, "linestyle": "-."},
    "HI": {"color": "black", "linestyle": "-", "linewidth": 0.9},
}
lines_of_sight = {
    f"l = {longitude}°, b = {latitude}°": sphere.pixel_at(sky.nside, longitude, latitude)
    for longitude, latitude in ((30, 0), (30, 60))
}
panels = []
for title, pixel in lines_of_sight.items():
    curves = [
        (
            freqs,
            [component.map(freq)[pixel] for freq in freqs],
            component_styles[component.name] | {"label": component.name},
        )
        for component in (synchrotron, free_free, sources)
    ]
    curves.append((freqs, hi[:, pixel], component_styles["HI"] | {"label": "HI"}))
    panels.append(
        {
            "curves": curves,
            "title": title,
            "xlabel": styles.CHANNELS,
            "ylabel": "temperature [mK]",
            "yscale": "log",
            "ylim": (3e-5, None),
            "legend": {"loc": "lower left", "ncols": 2},
        }
    )
stamped(plotting.lines(panels))

# %% [markdown]
# And across the sky: the contrast between the Galaxy and HI is largest at low $\ell$, for the Galaxy is brightest on the largest scales, and least at
# the end of the axis. The paper says that foregrounds are four to five orders of magnitude above HI, at high latitude too; the ledger has what comes
# out.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-all-spectra", "caption": "Angular power spectra of every component in the channel in the middle of the band, before beam and noise."}}
middle_maps = {
    component.name: component.map(freqs[middle]) for component in (synchrotron, free_free, sources)
} | {"HI": hi[middle].astype(float)}
power = {
    name: sphere.power_spectrum(sphere.analyse(pixels - pixels.mean()))[degrees]
    for name, pixels in middle_maps.items()
}
curves = [(degrees, power[name], style | {"label": name}) for name, style in component_styles.items()]
labels = {
    "xlabel": styles.AXES["angular"]["xlabel"],
    "ylabel": styles.AXES["angular"]["ylabel"],
    "xscale": "log",
    "yscale": "log",
}
room = {"ylim": (1e-9, None), "legend": {"loc": "lower left", "ncols": 2}}
stamped(plotting.lines([{"curves": curves, **labels, **room}], columns=1, size=(6.8, 4)))

# %% [markdown]
# ## The numbers

# %% tags=["hide-input"]
foreground = sum(middle_maps[name] for name in ("synchrotron", "free-free", "point sources"))
show(
    {
        "pixels of a map": sky.n_pix,
        "channels": sky.n_channels,
        "mean HI temperature, middle of the band": (1e3 * mean[middle], 0.05, "µK"),
        "mean of theory there": (1e3 * theory[middle], 0.01, "µK"),
        "rms of HI there": (1e3 * middle_maps["HI"].std(), 0.05, "µK"),
        "median foreground there": (np.median(foreground) / 1e3, 0.005, "K"),
        "rms of the foreground there": (foreground.std() / 1e3, 0.01, "K"),
        "that over the rms of HI": (foreground.std() / middle_maps["HI"].std(), 500),
        "mean of the point sources at 1.4 GHz": (sources.amplitude.mean(), 0.05, "mK"),
        "... of theory, below 1 Jy": (point_sources.mean_temperature(1.0), 0.01, "mK"),
    }
)

# %% tags=["hide-input"]
over_hi = {title: foreground[pixel] / mean[middle] for title, pixel in lines_of_sight.items()}
n_sources = 4 * np.pi * point_sources.number_density(point_sources.FLUX_FAINT, point_sources.FLUX_REMOVED)
quote(
    simulations_theory=(theory[middle], 1e-3, "mK"),
    simulations_sources=(n_sources, 1000),
    simulations_over_hi_plane=(over_hi["l = 30°, b = 0°"], 1000),
    simulations_over_hi_away=(over_hi["l = 30°, b = 60°"], 100),
    simulations_hi=(1e3 * mean[middle], 0.1, "µK"),
    simulations_foreground=(np.median(foreground) / 1e3, 0.005, "K"),
    simulations_brightest=(foreground.max() / 1e3, 0.5, "K"),
)

# %% [markdown]
# ## What to take away
#
# - In the middle of the band HI has {glue:text}`simulations_hi` on average, the foregrounds {glue:text}`simulations_foreground` in the median pixel and up to
#   {glue:text}`simulations_brightest`: removing them to one part in $10^5$ is not enough where they are brightest.
# - Foregrounds are smooth in frequency, HI is not; that is the only difference a blind method uses.
# - The simulation has limits. The density is lognormal, the velocities are linear, and HI has no structure below the cell of the box,
#   so small scales are a sketch. For the questions of this book, which are about foregrounds, that is enough.
#
# ## Exercises
#
# **1.** At which redshift do we see HI at $\nu = 1000$ MHz, and how much brighter is the Galaxy there than at 1400 MHz, if its spectral index is $-2.7$?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# $z = 1420.4/1000 - 1 = 0.42$, and $(1000/1400)^{-2.7} = 2.5$ times as bright.
#
# </details>
#
# **2.** Take another seed. Which numbers of this page stay, and which do not?
#
# ```sh
# himap run 01_simulations -p seed=7
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The means stay, within their scatter: they come from formulas. The contrast on the two lines of sight moves, for the synthetic Galaxy is drawn from
# the seed as well.
#
# </details>
#
# **3.** Take a real Galaxy. What becomes of the numbers of HI and of the radio galaxies?
#
# ```sh
# himap run 01_simulations -p galaxy=templates -p template_dir=my_templates    # from `himap templates my_templates`
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# They stay, to the last digit: each component draws from a stream of its own. Only what has the Galaxy in it changes.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 01_simulations --preset laptop    # sharper maps
# ```
