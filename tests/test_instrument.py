"""Beams and noise against FACTS.md, katbeam and closed forms; the observation put together."""

from dataclasses import replace

import healpy as hp
import katbeam
import numpy as np
import pytest

from himap.errors import InputError
from himap.instrument import beams
from himap.instrument.noise import noise_maps, noise_sigma, system_temperature
from himap.instrument.observe import observe
from himap.maps import sphere
from himap.survey import Survey

SURVEY = Survey(nside=16, n_channels=4, box_cells=16)
ROUND_FREQS = np.array([900.0, 1000, 1100, 1200, 1300, 1400])  # multiples of 10 MHz: no ripple there


def test_polynomial_of_the_oscillating_beam():
    fwhm = beams.oscillating_fwhm(ROUND_FREQS, 13.5)
    polynomial = fwhm / beams.diffraction_fwhm(ROUND_FREQS, 13.5)
    assert polynomial == pytest.approx([1.17756, 1.16300, 1.15097, 1.13336, 1.12579, 1.13206], abs=1e-5)
    assert np.rad2deg(fwhm) == pytest.approx([1.6647, 1.4798, 1.3313, 1.2017, 1.1019, 1.0288], abs=1e-4)


def test_polynomial_against_its_chebyshev_form():
    chebyshev = [1.14744, -0.0269958, 0.00670339, 0.00365301, 0.000960758]
    chebyshev += [-0.000408714, -0.000699873, 0.00100132, 0.000405592]
    freqs = np.arange(900.0, 1401, 10)
    stable = np.polynomial.chebyshev.chebval((freqs - 1150) / 250, chebyshev)
    ours = beams.oscillating_fwhm(freqs, 13.5) / beams.diffraction_fwhm(freqs, 13.5)
    assert ours == pytest.approx(stable, abs=2e-5)


def test_oscillating_beam_against_holography():
    """The MeerKAT L-band table: our FWHM is within 1.5 % of the mean of its four columns."""
    beam = katbeam.JimBeam("MKAT-AA-L-JIM-2020")
    table = beam.fwhmlist.mean(axis=0)
    expected = np.interp(ROUND_FREQS, beam.freqMHzlist, table)
    assert expected == pytest.approx([1.6527, 1.4772, 1.3256, 1.1965, 1.0950, 1.0194], abs=1e-3)
    assert np.rad2deg(beams.oscillating_fwhm(ROUND_FREQS, 13.5)) == pytest.approx(expected, rel=0.015)


@pytest.mark.parametrize(("ripple", "relative"), [("bracket", 0.0014), ("additive_strong", 0.007)])
def test_ripple_amplitude(ripple, relative):
    crest, trough = beams.oscillating_fwhm([1145.0, 1155.0], 13.5, ripple)  # sin = 1, -1
    smooth = beams.oscillating_fwhm([1140.0, 1150.0, 1160.0], 13.5, ripple)
    # Half the jump from crest to trough, less the smooth change of the beam over those 10 MHz.
    amplitude = 0.5 * (crest - trough + (smooth[0] - smooth[2]) * -0.5)
    assert amplitude / smooth[1] == pytest.approx(relative, rel=0.1)


def test_ripple_in_arcmin():
    for ripple, arcmin in (("additive", 0.1), ("additive_strong", 0.5)):
        extra = beams.oscillating_fwhm([905.0], 13.5, ripple) - beams.diffraction_fwhm([905.0], 13.5)
        assert np.rad2deg(extra) * 60 == pytest.approx([arcmin])


def test_gaussian_beam_against_healpy():
    fwhm = np.deg2rad([1.0, 2.0])
    ours = sphere.gaussian_beam(fwhm, 50)
    assert ours == pytest.approx(np.stack([hp.gauss_beam(width, 50) for width in fwhm]), rel=1e-10)


def test_degraded_beam_is_the_worst_everywhere():
    beam = beams.beam_model("degraded", SURVEY)
    worst = sphere.gaussian_beam(beams.diffraction_fwhm(SURVEY.freqs[0], 13.5), SURVEY.lmax)
    assert beam.transfer == pytest.approx(np.broadcast_to(worst, beam.transfer.shape), rel=1e-10)
    assert beam.after[0] == pytest.approx(1)


@pytest.mark.parametrize("name", ["evolving", "oscillating"])
def test_other_beams_are_native(name):
    beam = beams.beam_model(name, SURVEY)
    assert beam.after is None
    assert beam.transfer is beam.native
    assert (np.diff(beam.native[:, -1]) > 0).all()  # higher frequency, sharper beam


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
    before, after = noise_sigma(Survey())[0], noise_sigma(Survey(**change))[0]
    assert after / before == pytest.approx(factor, rel=1e-6)


def test_beam_model_follows_the_dish_and_the_ripple():
    """The width read back from b_l is that of the formula, for another dish and every reading."""
    survey = replace(SURVEY, dish_diameter=15.0)
    degree = 20
    for ripple in beams.RIPPLES:
        transfer = beams.beam_model("oscillating", survey, ripple=ripple).native[:, degree]
        sigma = np.sqrt(-2 * np.log(transfer) / (degree * (degree + 1)))
        expected = beams.oscillating_fwhm(survey.freqs, 15.0, ripple)
        assert sigma * np.sqrt(8 * np.log(2)) == pytest.approx(expected, rel=1e-9)


