"""Noise against closed forms; the observation put together, against healpy; the chain from sky to spectra."""

from dataclasses import replace

import numpy as np
import pytest
from skies import convolve, maps_through

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.instrument.beams import Degraded, Evolving
from himap.instrument.noise import noise_maps, noise_sigma, system_temperature
from himap.instrument.observe import observe
from himap.maps import sphere
from himap.maps.low_rank import HarmonicModes
from himap.measures import diagnostics
from himap.paper import cleaned, pipeline
from himap.paper.methods import paper_beams
from himap.removal import PCA
from himap.sky.galaxy import Galaxy
from himap.sky.point_sources import point_sources

SURVEY = Survey(nside=16, n_channels=4, box_cells=16)
BEAMS = (*paper_beams().values(), Degraded(noise="white"))


def test_noise_of_the_paper():
    survey = Survey(n_channels=500)
    sigma = noise_sigma(survey)
    assert sigma[[0, -1]] == pytest.approx([0.033, 0.046], abs=5e-4)
    assert noise_sigma(replace(survey, n_channels=125))[0] == pytest.approx(sigma[1] / 2, rel=0.01)
    assert system_temperature(300.0, 25.0) == pytest.approx(91.0)


@pytest.mark.parametrize(
    ("change", "factor"),
    [
        ({"f_sky": 0.25}, 0.5),
        ({"t_obs": 80_000.0}, 0.5),
        ({"n_dishes": 4 * 197}, 0.5),
        ({"dish_diameter": 27.0}, 2.0),
        ({"t_instr": 25.0 + system_temperature(902.0, 25.0)}, 2.0),
    ],
)
def test_noise_scales_as_the_radiometer_equation_says(change, factor):
    """Its number in mK may be read as a variance in mK^2: 0.033 becomes 0.18."""
    before, after = noise_sigma(Survey())[0], noise_sigma(Survey(**change))[0]
    assert after / before == pytest.approx(factor, rel=1e-6)
    variance = noise_sigma(Survey(noise_reading="variance", **change))[0]
    assert variance**2 == pytest.approx(after, rel=1e-12)


@pytest.mark.parametrize("reading", ["deviation", "variance"])
def test_noise_maps_obey_the_reading(reading, rng):
    survey = replace(SURVEY, noise_reading=reading)
    maps = noise_maps(survey, rng)
    assert maps.dtype == np.float32
    assert maps.std(axis=1) == pytest.approx(noise_sigma(survey), rel=0.06)
    assert np.corrcoef(maps)[np.triu_indices(4, 1)] == pytest.approx(0, abs=0.1)


@pytest.fixture
def cubes(rng):
    shape = (SURVEY.n_channels, SURVEY.n_pix)
    return [scale * rng.standard_normal(shape).astype(np.float32) for scale in (0.1, 1e4, 0.03)]


@pytest.mark.parametrize("beam", BEAMS, ids=str)
def test_observation(cubes, beam):
    hi, foregrounds, noise = cubes
    windows = beam.of_survey(SURVEY)
    hi_alms, alms, noise_alms = (sphere.analyse(cube.astype(float)) for cube in cubes)
    bright = HarmonicModes(spectra=np.eye(SURVEY.n_channels), alms=alms)
    seen = observe(hi_alms, bright, noise if windows.resmoothing is None else noise_alms, windows, SURVEY)
    assert seen.maps.dtype == seen.truth.dtype == np.float32
    smoothed = noise if windows.resmoothing is None else convolve(noise, windows.resmoothing)
    assert seen.truth == pytest.approx(convolve(hi, windows.total) + smoothed, abs=1e-6)
    expected = convolve(foregrounds, windows.total)
    assert seen.maps - seen.truth == pytest.approx(expected, rel=1e-4, abs=0.02)
    assert np.array_equal(seen.freqs, SURVEY.freqs)
    assert seen.beams.shape == (SURVEY.n_channels, SURVEY.lmax + 1)


