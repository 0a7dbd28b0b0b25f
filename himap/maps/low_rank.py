"""Products with cubes, one block of pixels at a time, and cubes that are a few spectra times maps.

Foregrounds are 1e5 times brighter than HI, so products are computed in float64. A float64 copy of a cube
would be twice as large as the cube; the copy of a block is small. If the sky is so bright that rounding of
float32 would affect HI, as at 60 MHz, the cube is in float64.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from himap.core.progress import progress

_BLOCK = 1024  # pixels: 4 MB in float64 for 500 channels, about the size of a processor cache
_ROUNDING = 2.0**-25  # relative rounding of float32, rms over all numbers
_HARMLESS = 1e-3  # mK: a hundredth of HI


def blocks(n_pix, size=None):
    """Slices of at most `size` pixels, 1024 unless given, that cover `n_pix` pixels."""
    size = size or _BLOCK
    return [slice(start, start + size) for start in range(0, n_pix, size)]


def in_threads(work, n_pix, label, size=None):
    """Call ``work(block)`` for every block of `blocks`, in parallel; return the results as a list, in order.

    Uses as many threads as the transforms, and one within a product: numpy releases the interpreter's lock
    while it computes.
    """
    from himap.maps import sphere  # here, because healpy takes a second to import

    parts = blocks(n_pix, size)
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(sphere.n_threads()) as pool:
        return list(progress(pool.map(work, parts), label, total=len(parts)))


def scattered(lines, kept):
    """Insert lines of sight (..., n_kept) among all pixels, (..., n_pix), 0 elsewhere."""
    out = np.zeros((*lines.shape[:-1], len(kept)), dtype=lines.dtype)
    out[..., kept] = lines
    return out


def precision(rms):
    """Float type for maps of this rms, mK: float32, or float64 where float32 would round HI away."""
    return np.float64 if rms * _ROUNDING > _HARMLESS else np.float32


def centred(maps, means=None):
    """Maps (n_channels, n_pix) less one number per channel, by default its mean: float32.

    float64 maps stay float64 where they need it (`precision`).
    """
    means = maps.mean(axis=1, dtype=np.float64) if means is None else means
    out = np.empty(maps.shape, dtype=_needed_floats(maps, means))
    for channel, value, row in zip(maps, means, out, strict=True):
        row[:] = channel - np.float64(value)
    return out


def as_float32(maps):
    """Maps (n_channels, n_pix) in float32; float64 ones unchanged where they need it (`precision`)."""
    return maps.astype(_needed_floats(maps, np.zeros(len(maps))), copy=False)


def _needed_floats(maps, means):
    """Float type needed by maps less `means`, at most that of the maps."""
    if maps.dtype != np.float64:
        return np.float32
    return precision(
        max(np.sqrt(np.mean((channel - mean) ** 2)) for channel, mean in zip(maps, means, strict=True))
    )


def projection(rows, maps, means=None):
    """rows @ maps, (n_rows, n_channels) times (n_channels, n_pix), float64.

    With `means` (n_channels,), float32 maps less these are used, rounded as by `centred`.
    """
    out = np.empty((len(rows), maps.shape[1]))

    def project(block):
        lines = maps[:, block]
        if means is not None:
            lines = (lines - means[:, None]).astype(np.float32)
        out[:, block] = rows @ lines.astype(np.float64)

    in_threads(project, maps.shape[1], "projection")
    return out


class SplitCube:
    """A cube for many products: its bright part in float64, as a few maps, and the faint rest in float32.

    The rest is no brighter than HI, so float32 products with it are exact enough, and take a third of the
    time of products that convert the cube to float64 block by block.

    Parameters
    ----------
    maps
        (n_channels, n_pix) float32; not changed.
    axes
        Orthonormal spectra of the bright part, (n_channels, n_axes).
    """

    def __init__(self, maps, axes):
        self.axes = axes
        self.bright = projection(axes.T, maps)
        # In parts that are contiguous in memory, for which products take half the time.
        self.rest = [
            (maps[:, block] - axes @ self.bright[:, block]).astype(np.float32)
            for block in blocks(maps.shape[1])
        ]

    def projection(self, rows):
        """rows @ maps, (n_rows, n_channels) times (n_channels, n_pix), float64."""
        rest = np.hstack([rows.astype(np.float32) @ part for part in self.rest])
        return (rows @ self.axes) @ self.bright + rest

    def correlation(self, sources):
        """maps @ sources^T, (n_channels, n_sources) float64."""
        total = self.axes @ (self.bright @ sources.T)
        for block, part in zip(blocks(sources.shape[1]), self.rest, strict=True):
            total += part @ sources[:, block].T.astype(np.float32)
        return total


@dataclass(frozen=True, kw_only=True)
class HarmonicModes:
    """A cube as `spectra` (n_channels, n_modes) @ maps with coefficients `alms` (n_modes, n_alm), mK."""

    spectra: np.ndarray
    alms: np.ndarray


@dataclass(frozen=True, kw_only=True)
class LowRankCube:
    """A cube as `spectra` (n_channels, n_modes) @ `maps` (n_modes, n_pix), mK, both float64.

    A foreground is 1e5 times brighter than HI, so its difference from another foreground needs more digits
    than a float32 cube has; this form has them.
    """

    spectra: np.ndarray
    maps: np.ndarray

    def __add__(self, other):
        spectra, maps = np.hstack([self.spectra, other.spectra]), np.concatenate([self.maps, other.maps])
        return LowRankCube(spectra=spectra, maps=maps)

    def __neg__(self):
        return LowRankCube(spectra=-self.spectra, maps=self.maps)

    def lines(self, pixels):
        """The lines of sight in some pixels (a slice, indices or a mask), (n_channels, n) float64."""
        return self.spectra @ self.maps[:, pixels]

    def of_channels(self, channels):
        """The same for some channels, a slice."""
        return LowRankCube(spectra=self.spectra[channels], maps=self.maps)

    def cube(self):
        """The full cube, (n_channels, n_pix) float32."""
        maps = np.empty((len(self.spectra), self.maps.shape[1]), dtype=np.float32)
        for block in progress(blocks(maps.shape[1]), "mixture"):
            maps[:, block] = self.lines(block)
        return maps

    def subtract_from(self, cube, means=None):
        """`cube` (n_channels, n_pix) less this and less one number per channel, float32."""
        residual = np.empty(cube.shape, dtype=np.float32)
        means = 0 if means is None else means[:, None]
        for block in blocks(cube.shape[1]):
            residual[:, block] = cube[:, block] - self.lines(block) - means
        return residual

    def truncate(self, faint):
        """The same less its channel means, with as few orthonormal spectra as possible.

        Parameters
        ----------
        faint
            Variance, mK^2, summed over channels, below which a term is dropped.
        """
        axes, triangle = np.linalg.qr(self.spectra)
        means, n_pix = self.maps.mean(axis=1, keepdims=True), self.maps.shape[1]

        def lines(block):  # computed twice, which is faster than keeping them
            return triangle @ (self.maps[:, block] - means)

        covariance = sum(part @ part.T for part in map(lines, blocks(n_pix))) / n_pix
        values, turn = np.linalg.eigh(covariance)
        turn = turn[:, values > faint][:, ::-1]
        maps = np.empty((turn.shape[1], n_pix))
        for block in blocks(n_pix):
            maps[:, block] = turn.T @ lines(block)
        return LowRankCube(spectra=axes @ turn, maps=maps)
