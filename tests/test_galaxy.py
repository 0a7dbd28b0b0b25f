"""The Galaxy as a choice: what PySM gives, and its dimmed plane; emission as spectra times maps."""

import time

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.maps import sphere
from himap.paper import pipeline
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
