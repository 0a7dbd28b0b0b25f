"""Foregrounds removed from a cube of one's own, by any method, and what is written of it."""

from dataclasses import dataclass

import numpy as np

from himap.core.errors import InputError
from himap.cubes.cube import Cube
from himap.removal import available, create
from himap.removal.base import REGISTRY, Cleaned, ForegroundRemover
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data
from himap.removal.peaks import least_channels

_LEAST_FOR_PEAKS = 8


@dataclass(frozen=True, kw_only=True)
class CleanedCube(Cleaned):
    """What `clean_cube` made of a `Cube`: what every method gives (`Cleaned`), and where it comes from.

    Attributes
    ----------
    cube
        What was cleaned; `maps`, `residual` and `foreground` are of its seen pixels. Where a voxel is missing
        the residual is 0, and maps and foreground have what was found of it.
    cleaning
        The `Cleaning`, to be done again with something changed.
    flagged
        Share of the voxels that peak masking replaced before the foreground was looked for.
    """

    cube: Cube
    cleaning: Cleaning
    flagged: float

    @classmethod
    def of(cls, cube, cleaning):
        """What a `Cleaning` of a `Cube` makes of it."""
        return cls(
            maps=cleaning.maps,
            residual=cleaning.residual,
            separation=cleaning.separation,
            cube=cube,
            cleaning=cleaning,
            flagged=cleaning.flagged,
        )

    @property
    def method(self):
        """The `ForegroundRemover`."""
        return self.cleaning.method

    @property
    def residual_with_nan(self):
        """The residual, (n_channels, n_seen), NaN where a voxel is missing."""
        missing = self.cube.missing
        return self.residual if missing is None else np.where(missing, np.float32(np.nan), self.residual)

    @property
    def foreground(self):
        """What was subtracted, the mean of every channel included, in the precision of the cube."""
        return self.maps - self.residual

    @property
    def remarks(self):
        """What the user should know of the result, a list of sentences."""
        separation, remarks = self.separation, []
        if not separation.converged:
            remarks.append(f"{self.method.name} stopped before it converged.")
        if separation.lmax is not None:
            remarks.append(
                f"{self.method.name} finds nothing beyond l = {separation.lmax}: what is left ends there, "
                "but for peaks that were masked; compare it with what ends there too."
            )
        return remarks


def cleaning_of(cube, method, *, beams=None, peaks=True, seed=2025):
    """The `Cleaning` of a `Cube` by a `ForegroundRemover`; parameters and errors as of `clean_cube`.

    Nothing is separated before it is asked for; peaks are masked now.
    """
    if peaks and len(cube.freqs) < _LEAST_FOR_PEAKS:
        raise InputError(
            f"peak masking fits polynomials of order 6 and needs {_LEAST_FOR_PEAKS} channels, got "
            f"{len(cube.freqs)}; go without it: peaks=False (--keep-peaks)."
        )
    return Cleaning.of(_data_of(cube, method, beams, seed), method, peaks=peaks)


def _data_of(cube, method, beams, seed):
    part = None if cube.whole_sky else cube.mask
    return Data(
        maps=cube.maps,
        freqs=cube.freqs,
        grid=part if cube.image is None else cube.image,
        weights=cube.weights,
        beams=beams if "beams" in method.uses else None,
        seed=np.random.default_rng(seed),
    )


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
        An unknown method or parameter, or what the method itself refuses, such as too small a part of the
        sky.
    """
    remover = method_for(cube, method, beams=beams, **parameters)
    return CleanedCube.of(cube, cleaning_of(cube, remover, beams=beams, peaks=peaks, seed=seed))


def check_pixels(cube, remover):
    """Refuse a method that needs the sphere for a cube of images in the plane."""
    if "sphere" in remover.uses and not cube.layout.pixels.whole_sky:
        able = [name for name in available() if "sphere" not in REGISTRY[name].uses]
        raise InputError(
            f"{remover.name} looks at the sphere, by multipoles, and the cube is an image in the plane: take "
            f"{', '.join(able[:-1])} or {able[-1]}, or put the cube on HEALPix, as reproject_to_healpix of "
            "the package reproject does."
        )


def method_for(cube, method, *, beams=None, **parameters):
    """The `ForegroundRemover` called `method`, if it can clean `cube` with these `beams`.

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
    check_pixels(cube, remover)
    n_channels, n_seen = cube.maps.shape
    remover.check(n_channels)
    by_line = hasattr(remover, "n_sources") and not remover.uses & {"sphere", "neighbours"}
    if by_line and n_seen < n_channels:  # a few of the spectra would explain all lines of sight
        raise InputError(
            f"{remover.name} finds spectra in the lines of sight, and of these only {n_seen} are seen, fewer "
            f"than the {n_channels} channels: HI would be taken for foreground. Keep more of the sky."
        )
    remover.check_data(_data_of(cube, remover, beams, 0))
    return remover


def with_enough_channels(cube, method, *, peaks=True):
    """The `Cube` without the pixels of which too many channels are missing for a `ForegroundRemover`.

    With `peaks` for the masking of peaks too.

    Raises
    ------
    InputError
        None is left, or a channel sees none of them.
    """
    least = method.least_channels(len(cube.freqs))
    if peaks and len(cube.freqs) >= _LEAST_FOR_PEAKS:
        least = max(least, least_channels(len(cube.freqs)))
    return cube.seen_in(least)
