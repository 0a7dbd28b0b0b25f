"""What every method of foreground removal has in common: checks, centring, subtraction, the register.

A method is a frozen dataclass of its parameters with one hook, `_separate`. To add one, write one file with
one class in `himap/removal/`; it registers by its name, and the contract test runs on it by itself.
"""

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from himap.checks import checked_beams, checked_cube, checked_fields, checked_freqs, checked_noise, parameter
from himap.errors import InputError
from himap.maps.blocked import centred
from himap.maps.modes import MapModes

__all__ = ["REGISTRY", "Cleaned", "ForegroundRemover", "Separation", "SeparationWarning", "parameter"]

REGISTRY = {}


class SeparationWarning(UserWarning):
    """A method ended without converging, or with something the user should know."""


@dataclass(frozen=True, kw_only=True)
class Separation:
    """What a method found.

    Attributes
    ----------
    mixing
        A, (n_channels, n_sources), float64.
    sources
        S, (n_sources, n_pix), mK, float64.
    taken
        The foreground, a `MapModes`, where it is not A S, such as one that is seen through beams.
    means
        What was taken from every channel before, (n_channels,): `_separate` leaves it to the base class.
    converged
        False if the method stopped at its limit.
    n_iterations
        0 for a direct method.
    flagged
        (n_pix,) bool, the lines of sight whose own fit cannot be trusted; None where there is no such fit.
    lmax
        Multipole at which the method ends: beyond, all goes with the foreground that was in the maps it was
        found in, so that peaks that were masked there stay whole; None if it does not end.
    """

    mixing: np.ndarray
    sources: np.ndarray
    taken: MapModes | None = None
    means: np.ndarray | None = None
    converged: bool = True
    n_iterations: int = 0
    flagged: np.ndarray | None = None
    lmax: int | None = None

    @property
    def foreground(self):
        """The foreground up to `lmax`, less `means`, a `MapModes`."""
        return MapModes(spectra=self.mixing, maps=self.sources) if self.taken is None else self.taken

    def left_of(self, maps, basis, modes=None, *, channels=slice(None)):
        """What is left of `maps` once the foreground of `basis` is taken, (n_channels, n_pix) float32.

        Parameters
        ----------
        maps, basis
            (n_channels, n_pix), mK; `basis` are those that this was found in.
        modes
            The `CubeModes` of `basis` where they are at hand, if this ends at `lmax`: beyond, all that
            `basis` holds is taken.
        channels
            A slice: which channels are asked for.
        """
        foreground = self.foreground.of_channels(channels)
        if self.lmax is None:
            return foreground.taken_from(maps[channels], self.means[channels])
        modes = _analysed(basis) if modes is None else modes
        left = foreground.taken_from(modes.low_cube(self.lmax, channels))
        for observed, found, out in zip(maps[channels], basis[channels], left, strict=True):
            out += observed - found
        return left


@dataclass(frozen=True, kw_only=True)
class Cleaned:
    """A cleaned cube.

    Attributes
    ----------
    maps
        What came, (n_channels, n_pix), mK.
    residual
        HI plus noise as the method sees it, (n_channels, n_pix) float32, mK.
    separation
        The `Separation` behind it.
    """

    maps: np.ndarray
    residual: np.ndarray
    separation: Separation

    @property
    def foreground(self):
        """What was subtracted, the mean of every channel included, float32, made when asked for."""
        return (self.maps - self.residual).astype(np.float32, copy=False)


