"""A sky of smooth spectra and a field like HI, seen through unequal beams; all of it Gaussian."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from skies import maps_through

from himap.maps import sphere

NSIDE, N_CHANNELS = 16, 64
WIDTH = 500 / N_CHANNELS
FREQS = 900 + WIDTH * (np.arange(N_CHANNELS) + 0.5)
BEAMS = sphere.gaussian_beam(np.deg2rad(np.linspace(6, 4, N_CHANNELS)), 3 * NSIDE - 1)
INDICES = (-2.1, -2.5, -2.9)
LMAX = 2 * NSIDE


def hi_covariance():
    """D R D with R = exp(-distance / 8 MHz) and D that falls with frequency."""
    levels = 0.1 * (FREQS / FREQS[0]) ** -1.5
    return toeplitz(np.exp(-(FREQS - FREQS[0]) / 8)) * np.outer(levels, levels)


def fields(covariance, cl, rng):
    """Coefficients of Gaussian fields of this covariance between channels, times `cl`, complex128."""
    root = np.linalg.cholesky(covariance)
    return root @ np.array([sphere.gaussian_alm(cl, rng) for _ in covariance])


def make_sky(rng, n_components=3, brightness=1e3):
    """`maps` of all, `truth` and `foreground` (n_channels, n_pix), mK, and the coefficients `hi` of truth."""
    degree = np.arange(LMAX + 1)
    white, red = (degree > 0).astype(float), np.where(degree > 0, np.maximum(degree, 1.0) ** -2.4, 0)
    hi = np.array(list(map(sphere.multiply_beam, fields(hi_covariance(), white, rng), BEAMS)))
    spectra = brightness * (FREQS / 1150)[:, None] ** np.array(INDICES[:n_components])
    sources = np.array([sphere.gaussian_alm(red, rng) for _ in range(n_components)])
    truth, foreground = sphere.synthesise(hi, NSIDE), maps_through(BEAMS, spectra @ sources, NSIDE)
    maps = (truth + foreground).astype(np.float32)
    return SimpleNamespace(maps=maps, truth=truth, foreground=foreground, hi=hi)


def check_mean(linear):
    """A `SpectralFilter` is F (F + C)^-1, with the covariances as matrices between channels (Wiener 1949)."""
    for degree in (3, 11, 30):
        spectra, faint = linear.spectra[degree], linear.faint_at(degree)
        foreground = spectra @ spectra.T
        expected = np.linalg.solve(foreground + faint, foreground).T
        assert spectra @ linear.estimators[degree] == pytest.approx(expected, abs=1e-4)