def test_a_sky_that_float32_would_round_hi_from(cubes, rng):
    """As at 240 MHz: the maps less the true foreground are the truth."""
    _, maps, _ = cubes
    bright = HarmonicModes(
        spectra=np.linspace(40, 4, 4)[:, None], alms=sphere.analyse(maps[:1].astype(float))
    )
    windows = Evolving().of_survey(SURVEY)
    nothing = np.zeros((4, sphere.alm_size(SURVEY.lmax)))
    noise = 1e-3 * rng.standard_normal((4, SURVEY.n_pix)).astype(np.float32)
    seen = observe(nothing, bright, noise, windows, SURVEY)
    assert seen.maps.dtype == np.float64 and seen.truth.dtype == np.float32
    foregrounds = maps_through(windows.total, bright.spectra * bright.alms, SURVEY.nside)
    assert seen.maps - foregrounds == pytest.approx(noise, abs=1e-6)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"hi": np.zeros((4, 12))}, r"hi .* \(4, 1176\), got \(4, 12\)"),
        ({"noise": np.zeros((2, 12))}, r"the noise .* \(4, 3072\)"),
        ({"noise": np.zeros((2, 12)), "beam": Degraded()}, r"the noise .* \(4, 1176\)"),
        ({"spectra": np.ones((2, 1))}, "spectra of the foregrounds"),
        ({"spectra": np.ones((4, 2))}, "spectra of the foregrounds"),
        ({"alms": np.zeros((1, 12))}, "coefficients of the foregrounds"),
        ({"survey": replace(SURVEY, nside=8)}, "b_l of the beam must have the shape for this survey"),
    ],
)
def test_what_is_not_of_the_survey(given, message):
    n_alm = sphere.alm_size(SURVEY.lmax)
    fine = {"hi": np.zeros((4, n_alm)), "noise": np.zeros((4, SURVEY.n_pix)), "survey": SURVEY}
    fine |= {"spectra": np.ones((4, 1)), "alms": np.zeros((1, n_alm)), "beam": Evolving()} | given
    modes, windows = HarmonicModes(spectra=fine["spectra"], alms=fine["alms"]), fine["beam"].of_survey(SURVEY)
    with pytest.raises(InputError, match=message):
        observe(fine["hi"], modes, fine["noise"], windows, fine["survey"])


SMALL = Survey(nside=16, n_channels=20, box_cells=32)
CASE = pipeline.Case(survey=SMALL)


def test_every_component_draws_from_its_own_stream():
    seen = pipeline.observation(replace(CASE, beam=Evolving()))
    alms = sphere.analyse(pipeline.hi_of_sky(SMALL.sky), n_iter=sphere.N_ITER_FLAT)
    signal = maps_through(seen.beams, alms, SMALL.nside)
    assert seen.truth - signal == pytest.approx(noise_maps(SMALL, SMALL.rng("noise")), abs=1e-6)
    *galaxy, sources = pipeline.components_of_sky(SMALL.sky, Galaxy())
    assert [one.name for one in (*galaxy, sources)] == ["synchrotron", "free-free", "point sources"]
    expected = point_sources(SMALL.nside, SMALL.rng("point sources"))
    assert np.array_equal(sources.amplitude, expected.amplitude)


def test_readings_of_the_noise_share_the_sky():
    """They change the noise alone, in the maps and in the spectra of the truth alike."""
    loud = replace(SMALL, noise_reading="variance")
    others = [replace(CASE, beam=Degraded(noise="white")), replace(CASE, survey=loud)]
    before = pipeline.observation(CASE)
    for case in others:
        assert pipeline.hi_alms_of_sky.is_cached(case.survey.sky)
        seen = pipeline.observation(case)
        assert seen.maps - seen.truth == pytest.approx(before.maps - before.truth, abs=0.02)
        assert seen.truth[-1].std() > 1.01 * before.truth[-1].std()
        alms = sphere.analyse(seen.truth[-1] - seen.truth[-1].mean(dtype=float), n_iter=sphere.N_ITER_FLAT)
        inside = slice(2, 2 * SMALL.nside)
        expected = sphere.power_spectrum(alms)[inside]
        assert pipeline.true_spectra(case).angular.cl[-1, inside] == pytest.approx(expected, rel=0.03)


def test_coefficients_of_the_truth_end_where_asked():
    alms = pipeline.truth_alms(CASE, 10)
    assert np.array_equal(alms, sphere.alms_upto(pipeline.truth_alms(CASE), 10))


def test_pca_on_the_real_sky(real_sky):
    """The paper's claim D1 for PCA: degraded beam, three components, C/C0 within 10 % (preset ci)."""
    case = pipeline.Case(
        survey=Survey.preset("ci"), galaxy=Galaxy(source="templates", template_dir=str(real_sky))
    )
    true, pca = pipeline.true_spectra(case), cleaned.assessment(case, PCA(n_sources=3)).power_spectra
    ratio = diagnostics.ratio(pca.angular.mean[1:], true.angular.mean[1:])
    assert np.abs(diagnostics.inside(true.angular.degrees[1:], ratio, 10, 64) - 1).max() < 0.1
