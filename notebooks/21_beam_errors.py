# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/beam_errors_quick_synthetic.json
#     - book/results/beam_errors_quick_templates.json
#     - book/results/beam_errors_lobes_synthetic.json
#     - book/results/beam_errors_lobes_templates.json
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
# # How well must the beam be known?
#
# > - **Read first**: {doc}`09_sdecgmca`, {doc}`20_transfer_function`.
# > - **Time and memory**: {cost}`21_beam_errors`.
#
# A method that knows the beam trusts what it is told. The paper tells it the truth. On a telescope a beam is measured, and wrong by something. This chapter tells methods a beam that is wrong by a known amount, and asks at which error one
# does better without any beam, and what one source more buys back.
#
# The FWHM that a method is told is that of the data times $1 + e$, with an error of one of these kinds:
#
# | kind | $e(\nu)$ |
# |---|---|
# | width | the same in all channels |
# | ripple | $a \sin(2\pi\nu / 20\,\mathrm{MHz})$, which the beam does not have |
# | amplitude, phase, period | what follows where that number of the beam's own ripple is wrong; it is 0.14 % of the FWHM ({doc}`02_beams_and_noise`) |
#
# Two things can go wrong, and they are shown apart. Of the power $P$ that is left, a part has something in common with the truth $t$: the share of HI that is **kept**, $\langle \hat t\, t^* \rangle / \langle |t|^2 \rangle$. A
# projection keeps whole what it keeps, so what is in $P/P_0$ above that share is **foreground left**. A transfer function ({doc}`20_transfer_function`) repairs the first, and nothing repairs the second.

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
beam: str = "oscillating"  # degraded, evolving, oscillating, rippled, meerkat, meerkat_lobes or a file
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
methods: list = [["beam_subspace", 3], ["beam_subspace", 4], ["pca", 6]]  # pairs of name and number
reading: str = "default"  # SDecGMCA: default, letter, code or follow-up
errors: dict = {"width": [0.0003, 0.003, 0.03], "ripple": [3e-6, 3e-5, 3e-4]}  # of each kind; "beam": names
results: list | None = None  # what `himap record beam-errors` wrote; null: that of the book
lobes: list | None = None  # the same where the data have side lobes

# %% tags=["hide-input"]
import numpy as np

from himap.companion.stored import RESULTS
from himap.figures import plotting, styles
from himap.figures.numbers import quote
from himap.figures.tables import Table
from himap.instrument.beams import named
from himap.paper.beam_errors import BeamError, by_error, evaluate, most_excess, tolerated
from himap.paper.beam_errors_figures import errors_figure
from himap.paper.corrections import cases_and_methods
from himap.paper.record_file import read_record
from himap.paper.study import Study
from himap.products.provenance import Provenance

# %% tags=["hide-input"]
cases, removers = cases_and_methods(
    preset=preset,
    survey=survey,
    galaxy=galaxy,
    template_dir=template_dir,
    small_scales=small_scales,
    beam=beam,
    ripple=ripple,
    methods=methods,
    reading=reading,
    n_realisations=1,
)
study = Study(
    preset=preset, overrides=survey, galaxy=galaxy, template_dir=template_dir, small_scales=small_scales
)

# %% [markdown]
# ## One sky
#
# Each method cleans the same observation again and again, told another beam each time. In the figure is the foreground that is left, over the truth, in the band where it is most, of $10 \leq \ell < 100$ and $k_\nu > 0.03$.

# %%
rows = evaluate(cases, removers, errors)

# %% [markdown]
# From left to right the error grows. A curve that rises is a method that trusts its beam; where it crosses the horizontal one, it would do better
# without.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-beam-errors-sky", "caption": "Foreground left in the worst band, over the power of HI and noise, by the error of the beam that a method is told. The horizontal curve is a method that is told none; the grey line is 1 %. What is less than 0.1 % is below the frame."}}
study.stamped(errors_figure(rows), beam=cases[0].beam)

# %% [markdown]
# An error that oscillates costs far more than one of all channels together: it is the failure of {doc}`10_results`, brought back in small. Foregrounds are brighter than HI by $10^4$ and more, and what the ripple makes of them is no
# smooth spectrum.
#
# (beam-errors-record)=
# ## Over several skies
#
# More errors, methods and skies, measured before and stored with the book, with the synthetic and the real Galaxy (templates, nside 64):
#
# ```sh
# himap record beam-errors --preset quick -p n_realisations=5 --jobs 2
# ```

