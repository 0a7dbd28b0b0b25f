"""The synthetic Galaxy has the statistics of the real one."""

import healpy as hp
import numpy as np
import pytest
from scipy.integrate import quad
from skies import bands, spectrum

from himap.maps import sphere
from himap.sky import synthetic
from himap.sky.galaxy import Galaxy

DEGREES = [2, 5, 10, 20, 50, 100]
# Medians and 99 % per band, and C_l: the real sky at nside 64, in mK and mK^2.
REAL = {
    "synchrotron": (
        1e3 * np.array([65, 48, 34, 24, 16, 12]),
        1e3 * np.array([515, 228, 124, 71, 47, 34]),
        1e6 * np.array([646, 62, 28, 4.6, 0.35, 0.051]),
    ),
    "free-free": (
        1e-3 * np.array([1130, 328, 132, 56, 16, 2.6]),
        1e-3 * np.array([41000, 4990, 1390, 1110, 423, 80]),
        1e6 * np.array([1.6e-7, 3.4e-8, 2.7e-8, 1.2e-8, 2.9e-9, 7.0e-10]),
    ),
}
INDEX_MEAN = [-2.99, -3.00, -3.02, -3.02, -2.99, -2.99]
INDEX_STD = [0.09, 0.09, 0.09, 0.07, 0.05, 0.05]


@pytest.fixture(scope="module")
def skies():
    """Synchrotron and free-free of twelve seeds."""
    return [Galaxy().components(64, np.random.default_rng(seed)) for seed in range(12)]


# Synthetic


@pytest.mark.parametrize(("which", "name"), list(enumerate(REAL)))
def test_synthetic_sky_has_the_statistics_of_the_real_one(skies, which, name):
    """Typical (geometric mean) over seeds: medians within 15 %, 99 % within 30 %, C_l within a factor 2."""
    measured = [[], [], []]
    for sky in skies:
        pixels = sky[which].amplitude
        assert sky[which].name == name
        measured[0].append([np.median(band) for band in bands(pixels)])
        measured[1].append([np.percentile(band, 99) for band in bands(pixels)])
        measured[2].append(spectrum(pixels)[DEGREES])
    for values, real, factor in zip(measured, REAL[name], (1.15, 1.3, 2.0), strict=True):
        offset = np.mean(np.log(values), axis=0) - np.log(real)
        assert np.abs(offset).max() < np.log(factor), np.exp(offset)


def test_synthetic_index(skies):
    mean = np.mean([[band.mean() for band in bands(sky[0].index)] for sky in skies], axis=0)
    std = np.mean([[band.std() for band in bands(sky[0].index)] for sky in skies], axis=0)
    assert mean == pytest.approx(INDEX_MEAN, abs=0.03)
    assert std == pytest.approx(INDEX_STD, abs=0.025)
    assert all(sky[1].index == -2.14 for sky in skies)
    assert all(np.all(np.abs(sky[0].index + 3) < 0.7) for sky in skies)


def test_synthetic_components_share_the_plane(skies):
    logs = np.log([[component.amplitude for component in sky] for sky in skies])
    structure = logs - logs.mean(axis=0)  # without the discs, which every seed has
    for pixels, low, high in ((logs, 0.6, 0.9), (structure, 0.3, 1.0)):
        correlation = np.mean(
            [[np.corrcoef(*pair)[0, 1] for pair in zip(*map(bands, sky), strict=True)] for sky in pixels],
            axis=0,
        )
        assert low < correlation[0] < high  # 0.80 in the real sky
        assert np.abs(correlation[-1]) < 0.2  # 0.07


def test_synthetic_plane_has_no_steps(skies):
    """The typical profile falls smoothly with latitude: no jump from one degree to the next."""
    latitude = np.abs(hp.pix2ang(64, np.arange(12 * 64**2), lonlat=True)[1]).astype(int)
    for which in (0, 1):
        log_sky = np.mean([np.log(sky[which].amplitude) for sky in skies], axis=0)
        profile = np.array([np.median(log_sky[latitude == degree]) for degree in range(60)])
        assert np.all(np.diff(profile[:20]) < 0.05)
        assert np.abs(np.diff(profile[5:])).max() < 0.25


@pytest.mark.parametrize("nside", [4, 32])
def test_coarse_synthetic_sky_is_the_mean_of_the_fine_one(skies, nside):
    for coarse, fine in zip(Galaxy().components(nside, np.random.default_rng(0)), skies[0], strict=True):
        assert coarse.amplitude == pytest.approx(sphere.change_resolution(fine.amplitude, nside))


def test_one_seed_is_one_sky_at_any_resolution(skies):
    fine = Galaxy().components(128, np.random.default_rng(0))
    for coarse, component in zip(skies[0], fine, strict=True):
        logs = np.log(coarse.amplitude), np.log(sphere.change_resolution(component.amplitude, 64))
        assert np.corrcoef(*logs)[0, 1] > 0.98
        assert component.amplitude.mean() == pytest.approx(coarse.amplitude.mean(), rel=0.02)
        ratio = spectrum(component.amplitude)[2:30] / spectrum(coarse.amplitude)[2:30]
        assert ratio == pytest.approx(1, abs=0.15)
        assert spectrum(component.amplitude)[300:380].min() > 0  # there is structure beyond 3 nside - 1 = 191


def test_disc_brightness_is_the_integral_along_the_line_of_sight():
    for lon, lat in [(0, 0), (3, 1), (40, -7), (180, 0.5), (250, 30), (10, 89)]:
        vector = hp.ang2vec(lon, lat, lonlat=True)

        def emissivity(path, vector=vector):
            x, y, z = path * vector
            radius = np.hypot(np.hypot(x - 8.2, y), 1.0)
            return 2.0 * np.exp((8.2 - radius) / 3.0) / np.cosh(min(abs(z) / 0.3, 300)) ** 2

        expected = quad(emissivity, 0, 30, points=[0.5, 2, 8.2, 12], limit=500)[0]
        measured = synthetic._disc_brightness(vector[None], 2.0, 3.0, 0.3)[0]
        assert measured == pytest.approx(expected, rel=5e-3), (lon, lat)


def test_coefficients_have_the_spectrum_and_do_not_depend_on_lmax(rng):
    cl = (np.arange(64) + 1.0) ** -2
    long = synthetic._gaussian_alm(cl, np.random.default_rng(5))
    short = synthetic._gaussian_alm(cl[:20], np.random.default_rng(5))
    kept = np.concatenate([long[hp.Alm.getidx(63, np.arange(m, 20), m)] for m in range(20)])
    assert np.array_equal(kept, short)
    mean = np.mean([hp.alm2cl(synthetic._gaussian_alm(cl, rng)) for _ in range(200)], axis=0)
    scatter = np.sqrt(2 / (200 * (2 * np.arange(64) + 1)))
    assert np.abs((mean / cl - 1) / scatter).max() < 4.5
