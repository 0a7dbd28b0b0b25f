# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/boxes_paper.json
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
# > - **Tests** (verdicts of {doc}`15_claims`): {claim}`F1`.
# > - **Time and memory**: {cost}`01_simulations`.
#
# The 21 cm line of neutral hydrogen (HI), emitted at 1420.4 MHz, is observed at
# $\nu = 1420.4\ \mathrm{MHz} / (1 + z)$. A map at one frequency shows the hydrogen at one distance; the band
# from 900 to 1400 MHz covers $z < 0.58$. The foregrounds are about ten thousand times brighter. This chapter
# simulates both, as {cite:t}`gkogkou2025` do in their Sect. 2.1.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
boxes: str | None = None  # record of `himap measure boxes`; None: that of the book

# %%
from dataclasses import replace

import numpy as np

from himap.app.stored import RESULTS
from himap.core.survey import Survey
from himap.figures import plotting, styles
from himap.figures.numbers import quote, show
from himap.figures.tables import Table
from himap.instrument.beams.paper import Degraded
from himap.maps import sphere
from himap.measures.spectra import frequency_power
from himap.paper import pipeline
from himap.paper.experiments.boxes import EXPERIMENT, table_of
from himap.paper.record import Record
from himap.removal.peaks import smooth_baselines
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
# ## The HI signal
#
# The mean brightness temperature after reionization is {cite:p}`furlanetto2006`
#
# ```{math}
# :label: eq-mean-temperature
# \bar{T}(z) = \frac{3\,h_\mathrm{P}\,c^3 A_{10}}{32\pi\,k_\mathrm{B}\,m_\mathrm{H}\,\nu_{21}^2}\,
# \frac{(1+z)^2}{H(z)}\,\Omega_\mathrm{HI}(z)\,\rho_\mathrm{c},
# \qquad \Omega_\mathrm{HI}(z) = 4 \times 10^{-4}\,(1+z)^{0.6},
# ```
#
# {glue:text}`simulations_theory` in the middle of the band. Fluctuations trace matter with the bias $b_\mathrm{HI}(z) = 0.3\,(1+z) + 0.6$ {cite:p}`martin2012,carucci2020`.
#
# As in CRIME {cite:p}`alonso2014`, a Gaussian field $\delta_G$ with the linear power spectrum of CAMB
# {cite:p}`lewis2000` fills a periodic box of $3\ h^{-1}$ Gpc around the observer. At distance $r$ it is
# scaled by the growth factor $D(z)$ and made lognormal {cite:p}`coles1991`,
#
# ```{math}
# :label: eq-lognormal
# 1 + \delta_\mathrm{HI} = \exp\left(b D\,\delta_G - \tfrac{1}{2}\,b^2 D^2 \sigma_G^2\right).
# ```
#
# The linear velocities of the box displace HI along the line of sight by $f D\,\psi_r$, with
# $\boldsymbol{\psi}_k = i\,\boldsymbol{k}\,\delta_k/k^2$ and the growth rate $f$ {cite:p}`kaiser1987`. HI is
# collected into channels along rays through the box.
#
# Simulated maps scatter most around {eq}`eq-mean-temperature` near the top of the band, where a channel is a
# small shell.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-hi-mean", "caption": "Mean HI brightness temperature of every channel: simulated maps (dots) and theory (line)."}}
hi = pipeline.hi_of_sky(sky.sky)
theory = HIModel().mean_temperature(redshift(freqs))
mean = hi.mean(axis=1, dtype=float)
curves = [
    (freqs, 1e3 * theory, {"color": "black", "label": "theory"}),
    (freqs, 1e3 * mean, {"color": styles.BLUE, "linestyle": "none", "marker": ".", "label": "simulation"}),
]
panel = {"curves": curves, "xlabel": styles.CHANNELS, "ylabel": r"mean temperature [$\mu$K]"}
stamped(plotting.lines([panel], columns=1, size=(6.8, 3.6)), "no")