# %% tags=["hide-input"]
galaxies = ("synthetic", "templates")
paths = results or [RESULTS / f"beam_errors_quick_{name}.json" for name in galaxies]
records = [read_record(BeamError, path) for path in paths]
made = [Provenance.of_stored(about) for _, about in records]

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-beam-errors-first", "caption": "As above, mean over several skies, by the error of each kind, with the synthetic Galaxy."}}
plotting.stamp(errors_figure(records[0][0]), made[0].footer())

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-beam-errors-second", "caption": "The same with the real Galaxy."}}
plotting.stamp(errors_figure(records[-1][0]), made[-1].footer())

# %% [markdown]
# A source more catches what a wrong beam makes of the foreground, once that stands out enough to be found: the curves come down again. Just before that, where it is as bright as the HI, no source finds it: **the errors that hurt
# most, with sources to spare, are the small ones.** SDecGMCA, with the paper's five, fails on a sky here and there whatever it is told ({doc}`09_sdecgmca` has its sensitivity), and a mean over skies shows that.
#
# The next table has the error up to which at most 1 % of foreground is left more than with the exact beam, between those that were tried by interpolation; "less" where the least of them is too much.


# %% tags=["hide-input"]
MANY = 1000  # percent from where on a factor reads better


def digits(value, unit="%"):
    """Two digits of a number, "less" for none, and a share of many times the whole as a factor."""
    if np.isnan(value):
        return "less"
    factor = unit == "%" and value >= MANY
    value, unit = (value / 100, "times") if factor else (value, unit)
    return f"{float(f'{value:.2g}'):g}\N{NO-BREAK SPACE}{unit}"


def tolerable(rows, known, method, kind):
    """The text of a tolerated error."""
    value = known[*method, kind]
    most = max(row.error for row in rows if row.kind == kind)
    text = digits(value, "rad") if kind == "phase" else digits(100 * value)
    return f"> {text}" if value == most else text


kinds = ("width", "ripple", "amplitude", "phase", "period")
lines = []
for (rows, _), one in zip(records, made, strict=True):
    known = tolerated(rows)
    for method in dict.fromkeys(key[:2] for key in known):
        name = styles.numbered(*method)
        lines.append((one.galaxy, name, *(tolerable(rows, known, method, kind) for kind in kinds)))
Table(["Galaxy", "method", *kinds], lines, align="llrrrrr")

# %% [markdown]
# (beam-errors-lobes)=
# ## A beam with side lobes
#
# Widths are not all. The beams of MeerKAT as holography knows them ({cite:t}`asad2021`, package katbeam) are no Gaussians: they have side lobes, and no $b_\ell$ at all beyond $2\pi D/\lambda$. Here the data are seen through
# these, `beam=meerkat_lobes`, and methods are told a Gaussian of the same FWHM in every channel, `meerkat`.

# %% tags=["hide-input"]
shown = [cases[0].survey.freqs[i] for i in (0, -1)]
curves = []
for colour, freq in zip((styles.BLUE, styles.VERMILION), shown, strict=True):
    for name, dashes, label in (("meerkat_lobes", "-", "with side lobes"), ("meerkat", "--", "Gaussian")):
        windows = named(name).windows(np.array([freq]), lmax=400).total[0]
        style = {"color": colour, "linestyle": dashes, "label": f"{freq:.0f} MHz, {label}"}
        curves.append((np.arange(len(windows)), windows, style))
panel = {
    "curves": curves,
    "xlabel": r"multipole $\ell$",
    "ylabel": r"$b_\ell$",
    "yscale": "log",
    "ylim": (1e-3, 1.2),
}

# %% [markdown]
# The two have the same width, and part at high $\ell$: with side lobes the beam ends, and the Gaussian goes on. At the multipoles where it is far above
# the true beam a method believes in structure that the data do not have.

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-beam-errors-lobes", "caption": "The beam of MeerKAT with its side lobes (solid) and the Gaussian of the same FWHM (dashed), at both ends of the band."}}
study.stamped(plotting.lines([panel], columns=1, size=(6, 3.6)))

# %% tags=["hide-input"]
lobed = [
    read_record(BeamError, path)
    for path in lobes or [RESULTS / f"beam_errors_lobes_{n}.json" for n in galaxies]
]
told = {("width", 0.0): "the beam itself", ("none", 0.0): "none", ("beam", "meerkat"): "Gaussians"}
lines = []
for rows, about in lobed:
    galaxy_of = Provenance.of_stored(about).galaxy
    for (method, n_sources, kind, error), means in by_error(rows).items():
        if (kind, error) in told:
            kept = min(share for _, share, _ in means.values())
            name = styles.numbered(method, n_sources)
            lines.append(
                (
                    galaxy_of,
                    name,
                    told[kind, error],
                    f"{100 * kept:.1f}\N{NO-BREAK SPACE}%",
                    digits(100 * most_excess(means)),
                )
            )
Table(["Galaxy", "method", "told", "HI kept at least", "foreground left at most"], lines, align="lllrr")


