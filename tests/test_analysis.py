"""The modes of a cube, against those that it was made of."""

import numpy as np
import pytest

from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.analysis import cube_modes

NSIDE = 16
LMAX = 32  # the transform of HEALPix maps is good to 2 nside


@pytest.fixture
def cube(rng):
    """Maps (8, n_pix) of a foreground of two spectra, 1e4 times noise, plus noise; the modes of both."""
    freqs = np.linspace(1.0, 1.5, 8)
    spectra = np.stack([freqs**-2.7, freqs**-2.1], axis=1)
    steep = 1 / (1.0 + np.arange(LMAX + 1)) ** 2
    bright = np.stack([sphere.gaussian_alm(1e8 * steep, rng) for _ in range(2)])
    faint = np.stack([sphere.gaussian_alm(np.ones(LMAX + 1), rng) for _ in range(8)])
    maps = np.stack([sphere.synthesise(alm, NSIDE) for alm in spectra @ bright + faint])
    return maps.astype(np.float32), harmonic.to_modes(spectra @ bright), harmonic.to_modes(faint)


def test_modes_are_those_that_the_cube_was_made_of(cube):
    """The quadrature that does for noise misses more of the foreground than there is noise."""
    maps, bright, faint = cube
    modes = cube_modes(maps)
    found, rough = modes.upto(LMAX), harmonic.to_modes(sphere.analyse(maps, LMAX, n_iter=0))
    assert found.dtype == np.float64 and found.shape == bright.shape
    assert (found - bright - faint).std() < 0.1 * faint.std()
    assert (rough - bright - faint).std() > faint.std()
    assert modes.spectra.shape == (8, 2)


def test_modes_along_spectra_are_their_sums(cube, rng):
    maps = cube[0]
    modes, rows = cube_modes(maps), rng.standard_normal((3, 8))
    expected = rows @ modes.upto(LMAX)
    np.testing.assert_allclose(modes.along(rows, LMAX), expected, atol=1e-5 * cube[2].std())
