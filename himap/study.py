"""What the notebooks of the companion share: one survey and sky seen through three beams, and its figures.

A notebook makes one `Study` of its parameters, and asks it for cases, cleaned cubes and figures.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from himap import diagnostics, pipeline, plotting
from himap.errors import InputError
from himap.provenance import Provenance
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = ["BEAMS", "N_SOURCES", "Study", "each_beam"]

N_SOURCES = {"degraded": 3, "evolving": 4, "oscillating": 5}
"""Number of components that the paper removes, by beam (Table 1)."""

BEAMS = tuple(N_SOURCES)

ANGULAR_BANDS = ((1, 10), (10, 200))
FREQUENCY_BANDS = ((0, 0.03), (0.03, 0.1), (0.1, np.inf))
PEAK = (0.25, 0.38)  # around 2 pi / 20 MHz, where the 20 MHz ripple of the oscillating beam shows

_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9")
_LINES = ("-", "--", "-.", ":")


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
    """

    preset: str = "quick"
    survey: dict = field(default_factory=dict)
    galaxy: str = "synthetic"
    template_dir: str | None = None
    small_scales: bool = True
    ripple: str = "bracket"

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
        return pipeline.Case(survey=self.made_for, galaxy=galaxy, beam=beam, ripple=self.ripple)

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

    def spectra(self, beam, remover, **options):
        """The `Spectra` of what `remover` leaves."""
        return pipeline.spectra(self.case(beam), remover, **options)

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

    def angular_figure(self, removers, *, ratio_limits=(0.5, 2), titles=None, **options):
        """C_l of what methods leave, {beam: [method, ...]}: a panel for each beam, ratios below."""
        panels = {}
        for beam, methods in removers.items():
            true = self.truth(beam).angular
            curves = [(_style(one), self.spectra(beam, one, **options).angular.mean) for one in methods]
            panels[(titles or {}).get(beam, _title(beam, methods))] = (true.degrees, true.mean, curves)
        labels = {
            "xlabel": r"multipole $\ell$",
            "ylabel": r"$C_\ell$ [mK$^2$]",
            "ratio_label": r"$C_\ell / C_\ell^\mathrm{true}$",
        }
        figure = plotting.spectrum(panels, **labels, x_limits=(2, self.l_top), ratio_limits=ratio_limits)
        return self.stamped(figure)

    def frequency_figure(self, removers, *, ratio_limits=(0.5, 2), titles=None, **options):
        """P(k) of what methods leave, as `angular_figure`."""
        panels = {}
        for beam, methods in removers.items():
            true = self.truth(beam).frequency
            curves = [(_style(one), self.spectra(beam, one, **options).frequency.power) for one in methods]
            panels[(titles or {}).get(beam, _title(beam, methods))] = (true.k, true.power, curves)
        labels = {
            "xlabel": r"$k_\nu$ [MHz$^{-1}$]",
            "ylabel": r"$P(k_\nu)$ [mK$^2$ MHz]",
            "ratio_label": r"$P / P^\mathrm{true}$",
        }
        return self.stamped(plotting.spectrum(panels, **labels, ratio_limits=ratio_limits))

    def ratios(self, beam, remover, **options):
        """(l, C/C0, k, P/P0) of one method, from l = 2 and from the first k above 0."""
        true, found = self.truth(beam), self.spectra(beam, remover, **options)
        return (
            true.angular.degrees[2:],
            diagnostics.ratio(found.angular.mean[2:], true.angular.mean[2:]),
            true.frequency.k[1:],
            diagnostics.ratio(found.frequency.power[1:], true.frequency.power[1:]),
        )

    def bands(self, beam, remover, **options):
        """Means of both ratios over bands, and the highest P/P0 near k = 0.31, {name: value}."""
        degrees, angular, k, frequency = self.ratios(beam, remover, **options)
        numbers = {}
        for low, high in ANGULAR_BANDS:
            high = min(high, self.l_top)
            _add(numbers, f"C/C0, {low} < l < {high}", degrees, angular, low, high, np.mean)
        for low, high in FREQUENCY_BANDS:
            name = f"P/P0, k > {low}" if high == np.inf else f"P/P0, {low} < k < {high}"
            _add(numbers, name, k, frequency, low, high, np.mean)
        _add(numbers, "P/P0, highest near k = 0.31", k, frequency, *PEAK, np.max)
        return numbers

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
        return self.stamped(plotting.sky_maps(maps), beam=beam, method=remover.name)

    def mixing_figure(self, beam, remover, *, ylabel="mixing coefficient", names=None, **options):
        """The spectra that a method removes: columns of its mixing matrix against frequency."""
        mixing = self.cleaned(beam, remover, **options).mixing
        curves = []
        for n, column in enumerate(mixing.T):
            look = {"color": _COLOURS[n % 5], "linestyle": _LINES[n % 4]}
            label = names[n] if names else f"component {n + 1}"
            curves.append((self.made_for.freqs, column, look | {"label": label}))
        panel = {"curves": curves, "xlabel": "frequency [MHz]", "ylabel": ylabel}
        return self.stamped(plotting.lines([panel], columns=1, size=(6.4, 4)), beam=beam, method=remover.name)

    def sources_figure(self, beam, remover, *, n_shown=4, limits=(2, 98), **options):
        """The maps that go with the columns of the mixing matrix."""
        sources = self.cleaned(beam, remover, **options).sources[:n_shown]
        maps = {f"component {n + 1}": source for n, source in enumerate(sources)}
        return self.stamped(plotting.sky_maps(maps, limits=limits), beam=beam, method=remover.name)


def _style(remover):
    return plotting.METHOD_STYLES.get(remover.name, {"label": remover.name})


def _title(beam, methods):
    """The beam, and the number of components where all methods that have one agree."""
    counts = {one.n_sources for one in methods if hasattr(one, "n_sources")}
    return f"{beam}, {counts.pop()} components" if len(counts) == 1 else beam


def _add(numbers, name, x, values, low, high, reduce):
    inside = (x > low) & (x < high)
    if inside.any():
        numbers[name] = float(reduce(values[inside]))
