"""Colours, lines and axis labels: consistent throughout figures, reports and notebooks.

Colours are those of Okabe and Ito, which colour-blind readers can distinguish, plus an indigo, a wine red, an
olive and a grey for methods that are not the paper's; line styles also differ, to be distinguishable in
grey.
"""

import matplotlib
import numpy as np

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, VERMILION = COLOURS
INDIGO = "#332288"

CHANNELS = "frequency [MHz]"
"""Axis label for channels."""

AXES = {
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
"""Axis labels for both power spectra, and for their ratios to the truth."""

_PALER = 0.28  # share of the way to white

METHOD_STYLES = {
    "pca": {"label": "PCA", "color": BLUE, "linestyle": "--"},
    "fastica": {"label": "FastICA", "color": ORANGE, "linestyle": (0, (1, 1.2))},
    "gmca": {"label": "GMCA", "color": GREEN, "linestyle": "-."},
    "sdecgmca": {"label": "SDecGMCA", "color": VERMILION, "linestyle": "-"},
    "polynomial": {"label": "polynomial", "color": PURPLE, "linestyle": (0, (3, 1, 1, 1, 1, 1))},
    "parametric": {"label": "parametric", "color": SKY_BLUE, "linestyle": (0, (8, 3))},
    "beam_subspace": {"label": "BeamSubspace", "color": INDIGO, "linestyle": (0, (10, 1.5, 1, 1.5))},
    "smooth_spectra": {"label": "SmoothSpectra", "color": "#882255", "linestyle": (0, (5, 1))},
    "gnilc": {"label": "GNILC", "color": "#999933", "linestyle": (0, (4, 1, 1, 1))},
    "gaussian_process": {"label": "Gaussian process", "color": "0.45", "linestyle": (0, (2, 2))},
}
for _name in ("sdecgmca", "beam_subspace", "smooth_spectra"):
    METHOD_STYLES[_name]["linewidth"] = 2
"""Line style of every method that comes with himap: the paper's six, ours and those of others."""


def numbered(name, n_sources):
    """Name of a method in a legend, with its number of sources; 0 or None if it has none."""
    label = METHOD_STYLES.get(name, {"label": name})["label"]
    return f"{label} {n_sources}" if n_sources else label


BEAM_STYLES = {
    "degraded": {"label": "degraded", "color": BLUE, "linestyle": "-"},
    "evolving": {"label": "evolving", "color": ORANGE, "linestyle": "--"},
    "oscillating": {"label": "oscillating", "color": GREEN, "linestyle": "-."},
    "meerkat": {"label": "MeerKAT", "color": PURPLE, "linestyle": (0, (1, 1.2))},
    "meerkat_lobes": {"label": "MeerKAT, side lobes", "color": VERMILION, "linestyle": (0, (6, 1.5))},
    "rippled": {"label": "rippled", "color": SKY_BLUE, "linestyle": (0, (8, 3))},
    "misjudged": {"label": "misjudged", "color": "0.45", "linestyle": (0, (3, 1, 1, 1))},
}
"""Line style of every beam that comes with himap."""

_OTHER = {"color": "0.35", "linestyle": (0, (6, 1, 1, 1, 1, 1, 1, 1))}
_UNLIKE = ("-", (0, (1, 1)), (0, (12, 3)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1)))
_DASHES = ("-", (0, (6, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1)))


def method_style(method):
    """Style of the curves of a `ForegroundRemover`, including its label."""
    return METHOD_STYLES.get(method.name, _OTHER | {"label": method.name})


def beam_style(beam):
    """Style of the curves of a `Beam`, including its label."""
    return BEAM_STYLES.get(beam.name, _OTHER | {"label": str(beam)})


def of_methods(methods):
    """{(name, number): style} of methods of which some appear more than once, in their order.

    Repetitions are paler, and have other dashes than the first; the second has none, or dots if the first
    has none. A number is that of sources, or a text with it.
    """
    looks, n_of = {}, {}
    for name, number in methods:
        n = n_of[name] = n_of.get(name, -1) + 1
        style = METHOD_STYLES.get(name, _OTHER)
        ink = 1 - np.array(matplotlib.colors.to_rgb(style["color"]))
        dashes = [style["linestyle"], *(one for one in _UNLIKE if one != style["linestyle"])]
        looks[name, number] = {
            "color": tuple(1 - ink * (1 - _PALER) ** n),
            "linestyle": dashes[n % len(_DASHES)],
            "label": numbered(name, number),
            "linewidth": 1.6,
        }
    return looks


def of_restarts(style, *failed, n):
    """The style of a curve for `n` restarts; its label says so, and how many failed (in each panel).

    >>> of_restarts({"label": "SDecGMCA"}, 0, 1, n=4)
    {'label': 'SDecGMCA, median of 4 (0, 1 failed)'}
    """
    if n == 1:
        return style
    return style | {"label": f"{style['label']}, median of {n} ({', '.join(map(str, failed))} failed)"}


def sequence(labels):
    """Styles of curves with an order, such as one for each number of components: [style, ...].

    Colours go from dark to light, perceptually evenly, also for colour-blind readers and in grey; neighbours
    also differ in their dashes.
    """
    colours = matplotlib.colormaps["plasma"](np.linspace(0.05, 0.9, len(labels)))
    return [
        {"label": label, "color": colour, "linestyle": _DASHES[n % len(_DASHES)], "linewidth": 1.6}
        for n, (label, colour) in enumerate(zip(labels, colours, strict=True))
    ]
