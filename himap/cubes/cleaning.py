"""Foregrounds removed from a cube of one's own, by any method, and what is written of it."""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from himap.cubes.cube import Cube
from himap.errors import InputError
from himap.maps.blocked import centred
from himap.removal import available, create
from himap.removal.analysis import analysed
from himap.removal.base import REGISTRY, Cleaned, ForegroundRemover
from himap.removal.masked import lines_of
from himap.removal.peaks import least_channels, mask_peaks

__all__ = ["Basis", "CleanedCube", "check_pixels", "clean_cube", "method_for", "with_enough_channels"]

_LEAST_FOR_PEAKS = 8


@dataclass(frozen=True, kw_only=True)
class CleanedCube(Cleaned):
    """What `clean_cube` made of a `Cube`: what every method gives (`Cleaned`), and where it comes from.

    Attributes
    ----------
    cube
        What was cleaned; `maps`, `residual` and `foreground` are of its seen pixels. Where a voxel is missing
        the residual is 0, and maps and foreground have what was found of it.
    method
        The `ForegroundRemover`.
    flagged
        Share of the voxels that peak masking replaced before the foreground was looked for.
    """

    cube: Cube
    method: ForegroundRemover
    flagged: float

    @property
    def told(self):
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


class Basis:
    """The maps of a `Cube` that a foreground is looked for in, made once for all methods that look.

    Parameters
    ----------
    cube
        The `Cube`.
    peaks
        Whether peaks are masked (paper, Sect. 4.1).

    Attributes
    ----------
    maps
        (n_channels, n_seen), mK, in the precision of those of the cube.
    flagged
        Share of the voxels that peak masking replaced.

    Raises
    ------
    InputError
        Too few channels for the masking of peaks.
    """

    def __init__(self, cube, *, peaks=True):
        if peaks and len(cube.freqs) < _LEAST_FOR_PEAKS:
            raise InputError(
                f"peak masking fits polynomials of order 6 and needs {_LEAST_FOR_PEAKS} channels, got "
                f"{len(cube.freqs)}; go without it: peaks=False (--keep-peaks)."
            )
        masked = mask_peaks(cube.maps, cube.freqs, weights=cube.weights) if peaks else None
        self.maps = _precise(masked, cube.maps) if peaks else cube.maps
        self.flagged = float(masked.flagged.mean()) if peaks else 0.0
        self._cube = cube

    @cached_property
    def modes(self):
        """The `CubeModes` of the maps less their channel means; of a part of the sky, continued outside."""
        kept = None if self._cube.whole_sky else self._cube.mask
        return analysed(self._cube.on_sphere(centred(self.maps)), kept)

    def given_to(self, method, maps):
        """What `method` is given of maps (n_channels, n_seen) of the cube: (maps, its further arguments).

        A method that looks at the whole sky gets them on the sphere, with the mask; one that takes images
        gets the seen pixels of one, and where they are.
        """
        options = {"modes": self.modes} if method.needs_modes else {}
        if self._cube.weights is not None:
            options["weights"] = self._cube.weights
        if method.takes_image and self._cube.image is not None:
            return maps, options | {"image": self._cube.image}
        if method.needs_whole_sky and not self._cube.whole_sky:
            return self._cube.on_sphere(maps), options | {"mask": self._cube.mask}
        return maps, options

    def separation(self, method, *, beams=None, seed=2025):
        """The `Separation` of the seen pixels by a method; parameters as of `clean_cube`."""
        maps, options = self.given_to(method, self.maps)
        with _solvable(method):
            found = method.separate(
                maps,
                freqs=self._cube.freqs,
                beams=beams if method.needs_beams else None,
                rng=np.random.default_rng(seed),
                **options,
            )
        return lines_of(found, self._cube.mask) if "mask" in options else found


def _precise(masked, maps):
    """The maps of a `PeakMasked`, in float64 where those that it was made of are."""
    return np.where(masked.flagged, masked.maps, maps) if maps.dtype == np.float64 else masked.maps


def clean_cube(cube, method, *, beams=None, peaks=True, basis=None, seed=2025, **parameters):
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
    basis
        The `Basis` of the cube where it is at hand, for several methods on one cube.
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
    remover = method_for(cube, method, **parameters)
    basis = Basis(cube, peaks=peaks) if basis is None else basis
    maps, options = basis.given_to(remover, cube.maps)
    with _solvable(remover):
        result = remover.clean(
            maps,
            freqs=cube.freqs,
            beams=beams if remover.needs_beams else None,
            rng=np.random.default_rng(seed),
            separate_on=basis.given_to(remover, basis.maps)[0],
            **options,
        )
    seen = {"maps": cube.maps, "residual": result.residual, "separation": result.separation}
    if cube.missing is not None:
        seen["maps"] = result.maps
    if "mask" in options:
        seen["residual"] = result.residual[:, cube.mask]
        seen["separation"] = lines_of(result.separation, cube.mask)
    return CleanedCube(**seen, cube=cube, method=remover, flagged=basis.flagged)


@contextmanager
def _solvable(method):
    """Equations that the digits of the maps do not suffice for, as an error of the input."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"{method.name} cannot solve its equations for these maps ({error}): the brightest part is too "
            "much brighter than the faintest. Take another method, or maps in float64."
        ) from None


def check_pixels(cube, remover):
    """Refuse a method that needs the sphere for a cube of images in the plane."""
    if remover.needs_sphere() and not cube.layout.pixels.whole_sky:
        able = [name for name in available() if not REGISTRY[name].needs_sphere()]
        raise InputError(
            f"{remover.name} looks at the sphere, by multipoles, and the cube is an image in the plane: take "
            f"{', '.join(able[:-1])} or {able[-1]}, or put the cube on HEALPix, as reproject_to_healpix of "
            "the package reproject does."
        )


def _check_seen(cube, remover):
    """Refuse to find spectra in fewer lines of sight than there are channels, which a few of them explain."""
    n_channels, n_seen = cube.maps.shape
    by_line = hasattr(remover, "n_sources") and not remover.needs_whole_sky  # others look at the mask itself
    if by_line and n_seen < n_channels:
        raise InputError(
            f"{remover.name} finds spectra in the lines of sight, and of these only {n_seen} are seen, fewer "
            f"than the {n_channels} channels: HI would be taken for foreground. Keep more of the sky."
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
    check_pixels(cube, remover)
    remover.check(len(cube.freqs))
    _check_seen(cube, remover)
    remover.checked_noise(None, len(cube.freqs))
    if cube.weights is not None:
        remover.check_weights(cube.weights)
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
