"""How a cleaned cube of HEALPix maps is judged and shown: C_l, P(k_nu), maps of the sky."""

import numpy as np

from himap.cubes import page
from himap.figures import comparisons, plotting, styles
from himap.figures.tables import Table
from himap.measures.difference import difference
from himap.measures.power_spectra import (
    angular_power,
    angular_power_pair,
    frequency_power,
    masked_alms,
    recovered_angular_power,
)
from himap.measures.results import Comparison, PowerSpectra

__all__ = [
    "compared",
    "maps_figure",
    "scales",
    "spectra_beside",
    "spectra_figure",
    "spectra_of",
    "spectra_part",
]


def spectra_of(cleaned):
    """The `PowerSpectra` of a `CleanedCube`; with a mask C_l are decoupled."""
    cube = cleaned.cube
    return PowerSpectra(
        angular=angular_power(cube.on_sphere(cleaned.residual), mask=cube.sky_mask),
        frequency=frequency_power(cleaned.residual, cube.channel_width),
    )


def spectra_beside(first):
    """`spectra_of`, for cubes that differ from a first one by a few spectra, without analysing each anew.

    Parameters
    ----------
    first
        A `CleanedCube`; the others are the same cube, cleaned in another way.

    Returns
    -------
    callable
        It takes one of them.
    """
    mask = first.cube.sky_mask
    maps = first.cube.on_sphere(first.residual)
    alms = masked_alms(maps, mask=mask)

    def spectra(cleaned):
        more = difference(cleaned.cube.on_sphere(cleaned.residual), maps, mask=mask)
        return PowerSpectra(
            angular=recovered_angular_power(alms, more, mask=mask),
            frequency=frequency_power(cleaned.residual, cleaned.cube.channel_width),
        )

    return spectra


def compared(cleaned, true):
    """Both spectra of a `CleanedCube` beside those of the truth, (n_channels, n_seen): a `Comparison`."""
    cube = cleaned.cube
    cubes = cleaned.residual, true
    recovered, true = (cube.on_sphere(maps) for maps in cubes)
    mask = cube.sky_mask
    angular = angular_power_pair(true, difference(recovered, true, mask=mask), mask=mask)
    recovered, true = (
        PowerSpectra(angular=power, frequency=frequency_power(maps, cube.channel_width))
        for power, maps in zip(angular, cubes, strict=True)
    )
    return Comparison.of(recovered, true, l_top=2 * cube.nside)


def scales(cube, spectra):
    """C_l for 2 <= l <= 2 nside, and P(k) for k > 0."""
    inside = (spectra.angular.degrees >= 2) & (spectra.angular.degrees <= 2 * cube.nside)
    return spectra.angular.mean[inside], spectra.frequency.power[1:]


def spectra_figure(spectra):
    """Both spectra, `PowerSpectra`, or with their ratios to the truth, a `Comparison`."""
    style = {"label": "cleaned", "color": styles.BLUE}
    if isinstance(spectra, Comparison):
        panels = [comparisons.panel(kind, [(style, spectra)]) for kind in ("angular", "frequency")]
        return plotting.spectrum(panels)
    values = {
        "angular": (spectra.angular.degrees, spectra.angular.mean),
        "frequency": (spectra.frequency.k, spectra.frequency.power),
    }
    panels = []
    for kind, (x, y) in values.items():
        labels = {name: styles.AXES[kind][name] for name in ("xlabel", "ylabel")}
        curves = {"curves": [(x[x > 0], y[x > 0], style)]}
        panels.append(labels | curves | {"xscale": "log", "yscale": "log"})
    return plotting.lines(panels)


def spectra_part(cleaned, spectra):
    """HTML of both spectra, and of their ratios to the truth where it is known."""
    text = (
        "A smooth, steep rise towards the smallest k is foreground that is left; a dip there is signal that "
        "was taken. A bump at one k is a ripple of the instrument. A rise towards the largest multipoles, "
        "after a method that uses the beam, means that the beam is not that of the cube."
    )
    parts = [
        "<h2>Spectra</h2>",
        page.figure(spectra_figure(spectra), "Angular and frequency power spectrum", text),
    ]
    if isinstance(spectra, Comparison):
        rows = [
            ("C/C0, l < 10", page.mean_ratio(spectra.degrees, spectra.angular_ratio, 0, 10)),
            ("C/C0, beyond", page.mean_ratio(spectra.degrees, spectra.angular_ratio, 10, np.inf)),
            ("P/P0, k < 0.03 / MHz", page.mean_ratio(spectra.k, spectra.frequency_ratio, 0, 0.03)),
            ("P/P0, beyond", page.mean_ratio(spectra.k, spectra.frequency_ratio, 0.03, np.inf)),
        ]
        parts += ["<h3>Over the truth</h3>", Table([], rows).html()]
    return parts


def maps_figure(cleaned):
    """What is left in the channel in the middle, and its rms over channels."""
    maps, spans = page.maps_of_residual(cleaned)
    return plotting.sky_maps(maps, span=spans)
