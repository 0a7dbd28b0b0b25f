"""Foregrounds as a short sum of spectra times maps."""

import numpy as np
import pytest

from himap.sky.emission import PowerLaw, emission_maps, emission_modes

FREQS = np.linspace(902, 1398, 100)


@pytest.fixture
def components(rng):
    bright, scatter = np.exp(rng.standard_normal(500)), rng.standard_normal(500)
    return [
        PowerLaw(name="synchrotron", amplitude=1e6 * bright, freq_ref=408.0, index=-3 + 0.1 * scatter),
        PowerLaw(name="free-free", amplitude=bright, freq_ref=30e3, index=-2.14),
        PowerLaw(name="sources", amplitude=100 * bright, freq_ref=1400.0, index=-2.7 + 0.4 * scatter),
    ]


def test_few_modes_add_up_to_the_emission(components):
    spectra, maps = emission_modes(components, FREQS)
    exact = sum(one.amplitude * (FREQS[:, None] / one.freq_ref) ** one.index for one in components)
    assert spectra @ maps == pytest.approx(exact, rel=1e-11)
    assert (spectra @ maps).astype(np.float32) == pytest.approx(emission_maps(components, FREQS), rel=3e-7)
    assert len(maps) < 15
    assert len(emission_modes(components[1:2], FREQS)[1]) == 1