# %% [markdown]
# Structures subtend larger angles in the nearer channel.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-hi-maps", "caption": "HI in a far and a near channel. The colour scales differ."}}
near = int(0.9 * sky.n_channels)
maps = {
    f"{freqs[channel]:.0f} MHz, z = {redshift(freqs[channel]):.2f}": 1e3 * hi[channel]
    for channel in (middle // 4, near)
}
stamped(plotting.sky_maps(maps, unit=r"$\mu$K"), "no")

# %% [markdown]
# The pattern changes within a few channels: HI is not smooth in frequency.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-hi-slice", "caption": "HI along the Galactic equator against frequency, which is distance. Structures span few pixels in the distant channels (left) and many in the near ones (right)."}}
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
# (simulations-resolution)=
# ### Resolution and smoothing
#
# Above {glue:text}`simulations_voxel` voxels (one pixel in one channel) are smaller than a cell of the box
# (with the paper's box, pixels and channels above {glue:text}`simulations_voxel_paper`). HI has no structure
# below the cell. The table shows the ratio of CRIME to himap before any beam, with the paper's cosmology,
# bias and HI abundance, the same Fourier modes, a box of 512³ cells, nside 64 and channels of 4 MHz. The
# ratios are stored, as CRIME is not part of himap.

# %% tags=["hide-input"]
CRIME = [
    ["900–1000", "1.001", "1.00–1.01", "1.015", "1.06", "1.02"],
    ["1100–1200", "1.001", "1.01", "1.05", "1.22", "1.25"],
    ["1200–1300", "1.008", "1.03–1.06", "1.17", "1.79", "1.60"],
    ["1300–1400", "1.001", "0.99–1.56", "3.6", "28", "6.2"],
]  # CRIME over himap
head = ["MHz", "mean T", "C_l, l 2–51", "l 52–99", "l 100–191", "brightest voxel"]
quote(simulations_crime_low=CRIME[-1][2].rpartition("–")[2], simulations_crime_high=CRIME[-1][4])
Table(head, CRIME, align="l" + 5 * "r")

# %% [markdown]
# The codes agree if a voxel contains many cells. In the nearest channels neither is converged: CRIME counts
# ten points per cell, whose noise adds power; interpolation between cells in himap removes power. Above 1300
# MHz the codes agree in the mean temperature, but in $C_\ell$ only at the lowest $\ell$: the ratio grows to
# {glue:text}`simulations_crime_low` at $\ell \approx 50$ and to {glue:text}`simulations_crime_high` beyond
# 100; the brightest voxels differ too. Through a beam of 1.66° ({doc}`02_beams_and_noise`) the power along
# the line of sight, $P(k_\nu)$ ({eq}`eq-frequency-power`), agrees to 6 % above 1300 MHz. CRIME also has half
# the power on the planes where $k_x$ is 0 or the Nyquist frequency, and lower velocities, computed as
# differences of neighbouring cells; himap has neither.
#
# CRIME's option `r_smooth` multiplies the modes of the matter by $e^{-k^2 r^2/2}$, which affects density and
# velocities. Its sample file sets 2 Mpc/h, its script with the paper's cosmology none. The paper does not
# mention it, and the default of himap is 0. In a smaller box with cells of
# {glue:text}`simulations_near_cell`, at {glue:text}`simulations_near` and through the degraded beam, 2 Mpc/h
# reduces the share of voxels beyond $5\,\sigma$ of their line of sight ({doc}`03_peak_masking`) from
# {glue:text}`simulations_flagged` to {glue:text}`simulations_flagged_smooth`, and the brightest voxel from
# {glue:text}`simulations_peak` to {glue:text}`simulations_peak_smooth`. Before the beam $P(k_\nu)$ at
# $k_\nu < 0.3$ MHz$^{-1}$ is reduced to {glue:text}`simulations_smooth_low`, and $C_\ell$ at
# {glue:text}`simulations_small` to {glue:text}`simulations_smooth_small`.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-hi-smoothing", "caption": "Power spectra of HI before the beam, without smoothing of the density and with 2 Mpc/h: angular, averaged over channels (left), and frequency (right); 1320 to 1400 MHz, smaller box, finer cells. Smoothing reduces the power on all scales, most on small ones."}}
near = replace(sky, freq_min=1320.0, freq_max=1400.0, n_channels=80, box_size=512.0, box_cells=192)
panels = [
    {
        "curves": [],
        "xlabel": labels["xlabel"],
        "ylabel": labels["ylabel"],
        "xscale": "log",
        "yscale": "log",
    }
    for labels in styles.AXES.values()
]
spectra, flagged, brightest = {}, {}, {}
for r_smooth, colour in ((0.0, "black"), (2.0, styles.BLUE)):
    close = replace(near, r_smooth=r_smooth)
    alms = pipeline.hi_alms_of_sky(close.sky)
    along = frequency_power(pipeline.hi_of_sky(close.sky), close.channel_width, taper=sky.taper)
    spectra[r_smooth] = sphere.power_spectrum(alms).mean(axis=0)[: 2 * sky.nside], along
    seen = pipeline.hi_seen(pipeline.Case(survey=close, beam=Degraded()))
    flagged[r_smooth] = smooth_baselines(seen, close.freqs).flagged.mean()
    brightest[r_smooth] = seen.max()
    style = {"color": colour, "label": f"r = {r_smooth:.0f} Mpc/h"}
    panels[0]["curves"].append((np.arange(2, 2 * sky.nside), spectra[r_smooth][0][2:], style))
    panels[1]["curves"].append((along.k[1:], along.power[1:], style))
stamped(plotting.lines(panels), "no")


# %% tags=["hide-input"]
def turning(survey):
    """The lowest frequency at which a voxel is smaller than a cell of the box, MHz."""
    distance = HIModel().cosmology.comoving_distance(redshift(survey.freq_edges))
    voxel = -4 * np.pi / 3 * np.diff(distance**3) / survey.n_pix
    return survey.freqs[np.argmax(voxel < (survey.box_size / survey.box_cells) ** 3)]


before, after = spectra.values()
low = before[1].k < 0.3
small = slice(min(100, sky.nside), None)
quote(
    simulations_cell=(sky.box_size / sky.box_cells, 0.05, "Mpc/h"),
    simulations_voxel=(turning(sky), 5, "MHz"),
    simulations_voxel_paper=(turning(Survey.preset("paper", box_cells=2048)), 5, "MHz"),
    simulations_small=f"ℓ ≥ {small.start}",
    simulations_near=f"{near.freq_min:.0f} to {near.freq_max:.0f} MHz",
    simulations_near_cell=(near.box_size / near.box_cells, 0.05, "Mpc/h"),
    simulations_flagged=(100 * flagged[0.0], 0.005, "%"),
    simulations_flagged_smooth=(100 * flagged[2.0], 0.005, "%"),
    simulations_peak=(brightest[0.0], 0.05 * brightest[0.0], "mK"),
    simulations_peak_smooth=(brightest[2.0], 0.05 * brightest[2.0], "mK"),
    simulations_smooth_low=(100 * after[1].power[low].mean() / before[1].power[low].mean(), 0.5, "%"),
    simulations_smooth_small=(100 * after[0][small].mean() / before[0][small].mean(), 0.5, "%"),
)

# %% [markdown]
# With cells as small as the paper's the two codes flag nearly the same share of voxels (brightest voxel and
# spectra were not compared there). The cell size has little effect on this share, and far more on the
# brightest voxel and on $P(k_\nu)$ at both ends; smoothing changes all quantities shown. Each row is a pair
# of runs; the bands of most, and the ranges of $k_\nu$, are not stored. The row of `r_smooth` starts from
# another run, so cell size and smoothing cannot be ranked. Claims B1 to B3 and D3 may depend on both:
# {doc}`18_paper_size` judges them with either. At the smaller presets the cells smooth more than 2 Mpc/h
# does.

# %% tags=["hide-input"]
CHOICES = [
    ["code, before the beam", "himap → CRIME", "8.33 → 8.23", "–", "–", "–"],
    ["code, through the beam", "himap → CRIME", "7.40 → 7.38", "–", "–", "–"],
    [
        "cell, through the beam",
        "1.465 → 2.93 Mpc/h",
        "7.36 → 7.20",
        "190 → 42",
        "0.060 → 0.033",
        "0.023 → 0.0062",
    ],
    ["`r_smooth`", "0 → 2 Mpc/h", "8.9 → 6.8", "72 → 6", "0.069 → 0.029", "–"],
]  # of the comparison with CRIME
head = ["choice", "", "flagged, 10⁻³", "brightest, mK", "P at low k, mK² MHz", "P at high k, mK² MHz"]
Table(head, CHOICES, align="ll" + 4 * "r")

# %% [markdown]
# The paper's box has 2048³ cells. Such a field contains the Fourier modes of the box of 1024³ cells with the
# same seed, and smaller scales. It is compared with that box and with another draw of 512³ cells, over the
# band of the paper at `nside` 256; “through the beam” refers to the degraded beam. Spectra are relative to
# those of 2048³ cells, whose values are in the last column.

# %% tags=["hide-input"]
record = Record.load(EXPERIMENT, boxes or RESULTS / "boxes_paper.json")
several = table_of(record.rows)
Table(several.columns, several.to_numpy(), align="lll" + len(several) * "r", note=record.made.footer())

# %% [markdown]
# The mean temperature and the share of voxels beyond $5\,\sigma$ depend little on the cell size. The
# brightest voxel and all spectra do. A channel is about as thick as a cell of 1024³, so its $C_\ell$ has
# power from line-of-sight modes that a coarser box lacks, at every $\ell$ and most in the nearest channels.
# The claims are judged on ratios to the truth of the same box; {doc}`18_paper_size` judges them with the
# paper's box.

# %% [markdown]
# ## The foregrounds
#
# ### The Galaxy
#
# Synchrotron and free-free emission are power laws in frequency (the paper's Eqs. 1 and 2),
#
# ```{math}
# :label: eq-power-law
# T(\nu, p) = T(\nu_0, p)\,\left(\frac{\nu}{\nu_0}\right)^{\beta(p)},
# ```
#
# with an index near $-3$ that varies over the sky for synchrotron and $-2.14$ everywhere for free-free
# emission. The foregrounds therefore have more than one spectrum. The paper uses the maps of PySM
# {cite:p}`thorne2017,zonca2021`: the 408 MHz survey {cite:p}`haslam1982,remazeilles2015` and an index map
# {cite:p}`miville2008`. The parameter `galaxy` chooses
#
# - `pysm3`, the paper's maps;
# - `templates`, FITS maps, if need be with a Gaussian field that continues their spectrum to smaller scales
#   {cite:p}`miville2007,thorne2017`;
# - `synthetic` (default), drawn with statistics like those of the real maps
#   ([conventions](../book/conventions.md)).
#
# Only synchrotron and free-free emission are concentrated in the Galactic plane.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-galaxy", "caption": "The Galaxy of this run: synchrotron emission at 408 MHz, its spectral index, free-free emission at 30 GHz, and point sources at 1.4 GHz. Colours are logarithmic except for the index."}}
synchrotron, free_free, sources = pipeline.components_of_sky(sky.sky, milky_way)
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
# {numref}`fig-galaxy-beside` compares the synthetic Galaxy with PySM's maps, {numref}`fig-galaxy-statistics`
# with the statistics used to calibrate it. The synthetic Galaxy lacks the coherent clouds of the real sky
# (Cygnus, Orion, the Gum nebula), and its free-free emission has less power on most scales.
#
# ```{figure} ../book/_static/galaxy_beside.png
# :name: fig-galaxy-beside
# The real Galaxy (left) and the synthetic one (right) on the same colours: synchrotron emission at 408 MHz {cite:p}`remazeilles2015` and free-free emission at 30 GHz
# {cite:p}`draine2011`, in mK, nside 64.
# ```

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-galaxy-statistics", "caption": "The synthetic Galaxy (lines, this seed) and the real sky (dots, nside 64): medians by Galactic latitude, and angular power spectra, of synchrotron emission at 408 MHz and free-free emission at 30 GHz."}}
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
# The logarithm of the differential source counts, times $S^{2.5}$ with the flux $S$, is a fifth-order
# polynomial in $\log S$ {cite:p}`battye2013`. Sources fainter than 10 mJy are a field {cite:p}`olivari2016`
# with
#
# ```{math}
# :label: eq-sources
# \bar{T} = \frac{\lambda^2}{2 k_\mathrm{B}} \int S\,\frac{\mathrm{d}N}{\mathrm{d}S}\,\mathrm{d}S,
# \qquad
# C_\ell = 1.8 \times 10^{-4}\,\ell^{-1.2}\,\bar{T}^2
# + \left(\frac{\lambda^2}{2 k_\mathrm{B}}\right)^{2} \int S^2\,\frac{\mathrm{d}N}{\mathrm{d}S}\,\mathrm{d}S .
# ```
#
# About {glue:text}`simulations_sources` sources between 10 mJy and 1 Jy are placed individually; brighter
# ones are assumed removed. Spectral indices of pixels are normally distributed with mean $-2.7$ and width
# 0.2.
#
# The clustering power falls with $\ell$, the Poisson power is constant, and at high $\ell$ the individual
# sources dominate.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-counts", "caption": "Left: Euclidean-normalised differential source counts; sources of the thick part are placed individually. Right: angular power spectra of the faint sources (clustering and Poisson) and of all sources."}}
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
            (flux, counts, {"color": styles.BLUE, "label": "faint: field"}),
            (
                flux[bright],
                counts[bright],
                {"color": styles.VERMILION, "linewidth": 3, "label": "individual sources"},
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
# ## All components
#
# In the middle of the band the foregrounds are {glue:text}`simulations_over_hi_away` times the mean of HI on
# the line of sight away from the plane and {glue:text}`simulations_over_hi_plane` times in the plane. They
# are smooth in frequency; HI is not.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-lines-of-sight", "caption": "Brightness temperature of each component along a line of sight in the Galactic plane (left) and away from it (right), on a logarithmic axis."}}
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
# The contrast between the Galaxy and HI is largest at low $\ell$. The paper's “over four” orders of magnitude
# and “up to five”, even at high latitudes, refer to temperatures and are twice as many in $C_\ell$.
# {doc}`15_claims` has the measured ratio, {doc}`18_paper_size` that of the paper's box, in which HI is
# brighter and the ratio just below four orders.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-all-spectra", "caption": "Angular power spectra of all components in the channel in the middle of the band, before beam and noise."}}
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
        "rms of the foreground over that of HI": (foreground.std() / middle_maps["HI"].std(), 500),
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
# ## Conclusions
#
# - The mean of HI in the middle of the band is {glue:text}`simulations_hi`; the foreground is
#   {glue:text}`simulations_foreground` in the median pixel and at most {glue:text}`simulations_brightest`.
#   Removing it to one part in $10^5$ is not enough where it is brightest.
# - HI has a lognormal density, linear velocities, and no structure below the cell of the box, here
#   {glue:text}`simulations_cell`. Boxes with larger cells than the paper's have less power in $P(k_\nu)$ and
#   $C_\ell$ at all scales, in $C_\ell$ most above 1300 MHz; methods are compared with the truth of the same
#   box.
#
# ## Exercise
#
# Which numbers of this page change with another seed?
#
# ```sh
# himap run 01_simulations -p seed=7
# ```
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# The means change within their scatter. The contrast along the two lines of sight changes with the synthetic
# Galaxy.
#
# </details>
