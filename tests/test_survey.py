"""The survey: presets, derived numbers, random streams, and what it refuses."""

import numpy as np
import pytest

from himap.core.survey import PRESETS, Survey


@pytest.mark.parametrize("name", PRESETS)
def test_channels_of_presets(name):
    """Their numbers are those of the page on conventions (test_project.py).

    A 20 MHz wave keeps its mean square on them; round frequencies 10 MHz apart would see none.
    """
    survey = Survey.preset(name)
    assert survey.freqs == pytest.approx(900 + survey.channel_width * (np.arange(survey.n_channels) + 0.5))
    assert len(survey.freq_edges) == survey.n_channels + 1
    assert np.mean(np.sin(2 * np.pi * survey.freqs / 20) ** 2) == pytest.approx(0.5)


def test_default_and_overrides():
    assert Survey() == Survey.preset() == PRESETS["quick"]
    survey = Survey.preset("ci", nside=16, seed=3)
    assert (survey.nside, survey.seed, survey.n_channels) == (16, 3, 100)


def test_the_sky_does_not_depend_on_the_instrument():
    """Every field of the dish, of the noise and of the measures goes back to its default, and no other."""
    changed = {"dish_diameter": 20.0, "n_dishes": 64, "t_obs": 1e3, "t_instr": 20.0, "f_sky": 0.5}
    survey = Survey.preset("ci", seed=3, **changed, noise_reading="variance", taper="hann")
    assert survey.sky == Survey.preset("ci", seed=3)


def test_random_streams():
    survey = Survey(seed=1)
    hi = survey.rng("hi").standard_normal(4)
    assert np.array_equal(hi, survey.rng("hi").standard_normal(4))
    assert not np.array_equal(hi, survey.rng("noise").standard_normal(4))
    assert not np.array_equal(hi, Survey(seed=2).rng("hi").standard_normal(4))
