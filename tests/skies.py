"""Maps and measures of maps that several tests share."""

import healpy as hp
import numpy as np

from himap.maps import sphere
from himap.measures.diagnostics import Comparison
from himap.measures.transfer import HarmonicPower, MockPower

BANDS = [(0, 2), (2, 5), (5, 10), (10, 20), (20, 40), (40, 90)]  # |b|, deg


def spectrum(pixels):
    return sphere.power_spectrum(sphere.analyse(pixels))


def bands(pixels):
    """The pixels of each band of latitude."""
    nside = sphere.nside_of(pixels)
    latitude = np.abs(hp.pix2ang(nside, np.arange(len(pixels)), lonlat=True)[1])
    return [pixels[(latitude >= low) & (latitude < high)] for low, high in BANDS]


def comparison(degrees, angular, k=(1.0,), frequency=(1.0,)):
    """A `Comparison` with a truth of 1."""
    degrees, angular, k, frequency = (np.asarray(values) for values in (degrees, angular, k, frequency))
    true = {"true_angular": np.ones(len(degrees)), "true_frequency": np.ones(len(k))}
    return Comparison(degrees=degrees, angular=angular, k=k, frequency=frequency, **true)


def lognormal(nside, seed=1, width=0.4):
    rng = np.random.default_rng(seed)
    degree = np.arange(2 * nside)
    alm = sphere.gaussian_alm(np.where(degree > 0, (degree + 4.0) ** -2.7, 0), rng)
    field = sphere.synthesise(alm, nside)
    return np.exp(width * field / field.std())


def mock_power(share, n_degrees):
    """The `MockPower` of 500 channels of 1 MHz, of which a share (n_l, n_k) of the power comes back."""
    powers = (np.broadcast_to(one, (n_degrees, 251)).astype(float) for one in (1.0, share, np.sqrt(share)))
    return MockPower(*(HarmonicPower(power=one, n_channels=500, channel_width=1.0) for one in powers))


def line_errors(recovered, true):
    """Mean squared error of every line of sight of two cubes less their channel means, (n_pix,), mK^2."""
    error = recovered.astype(float) - true
    return np.mean((error - error.mean(axis=1, keepdims=True)) ** 2, axis=0)


def correlation(recovered, true):
    """Pearson r of recovered and true map in every channel, (n_channels,)."""
    return np.array([np.corrcoef(one, two)[0, 1] for one, two in zip(recovered, true, strict=True)])


def maps_through(beams, alms, nside):
    """Maps (n_channels, n_pix) of coefficients (n_channels, n_alm), with beams (n_channels, lmax + 1)."""
    seen = (sphere.multiply_beam(alm, beam) for alm, beam in zip(alms, beams, strict=True))
    return np.array([sphere.synthesise(alm, nside) for alm in seen])


def convolve(maps, beams):
    """A cube through `beams` (n_channels, lmax + 1), channel by channel, with healpy alone."""
    nside, lmax = hp.npix2nside(maps.shape[1]), beams.shape[1] - 1
    alms = (hp.map2alm(channel.astype(float), lmax=lmax, iter=sphere.N_ITER) for channel in maps)
    return np.array([hp.alm2map(hp.almxfl(alm, b), nside) for alm, b in zip(alms, beams, strict=True)])
