"""Matrix products with cubes, a block of pixels at a time.

Foregrounds are 1e5 times brighter than HI, so products are taken in float64; a float64 copy of a whole
cube would be twice as large as the cube, that of a block is small.
"""

import numpy as np

__all__ = ["blocks", "correlation", "mixture", "projection"]

_BLOCK = 16384  # pixels


def blocks(n_pix, size=None):
    """Slices of at most `size` pixels, 16384 unless given, that cover `n_pix` pixels."""
    size = size or _BLOCK
    return [slice(start, start + size) for start in range(0, n_pix, size)]


def projection(rows, maps):
    """rows @ maps, (n_rows, n_channels) times (n_channels, n_pix), float64."""
    out = np.empty((len(rows), maps.shape[1]))
    for block in blocks(maps.shape[1]):
        out[:, block] = rows @ maps[:, block].astype(np.float64)
    return out


def mixture(mixing, sources):
    """mixing @ sources, (n_channels, n_pix) float32."""
    maps = np.empty((len(mixing), sources.shape[1]), dtype=np.float32)
    for block in blocks(sources.shape[1]):
        maps[:, block] = mixing @ sources[:, block]
    return maps


def correlation(maps, sources):
    """maps @ sources^T, (n_channels, n_sources) float64."""
    total = np.zeros((len(maps), len(sources)))
    for block in blocks(maps.shape[1]):
        total += maps[:, block].astype(np.float64) @ sources[:, block].T
    return total