@dataclass(frozen=True, kw_only=True)
class ForegroundRemover(ABC):
    """A method of foreground removal; its fields are its parameters.

    Attributes
    ----------
    name
        What it is called in `removal.create`, in file names and in figures.
    centred
        Whether `_separate` gets maps less their channel means. A method that is not linear in the maps, such
        as a fit of power laws, sets it to False and gives the whole foreground.
    needs_beams
        Whether the method uses the beams; the others get None for them.
    needs_noise
        Whether the method uses the noise of the instrument.
    needs_whole_sky
        Whether the pixels must be a whole HEALPix sphere; the others take any lines of sight.
    ends_by_count
        Whether the method as published also ends after so many iterations, settled or not; then to have come
        to that end is recorded (`Separation.converged`), and no warning.
    needs_modes
        Whether `_separate` gets the harmonic modes of the maps too, `modes`, a `CubeModes`.
    """

    name: ClassVar[str]
    centred: ClassVar[bool] = True
    needs_beams: ClassVar[bool] = False
    needs_noise: ClassVar[bool] = False
    needs_whole_sky: ClassVar[bool] = False
    needs_modes: ClassVar[bool] = False
    ends_by_count: ClassVar[bool] = False

    @property
    def ends(self):
        """Whether what is left ends at some multipole (`Separation.lmax`)."""
        return False

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        REGISTRY[cls.name] = cls

    def __post_init__(self):
        checked_fields(self)

    def clean(self, maps, *, freqs, beams=None, noise=None, rng=None, separate_on=None, modes=None):
        """Find the foreground and subtract it.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; left as they are.
        freqs, beams, noise, rng
            As in `separate`.
        separate_on
            Maps of the same shape to find the foreground in, such as `maps` with their peaks masked; `maps`
            themselves unless given. The foreground is always subtracted from `maps`.
        modes
            As in `separate`, of those maps.

        Returns
        -------
        Cleaned

        Raises
        ------
        InputError
            Maps of different shapes; and as `separate`.
        """
        maps = checked_cube("maps", maps, min_channels=2)
        basis = maps if separate_on is None else checked_cube("separate_on", separate_on, min_channels=2)
        if basis.shape != maps.shape:
            raise InputError(f"separate_on must have the shape of maps, {maps.shape}, got {basis.shape}.")
        separation, modes = self._found(basis, freqs, beams, noise, rng, modes)
        residual = separation.left_of(maps, basis, modes)
        return Cleaned(maps=maps, residual=residual, separation=separation)

    def separate(self, maps, *, freqs, beams=None, noise=None, rng=None, modes=None):
        """Find the foreground.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; left as they are.
        freqs
            Channel centres, MHz, ascending, (n_channels,).
        beams
            b_l, (n_channels, lmax + 1), for methods that use them: positive and finite.
        noise
            Noise of the instrument per pixel, mK, a number or (n_channels,), for methods that use it.
        rng
            numpy Generator, for methods that draw numbers.
        modes
            The `CubeModes` of the maps less their channel means (`himap.removal.analysis.analysed`), where
            they are at hand, for methods that need them: to make them is half of the work.

        Returns
        -------
        Separation

        Raises
        ------
        InputError
            Maps that are not finite or of one channel; frequencies or beams that do not fit them; more
            sources than channels.
        """
        maps = checked_cube("maps", maps, min_channels=2)
        return self._found(maps, freqs, beams, noise, rng, modes)[0]

    def _found(self, maps, freqs, beams, noise, rng, modes):
        """The `Separation` of checked maps, and their `CubeModes` where the method needs them."""
        freqs = checked_freqs(freqs, len(maps))
        beams = self._own_beams(beams, len(maps))
        noise = self.checked_noise(noise, len(maps))
        self.check(len(maps))
        find = partial(self._separate, freqs=freqs, beams=beams, rng=rng)
        if self.needs_noise:
            find = partial(find, noise=noise)
        if self.needs_modes:
            modes = _analysed(maps) if modes is None else modes
            find = partial(find, modes=modes)
        means = maps.mean(axis=1, dtype=np.float64) if self.centred else np.zeros(len(maps))
        separation = replace(find(centred(maps, means) if self.centred else _single(maps)), means=means)
        self._check_result(separation, maps.shape)
        return separation, modes

    def _own_beams(self, beams, n_channels):
        if not self.needs_beams:
            return None
        if beams is None:
            raise InputError(
                f"{self.name} needs beams=, the b_l of every channel, (n_channels, lmax + 1); "
                "himap.instrument.beams makes those of the paper."
            )
        return checked_beams("beams", beams, n_channels)

    def checked_noise(self, noise, n_channels):
        """The noise per pixel of the instrument as a float, a tuple (n_channels,) or None, mK.

        Raises
        ------
        InputError
            It is not above zero, or of another number of channels, or missing where the method needs it.
        """
        noise = checked_noise("noise", noise)
        if isinstance(noise, tuple) and len(noise) != n_channels:
            raise InputError(
                f"noise must be one value or {n_channels}, one for each channel, got {len(noise)}."
            )
        return noise

    def _check_result(self, separation, shape):
        """Hold a method to what it promises, and pass on what it says of its result."""
        foreground = separation.foreground
        pairs = (separation.mixing, separation.sources), (foreground.spectra, foreground.maps)
        for spectra, maps in pairs:
            expected = (shape[0], len(maps)), (len(maps), shape[1])
            # A foreground is 1e5 times brighter than what is left: single precision would not do.
            double = spectra.dtype == maps.dtype == np.float64
            if (spectra.shape, maps.shape) != expected or not double:
                name, got = type(self).__name__, f"{spectra.dtype} {spectra.shape}, {maps.dtype} {maps.shape}"
                raise TypeError(
                    f"{name}._separate must return spectra {expected[0]} times maps {expected[1]}, float64, "
                    f"got {got}."
                )
        if not (separation.converged or self.ends_by_count):
            warnings.warn(
                f"{self.name}: stopped after {separation.n_iterations} iterations without converging.",
                SeparationWarning,
                stacklevel=4,
            )

    def check(self, n_channels):
        """Refuse, before any work, parameters that do not fit maps of `n_channels` channels.

        Raises
        ------
        InputError
            More sources than channels.
        """
        n_sources = getattr(self, "n_sources", 0)
        if n_sources > n_channels:
            raise InputError(
                f"n_sources must be at most the number of channels, {n_channels}, got {n_sources}."
            )

    @abstractmethod
    def _separate(self, maps, *, freqs, beams, rng):
        """The `Separation` of float32 `maps`, centred if the class says so; must not change them."""


def _single(maps):
    return maps.astype(np.float32, copy=False)


def _analysed(maps):
    """The `CubeModes` of maps (n_channels, n_pix) less their channel means."""
    # Imported here: most methods do without transforms, and to import these takes a second.
    from himap.removal.analysis import analysed

    return analysed(centred(maps))
