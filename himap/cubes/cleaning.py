"""Foregrounds removed from a cube of one's own, by any method, and what is written of it."""

from dataclasses import dataclass

import numpy as np

from himap.cubes.cube import Cube
from himap.errors import InputError
from himap.removal import available, create
from himap.removal.base import REGISTRY, ForegroundRemover, Separation
from himap.removal.peaks import mask_peaks

__all__ = ["CleanedCube", "clean_cube", "method_for"]

_LEAST_FOR_PEAKS = 8


@dataclass(frozen=True, kw_only=True)
class CleanedCube:
    """What `clean_cube` made of a `Cube`; maps are of its seen pixels.

    Attributes
    ----------
    cube
        What was cleaned.
    method
        The `ForegroundRemover`.
    residual
        The cleaned maps, (n_channels, n_seen) float32, mK.
    separation
        The `Separation`: foreground, mixing matrix, sources.
    flagged
        Share of the voxels that peak masking replaced before the foreground was looked for.
    """

    cube: Cube
    method: object
    residual: np.ndarray
    separation: Separation
    flagged: float

    @property
    def foreground(self):
        """What was subtracted, (n_channels, n_seen) float32, mK."""
        return self.separation.foreground


def clean_cube(cube, method, *, beams=None, peaks=True, seed=2025, **parameters):
    """Remove the foregrounds of a cube.

    Parameters
    ----------
    cube
        A `Cube` (`read_cube`).
    method
        Name of a method, such as "pca"; or a `ForegroundRemover`.
    beams
        b_l, (n_channels, lmax + 1), for methods that use them (`beams_of`).
    peaks
        Whether the foreground is looked for in maps whose peaks are masked (paper, Sect. 4.1).
    seed
        Of the random numbers of methods that draw some.
    parameters
        Of the method, such as n_sources.

    Returns
    -------
    CleanedCube

    Raises
    ------
    InputError
        An unknown method or parameter, a method that needs the whole sky on a part of it, or what the method
        itself refuses.
    """
    remover = method_for(cube, method, **parameters)
    if peaks and len(cube.freqs) < _LEAST_FOR_PEAKS:
        raise InputError(
            f"peak masking fits polynomials of order 6 and needs {_LEAST_FOR_PEAKS} channels, got "
            f"{len(cube.freqs)}; go without it: peaks=False (--keep-peaks)."
        )
    masked = mask_peaks(cube.maps, cube.freqs) if peaks else None
    found = remover.clean(
        cube.maps,
        freqs=cube.freqs,
        beams=beams if remover.needs_beams else None,
        rng=np.random.default_rng(seed),
        separate_on=masked.maps if peaks else None,
    )
    return CleanedCube(
        cube=cube,
        method=remover,
        residual=found.residual,
        separation=found.separation,
        flagged=float(masked.flagged.mean()) if peaks else 0.0,
    )


def method_for(cube, method, **parameters):
    """The `ForegroundRemover` called `method`, if it can clean `cube`.

    Raises
    ------
    InputError
        It cannot, or there is none of that name or with these parameters.
    """
    if not isinstance(method, str | ForegroundRemover):
        raise InputError(f"method must be a name, such as 'pca', or a method, such as PCA(), got {method!r}.")
    if parameters and not isinstance(method, str):
        raise InputError(f"{', '.join(parameters)}: give parameters to {type(method).__name__}(...) itself.")
    remover = create(method, **parameters) if isinstance(method, str) else method
    remover.check(len(cube.freqs))
    if remover.needs_whole_sky and not cube.whole:
        able = [name for name in available() if not REGISTRY[name].needs_whole_sky]
        raise InputError(
            f"{remover.name} transforms whole maps and cannot work on {cube.mask.mean():.1%} of the sky. "
            f"Use a method that takes each line of sight as it comes ({', '.join(able)}), or fill the gaps."
        )
    return remover
