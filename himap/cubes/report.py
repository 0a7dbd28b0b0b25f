"""A page on a cleaned cube: spectra, leading modes, maps of what is left, and what to look at."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from himap.cubes import page
from himap.errors import InputError
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
from himap.removal.covariance import channel_covariance

__all__ = [
    "SpectraBeside",
    "check_truth",
    "compared",
    "maps_figure",
    "modes_figure",
    "spectra_figure",
    "spectra_of",
    "write_report",
]

_FAINT = 1e-3  # of the faintest eigenvalue before: what cleaning took altogether is drawn there


def spectra_of(cleaned):
    """The `PowerSpectra` of a `CleanedCube`; with a mask C_l are decoupled."""
    cube = cleaned.cube
    return PowerSpectra(
        angular=angular_power(cube.on_sphere(cleaned.residual), mask=_mask_of(cube)),
        frequency=frequency_power(cleaned.residual, cube.channel_width),
    )


class SpectraBeside:
    """`spectra_of` cubes that differ from a first one by a few spectra, without analysing each anew.

    Parameters
    ----------
    first
        A `CleanedCube`; the others are the same cube, cleaned in another way.
    """

    def __init__(self, first):
        self._mask = _mask_of(first.cube)
        self._maps = first.cube.on_sphere(first.residual)
        self._alms = masked_alms(self._maps, mask=self._mask)

    def __call__(self, cleaned):
        maps = cleaned.cube.on_sphere(cleaned.residual)
        more = difference(maps, self._maps, mask=self._mask)
        return PowerSpectra(
            angular=recovered_angular_power(self._alms, more, mask=self._mask),
            frequency=frequency_power(cleaned.residual, cleaned.cube.channel_width),
        )


def _mask_of(cube):
    return None if cube.whole_sky else cube.mask


def compared(cleaned, truth):
    """Both spectra of a `CleanedCube` beside those of the truth, a `Comparison`.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    truth
        A `Cube` of what a perfect cleaning would leave, with the same channels.

    Raises
    ------
    InputError
        A truth of another resolution, other channels, or that does not see what was cleaned.
    """
    cube = cleaned.cube
    check_truth(cube, truth)
    cubes = cleaned.residual, truth.maps[:, cube.mask[truth.mask]]
    recovered, true = (cube.on_sphere(maps) for maps in cubes)
    mask = _mask_of(cube)
    angular = angular_power_pair(true, difference(recovered, true, mask=mask), mask=mask)
    recovered, true = (
        PowerSpectra(angular=power, frequency=frequency_power(maps, cube.channel_width))
        for power, maps in zip(angular, cubes, strict=True)
    )
    return Comparison.of(recovered, true, l_top=2 * cube.nside)


def check_truth(cube, truth):
    """Refuse a truth, a `Cube`, that is not one of `cube`.

    Raises
    ------
    InputError
        It has another resolution or other channels, or does not see what the cube does.
    """
    if truth.nside != cube.nside or len(truth.freqs) != len(cube.freqs):
        raise InputError(
            f"the truth must have the channels and the nside of the cube, {len(cube.freqs)} and "
            f"{cube.nside}; got {len(truth.freqs)} and {truth.nside}."
        )
    differs = ~np.isclose(truth.freqs, cube.freqs, rtol=1e-6, atol=0)
    if differs.any():
        channel = int(differs.argmax())
        raise InputError(
            f"the truth must have the frequencies of the cube, got {truth.freqs[channel]:.10g} MHz where "
            f"that has {cube.freqs[channel]:.10g}."
        )
    if (cube.mask & ~truth.mask).any():
        raise InputError("the truth must see all pixels of the cube.")


def write_report(cleaned, path, *, truth=None, spectra=None, more=()):
    """Write the page to `path`, one HTML file that needs nothing else.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    path
        Of the page.
    truth
        A `Cube` of what a perfect cleaning would leave.
    spectra
        What `compared` gives with a truth, and `spectra_of` without, where it is at hand.
    more
        HTML that stands after the spectra.
    """
    if spectra is None:
        spectra = spectra_of(cleaned) if truth is None else compared(cleaned, truth)
    parts = [*_head(cleaned), *_spectra_part(spectra), *more, *_modes_part(cleaned), *_maps_part(cleaned)]
    Path(path).write_text(page.page(f"Cleaned with {cleaned.method.name}", parts), encoding="utf-8")


def _head(cleaned):
    cube, method = cleaned.cube, cleaned.method
    parameters = [f"{name} = {value}" for name, value in asdict(method).items()]
    facts = {
        "method": ", ".join([method.name, *parameters]),
        "channels": f"{len(cube.freqs)}, {cube.freqs[0]:g} to {cube.freqs[-1]:g} MHz",
        "sky": f"nside {cube.nside}, {cube.mask.mean():.1%} seen",
        "rms of what came": f"{_rms(cube.maps):.4g} mK",
        "rms of what is left": f"{_rms(cleaned.residual):.4g} mK",
        "peak masking": f"{cleaned.flagged:.2%} of the voxels replaced before the foreground was looked for",
        "iterations": f"{cleaned.separation.n_iterations}",
    }
    notes = [*cube.remarks, *cleaned.remarks]
    return [Table([], facts.items()).html(), *map(page.note, notes)]


def _rms(maps):
    """Rms of maps less their channel means, mK."""
    return float(np.sqrt(np.mean([pixels.var(dtype=np.float64) for pixels in maps])))


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


def _spectra_part(spectra):
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
            ("C/C0, l < 10", _mean(spectra.degrees, spectra.angular_ratio, 0, 10)),
            ("C/C0, beyond", _mean(spectra.degrees, spectra.angular_ratio, 10, np.inf)),
            ("P/P0, k < 0.03 / MHz", _mean(spectra.k, spectra.frequency_ratio, 0, 0.03)),
            ("P/P0, beyond", _mean(spectra.k, spectra.frequency_ratio, 0.03, np.inf)),
        ]
        parts += ["<h3>Over the truth</h3>", Table([], rows).html()]
    return parts


def _mean(x, values, low, high):
    inside = (x > low) & (x < high)
    return f"{values[inside].mean():.3f}" if inside.any() else "no such scale"


def modes_figure(cleaned):
    """Eigenvalues of the channel covariance before and after, and the mixing matrix."""
    cube = cleaned.cube
    before, after = (
        np.linalg.eigvalsh(channel_covariance(maps))[::-1] for maps in (cube.maps, cleaned.residual)
    )
    numbers = np.arange(1, len(before) + 1)
    mixing = cleaned.separation.mixing
    blue = {"color": styles.BLUE}
    panels = [
        {
            "title": "Eigenvalues of the channel covariance",
            "xlabel": "component",
            "ylabel": r"variance [mK$^2$]",
            "xscale": "log",
            "yscale": "log",
            "curves": [
                (numbers, before, {"label": "as it came", "color": styles.VERMILION}),
                (numbers, np.maximum(after, before.min() * _FAINT), blue | {"label": "cleaned"}),
            ],
        },
        {
            "title": "Spectra of the sources",
            "xlabel": styles.CHANNELS,
            "ylabel": "mixing coefficient",
            "legend": {"loc": "center left", "bbox_to_anchor": (1, 0.5)},
            "curves": [
                (cube.freqs, column, style)
                for column, style in zip(
                    mixing.T,
                    styles.sequence([f"source {n + 1}" for n in range(mixing.shape[1])]),
                    strict=True,
                )
            ],
        },
    ]
    return plotting.lines(panels)


def _modes_part(cleaned):
    text = (
        "Foreground components stand above the slow decline of HI and noise. Cleaned eigenvalues that stand "
        "out still mean too few sources; spectra that are one spike mean too many. The last eigenvalues "
        "after cleaning, as many as there were sources, are zero but for rounding."
    )
    return [
        "<h2>Leading modes</h2>",
        page.figure(modes_figure(cleaned), "Eigenvalues and mixing matrix", text),
    ]


def maps_figure(cleaned):
    """What is left in the channel in the middle, and its rms over channels."""
    cube, middle = cleaned.cube, len(cleaned.cube.freqs) // 2
    maps = {
        f"left at {cube.freqs[middle]:g} MHz": cleaned.residual[middle],
        "rms over channels": np.sqrt(np.einsum("cp,cp->p", *[cleaned.residual] * 2) / len(cube.freqs)),
    }
    spans = {title: tuple(np.percentile(pixels, (1, 99))) for title, pixels in maps.items()}
    return plotting.sky_maps({title: _with_gaps(cube, pixels) for title, pixels in maps.items()}, span=spans)


def _maps_part(cleaned):
    text = (
        "HI and noise look alike in all directions. Structure that follows the Galaxy or point sources is "
        "foreground; lines of sight whose rms stands out can be left out of the spectra."
    )
    return ["<h2>What is left</h2>", page.figure(maps_figure(cleaned), "Maps of the residual", text)]


def _with_gaps(cube, pixels):
    out = np.full(len(cube.mask), np.nan)
    out[cube.mask] = pixels
    return out
