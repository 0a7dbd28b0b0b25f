"""What every method of foreground removal has in common: checks, centring, subtraction, the register.

A method is a dataclass of its parameters with one hook, `_separate`. To add one, write one file with
one class and import it in `himap/removal/__init__.py`; the contract test runs on it by itself.
"""

import difflib
import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from himap.checks import checked_cube, checked_field, parameter, real_array
from himap.errors import InputError

__all__ = ["Cleaned", "ForegroundRemover", "Separation", "SeparationWarning", "parameter"]

_REGISTRY = {}


class SeparationWarning(UserWarning):
    """A method ended without converging, or with something the user should know."""


@dataclass(frozen=True, kw_only=True)
class Separation:
    """What a method found.

    Attributes
    ----------
    foreground
        (n_channels, n_pix) float32, mK, a new array. `_separate` gives that of the centred maps; the
        base class adds the channel means in place, for a second cube of that size is not small.
    mixing
        (n_channels, n_sources).
    sources
        (n_sources, n_pix).
    converged
        False if the method stopped at its limit.
    n_iterations
        0 for a direct method.
    """

    foreground: np.ndarray
    mixing: np.ndarray
    sources: np.ndarray
    converged: bool = True
    n_iterations: int = 0


@dataclass(frozen=True, kw_only=True)
class Cleaned:
    """A cleaned cube: `residual` + `foreground` is the input, up to float32 rounding.

    Attributes
    ----------
    residual
        HI plus noise as the method sees it, (n_channels, n_pix) float32, mK.
    separation
        The `Separation` behind it.
    """

    residual: np.ndarray
    separation: Separation

    @property
    def foreground(self):
        """What was subtracted, the mean of every channel included, same shape."""
        return self.separation.foreground


@dataclass(kw_only=True)
class ForegroundRemover(ABC):
    """A method of foreground removal; its fields are its parameters."""

    name: ClassVar[str]

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        _REGISTRY[cls.name] = cls

    def __post_init__(self):
        for item in fields(self):
            setattr(self, item.name, checked_field(item, getattr(self, item.name)))

    @staticmethod
    def available():
        """Names of the methods, sorted."""
        return sorted(_REGISTRY)

    @staticmethod
    def create(name, **parameters):
        """The method called `name`.

        Raises
        ------
        InputError
            An unknown name or parameter (the message lists what exists), or a bad value.
        """
        if not isinstance(name, str) or name not in _REGISTRY:
            raise InputError(f"unknown method {name!r}; there are {', '.join(sorted(_REGISTRY))}.")
        method = _REGISTRY[name]
        known = {item.name: item.metadata["help"] for item in fields(method)}
        for key in sorted(set(parameters) - set(known)):
            near = difflib.get_close_matches(key, known, n=1)
            hint = f" (did you mean {near[0]}?)" if near else ""
            listing = "; ".join(f"{item}: {help}" for item, help in known.items())
            raise InputError(f"{name} has no parameter {key!r}{hint}; its parameters are {listing}.")
        return method(**parameters)

    def clean(self, maps, *, freqs, beams=None, rng=None, separate_on=None):
        """Find the foreground and subtract it.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; left as they are.
        freqs
            Channel centres, MHz, ascending, (n_channels,).
        beams
            b_l, (n_channels, lmax + 1), for methods that use them.
        rng
            numpy Generator, for methods that draw numbers.
        separate_on
            Maps of the same shape to find the foreground in, such as `maps` with their peaks masked; `maps`
            themselves unless given. The foreground is always subtracted from `maps`.

        Returns
        -------
        Cleaned

        Raises
        ------
        InputError
            Maps that are not finite, of one channel or of different shapes; frequencies that do not
            fit them; more sources than channels.
        """
        maps = checked_cube("maps", maps, min_channels=2)
        basis = maps if separate_on is None else checked_cube("separate_on", separate_on, min_channels=2)
        if basis.shape != maps.shape:
            raise InputError(f"separate_on must have the shape of maps, {maps.shape}, got {basis.shape}.")
        freqs = _checked_freqs(freqs, len(maps))
        self.check(len(maps))
        mean = basis.mean(axis=1, dtype=np.float64)
        separation = self._separate(_centred(basis, mean), freqs=freqs, beams=beams, rng=rng)
        if not separation.converged:
            warnings.warn(
                f"{self.name} stopped after {separation.n_iterations} iterations without converging.",
                SeparationWarning,
                stacklevel=2,
            )
        residual = np.empty(maps.shape, dtype=np.float32)
        for seen, found, value, left in zip(maps, separation.foreground, mean, residual, strict=True):
            found += value
            left[:] = seen - found
        return Cleaned(residual=residual, separation=separation)

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
        """The `Separation` of centred float32 `maps`; must not change them."""


def _centred(maps, mean):
    """float32 maps less one number per channel, subtracted in float64 a channel at a time."""
    out = np.empty(maps.shape, dtype=np.float32)
    for channel, value, row in zip(maps, mean, out, strict=True):
        row[:] = channel - np.float64(value)
    return out


def _checked_freqs(freqs, n_channels):
    freqs = real_array("freqs", freqs.to_value("MHz") if hasattr(freqs, "to_value") else freqs).astype(float)
    if freqs.shape != (n_channels,):
        raise InputError(f"freqs must be one MHz value per channel, ({n_channels},), got {freqs.shape}.")
    if not (freqs[0] > 0 and np.isfinite(freqs).all() and (np.diff(freqs) > 0).all()):
        raise InputError("freqs must be positive and ascending, in MHz; sort the channels and maps together.")
    if not 10 < freqs[0] < freqs[-1] < 1e5:
        raise InputError(f"freqs are in MHz; {freqs[0]:g} to {freqs[-1]:g} looks like another unit.")
    return freqs
