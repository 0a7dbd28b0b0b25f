"""The covariance between channels and its principal axes."""

import numpy as np
from scipy import linalg
from threadpoolctl import threadpool_limits

from himap.core.progress import progress
from himap.maps.low_rank import blocks

_BLOCK = 16384  # pixels: products of this size are limited by arithmetic; longer ones are no faster
_BRIGHT = 1e3  # variance over that of HI and noise


def channel_covariance(maps):
    """X X^T / n_pix of maps less their channel means, (n_channels, n_channels) float64.

    Foregrounds are 1e5 times brighter than HI, their covariance 1e10 times. In float32 sums HI would be
    lost to rounding, so products are in float64, block by block, on one thread, because the number of
    threads changes their last bits.
    """
    n_channels, n_pix = maps.shape
    mean = maps.mean(axis=1, dtype=np.float64)[:, None]
    total = np.zeros((n_channels, n_channels))
    with threadpool_limits(1, user_api="blas"):
        for block in progress(blocks(n_pix, _BLOCK), "channel covariance"):
            lines = maps[:, block] - mean
            total += lines @ lines.T
    return total / n_pix


def principal_axes(covariance, n_axes):
    """Eigenvectors of the largest eigenvalues, descending, (n_channels, n_axes); with definite signs."""
    n_channels = len(covariance)
    _, vectors = linalg.eigh(covariance, subset_by_index=[n_channels - n_axes, n_channels - 1])
    vectors = vectors[:, ::-1]
    largest = vectors[np.abs(vectors).argmax(axis=0), np.arange(n_axes)]
    return vectors * np.sign(largest)


def bright_axes(covariance, *, least=1):
    """Principal axes too bright for float32 to hold together with HI, and `least` of them in any case.

    No other axis has more than 1000 times the typical variance, the median: six digits are enough for these.
    """
    values = np.linalg.eigvalsh(covariance)
    return principal_axes(covariance, max(least, int(np.sum(values > _BRIGHT * np.median(values)))))
