"""The figures of a `himap.paper.study.Study`: they show its numbers, and no number depends on them."""

import numpy as np

from himap.figures import plotting, styles
from himap.measures.diagnostics import Comparison
from himap.paper import pipeline
from himap.store.provenance import Provenance

_LINES = ("-", "--", "-.", ":", (0, (8, 2)))


class StudyFigures:
    """The figures that the notebooks share, of beams and methods of a `Study`."""

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
        return plotting.comparison_panel(kind, curves, title=title, true=comparison)

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
