"""Input that looks like data and is not: each is refused in words, none gives numbers in silence."""

from dataclasses import replace

import astropy.units as u
import numpy as np
import pytest

from himap.core.checks import checked_cube, evenly_spaced, real_array, whole_number
from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.instrument.beams import Evolving
from himap.instrument.observe import observe
from himap.measures import spectra
from himap.paper import pipeline
from himap.removal.pca import PCA

SURVEY = Survey(nside=4, n_channels=6, box_cells=16)
N_PIX = SURVEY.n_pix


@pytest.fixture
def maps(rng):
    return rng.standard_normal((6, N_PIX))


def test_masked_arrays_are_refused_wherever_they_come_in(maps):
    masked = np.ma.masked_greater(maps, 1)
    with pytest.raises(InputError, match="maps has masked values"):
        PCA().clean(masked, freqs=SURVEY.freqs)
    with pytest.raises(InputError, match="maps has masked values"):
        spectra.angular_power(masked)
    with pytest.raises(InputError, match="the mask has masked values"):
        spectra.angular_power(maps, mask=np.ma.masked_less(np.ones(N_PIX), 2))
    assert checked_cube("maps", np.ma.array(maps)).shape == maps.shape  # nothing masked: fine


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([[1, 2], [3]], "one array, got rows of unequal length"),
        (np.ones((2, 3), dtype=complex), "real numbers, got complex128"),
        (np.array([["a"]]), "real numbers, got <U1"),
        (np.ones((2, 3), dtype=bool), "real numbers, got bool"),
        (np.ones(3), r"\(n_channels, n_pix\), got \(3,\)"),
        (np.ones((3, 0)), r"got \(3, 0\)"),
        (np.full((2, 3), -1.6375e30), "got 6 NaN, infinite or UNSEEN"),
    ],
)
def test_cubes_that_are_none(values, message):
    with pytest.raises(InputError, match=message):
        checked_cube("maps", values)


def test_cubes_keep_float32_and_widen_the_rest(maps):
    single = maps.astype(np.float32)
    assert checked_cube("maps", single) is single
    for kind in (np.int32, np.float16, ">f8"):
        assert checked_cube("maps", maps.astype(kind)).dtype == np.float64


def test_whole_numbers():
    assert whole_number("n", np.int64(3), 1, 4) == 3
    for value in (0, 5, 2.5, "2", True, None):
        with pytest.raises(InputError, match="n must be a whole number between 1 and 4"):
            whole_number("n", value, 1, 4)


def test_spectra_of_integer_maps_are_those_of_the_numbers(maps):
    whole = (100 * maps).astype(np.int16)
    expected = spectra.angular_power(whole.astype(float)).cl
    assert spectra.angular_power(whole).cl == pytest.approx(expected)


def test_what_a_mask_leaves_out_may_be_anything(maps):
    mask = np.arange(N_PIX) > 50
    dirty = maps.copy()
    dirty[:, :20] = np.nan
    dirty[:, 20:50] = -1.6375e30
    expected = spectra.angular_power(maps, mask=mask).cl
    assert spectra.angular_power(dirty, mask=mask).cl == pytest.approx(expected)
    expected = spectra.frequency_power(maps, 1.0, mask=mask).power
    assert spectra.frequency_power(dirty, 1.0, mask=mask).power == pytest.approx(expected)
    with pytest.raises(InputError, match="UNSEEN"):
        spectra.angular_power(dirty)


@pytest.mark.parametrize("width", [0, -1, np.nan, np.inf, "4", 1j])
def test_channel_width(maps, width):
    with pytest.raises(InputError, match="channel_width must be a positive number"):
        spectra.frequency_power(maps, width)


def test_frequencies_in_other_units(maps):
    plain = PCA().clean(maps, freqs=SURVEY.freqs)
    quantity = PCA().clean(maps, freqs=SURVEY.freqs / 1e3 * u.GHz)
    assert np.array_equal(plain.residual, quantity.residual)
    for factor in (1e-3, 1e6):
        with pytest.raises(InputError, match="looks like another unit"):
            PCA().clean(maps, freqs=SURVEY.freqs * factor)
    with pytest.raises(InputError, match="real numbers"):
        PCA().clean(maps, freqs=SURVEY.freqs + 1j)


def test_beam_of_another_survey(maps):
    other = Evolving().of_survey(replace(SURVEY, nside=8))
    with pytest.raises(InputError, match=r"made for this survey: b_l of shape \(6, 12\), got \(6, 24\)"):
        observe(maps, maps, maps, other, SURVEY)


def test_an_observer_at_the_centre_of_a_cell_is_refused():
    with pytest.raises(InputError, match="box_cells must be even.*got 65, try 66"):
        Survey(box_cells=65)


def test_a_case_takes_objects():
    with pytest.raises(InputError, match="a Survey and a Galaxy"):
        pipeline.Case(survey=SURVEY, galaxy="synthetic")
    with pytest.raises(InputError, match="a Case takes a beam, such as Degraded"):
        pipeline.Case(survey=SURVEY, beam="degraded")


def test_real_array_names_its_input():
    with pytest.raises(InputError, match="^beams must be real"):
        real_array("beams", [None])


@pytest.mark.parametrize(("freqs", "even"), [([1, 2], True), ([1, 2, 3.009], True), ([1, 2, 3.011], False)])
def test_evenly_spaced(freqs, even):
    assert evenly_spaced(np.array(freqs)) == even
