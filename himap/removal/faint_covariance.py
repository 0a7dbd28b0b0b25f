"""The covariance between channels of HI and noise, as smooth as HI is, from what bright spectra leave."""

import numpy as np
from scipy.linalg import toeplitz

_LEVEL_ORDER = 3  # of the polynomial in frequency that the logarithm of the variance is
_POWER_ORDER = 3  # of the one in k / (k + _SCALE) that the logarithm of the power is
_SCALE = 0.3  # 1/MHz: channels a few MHz apart hold nearly the same HI; about there its power bends
_MOST_STEPS = 50  # of a fit; it takes 5 to 10
_SETTLED = 1e-9  # change of a logarithm


def faint_covariance(products, freqs, n_taken):
    """A covariance D R D with D smooth in frequency and R that of a stationary field of smooth power.

    HI along a line of sight, at one l, is close to stationary, and its power has no features: the logarithm
    of the variance of a channel is a cubic in frequency, that of the power one in k / (k + 0.3/MHz), which
    goes from 0 to nearly 1, level at both ends. So the power at small k, where foregrounds are and HI went
    with them, is continued from where HI is all that there is, and what is no more than HI in a smooth
    spectrum is not taken for a foreground.

    Parameters
    ----------
    products
        Mean of the products of the modes of two channels, (n_channels, n_channels).
    freqs
        Channel centres, MHz, (n_channels,).
    n_taken
        Smooth spectra that were taken: the power below half a wave more in the band is not looked at.

    Returns
    -------
    numpy.ndarray
        (n_channels, n_channels), positive definite.
    """
    n_channels = len(freqs)
    places = (freqs - freqs[0]) / (freqs[-1] - freqs[0]) * (n_channels - 1)
    levels = np.sqrt(_smooth(np.diag(products), places, _LEVEL_ORDER))
    waves = np.arange(n_channels)  # half of them in the band, from none up to Nyquist's
    power = _power(products / np.outer(levels, levels), places, waves)
    k = np.pi * waves / (freqs[-1] - freqs[0])
    first = max(0, min(n_taken + 1, n_channels - _POWER_ORDER - 1))
    smooth = _smooth(power, k / (k + _SCALE), _POWER_ORDER, first)
    return np.outer(levels, levels) * _correlation(smooth, places, waves)


def log_fit(design, values):
    """b of values = exp(design @ b) times scatter that is alike everywhere: regression of a gamma variable.

    Unlike a fit to the logarithms its mean is not biased by the scatter (McCullagh & Nelder 1989, Sect. 8).
    """
    inverse = np.linalg.pinv(design)
    found = inverse @ np.log(values)
    for _ in range(_MOST_STEPS):
        step = inverse @ (values * np.exp(-design @ found) - 1)
        change = np.abs(design @ step).max()
        found += step / max(1, change)  # never by more than a factor of e
        if change < _SETTLED:
            break
    return found


def _smooth(values, places, order, first=0):
    """`values` at ascending `places` as the exponential of a polynomial, fitted to those from `first` on."""
    x = 2 * (places - places[0]) / (places[-1] - places[0]) - 1
    design = np.polynomial.legendre.legvander(x, min(order, len(values) - first - 1))
    return np.exp(design @ log_fit(design[first:], np.maximum(values[first:], np.finfo(float).tiny)))


def _power(products, places, waves):
    """Periodogram of a covariance with a sine taper, so that what is bright at small k stays there."""
    taper = np.sin(np.pi * (places + 0.5) / len(places))
    transform = np.exp(-1j * np.pi / len(places) * np.outer(waves, places)) * taper
    return np.sum((transform @ products) * transform.conj(), axis=1).real / np.sum(taper**2)


def _correlation(power, places, waves):
    """Correlation matrix of a stationary field of this power, by the trapezoidal rule in k."""
    weights = power.copy()
    weights[[0, -1]] /= 2
    even = np.allclose(np.diff(places), 1)
    lags = places if even else np.abs(places[:, None] - places).ravel()
    found = np.cos(np.pi / (len(waves) - 1) * np.outer(lags, waves)) @ weights / weights.sum()
    return toeplitz(found) if even else found.reshape(len(places), -1)
