"""A separation problem of the kind of Carloni Gertosio & Bobin (2021): sparse sources, unequal beams."""

import numpy as np
from scipy.linalg import subspace_angles
from skies import maps_through

from himap.maps import sphere
from himap.removal import harmonic

NSIDE, LMAX = 16, 32
BEAMS = sphere.gaussian_beam(np.deg2rad(np.linspace(12, 5, 8)), 3 * NSIDE - 1)


def sparse_sources(rng, n_sources=4, n_spots=25, nside=NSIDE, lmax=LMAX):
    """A few spots of each source on an empty sky, smooth enough for the grid: sparse in starlets."""
    maps = np.zeros((n_sources, 12 * nside**2))
    for source in maps:
        source[rng.choice(len(source), n_spots, replace=False)] = 50 + 50 * rng.random(n_spots)
    smooth = sphere.gaussian_beam(np.deg2rad(8), lmax)
    return np.stack([sphere.multiply_beam(sphere.analyse(source, lmax), smooth) for source in maps])


def make_problem(rng, nside=NSIDE):
    """(maps without noise, A, S as modes, beams): 4 sparse sources, 8 channels, beams wide and narrow."""
    lmax = 2 * nside
    beams = sphere.gaussian_beam(np.deg2rad(np.linspace(12, 5, 8)) * NSIDE / nside, 3 * nside - 1)
    mixing = rng.random((8, 4)) + 0.1
    mixing /= np.linalg.norm(mixing, axis=0)
    alms = sparse_sources(rng, nside=nside, lmax=lmax)
    return maps_through(beams, mixing @ alms, nside), mixing, harmonic.to_modes(alms), beams


def noisy(maps, decibel, rng):
    """Maps with white noise at a signal-to-noise ratio in dB."""
    return maps + maps.std() * 10 ** (-decibel / 20) * rng.standard_normal(maps.shape)


def largest_angle(one, two):
    """Sine of the largest angle between the spaces that two sets of columns span."""
    return np.sin(subspace_angles(one, two)[0])


def similarity(one, two):
    """Largest absolute correlation of every row of `one` with a row of `two`."""
    return np.abs(np.corrcoef(one, two)[: len(one), len(one) :]).max(axis=1)


def mixing_error(found, true):
    """Mean absolute entry of A^+ A_true less the permutation with signs that fits best (C21, Eq. 33)."""
    product = np.linalg.pinv(found) @ true
    best = np.abs(product).argmax(axis=0)
    assert sorted(best) == list(range(len(product)))  # each source found once
    product = product[best] * np.sign(product[best].diagonal())[:, None]
    return np.abs(product - np.eye(len(product))).mean()