def test_noise_maps(rng):
    maps = noise_maps(SURVEY, rng)
    assert maps.dtype == np.float32
    assert maps.std(axis=1) == pytest.approx(noise_sigma(SURVEY), rel=0.06)
    assert np.corrcoef(maps)[np.triu_indices(4, 1)] == pytest.approx(0, abs=0.1)


@pytest.fixture
def cubes(rng):
    shape = (SURVEY.n_channels, SURVEY.n_pix)
    return [scale * rng.standard_normal(shape).astype(np.float32) for scale in (0.1, 1e4, 0.03)]


@pytest.mark.parametrize("name", beams.BEAM_MODELS)
def test_observation(cubes, name):
    hi, foregrounds, noise = cubes
    beam = beams.beam_model(name, SURVEY)
    seen = observe(hi, foregrounds, noise, beam, SURVEY, provenance={"galaxy": "test"})
    assert seen.maps.dtype == seen.truth.dtype == np.float32
    smoothed = sphere.convolve(noise, beam.after) if name == "degraded" else noise
    assert seen.truth == pytest.approx(sphere.convolve(hi, beam.transfer) + smoothed, abs=1e-6)
    expected = sphere.convolve(foregrounds, beam.transfer)
    assert seen.maps - seen.truth == pytest.approx(expected, rel=1e-4, abs=0.02)
    assert seen.provenance == {"galaxy": "test", "beam": name}
    assert np.array_equal(seen.freqs, SURVEY.freqs)
    assert seen.beams.shape == (SURVEY.n_channels, SURVEY.lmax + 1)


def test_foregrounds_as_spectra_times_maps(cubes, rng):
    hi, _, noise = cubes
    spectra, maps = 1 + rng.random((SURVEY.n_channels, 2)), 1e4 * rng.random((2, SURVEY.n_pix))
    beam = beams.beam_model("evolving", SURVEY)
    alms = sphere.analyse(maps)
    one = observe(hi, (spectra, alms), noise, beam, SURVEY)
    two = observe(hi, (spectra @ maps).astype(np.float32), noise, beam, SURVEY)
    assert one.maps == pytest.approx(two.maps, abs=0.01)  # float32 of 1e4 mK has 1e-3
    for bad in [(spectra[:2], alms), (spectra[:, :1], alms), (spectra, alms[:, 1:]), (spectra, maps)]:
        with pytest.raises(InputError, match="foregrounds must have shapes"):
            observe(hi, bad, noise, beam, SURVEY)


@pytest.mark.parametrize("name", ["evolving", "degraded"])
def test_coefficients_at_hand(cubes, name):
    hi, foregrounds, noise = cubes
    beam = beams.beam_model(name, SURVEY)
    alms = sphere.analyse(hi), sphere.analyse(foregrounds.astype(float))
    one = observe(*alms, noise, beam, SURVEY, noise_alms=sphere.analyse(noise))
    two = observe(*cubes, beam, SURVEY)
    assert one.truth == pytest.approx(two.truth, abs=1e-6)
    assert one.maps == pytest.approx(two.maps, abs=0.01)
    with pytest.raises(InputError, match=r"hi must have shape \(n_channels, n_alm\)"):
        observe(alms[0][:, 1:], foregrounds, noise, beam, SURVEY)


def test_custom_beam(cubes):
    transfer = beams.beam_model("evolving", SURVEY).native
    own = observe(*cubes, beams.beam_from_array(transfer, SURVEY), SURVEY)
    paper = observe(*cubes, beams.beam_model("evolving", SURVEY), SURVEY)
    assert np.array_equal(own.maps, paper.maps)


def test_bad_beams():
    with pytest.raises(InputError, match="degraded, evolving, oscillating"):
        beams.beam_model("gaussian", SURVEY)
    with pytest.raises(InputError, match="bracket .*additive"):
        beams.oscillating_fwhm(ROUND_FREQS, 13.5, "wobble")
    with pytest.raises(InputError, match="850 to 1420 MHz"):
        beams.oscillating_fwhm([1000.0, 1500.0], 13.5)
    with pytest.raises(InputError, match=r"\(4, 48\).*got \(4, 10\)"):
        beams.beam_from_array(np.ones((4, 10)), SURVEY)
    for value, degree in ((np.nan, 7), (50.0, 7), (0.0, 0)):
        bad = np.ones((4, 48))
        bad[2, degree] = value
        with pytest.raises(InputError, match=f"got {value} at channel 2, l = {degree}"):
            beams.beam_from_array(bad, SURVEY)


def test_cubes_of_the_wrong_shape(cubes):
    with pytest.raises(InputError, match="noise must have shape"):
        observe(cubes[0], cubes[1], cubes[2][:2], beams.beam_model("evolving", SURVEY), SURVEY)
