"""What the notebooks of the companion share: one survey and sky seen through three beams, and its figures.

A notebook makes one `Study` of its parameters, and asks it for cases, cleaned cubes and figures.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from himap.errors import InputError
from himap.figures import plotting
from himap.measures import diagnostics
from himap.measures.results import Comparison
from himap.paper import pipeline
from himap.products.memory import check_memory
from himap.products.parallel import make_all, n_jobs
from himap.products.provenance import Provenance
from himap.removal.sdecgmca.method import TABLE_1
from himap.sky.dimming import Dimming
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = ["BEAMS", "N_SOURCES", "Study", "each_beam"]

N_SOURCES = {beam: row["n_sources"] for beam, row in TABLE_1.items()}
"""Number of components that the paper removes, by beam (Table 1)."""

BEAMS = tuple(N_SOURCES)

_AXES = {
    "angular": {
        "xlabel": r"multipole $\ell$",
        "ylabel": r"$C_\ell$ [mK$^2$]",
        "ratio_label": r"$C / C_0$",
    },
    "frequency": {
        "xlabel": r"$k_\nu$ [MHz$^{-1}$]",
        "ylabel": r"$P(k_\nu)$ [mK$^2$ MHz]",
        "ratio_label": r"$P / P_0$",
    },
}
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9")
_LINES = ("-", "--", "-.", ":", (0, (8, 2)))


def each_beam(make, **changed):
    """{beam: [method]} with the paper's number of components: `make(n_sources)` for each beam.

    >>> each_beam(lambda n: PCA(n_sources=n), oscillating=6)  # doctest: +SKIP
    """
    return {beam: [make(n)] for beam, n in (N_SOURCES | changed).items()}


@dataclass(frozen=True, kw_only=True)
class Study:
    """The three observations of one sky; the fields are the parameters common to all notebooks.

    Attributes
    ----------
    preset, survey
        Name of a preset, and the `Survey` fields that differ from it.
    galaxy, template_dir, small_scales
        Which Galaxy, as in `Galaxy`.
    ripple
        Reading of the oscillating beam's ripple.
    dimming
        A `Dimming` of the foregrounds along the Galactic plane, or None.
    keep_cubes
        Whether cleaned cubes are kept in the cache, or only what is measured on them.
    """

    preset: str = "quick"
    survey: dict = field(default_factory=dict)
    galaxy: str = "synthetic"
    template_dir: str | None = None
    small_scales: bool = True
    ripple: str = "bracket"
    dimming: Dimming | None = None
    keep_cubes: bool = True

    @cached_property
    def made_for(self):
        """The `Survey`."""
        return Survey.preset(self.preset, **self.survey)

    @property
    def l_top(self):
        """2 nside: where the pixels of the maps end to matter."""
        return 2 * self.made_for.nside

    def case(self, beam):
        """The `Case` of one beam.

        Raises
        ------
        InputError
            An unknown beam, survey field, Galaxy or ripple.
        """
        galaxy = Galaxy(source=self.galaxy, template_dir=self.template_dir, small_scales=self.small_scales)
        return pipeline.Case(
            survey=self.made_for, galaxy=galaxy, beam=beam, ripple=self.ripple, dimming=self.dimming
        )

    def observed(self, beam):
        """The `Observation` through one beam."""
        return pipeline.observation(self.case(beam))

    def peak_masked(self, beam):
        """The observed maps with their peaks masked, a `PeakMasked`."""
        return pipeline.peak_masked(self.case(beam))

    def truth(self, beam):
        """The `Spectra` of the truth, HI plus noise through the beam."""
        return pipeline.spectra(self.case(beam))

    def cleaned(self, beam, remover, **options):
        """What `remover` leaves, a `Residual`; options as in `pipeline.cleaned`."""
        return pipeline.cleaned(self.case(beam), remover, **options)

    def assessed(self, beam, remover, *, mask_peaks=True, post_mask=False):
        """How well `remover` did, a `pipeline.Assessment`; keeps the cleaned cube if the study does."""
        if self.keep_cubes:
            self.cleaned(beam, remover, mask_peaks=mask_peaks)
        with_masked = self.case(beam), remover, mask_peaks, True  # holds the other too
        post_mask = post_mask or pipeline.assessment.is_cached(*with_masked)
        return pipeline.assessment(*with_masked[:3], post_mask)

    def spectra(self, beam, remover, **options):
        """The `Spectra` of what `remover` leaves."""
        return self.assessed(beam, remover, **options).spectra

    def compared(self, beam, remover, *, masked=False, **options):
        """Both spectra against the truth, an `results.Comparison`.

        With `masked`, without the lines of sight whose error stands out, in what is left and in the truth.
        """
        found = self.assessed(beam, remover, post_mask=masked, **options)
        pair = (found.masked, found.masked_truth) if masked else (found.spectra, self.truth(beam))
        return Comparison.of(*pair, l_top=self.l_top)

    def prepare(self, removers, *, mask_peaks=True, post_mask=False):
        """Assess {beam: [method, ...]} in as many processes as `himap run --jobs` says; keeps the results."""
        cases = {beam: self.case(beam) for beam in removers}
        check_memory(self.made_for, jobs=n_jobs(), steps=["cleaning"])
        pipeline.prepare(cases.values())
        for product in (pipeline.observation, pipeline.peak_masked):
            make_all(product, [(case,) for case in cases.values()], product.name.rpartition(".")[2])
        calls = [(cases[beam], one, mask_peaks) for beam, methods in removers.items() for one in methods]
        if self.keep_cubes:
            make_all(pipeline.cleaned, calls, "cleaning")
        make_all(pipeline.assessment, [(*call, post_mask) for call in calls], "assessing")

    def check(self, removers):
        """Refuse methods that do not fit the survey now, not after the simulation.

        Raises
        ------
        InputError
            As `ForegroundRemover.check`, or an unknown beam.
        """
        for beam, methods in removers.items():
            self.case(beam)
            for remover in methods:
                remover.check(self.made_for.n_channels)
        if not removers:
            raise InputError("there is nothing to clean: give {beam: [method, ...]}.")

    def stamped(self, figure, **parameters):
        """The figure with a line that says where it comes from, `parameters` of the figure included."""
        where = Provenance.of(self.made_for, galaxy=self.galaxy, preset=self.preset, parameters=parameters)
        return plotting.stamp(figure, where)

    def panel(self, kind, beam, curves, title):
        """One panel of `plotting.spectrum`: `kind` "angular" or "frequency", curves [(style, Comparison)]."""
        true = self.truth(beam)
        shown = Comparison.of(true, true, l_top=self.l_top)
        return _AXES[kind] | {
            "title": title,
            "true": _spectra_of(kind, shown)[:2],
            "curves": [(style, *_spectra_of(kind, one)) for style, one in curves],
        }

    def angular_figure(self, removers, *, ratio_limits=(0, 2), titles=None, **options):
        """C_l of what methods leave, {beam: [method, ...]}: a panel for each beam, ratios below."""
        return self._by_beam("angular", removers, ratio_limits, titles or {}, options)

    def frequency_figure(self, removers, *, ratio_limits=(0, 2), titles=None, **options):
        """P(k) of what methods leave, as `angular_figure`."""
        return self._by_beam("frequency", removers, ratio_limits, titles or {}, options)

    def _by_beam(self, kind, removers, ratio_limits, titles, options):
        panels = [
            self.panel(
                kind,
                beam,
                [(_style(one), self.compared(beam, one, **options)) for one in methods],
                titles.get(beam, _title(beam, methods)),
            )
            for beam, methods in removers.items()
        ]
        return self.stamped(plotting.spectrum(panels, ratio_limits=ratio_limits))

    def both_figure(self, beam, curves, *, ratio_limits=(0, 2), **parameters):
        """P(k) left and C_l right, ratios below, as in the paper's Figs. 4, 6 and 7.

        `curves` are [(style, Comparison)]; `parameters` go into the line under the figure.
        """
        panels = [
            self.panel("frequency", beam, curves, "along the line of sight"),
            self.panel("angular", beam, curves, "across the sky"),
        ]
        figure = plotting.spectrum(panels, ratio_limits=ratio_limits)
        return self.stamped(figure, beam=beam, **parameters)

    @staticmethod
    def style(remover):
        """How a method is drawn in figures, its label included."""
        return dict(_style(remover))

    def ratios(self, beam, remover, **options):
        """(l, C/C0, k, P/P0) of one method, from l = 2 to 2 nside and from the first k above 0."""
        one = self.compared(beam, remover, **options)
        return one.degrees, one.angular_ratio, one.k, one.frequency_ratio

    def bands(self, beam, remover, **options):
        """`diagnostics.band_means` of one method, {name: value}."""
        return diagnostics.band_means(*self.ratios(beam, remover, **options))

    @staticmethod
    def label(remover):
        """What a method is called in figures."""
        return _style(remover)["label"]

    def band_numbers(self, removers, *, tolerance=0.02, **options):
        """`bands` of all methods, for `numbers.show`; `tolerance` is relative, and absolute below 1."""
        return {
            f"{beam}, {_style(one)['label']}: {name}": (value, tolerance * max(1, value))
            for beam, methods in removers.items()
            for one in methods
            for name, value in self.bands(beam, one, **options).items()
        }

    def channel_figure(self, beam, remover, **options):
        """One channel in the middle of the band: observed, cleaned, truth, and what is wrong."""
        observed, result = self.observed(beam), self.cleaned(beam, remover, **options)
        channel = self.made_for.n_channels // 2
        cubes = (observed.maps, result.maps, observed.truth)
        seen, left, truth = (cube[channel] - cube[channel].mean(dtype=float) for cube in cubes)
        freq = f"{observed.freqs[channel]:.0f} MHz"
        maps = {
            f"observed, {freq}": seen,
            "cleaned": left,
            "truth": truth,
            "cleaned minus truth": left - truth,
        }
        common = tuple(np.percentile([left, truth], (1, 99)))  # to be compared with each other
        spans = {"cleaned": common, "truth": common}
        return self.stamped(plotting.sky_maps(maps, span=spans), beam=beam, method=remover.name)

    def mixing_figure(self, beam, remover, *, ylabel="mixing coefficient", names=None, **options):
        """The spectra that a method removes: columns of its mixing matrix against frequency."""
        mixing = self.cleaned(beam, remover, **options).mixing
        curves = []
        for n, column in enumerate(mixing.T):
            look = {"color": _COLOURS[n % 5], "linestyle": _LINES[n % 5]}
            label = names[n] if names else f"component {n + 1}"
            curves.append((self.made_for.freqs, column, look | {"label": label}))
        panel = {"curves": curves, "xlabel": "frequency [MHz]", "ylabel": ylabel}
        return self.stamped(plotting.lines([panel], columns=1, size=(6.4, 4)), beam=beam, method=remover.name)

    def sources_figure(self, beam, remover, *, n_shown=6, limits=(2, 98), **options):
        """The maps that go with the columns of the mixing matrix."""
        sources = self.cleaned(beam, remover, **options).sources[:n_shown]
        maps = {f"component {n + 1}": source for n, source in enumerate(sources)}
        return self.stamped(plotting.sky_maps(maps, limits=limits), beam=beam, method=remover.name)


def _style(remover):
    return plotting.METHOD_STYLES.get(remover.name, {"label": remover.name})


def _spectra_of(kind, one):
    """(x, recovered, true) of a `Comparison`."""
    if kind == "angular":
        return one.degrees, one.angular, one.true_angular
    return one.k, one.frequency, one.true_frequency


def _title(beam, methods):
    """The beam, and the number of components where all methods that have one agree."""
    counts = {one.n_sources for one in methods if hasattr(one, "n_sources")}
    return f"{beam}, {counts.pop()} components" if len(counts) == 1 else beam
