"""Kinds of numbers that are understood, and the survey; what is refused is in test_refused.py."""

import astropy.units as u
import numpy as np
import pytest

from himap.core.checks import checked_cube, checked_noise, evenly_spaced, with_fields
from himap.core.errors import InputError
from himap.core.survey import PRESETS, Survey
from himap.removal.pca import PCA

SURVEY = Survey(nside=4, n_channels=6, box_cells=16)
N_PIX = SURVEY.n_pix


@pytest.fixture
def maps(rng):
    return rng.standard_normal((6, N_PIX))


def test_cubes_keep_float32_and_widen_the_rest(maps):
    single = maps.astype(np.float32)
    assert checked_cube("maps", single) is single
    assert checked_cube("maps", np.ma.array(maps)).shape == maps.shape  # nothing masked: fine
    for kind in (np.int32, np.float16, ">f8"):
        assert checked_cube("maps", maps.astype(kind)).dtype == np.float64


def test_temperatures_in_other_units(maps):
    plain, kelvin = (PCA().clean(one, freqs=SURVEY.freqs) for one in (maps, maps / 1e3 * u.K))
    assert kelvin.residual == pytest.approx(plain.residual, abs=1e-6 * np.abs(maps).max())
    assert checked_noise("noise", 1e-5 * u.K) == pytest.approx(0.01)
    with pytest.raises(InputError, match="maps must have a unit that is one of mK"):
        PCA().clean(maps * u.deg_C, freqs=SURVEY.freqs)


def test_frequencies_in_other_units(maps):
    plain = PCA().clean(maps, freqs=SURVEY.freqs)
    quantity = PCA().clean(maps, freqs=SURVEY.freqs / 1e3 * u.GHz)
    assert np.array_equal(plain.residual, quantity.residual)


@pytest.mark.parametrize(("freqs", "even"), [([1, 2], True), ([1, 2, 3.009], True), ([1, 2, 3.011], False)])
def test_evenly_spaced(freqs, even):
    assert evenly_spaced(np.array(freqs)) == even


def test_fields_of_parameters_by_name():
    assert with_fields(Survey, {"nside": 8}) == Survey(nside=8)
    with pytest.raises(InputError, match=r"Survey has no field nsde \(did you mean nside\?\); it has "):
        with_fields(Survey, {"nsde": 8})


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
