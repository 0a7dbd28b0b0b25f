"""A page on a cleaned cube: spectra, leading modes, maps of the residual, and what to look at."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from himap.core.errors import InputError
from himap.cubes import page
from himap.cubes.views import spectra_figure, views_of
from himap.figures import plotting, styles
from himap.figures.tables import Table
from himap.removal.covariance import channel_covariance

__all__ = [
    "check_truth",
    "compared",
    "maps_figure",
    "modes_figure",
    "spectra_figure",
    "spectra_of",
    "views_of",
    "write_report",
]

_ALIKE = 1e-5  # relative: the same maps but for rounding
_FAINT = 1e-3  # of the faintest eigenvalue before: what cleaning took altogether is drawn there
_MODES = (
    "Foreground components stand above the slow decline of HI and noise. Cleaned eigenvalues that stand "
    "out still mean too few sources; spectra that are one spike mean too many. The last eigenvalues "
    "after cleaning, as many as there were sources, are zero but for rounding."
)
_MAPS = (
    "HI and noise look alike in all directions. Structure that follows the Galaxy or point sources is "
    "foreground; lines of sight whose rms stands out can be left out of the spectra."
)


def spectra_of(cleaned):
    """The power spectra of a `CleanedCube`.

    Returns
    -------
    PowerSpectra or PlaneSpectra
        Of HEALPix maps C_l, decoupled with a mask, and P(k_nu); of images P(k_perp, k_par) and P(k_nu).
    """
    return views_of(cleaned.cube).spectra_of(cleaned)


def compared(cleaned, truth):
    """The spectra of a `CleanedCube` beside those of the truth.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    truth
        A `Cube` of what a perfect cleaning would leave, with the same channels.

    Returns
    -------
    Comparison or PlaneSpectra

    Raises
    ------
    InputError
        A truth of other pixels, other channels, or that does not see what was cleaned.
    """
    cube = cleaned.cube
    check_truth(cube, truth)
    return views_of(cube).compared(cleaned, cube.seen_of(truth))


def check_truth(cube, truth):
    """Refuse a truth, a `Cube`, that is not one of `cube`.

    Raises
    ------
    InputError
        It has another resolution or other channels, does not see what the cube does, or is the cube itself.
    """
    pixels, others = cube.layout.pixels, truth.layout.pixels
    if not pixels.same(others) or len(truth.freqs) != len(cube.freqs):
        raise InputError(
            f"the truth must have the channels and the {pixels.grid} of the cube, {len(cube.freqs)} and "
            f"{pixels}; got {len(truth.freqs)} and {others}."
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
    seen = cube.mask[truth.mask]
    if all(
        np.allclose(true[seen], pixels, rtol=_ALIKE, atol=0)
        for true, pixels in zip(truth.maps, cube.maps, strict=True)
    ):
        raise InputError(
            "the truth is the cube itself: give what a perfect cleaning would leave, HI and noise."
        )


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
    parts = [
        *_head(cleaned),
        *views_of(cleaned.cube).spectra_part(cleaned, spectra),
        *more,
        *page.section("Leading modes", modes_figure(cleaned), "Eigenvalues and mixing matrix", _MODES),
        *page.section("What is left", maps_figure(cleaned), "Maps of the residual", _MAPS),
    ]
    Path(path).write_text(page.page(f"Cleaned with {cleaned.method.name}", parts), encoding="utf-8")


def _head(cleaned):
    cube, method, pixels = cleaned.cube, cleaned.method, cleaned.cube.layout.pixels
    parameters = [f"{name} = {value}" for name, value in asdict(method).items()]
    facts = {
        "method": ", ".join([method.name, *parameters]),
        "channels": f"{len(cube.freqs)}, {cube.freqs[0]:g} to {cube.freqs[-1]:g} MHz",
        "sky": f"{pixels.grid} {pixels}, {cube.mask.mean():.1%} seen",
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


def modes_figure(cleaned):
    """Eigenvalues of the channel covariance before and after, and the mixing matrix."""
    cube = cleaned.cube
    before, after = (
        np.linalg.eigvalsh(channel_covariance(maps))[::-1] for maps in (cleaned.maps, cleaned.residual)
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


def maps_figure(cleaned):
    """What is left in the channel in the middle, and its rms over channels."""
    return views_of(cleaned.cube).maps_figure(cleaned)
