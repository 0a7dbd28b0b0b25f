"""What a method of foreground removal found, and what is left without it."""

from dataclasses import dataclass

import numpy as np

from himap.maps.blocked import centred
from himap.maps.modes import MapModes

__all__ = ["Cleaned", "Separation", "modes_of"]


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
        What was taken from every channel before, (n_channels,): `_separate` leaves it to the base class, or
        says what else is to be taken.
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

    def check(self, method, shape):
        """Hold the class `method` to what it promises of maps of this shape; TypeError if it fails."""
        foreground = self.foreground
        for spectra, maps in ((self.mixing, self.sources), (foreground.spectra, foreground.maps)):
            expected = (shape[0], len(maps)), (len(maps), shape[1])
            # A foreground is 1e5 times brighter than what is left: single precision would not do.
            double = spectra.dtype == maps.dtype == np.float64
            if (spectra.shape, maps.shape) != expected or not double:
                got = f"{spectra.dtype} {spectra.shape}, {maps.dtype} {maps.shape}"
                raise TypeError(
                    f"{method}._separate must return spectra {expected[0]} times maps {expected[1]}, "
                    f"float64, got {got}."
                )

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
        modes = modes_of(basis) if modes is None else modes
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


def modes_of(maps):
    """The `CubeModes` of maps (n_channels, n_pix) less their channel means."""
    # Imported here: most methods do without transforms, and to import these takes a second.
    from himap.removal.analysis import analysed

    return analysed(centred(maps))
