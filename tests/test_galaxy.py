"""The Galaxy: what PySM gives, its dimmed plane, its synthetic statistics; emission as spectra times maps."""

import time

import healpy as hp
import numpy as np
import pytest
from scipy.integrate import quad
from skies import bands, spectrum

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.maps import sphere
from himap.paper import pipeline
from himap.sky import synthetic
from himap.sky.emission import PowerLaw, emission_maps, emission_modes
from himap.sky.galaxy import Dimming, Galaxy

SMALL = Survey(nside=16, n_channels=20, box_cells=32)


def test_pysm3_without_network_says_what_to_do():
    """Real, where there is no network; the templates in PySM's own cache also make it pass."""
    started = time.monotonic()
    try:
        sky = Galaxy(source="pysm3").components(16, np.random.default_rng(0))
    except InputError as error:
        assert "could not download" in str(error)
        assert "'synthetic'" in str(error)
        assert "'templates'" in str(error)
        assert time.monotonic() - started < 30
    else:
        assert [component.freq_ref for component in sky] == [408, 30_000]


def test_weight_is_a_gaussian_of_a_third_of_the_edge_and_1_beyond():
    """Far from the edge, where the small step that closes the gap to 1 does not matter."""
    latitude = np.abs(sphere.pixel_latitude(64))
    weights, inside = Dimming(weight=0.0, edge=30.0).weights(64), latitude < 15
    assert weights[inside] == pytest.approx(1 - np.exp(-(latitude[inside] ** 2) / 200), abs=0.012)
    weights = Dimming().weights(64)
    assert weights[latitude.argmin()] == pytest.approx(0.1, abs=1e-3)
    assert (weights[latitude >= 15] == 1).all()
    assert (np.diff(weights[np.argsort(latitude)]) >= 0).all()
    assert (Dimming(weight=1.0).weights(16) == 1).all()


def test_only_foregrounds_are_dimmed():
    full, dimmed = (
        pipeline.Case(survey=SMALL, dimming=one) for one in (None, Dimming(weight=0.0, edge=90.0))
    )
    seen, fainter = pipeline.observation(full), pipeline.observation(dimmed)
    assert np.array_equal(seen.truth, fainter.truth)
    near = np.abs(sphere.pixel_latitude(16)) < 5
    assert fainter.maps[:, near].mean() < 0.2 * seen.maps[:, near].mean()


def test_few_modes_add_up_to_the_emission(rng):
    bright, scatter = np.exp(rng.standard_normal(500)), rng.standard_normal(500)
    freqs = np.linspace(902, 1398, 100)
    components = [
        PowerLaw(name="synchrotron", amplitude=1e6 * bright, freq_ref=408.0, index=-3 + 0.1 * scatter),
        PowerLaw(name="free-free", amplitude=bright, freq_ref=30e3, index=-2.14),
        PowerLaw(name="sources", amplitude=100 * bright, freq_ref=1400.0, index=-2.7 + 0.4 * scatter),
    ]
    spectra, maps = emission_modes(components, freqs)
    exact = sum(one.amplitude * (freqs[:, None] / one.freq_ref) ** one.index for one in components)
    assert spectra @ maps == pytest.approx(exact, rel=1e-11)
    assert (spectra @ maps).astype(np.float32) == pytest.approx(emission_maps(components, freqs), rel=3e-7)
    assert len(maps) < 15
    assert len(emission_modes(components[1:2], freqs)[1]) == 1


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
