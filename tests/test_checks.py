"""Kinds of numbers that are understood; what is refused is in test_refused.py."""

import astropy.units as u
import numpy as np
import pytest

from himap.core.checks import checked_cube, checked_noise, evenly_spaced, with_fields
from himap.core.errors import InputError
from himap.core.survey import Survey
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
