"""What is known of HI and noise beforehand: their covariance between channels, scale by scale."""

import numpy as np
from scipy import linalg

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.blocked import centred
from himap.removal import harmonic

LINE = 1420.405751768
"""Rest frequency of the 21 cm line, MHz."""

_BRIGHT = 9.0  # times the median of the variances: foreground, not HI and noise alone
_ORDER = 3  # of the polynomial in frequency through the logarithm of a variance


def read_mock(path, shape):
    """The maps of a mock, (n_channels, n_pix) float32, mK, from a .npy file.

    Raises
    ------
    InputError
        There is no such file, it is no array, or not one of finite numbers of that shape.
    """
    try:
        maps = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError) as problem:
        raise InputError(
            "prior must be a .npy file with maps of HI and noise, (n_channels, n_pix) in mK, RING, channels "
            f"ascending; {path}: {problem}."
        ) from None
    maps = checked_cube("the mock of prior", maps, min_channels=2)
    if maps.shape != shape:
        raise InputError(
            f"the mock of prior must have the shape of the maps, {shape}, got {maps.shape}; make it for "
            "this survey, seen through its beam."
        )
    return maps


def mock_covariances(maps, windows):
    """The covariance of a mock in every window, made `stationary`, a list of (n_channels, n_channels), mK^2.

    Parameters
    ----------
    maps
        (n_channels, n_pix), mK: HI and noise as the instrument sees them.
    windows
        (n_windows, lmax + 1).
    """
    lmax = windows.shape[1] - 1
    modes = np.empty((len(maps), (lmax + 1) ** 2), dtype=np.float32)
    for channel, out in zip(progress(centred(maps), "prior"), modes, strict=True):
        out[:] = harmonic.to_modes(sphere.analyse(channel, lmax, n_iter=sphere.N_ITER_FLAT))
    return [stationary(band_covariance(modes, window)) for window in windows]


def band_covariance(modes, window):
    """Covariance between channels of maps through a window h_l, (n_channels, n_channels) float64, mK^2.

    Parameters
    ----------
    modes
        Real modes, (n_channels, (lmax + 1)^2).
    window
        h_l, to lmax or beyond.
    """
    total = np.zeros((len(modes), len(modes)))
    for weight, block in zip(window, harmonic.blocks(modes), strict=False):
        if weight:
            data = weight * block.astype(np.float64)
            total += data @ data.T
    return total / (4 * np.pi)


def stationary(covariance):
    """The nearest of the form s_a s_b rho(a - b): what a few modes can tell of a smooth covariance.

    ln s^2 is a cubic in frequency, rho the mean along each diagonal, less far off it by the share of channels
    that are so far apart: so it is the autocorrelation of a series, which has no negative power. Channels are
    taken as evenly spaced.
    """
    deviation = np.sqrt(_smoothed(np.diag(covariance)))
    correlation = covariance / np.outer(deviation, deviation)
    along = np.array([np.trace(correlation, lag) for lag in range(len(correlation))])
    return np.outer(deviation, deviation) * linalg.toeplitz(along / along[0])


def expected_covariance(covariance, freqs, degree):
    """A covariance of HI without a mock: its shape from theory, its level from the data, mK^2.

    Of matter with P(k) ~ k^-2 the correlation between two distances r < r' at multipole l is
    exp(-l (r' - r) / r): in redshift, which is distance here, (z / z')^l. The variance by channel is a smooth
    curve through what `covariance`, that of the data, has off the axes where foreground stands out.

    Parameters
    ----------
    covariance
        Of the data, (n_channels, n_channels).
    freqs
        MHz, below the rest frequency of the line.
    degree
        Multipole l.

    Raises
    ------
    InputError
        A frequency at or above that of the line, which no HI in the Hubble flow has.
    """
    if freqs[-1] >= LINE:
        raise InputError(
            f"without a mock HI is expected below {LINE:.1f} MHz, got channels up to {freqs[-1]:g} MHz; give "
            "prior, a file with a mock."
        )
    place = degree * np.log(LINE / freqs - 1)
    shape = np.exp(-np.abs(place[:, None] - place))
    values, axes = np.linalg.eigh(covariance)
    faint = axes[:, values <= _BRIGHT * np.median(values)]
    found, share = (np.sum((faint @ (faint.T @ one @ faint)) * faint, axis=1) for one in (covariance, shape))
    deviation = np.sqrt(_smoothed(found / share))
    return np.outer(deviation, deviation) * shape


def _smoothed(variance):
    """A cubic through the logarithms."""
    place = np.linspace(-1, 1, len(variance))
    order = min(_ORDER, len(variance) - 1)
    floor = np.finfo(float).tiny
    return np.exp(np.polyval(np.polyfit(place, np.log(np.maximum(variance, floor)), order), place))
