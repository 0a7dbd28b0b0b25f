"""Foreground removal from a cube by any method, with its beams, and the cleaned cube."""

import warnings
from dataclasses import dataclass, field, replace

import numpy as np

from himap.core.checks import checked_beams, whole_number
from himap.core.errors import InputError
from himap.cubes.cube import Cube
from himap.instrument import beams as all_beams
from himap.instrument.beams.base import DISH, Beam
from himap.removal import available, create
from himap.removal.base import REGISTRY, ForegroundRemover, SeparationWarning
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data
from himap.removal.peaks import can_stand_out, least_channels
from himap.removal.restarts import Ensemble, checked_restarts, has_restarts, remarks_on_one

_LEAST_FOR_PEAKS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class CleanedCube(Cleaning):
    """The `Cleaning` of the observed pixels of a `Cube`; the residual is 0 in missing voxels.

    Attributes
    ----------
    cube
        The `Cube`.
    ensemble
        The `Ensemble` of restarts of which this is the medoid, or None.
    """

    cube: Cube
    ensemble: Ensemble | None = field(init=False, default=None)

    @property
    def residual_with_nan(self):
        """The residual, (n_channels, n_seen), NaN in missing voxels."""
        missing = self.cube.missing
        return self.residual if missing is None else np.where(missing, np.float32(np.nan), self.residual)

    @property
    def foreground(self):
        """The subtracted foreground, including the mean of each channel, in the precision of the cube."""
        return self.maps - self.residual

    @property
    def remarks(self):
        """Remarks on the result, a list of sentences."""
        lmax, beams = self.separation.lmax, self.data.beams
        remarks = remarks_on_one(self) if self.ensemble is None else self.ensemble.remarks
        if not (self.separation.converged or has_restarts(self.method)):
            remarks.append(f"{self.method.name} stopped before it converged.")
        if not (self._keeps_peaks or can_stand_out(self.cube.freqs)):
            remarks.append(
                f"In {len(self.cube.freqs)} channels no value can exceed 5 standard deviations of all: no "
                "peak is masked."
            )
        if beams is not None and (last := beams.shape[1] - 1) < (top := 3 * self.cube.nside - 1):
            remarks.append(
                f"The beams end at l = {last}, the maps at l = {top}: beyond the beams the residual may "
                "contain foreground; give longer b_l."
            )
        if lmax is not None:
            remarks.append(
                f"{self.method.name} estimates nothing beyond l = {lmax}: the residual ends there, except "
                "for masked peaks; compare it with maps that end there too."
            )
        return remarks

    def with_restarts(self, n):
        """The medoid of `n` restarts, starting with this one, with its `Ensemble`; raises the same errors."""
        ensemble = Ensemble.of(self, n)
        medoid, _ = replace(ensemble.medoid), ensemble.medoid.residual  # computed once
        vars(medoid).update(vars(ensemble.medoid), ensemble=ensemble)
        return medoid


def check_cleaned(cleaned):
    """Refuse anything but a `CleanedCube`."""
    if not isinstance(cleaned, CleanedCube):
        raise InputError(f"expected a CleanedCube, as returned by clean_cube, got {type(cleaned).__name__}.")


def clean_cube(cube, method, *, beams=None, peaks=True, restarts=None, seed=2025, **parameters):
    """Remove the foregrounds of a cube.

    Parameters
    ----------
    cube
        A `Cube` (`read_cube`).
    method
        Name of a method, such as "pca", or a `ForegroundRemover`.
    beams
        b_l, (n_channels, lmax + 1), for methods that use them (`beams_of`).
    peaks
        Whether the foreground is estimated from maps whose peaks are masked (paper, Sect. 4.1).
    restarts
        Number of starts of a chaotic method, SDecGMCA; default 4. The result is the medoid.
    seed
        Of the random numbers of methods that use them.
    parameters
        Parameters of the method, such as n_sources.

    Returns
    -------
    CleanedCube
        With its `ensemble` for several restarts.

    Raises
    ------
    InputError
        Restarts of a method without any, an unknown method or parameter, or conditions of the method itself,
        such as too small a part of the sky.
    """
    remover = method_for(cube, method, beams=beams, **parameters)
    n = checked_restarts(remover, restarts)
    cleaned = cleaning_of(cube, remover, beams, peaks=peaks, seed=seed)
    cleaned = cleaned if n == 1 else cleaned.with_restarts(n)
    _ = cleaned.residual  # computed now and cached
    if has_restarts(remover) and (n == 1 or len(cleaned.ensemble.remarks) > 1):
        warnings.warn(" ".join(cleaned.remarks), SeparationWarning, stacklevel=2)
    return cleaned


def cleaning_of(cube, method, beams=None, *, peaks=True, seed=2025):
    """The `CleanedCube` by a `ForegroundRemover`; parameters and errors as in `clean_cube`.

    The separation is computed when first needed; peaks are masked now.
    """
    if not isinstance(peaks, bool):
        raise InputError(f"peaks must be True or False, got {peaks!r}.")
    if peaks and len(cube.freqs) < _LEAST_FOR_PEAKS:
        raise InputError(
            f"peak masking fits polynomials of order 6 and needs {_LEAST_FOR_PEAKS} channels, got "
            f"{len(cube.freqs)}; do without it: peaks=False (--keep-peaks)."
        )
    return CleanedCube.of(_data_of(cube, method, beams, seed), method, peaks=peaks, cube=cube)


