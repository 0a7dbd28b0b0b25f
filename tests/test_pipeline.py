"""The chain of products, from sky to spectra, on a small sky; and the chain on the real one."""

from dataclasses import replace

import numpy as np
import pytest
from skies import maps_through

from himap.core.survey import Survey
from himap.instrument.beams import Degraded
from himap.instrument.beams.paper import Evolving
from himap.instrument.noise import noise_maps
from himap.maps import sphere
from himap.measures import diagnostics
from himap.paper import cleaned, pipeline
from himap.removal import PCA
from himap.sky.galaxy import Galaxy
from himap.sky.point_sources import point_sources

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
