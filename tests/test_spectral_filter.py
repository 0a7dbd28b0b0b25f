"""What a linear filter by multipole takes of maps, against a slow twin on the coefficients of a cube."""

import numpy as np
import pytest
from smooth_problem import NSIDE, make_sky

from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.analysis import analysed
from himap.removal.spectral_filter import SpectralFilter

LMAX = 2 * NSIDE


@pytest.fixture
def sky(rng):
    return make_sky(rng)


def some_filter(rng, n_channels, lmax, n_sources=2):
    """Another one at every l, none beyond the first source from l = 20 on."""
    spectra = rng.standard_normal((lmax + 1, n_channels, n_sources))
    spectra[20:, :, 1] = 0
    return SpectralFilter(
        spectra=spectra,
        estimators=0.1 * rng.standard_normal((lmax + 1, n_sources, n_channels)),
        faint=np.array([np.eye(n_channels), 2 * np.eye(n_channels)]),
        first=np.array([0, 5]),
    )


def take(linear, maps):
    return linear.foreground(maps, analysed(maps)).cube()


def test_taken_one_multipole_at_a_time(sky, rng):
    """Maps that end at the last l of the filter: what a transform holds is all that there is."""
    linear = some_filter(rng, len(sky.maps), LMAX)
    modes = analysed(sky.maps)
    expected = modes.upto(LMAX)
    for degree, block in enumerate(harmonic.blocks(expected)):
        block[:] = linear.spectra[degree] @ linear.estimators[degree] @ block
    expected = np.array([sphere.synthesise(alm, NSIDE) for alm in harmonic.from_modes(expected)])
    found = take(linear, sky.maps)
    assert np.std(found - expected) < 1e-3 * np.std(expected)


def test_beyond_the_last_multipole_it_goes_on_as_there(rng):
    """A map of all l that the pixels hold, and a filter that takes the same at every l."""
    maps = rng.standard_normal((6, 12 * NSIDE**2)).astype(np.float32)
    linear = some_filter(rng, 6, 12)
    linear.spectra[:], linear.estimators[:] = linear.spectra[0], linear.estimators[0]
    expected = linear.spectra[0] @ linear.estimators[0] @ maps
    assert linear.foreground(maps, analysed(maps)).cube() == pytest.approx(expected, abs=1e-5)


def test_a_filter_of_a_sum_is_the_sum_of_filters(sky, rng):
    linear = some_filter(rng, len(sky.maps), LMAX)
    cubes = [part.astype(np.float32) for part in (sky.maps, sky.truth, sky.maps - sky.truth)]
    whole, truth, rest = (linear.foreground(cube, analysed(cube)).cube() for cube in cubes)
    assert np.std(whole - truth - rest) < 1e-3 * np.std(whole)


def test_modes_of_one_multipole(sky):
    modes = analysed(sky.maps)
    whole = modes.upto(LMAX)
    for degree in (0, 7, LMAX):
        assert modes.at(degree) == pytest.approx(harmonic.blocks(whole)[degree])


def test_covariance_of_the_band(rng):
    linear = some_filter(rng, 3, 12)
    assert [linear.faint_at(degree)[0, 0] for degree in (0, 4, 5, 12)] == [1, 1, 2, 2]
