"""Figures shared by the notebooks, for beams and methods of a `Study`: no number depends on them.

Methods are {beam: [method, ...]}; options are those of the method of `Study` that a figure uses.
"""

from dataclasses import replace

import numpy as np

from himap.figures import plotting, styles
from himap.measures.diagnostics import Comparison
from himap.paper import pipeline
from himap.removal.restarts import has_restarts


def angular_figure(study, removers, *, titles=None, **options):
    """C_l of residuals: a panel for each beam, ratios below."""
    return _by_beam(study, "angular", removers, titles or {}, options)


def frequency_figure(study, removers, *, titles=None, **options):
    """P(k) of residuals, like `angular_figure`."""
    return _by_beam(study, "frequency", removers, titles or {}, options)


def _by_beam(study, kind, removers, titles, options):
    found = {
        beam: {method: study.ensemble(beam, method, **options) for method in methods}
        for beam, methods in removers.items()
    }
    panels, by_name = [], {}  # for one legend
    for method, members in (pair for ensembles in found.values() for pair in ensembles.items()):
        by_name.setdefault(method.name, []).append(members)
    for beam, methods in removers.items():
        curves = [
            (ensemble_style(styles.method_style(method), *by_name[method.name]), members)
            for method, members in found[beam].items()
        ]
        counts = {method.n_sources for method in methods if hasattr(method, "n_sources")}
        title = f"{beam}, {counts.pop()} components" if len(counts) == 1 else str(beam)
        panels.append(_panel(study, kind, beam, curves, titles.get(beam, title)))
    every = [method for methods in removers.values() for method in methods]
    return study.stamped(plotting.spectrum(panels), **_reading(*every))


def ensemble_style(style, *ensembles):
    """A style whose label has the numbers of members and of failures, for lists of `Comparison` by panel."""
    failed = [sum(one.fails for one in members) for members in ensembles]
    return styles.of_restarts(style, *failed, n=len(ensembles[0]))


def median_of(members):
    """Medians of the spectra of several `Comparison` at the same l and k, as one `Comparison`.

    For figures with several ensembles whose bands would hide each other.
    """
    medians = {
        name: np.median([getattr(one, name) for one in members], axis=0) for name in ("angular", "frequency")
    }
    return replace(members[0], **medians)


def both_figure(study, beam, curves, **parameters):
    """P(k) left and C_l right, ratios below, as in the paper's Figs. 4, 6 and 7.

    `curves` are as in `plotting.comparison_panel`; `parameters` are added to the line under the figure.
    """
    panels = [
        _panel(study, "frequency", beam, curves, "along the line of sight"),
        _panel(study, "angular", beam, curves, "across the sky"),
    ]
    return study.stamped(plotting.spectrum(panels), beam=beam, **parameters)


def channel_figure(study, beam, remover, **options):
    """One channel in the middle of the band: observed, cleaned, truth, and error."""
    observation, found = study.observed(beam), study.separation(beam, remover, **options)
    channel = study.survey.n_channels // 2
    only = slice(channel, channel + 1)
    (residual,) = study.residual(beam, remover, channels=only, **options)
    (truth,) = pipeline.truth(study.case(beam), found.lmax, only)
    maps = (observation.maps[channel], residual, truth)
    observed, residual, truth = (one - one.mean(dtype=float) for one in maps)
    maps = {
        f"observed, {observation.freqs[channel]:.0f} MHz": observed,
        "cleaned": residual,
        "truth": truth,
        "cleaned minus truth": residual - truth,
    }
    span = tuple(np.percentile([residual, truth], (1, 99)))  # the same for both, to compare them
    figure = plotting.sky_maps(
        maps, span={"cleaned": span, "truth": span}, diverging={"cleaned minus truth": True}
    )
    return _of_method(study, figure, beam, remover)


def mixing_figure(study, beam, remover, **options):
    """The spectra that a method removes: columns of its mixing matrix by frequency."""
    columns = study.separation(beam, remover, **options).mixing.T
    looks = styles.sequence([f"component {n + 1}" for n in range(len(columns))])
    curves = [(study.survey.freqs, one, look) for one, look in zip(columns, looks, strict=True)]
    panel = {"curves": curves, "xlabel": styles.CHANNELS, "ylabel": "mixing coefficient"}
    return _of_method(study, plotting.lines([panel], columns=1, size=(6.4, 4)), beam, remover)


def sources_figure(study, beam, remover, *, most=6, **options):
    """The maps of the first `most` columns of the mixing matrix."""
    sources = study.separation(beam, remover, **options).sources[:most]
    maps = {f"component {n + 1}": source for n, source in enumerate(sources)}
    return _of_method(study, plotting.sky_maps(maps, limits=(2, 98)), beam, remover)


def _panel(study, kind, beam, curves, title):
    truth = study.truth(beam)
    comparison = Comparison.of(truth, truth, l_top=study.l_top)
    return plotting.comparison_panel(kind, curves, title=title, true=comparison)


def _of_method(study, figure, beam, remover):
    restart = {"restart": remover.restart} if study.n_restarts > 1 and has_restarts(remover) else {}
    return study.stamped(figure, beam=beam, method=remover.name, **restart, **_reading(remover))


def _reading(*methods):
    """{"reading": readings of these methods}, for the line under a figure; empty if none has one."""
    readings = dict.fromkeys(method.reading for method in methods if hasattr(method, "reading"))
    return {"reading": " and ".join(readings)} if readings else {}
