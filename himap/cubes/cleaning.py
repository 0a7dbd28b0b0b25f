"""Foregrounds removed from a cube of one's own, by any method, and what is written of it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from himap.cubes.cube import Cube
from himap.errors import InputError
from himap.maps.blocked import centred
from himap.removal import create
from himap.removal.analysis import analysed
from himap.removal.base import Cleaned, ForegroundRemover
from himap.removal.masked import lines_of
from himap.removal.peaks import mask_peaks

__all__ = ["Basis", "CleanedCube", "clean_cube", "method_for"]

_LEAST_FOR_PEAKS = 8


@dataclass(frozen=True, kw_only=True)
class CleanedCube(Cleaned):
    """What `clean_cube` made of a `Cube`: what every method gives (`Cleaned`), and where it comes from.

    Attributes
    ----------
    cube
        What was cleaned; `maps`, `residual` and `foreground` are of its seen pixels.
    method
        The `ForegroundRemover`.
    flagged
        Share of the voxels that peak masking replaced before the foreground was looked for.
    """

    cube: Cube
    method: ForegroundRemover
    flagged: float

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
        (n_channels, n_seen) float32, mK.
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
        masked = mask_peaks(cube.maps, cube.freqs) if peaks else None
        self.maps = masked.maps if peaks else cube.maps
        self.flagged = float(masked.flagged.mean()) if peaks else 0.0
        self._cube = cube

    @cached_property
    def modes(self):
        """The `CubeModes` of the maps less their channel means; of a part of the sky, continued outside."""
        kept = None if self._cube.whole_sky else self._cube.mask
        return analysed(self._cube.on_sphere(centred(self.maps)), kept)

    def given_to(self, method, maps):
        """What `method` is given of maps (n_channels, n_seen) of the cube: (maps, its further arguments).

        A method that looks at the whole sky gets them on the sphere, with the mask.
        """
        options = {"modes": self.modes} if method.needs_modes else {}
        if method.needs_whole_sky and not self._cube.whole_sky:
            return self._cube.on_sphere(maps), options | {"mask": self._cube.mask}
        return maps, options

    def separation(self, method, *, beams=None, seed=2025):
        """The `Separation` of the seen pixels by a method; parameters as of `clean_cube`."""
        maps, options = self.given_to(method, self.maps)
        found = method.separate(
            maps,
            freqs=self._cube.freqs,
            beams=beams if method.needs_beams else None,
            rng=np.random.default_rng(seed),
            **options,
        )
        return lines_of(found, self._cube.mask) if "mask" in options else found


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
    result = remover.clean(
        maps,
        freqs=cube.freqs,
        beams=beams if remover.needs_beams else None,
        rng=np.random.default_rng(seed),
        separate_on=basis.given_to(remover, basis.maps)[0],
        **options,
    )
    seen = {"maps": cube.maps, "residual": result.residual, "separation": result.separation}
    if "mask" in options:
        seen["residual"] = result.residual[:, cube.mask]
        seen["separation"] = lines_of(result.separation, cube.mask)
    return CleanedCube(**seen, cube=cube, method=remover, flagged=basis.flagged)


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
    remover.checked_noise(None, len(cube.freqs))
    return remover
