"""What the notebooks share: one survey and sky seen through several beams, and its figures.

A notebook makes one `Study` of its parameters, and asks it for cases, cleaned cubes and figures.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from himap.errors import InputError
from himap.figures import comparisons, plotting, styles
from himap.measures import diagnostics
from himap.measures.results import Comparison
from himap.paper import cleaned, pipeline, plan
from himap.products.provenance import Provenance
from himap.sky.dimming import Dimming
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = ["Study"]

_LINES = ("-", "--", "-.", ":", (0, (8, 2)))


@dataclass(frozen=True, kw_only=True)
class Study:
    """The observations of one sky; the fields are the parameters common to all notebooks.

    Attributes
    ----------
    preset, overrides
        Name of a preset, and the `Survey` fields that differ from it.
    galaxy, template_dir, small_scales
        Which Galaxy, as in `Galaxy`.
    dimming
        A `Dimming` of the foregrounds along the Galactic plane, or None.
    keep_separations
        Whether what methods find is kept where only what is measured on it is asked for (`assessed`,
        `prepare`): figures of a method need it.
    """

    preset: str = "quick"
    overrides: dict = field(default_factory=dict)
    galaxy: str = "synthetic"
    template_dir: str | None = None
    small_scales: bool = True
    dimming: Dimming | None = None
    keep_separations: bool = True

    @cached_property
    def survey(self):
        """The `Survey`."""
        return Survey.preset(self.preset, **self.overrides)

    @property
    def l_top(self):
        """2 nside: where the pixels of the maps end to matter."""
        return 2 * self.survey.nside

    @cached_property
    def milky_way(self):
        """The `Galaxy`."""
        return Galaxy(source=self.galaxy, template_dir=self.template_dir, small_scales=self.small_scales)

    def case(self, beam):
        """The `Case` of one `Beam`.

        Raises
        ------
        InputError
            A survey field, a Galaxy or a beam that cannot be.
        """
        return pipeline.Case(survey=self.survey, galaxy=self.milky_way, beam=beam, dimming=self.dimming)

    def observed(self, beam):
        """The `Observation` through one beam."""
        return pipeline.observation(self.case(beam))

    def peak_masked(self, beam):
        """The observed maps with their peaks masked, a `PeakMasked`."""
        return pipeline.peak_masked(self.case(beam))

    def truth(self, beam):
        """The `PowerSpectra` of the truth, HI plus noise through the beam."""
        return pipeline.true_spectra(self.case(beam))

    def separation(self, beam, remover, **options):
        """What `remover` finds, a `Separation`; options as in `cleaned.separation`."""
        return cleaned.separation(self.case(beam), remover, **options)

    def residual(self, beam, remover, *, mask_peaks=True, channels=slice(None)):
        """The cube that `remover` leaves, (n_channels, n_pix) float32, mK, or some channels; made anew."""
        self.separation(beam, remover, mask_peaks=mask_peaks)
        return cleaned.residual(self.case(beam), remover, mask_peaks, channels)

    def assessed(self, beam, remover, *, mask_peaks=True, post_mask=False):
        """How well `remover` did, an `Assessment`; keeps what was found if the study does."""
        if self.keep_separations:
            self.separation(beam, remover, mask_peaks=mask_peaks)
        return cleaned.assessment(self.case(beam), remover, mask_peaks, post_mask)

    def compared(self, beam, remover, *, masked=False, **options):
        """Both spectra against the truth, a `Comparison`.

        With `masked`, without the lines of sight whose error stands out, in what is left and in the truth.
        """
        result = self.assessed(beam, remover, post_mask=masked, **options)
        true = result.truth or self.truth(beam)
        pair = (result.masked, result.masked_truth) if masked else (result.power_spectra, true)
        return Comparison.of(*pair, l_top=self.l_top)

    def prepare(self, removers, *, mask_peaks=True, post_mask=False):
        """Assess {beam: [method, ...]} in as many processes as `himap run --jobs` says; keeps the results."""
        calls = [
            (self.case(beam), method, mask_peaks, post_mask)
            for beam, methods in removers.items()
            for method in methods
        ]
        plan.make(calls, keep_separations=self.keep_separations)

    def check(self, removers):
        """Refuse methods that do not fit the survey now, not after the simulation.

        Raises
        ------
        InputError
            As `ForegroundRemover.check`, or a beam that does not fit the survey.
        """
        for beam, methods in removers.items():
            self.case(beam)
            for remover in methods:
                remover.check(self.survey.n_channels)
        if not removers:
            raise InputError("there is nothing to clean: give {beam: [method, ...]}.")

    def stamped(self, figure, **parameters):
        """The figure with a line that says where it comes from, `parameters` of the figure included.

        The reading of SDecGMCA, `reading`, is said unless it is the default.
        """
        if parameters.get("reading") == "default":
            del parameters["reading"]
        made = Provenance.of(self.survey, galaxy=self.milky_way, preset=self.preset, parameters=parameters)
        return plotting.stamp(figure, made)

    def panel(self, kind, beam, curves, title):
        """One panel of `plotting.spectrum`: `kind` "angular" or "frequency", curves [(style, Comparison)]."""
        truth = self.truth(beam)
        comparison = Comparison.of(truth, truth, l_top=self.l_top)
        return comparisons.panel(kind, curves, title=title, true=comparison)

    def angular_figure(self, removers, *, titles=None, **options):
        """C_l of what methods leave, {beam: [method, ...]}: a panel for each beam, ratios below."""
        return self._by_beam("angular", removers, titles or {}, options)

    def frequency_figure(self, removers, *, titles=None, **options):
        """P(k) of what methods leave, as `angular_figure`."""
        return self._by_beam("frequency", removers, titles or {}, options)

    def _by_beam(self, kind, removers, titles, options):
        panels = [
            self.panel(
                kind,
                beam,
                [(styles.method_style(method), self.compared(beam, method, **options)) for method in methods],
                titles.get(beam, _title(beam, methods)),
            )
            for beam, methods in removers.items()
        ]
        every = [method for methods in removers.values() for method in methods]
        return self.stamped(plotting.spectrum(panels), **_reading(*every))

    def both_figure(self, beam, curves, **parameters):
        """P(k) left and C_l right, ratios below, as in the paper's Figs. 4, 6 and 7.

        `curves` are [(style, Comparison)]; `parameters` go into the line under the figure.
        """
        panels = [
            self.panel("frequency", beam, curves, "along the line of sight"),
            self.panel("angular", beam, curves, "across the sky"),
        ]
        return self.stamped(plotting.spectrum(panels), beam=beam, **parameters)

    def ratios(self, beam, remover, **options):
        """(l, C/C0, k, P/P0) of one method, from l = 2 to 2 nside and from the first k above 0."""
        result = self.compared(beam, remover, **options)
        return result.degrees, result.angular_ratio, result.k, result.frequency_ratio

    def bands(self, beam, remover, **options):
        """`diagnostics.band_means` of one method, {name: value}."""
        return diagnostics.band_means(*self.ratios(beam, remover, **options))

    def band_numbers(self, removers, *, tolerance=0.02, **options):
        """`bands` of all methods, for `numbers.show`; `tolerance` is relative, and absolute below 1."""
        return {
            f"{beam}, {styles.method_style(method)['label']}: {name}": (value, tolerance * max(1, value))
            for beam, methods in removers.items()
            for method in methods
            for name, value in self.bands(beam, method, **options).items()
        }

    def channel_figure(self, beam, remover, **options):
        """One channel in the middle of the band: observed, cleaned, truth, and what is wrong."""
        observation, found = self.observed(beam), self.separation(beam, remover, **options)
        channel = self.survey.n_channels // 2
        only = slice(channel, channel + 1)
        (left,) = self.residual(beam, remover, channels=only, **options)
        (truth,) = pipeline.truth(self.case(beam), found.lmax, only)
        maps = (observation.maps[channel], left, truth)
        observed, left, truth = (one - one.mean(dtype=float) for one in maps)
        maps = {
            f"observed, {observation.freqs[channel]:.0f} MHz": observed,
            "cleaned": left,
            "truth": truth,
            "cleaned minus truth": left - truth,
        }
        common = tuple(np.percentile([left, truth], (1, 99)))  # to be compared with each other
        spans = {"cleaned": common, "truth": common}
        wrong = {"cleaned minus truth": True}
        return self._of_method(plotting.sky_maps(maps, span=spans, diverging=wrong), beam, remover)

    def mixing_figure(self, beam, remover, *, ylabel="mixing coefficient", names=None, **options):
        """The spectra that a method removes: columns of its mixing matrix against frequency."""
        mixing = self.separation(beam, remover, **options).mixing
        curves = []
        for n, column in enumerate(mixing.T):
            style = {"color": styles.COLOURS[n % 5], "linestyle": _LINES[n % 5]}
            label = names[n] if names else f"component {n + 1}"
            curves.append((self.survey.freqs, column, style | {"label": label}))
        panel = {"curves": curves, "xlabel": styles.CHANNELS, "ylabel": ylabel}
        return self._of_method(plotting.lines([panel], columns=1, size=(6.4, 4)), beam, remover)

    def sources_figure(self, beam, remover, *, n_shown=6, limits=(2, 98), **options):
        """The maps that go with the columns of the mixing matrix."""
        sources = self.separation(beam, remover, **options).sources[:n_shown]
        maps = {f"component {n + 1}": source for n, source in enumerate(sources)}
        return self._of_method(plotting.sky_maps(maps, limits=limits), beam, remover)

    def _of_method(self, figure, beam, remover):
        return self.stamped(figure, beam=beam, method=remover.name, **_reading(remover))


def _title(beam, methods):
    """The beam, and the number of components where all methods that have one agree."""
    counts = {method.n_sources for method in methods if hasattr(method, "n_sources")}
    return f"{beam}, {counts.pop()} components" if len(counts) == 1 else str(beam)


def _reading(*methods):
    """{"reading": how these methods read the paper}, for the line under a figure; empty if none has to."""
    readings = dict.fromkeys(method.reading for method in methods if hasattr(method, "reading"))
    return {"reading": " and ".join(readings)} if readings else {}
