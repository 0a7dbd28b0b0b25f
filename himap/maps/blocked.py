"""Matrix products with cubes, a block of pixels at a time.

Foregrounds are 1e5 times brighter than HI, so products are taken in float64; a float64 copy of a whole
cube would be twice as large as the cube, that of a block is small. Where the sky is so bright that float32
itself would cost HI, as at 60 MHz, the cube is in float64.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from threadpoolctl import threadpool_limits

from himap.core.progress import progress

_BLOCK = 16384  # pixels
_ROUNDING = 2.0**-25  # relative, of float32: its rms in the mean over all numbers
_HARMLESS = 1e-3  # mK: a hundredth of HI


def blocks(n_pix, size=None):
    """Slices of at most `size` pixels, 16384 unless given, that cover `n_pix` pixels."""
    size = size or _BLOCK
    return [slice(start, start + size) for start in range(0, n_pix, size)]


def in_threads(work, n_pix, label, size=None):
    """``work(block)`` for every block of `blocks`, several at a time; a list of what it returns, in order.

    As many threads as transforms have, each with products on itself alone: numpy leaves the interpreter to
    the others while it computes.
    """
    from himap.maps import sphere  # here, for to import healpy takes a second

    parts = blocks(n_pix, size)
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(sphere.n_threads()) as pool:
        return list(progress(pool.map(work, parts), label, total=len(parts)))


def precision(rms):
    """The floats for maps of this rms, mK: float32, or float64 where that would round HI away."""
    return np.float64 if rms * _ROUNDING > _HARMLESS else np.float32


def centred(maps, means=None):
    """Maps (n_channels, n_pix) less one number per channel, its mean unless given: float32.

    Those of float64 maps stay float64 where they need it (`precision`).
    """
    means = maps.mean(axis=1, dtype=np.float64) if means is None else means
    out = np.empty(maps.shape, dtype=_needed(maps, means))
    for channel, value, row in zip(maps, means, out, strict=True):
        row[:] = channel - np.float64(value)
    return out


def lean(maps):
    """Maps (n_channels, n_pix) in float32; float64 ones as they are where they need it (`precision`)."""
    return maps.astype(_needed(maps, np.zeros(len(maps))), copy=False)


def _needed(maps, means):
    """The floats that maps less `means` need, of those that they have."""
    if maps.dtype != np.float64:
        return np.float32
    return precision(
        max(np.sqrt(np.mean((channel - mean) ** 2)) for channel, mean in zip(maps, means, strict=True))
    )


def projection(rows, maps):
    """rows @ maps, (n_rows, n_channels) times (n_channels, n_pix), float64."""
    out = np.empty((len(rows), maps.shape[1]))

    def project(block):
        out[:, block] = rows @ maps[:, block].astype(np.float64)

    in_threads(project, maps.shape[1], "projection")
    return out


def mixture(mixing, sources):
    """mixing @ sources, (n_channels, n_pix) float32."""
    maps = np.empty((len(mixing), sources.shape[1]), dtype=np.float32)
    for block in progress(blocks(sources.shape[1]), "mixture"):
        maps[:, block] = mixing @ sources[:, block]
    return maps


class SplitCube:
    """A cube for many products: its bright part in float64, as a few maps, and the faint rest in float32.

    The rest is no brighter than HI, so that float32 products with it lose nothing, and take a third of the
    time of those that turn the cube to float64 block by block.

    Parameters
    ----------
    maps
        (n_channels, n_pix) float32; left as they are.
    axes
        Orthonormal spectra of the bright part, (n_channels, n_axes).
    """

    def __init__(self, maps, axes):
        self.axes = axes
        self.bright = projection(axes.T, maps)
        self.rest = np.empty(maps.shape, dtype=np.float32)
        for block in blocks(maps.shape[1]):
            self.rest[:, block] = maps[:, block] - axes @ self.bright[:, block]

    def projection(self, rows):
        """rows @ maps, (n_rows, n_channels) times (n_channels, n_pix), float64."""
        return (rows @ self.axes) @ self.bright + rows.astype(np.float32) @ self.rest

    def correlation(self, sources):
        """maps @ sources^T, (n_channels, n_sources) float64."""
        total = self.axes @ (self.bright @ sources.T)
        for block in blocks(sources.shape[1]):
            total += self.rest[:, block] @ sources[:, block].T.astype(np.float32)
        return total