# %% tags=["hide-input"]
def left(rows, method, n_sources, kind="width", error=0.0):
    """Foreground left in the worst band, %."""
    found = by_error(rows).get((method, n_sources, kind, error))
    return "not measured" if found is None else digits(100 * most_excess(found))


def least(rows, **told_as):
    """(number of sources, foreground left) of BeamSubspace where least is left."""
    numbers = sorted({row.n_sources for row in rows if row.method == "beam_subspace"})
    found = {
        n: most_excess(by_error(rows)["beam_subspace", n, told_as["kind"], told_as["error"]]) for n in numbers
    }
    best = min(found, key=found.get)
    return best, digits(100 * found[best])


best = [least(rows, kind="beam", error="meerkat") for rows, _ in lobed]
limits = [tolerated(rows) for rows, _ in records]
quote(
    beams_width=digits(100 * min(one["beam_subspace", 3, "width"] for one in limits)),
    beams_ripple=digits(100 * min(one["beam_subspace", 3, "ripple"] for one in limits)),
    beams_lobes=left(lobed[0][0], "beam_subspace", 3, "beam", "meerkat"),
    beams_lobes_real=left(lobed[-1][0], "beam_subspace", 3, "beam", "meerkat"),
    beams_lobes_right=left(lobed[0][0], "beam_subspace", 3),
    beams_lobes_right_real=left(lobed[-1][0], "beam_subspace", 3),
    beams_best=f"{best[0][0]} sources and {best[0][1]}",
    beams_best_real=f"{best[-1][0]} sources and {best[-1][1]}",
    beams_skies=len({row.seed for row in records[0][0]}),
)

# %% [markdown]
# ## What to take away
#
# At `quick`, in the mean over {glue:text}`beams_skies` skies:
#
# - **With the number of sources that an exact beam asks for, the beam has to be exact**: BeamSubspace with three sources leaves 1 % more of foreground than with the exact beam as soon as the width is wrong by {glue:text}`beams_width`, or by a ripple of
#   {glue:text}`beams_ripple` of the FWHM, on the Galaxy where that is less.
# - **Sources buy knowledge**: what a wrong beam makes of the foreground is a few spectra more, and a method that has one or two to spare finds them. It costs the HI that each further source takes, which mocks can correct
#   ({doc}`20_transfer_function`). It does not buy the smallest ripples on the real Galaxy: there the table allows five and six sources no more than three.
# - **A Gaussian is not a beam.** Told the beam with its side lobes, three sources leave {glue:text}`beams_lobes_right` (synthetic Galaxy) and {glue:text}`beams_lobes_right_real` (real) of foreground; told Gaussians of the right width,
#   {glue:text}`beams_lobes` and {glue:text}`beams_lobes_real`. The best that more sources make of that: {glue:text}`beams_best`, and on the real Galaxy {glue:text}`beams_best_real`.
# - **A method without a beam has nothing to be told wrong.** Where the beam is not known to the errors in the table, PCA with enough components is no worse, and simpler.
#
# How much hangs on the beam of a cube of one's own, without the truth:
#
# ```sh
# himap sensitivity cube.h5 --method beam_subspace --beam meerkat -p n_sources=4 --width 0.01 --ripple 0.001 -o beam.html
# himap clean cube.h5 --method beam_subspace --beam misjudged:beam=meerkat,width=0.01 -p n_sources=4 -o cleaned.h5
# ```
#
# ## Exercises
#
# **1.** A foreground of 10 K stands before HI of 0.1 mK. To which relative accuracy must a method predict the foreground of a channel, if 1 % of the
# power of HI is tolerated?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# 1 % of a power is a tenth of an amplitude, $0.01$ mK of $10^4$ mK: $10^{-6}$. No beam is known that well. What saves a method is that an error which
# is smooth in frequency looks like one spectrum more.
#
# </details>
#
# **2.** Why does an error of the width in all channels alike cost so much less than a ripple of the same size?
#
# <details class="himap-answer">
# <summary>Answer</summary>
#
# It changes the blurring of all channels together, which for smooth foregrounds is again a smooth change with frequency, and the spectra that are
# fitted take most of it. A ripple makes of every bright pixel a spectrum that none of these spectra has.
#
# </details>
#
# More to run:
#
# ```sh
# himap run 21_beam_errors -p beam=meerkat_lobes -p 'errors={"beam": ["meerkat", "evolving"], "width": [0.01]}'
# himap run 21_beam_errors -p 'methods=[["beam_subspace", 5], ["pca", 7]]'
# himap run 21_beam_errors -p beam=rippled:amplitude=1 -p 'errors={"amplitude": [0.01, 0.1], "period": [0.001]}'
# ```
