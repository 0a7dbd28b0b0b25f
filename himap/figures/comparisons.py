"""Spectra of cleaned cubes beside the truth, as panels of `plotting.spectrum`."""

from himap.figures.styles import AXES


def panel(kind, curves, *, title="", true=None):
    """One panel: ``kind`` "angular" or "frequency".

    Parameters
    ----------
    kind
        Which of the two power spectra.
    curves
        [(style, `Comparison`)].
    title
        Above it.
    true
        The `Comparison` whose truth is drawn; that of the first curve unless given.
    """
    truth = _spectra_of(kind, curves[0][1] if true is None else true)
    return AXES[kind] | {
        "title": title,
        "true": (truth[0], truth[2]),
        "curves": [(style, *_spectra_of(kind, comparison)) for style, comparison in curves],
    }


def _spectra_of(kind, comparison):
    """(x, recovered, true) of a `Comparison`."""
    if kind == "angular":
        return comparison.degrees, comparison.angular, comparison.true_angular
    return comparison.k, comparison.frequency, comparison.true_frequency
