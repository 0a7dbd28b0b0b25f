"""The estimate of a foreground removal method, and the residual after its subtraction."""

from dataclasses import dataclass, replace

import numpy as np

from himap.maps.low_rank import LowRankCube


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The foreground estimated by a method.

    Attributes
    ----------
    mixing
        A, (n_channels, n_sources), float64.
    sources
        S, (n_sources, n_pix), mK, float64.
    low_rank
        The foreground, a `LowRankCube`, if it is not A S, for example if it is seen through beams.
    means
        Constants also subtracted from every channel, (n_channels,), mK: the means of the data unless
        `_separate` sets others.
    converged
        False if the method stopped at its limit of iterations.
    n_iterations
        0 for a direct method.
    flagged
        (n_pix,) bool, lines of sight whose fit is unreliable; None if these are not fitted separately.
    lmax
        Largest multipole of the estimate. Beyond it, all that the maps used for the estimate hold is
        subtracted, so peaks that were masked there remain complete. None if there is no such limit.
    diagnostics
        {name: number} to judge an iteration without the truth; None for other methods.
    """

    mixing: np.ndarray
    sources: np.ndarray
    low_rank: LowRankCube | None = None
    means: np.ndarray | None = None
    converged: bool = True
    n_iterations: int = 0
    flagged: np.ndarray | None = None
    lmax: int | None = None
    diagnostics: dict | None = None

    @property
    def foreground(self):
        """The foreground up to `lmax`, less `means`, a `LowRankCube`."""
        return LowRankCube(spectra=self.mixing, maps=self.sources) if self.low_rank is None else self.low_rank

    def check(self, method, shape):
        """Check that the class `method` returned what it must for maps of this shape; TypeError if not."""
        foreground = self.foreground
        for spectra, maps in ((self.mixing, self.sources), (foreground.spectra, foreground.maps)):
            expected = (shape[0], len(maps)), (len(maps), shape[1])
            # A foreground is 1e5 times brighter than the residual: single precision is not enough.
            double = spectra.dtype == maps.dtype == np.float64
            if (spectra.shape, maps.shape) != expected or not double:
                got = f"{spectra.dtype} {spectra.shape}, {maps.dtype} {maps.shape}"
                raise TypeError(
                    f"{method}._separate must return spectra {expected[0]} times maps {expected[1]}, "
                    f"float64, got {got}."
                )

    def residual(self, maps, basis, channels=slice(None)):
        """`maps` (n_channels, n_pix), mK, without the foreground, float32; for a slice of the channels.

        `basis` are the `Data` used for the estimate: beyond `lmax`, all that they hold is subtracted.
        """
        foreground = self.foreground.of_channels(channels)
        if self.lmax is None:
            return foreground.subtract_from(maps[channels], self.means[channels])
        low = basis.modes.low_cube(self.lmax, channels)
        low = low if basis.grid is None else low[:, basis.grid]
        residual = foreground.subtract_from(low)
        for observed, found, out in zip(maps[channels], basis.maps[channels], residual, strict=True):
            out += observed - found
        return residual

    def moved(self, move):
        """The same for other pixels: ``move(lines)`` maps lines of sight (..., n_pix) to the new ones."""
        low_rank, flagged = self.low_rank, self.flagged
        return replace(
            self,
            sources=move(self.sources),
            low_rank=None if low_rank is None else replace(low_rank, maps=move(low_rank.maps)),
            flagged=None if flagged is None else move(flagged),
        )


@dataclass(frozen=True, kw_only=True)
class Cleaned:
    """A cleaned cube.

    Attributes
    ----------
    maps
        As observed, (n_channels, n_pix), mK; missing voxels hold the estimated foreground.
    residual
        Recovered HI plus noise, (n_channels, n_pix) float32, mK.
    separation
        The `Separation` that the residual comes from.
    """

    maps: np.ndarray
    residual: np.ndarray
    separation: Separation

    @property
    def foreground(self):
        """The subtracted foreground, including the mean of every channel, float32, computed on access."""
        return (self.maps - self.residual).astype(np.float32, copy=False)


def ordered(mixing, sources):
    """Return A and S with columns of unit length, in order of source variance, largest entries positive.

    The product A S does not change; scale, order and sign of sources are conventions.
    """
    length = np.linalg.norm(mixing, axis=0)
    largest = mixing[np.abs(mixing).argmax(axis=0), np.arange(len(length))]
    factor = np.copysign(length, largest)
    order = np.argsort(-(length**2) * np.mean(sources**2, axis=1), kind="stable")
    return (mixing / factor)[:, order], (sources * factor[:, None])[order]
