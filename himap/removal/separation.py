"""What a method of foreground removal finds, and the residual without it."""

from dataclasses import dataclass, replace

import numpy as np

from himap.maps.low_rank import LowRankCube


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The foreground that a method finds.

    Attributes
    ----------
    mixing
        A, (n_channels, n_sources), float64.
    sources
        S, (n_sources, n_pix), mK, float64.
    low_rank
        The foreground, a `LowRankCube`, where it is not A S, such as one that is seen through beams.
    means
        What else is subtracted from every channel, (n_channels,), mK: the means of the data unless
        `_separate` gives others.
    converged
        False if the method stopped at its limit.
    n_iterations
        0 for a direct method.
    flagged
        (n_pix,) bool, the lines of sight whose fit cannot be trusted; None where lines have no separate fits.
    lmax
        Multipole at which the method ends: beyond, all goes with the foreground that was in the maps it was
        found in, so that peaks that were masked there remain complete; None if it does not end.
    diagnostics
        {name: number} by which an iteration can be judged without the truth; None of other methods.
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
        """Hold the class `method` to what it promises of maps of this shape; TypeError if it fails."""
        foreground = self.foreground
        for spectra, maps in ((self.mixing, self.sources), (foreground.spectra, foreground.maps)):
            expected = (shape[0], len(maps)), (len(maps), shape[1])
            # A foreground is 1e5 times brighter than the residual: single precision would not do.
            double = spectra.dtype == maps.dtype == np.float64
            if (spectra.shape, maps.shape) != expected or not double:
                got = f"{spectra.dtype} {spectra.shape}, {maps.dtype} {maps.shape}"
                raise TypeError(
                    f"{method}._separate must return spectra {expected[0]} times maps {expected[1]}, "
                    f"float64, got {got}."
                )

    def residual(self, maps, basis, channels=slice(None)):
        """`maps` (n_channels, n_pix), mK, without the foreground, float32; of some channels, a slice.

        `basis` are the `Data` that this was found in: beyond `lmax` all that they hold is subtracted.
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
        """The same of other pixels: ``move(lines)`` turns lines of sight (..., n_pix) into theirs."""
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
        As observed, (n_channels, n_pix), mK; where a voxel is missing the foreground that was found.
    residual
        HI plus noise as the method has them, (n_channels, n_pix) float32, mK.
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


def ordered(mixing, sources):
    """A and S with columns of unit length, by variance of the sources, largest entry positive.

    The product A S stays as it is; scale, order and sign of sources are a matter of convention.
    """
    length = np.linalg.norm(mixing, axis=0)
    largest = mixing[np.abs(mixing).argmax(axis=0), np.arange(len(length))]
    factor = np.copysign(length, largest)
    order = np.argsort(-(length**2) * np.mean(sources**2, axis=1), kind="stable")
    return (mixing / factor)[:, order], (sources * factor[:, None])[order]