def _data_of(cube, method, beams, seed=0):
    return Data(
        maps=cube.maps,
        freqs=cube.freqs,
        grid=None if cube.whole_sky else cube.mask.reshape(cube.layout.pixels.shape),
        weights=cube.weights,
        beams=beams if "beams" in method.uses else None,
        seed=np.random.default_rng(whole_number("seed", seed, 0, 2**63)),
    )


def method_for(cube, method, *, beams=None, **parameters):
    """The `ForegroundRemover` called `method`; InputError if unknown or unable to clean `cube`."""
    if not isinstance(cube, Cube):
        raise InputError(f"the cube must be a Cube, as returned by read_cube, got {type(cube).__name__}.")
    if not isinstance(method, str | ForegroundRemover):
        raise InputError(f"method must be a name, such as 'pca', or a method, such as PCA(), got {method!r}.")
    if parameters and not isinstance(method, str):
        raise InputError(f"{', '.join(parameters)}: pass parameters to {type(method).__name__}(...) itself.")
    remover = create(method, **parameters) if isinstance(method, str) else method
    check_pixels(cube, remover)
    n_channels, n_seen = cube.maps.shape
    remover.check(n_channels)
    if getattr(remover, "n_sources", 0) == n_channels:
        raise InputError(
            f"n_sources must be below the number of channels, {n_channels}: more would include HI and noise."
        )
    by_line = hasattr(remover, "n_sources") and not remover.uses & {"sphere", "neighbours"}
    if by_line and n_seen < n_channels:  # as many spectra would represent all lines of sight
        raise InputError(
            f"{remover.name} estimates spectra from lines of sight, and only {n_seen} are observed, fewer "
            f"than the {n_channels} channels: HI would be removed as foreground. Use more of the sky; "
            "in weights 0, in masks False and in flags any other value mean missing."
        )
    if beams is not None and "beams" in remover.uses:
        _check_reach("beams", np.asarray(beams), cube)
    remover.check_data(_data_of(cube, remover, beams))
    return remover


def _check_reach(label, beams, cube):
    """Refuse b_l, (n_channels, lmax + 1), that end before 2 nside: larger l would not be cleaned."""
    if beams.shape[-1] <= 2 * cube.nside:
        raise InputError(
            f"{label} must hold b_l from l = 0 to 2 nside = {2 * cube.nside} at least, got {beams.shape[-1]} "
            "numbers per line; for widths give one FWHM (deg) per line."
        )


def check_pixels(cube, remover):
    """Refuse a method that needs the sphere for a cube of images in the plane."""
    if "sphere" in remover.uses and cube.image is not None:
        able = [name for name in available() if "sphere" not in REGISTRY[name].uses]
        raise InputError(
            f"{remover.name} uses multipoles of the sphere, and the cube is an image in the plane: use "
            f"{', '.join(able[:-1])} or {able[-1]}, or put the cube on HEALPix (reproject_to_healpix of the "
            "package reproject)."
        )


def with_enough_channels(cube, method, *, peaks=True):
    """The `Cube` without pixels with too few channels for a `ForegroundRemover`, or for peak masking.

    InputError if no pixel or only one channel remains.
    """
    least = method.least_channels(len(cube.freqs))
    if peaks and len(cube.freqs) >= _LEAST_FOR_PEAKS:
        least = max(least, least_channels(len(cube.freqs)))
    return cube.seen_in(least)


def beams_of(cube, beam, *, dish=None):
    """b_l of each channel of a `Cube`, (n_channels, 3 nside), or up to the last l of a file.

    Parameters
    ----------
    cube
        The `Cube`.
    beam
        A `Beam`, or an argument of `himap.instrument.beams.named`: a name, such as "meerkat", or the path of
        a file with one line per channel in the order of the cube's file, the FWHM in degrees or b_l.
    dish
        Diameter in m, 13.5 unless given; for beams whose width depends on it.

    Raises
    ------
    InputError
        An unknown name, a file that does not match, or frequencies outside the range of a beam.
    """
    try:
        beam = beam if isinstance(beam, Beam) else all_beams.named(beam)
    except TypeError as error:
        raise InputError(
            f"the beam {beam!r} is incomplete ({error}): give NAME:PARAMETER=VALUE, or instead of "
            "`file` the path of the file itself."
        ) from None
    if dish is not None and not beam.follows_dish:
        able = [name for name in all_beams.available() if all_beams.base.REGISTRY[name].follows_dish]
        raise InputError(f"dish= (--dish) applies to beams that depend on it: {', '.join(able)}.")
    options = {"lmax": 3 * cube.nside - 1, "dish_diameter": DISH if dish is None else dish}
    if beam.by_line:
        beams = beam.windows(cube.layout.freqs, **options).total[cube.layout.channels]
    else:
        beams = beam.windows(cube.freqs, **options).total
    _check_reach(beam, beams, cube)
    return checked_beams(str(beam), beams, len(cube.freqs))
