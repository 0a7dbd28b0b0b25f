"""The contract that every beam fulfils; the beams of the paper against FACTS, katbeam and closed forms."""

from dataclasses import fields, replace

import healpy as hp
import katbeam
import numpy as np
import pytest
from book_examples import added

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.cubes import beams_of, read_cube
from himap.instrument import beams
from himap.instrument.beams import (
    Degraded,
    Evolving,
    FromFile,
    MeerKAT,
    MeerKATLobes,
    Oscillating,
    PerturbedBeam,
    Rippled,
    named,
)
from himap.instrument.beams.base import REGISTRY, GaussianBeam, diffraction_fwhm, gaussian_widths
from himap.maps import sphere
from himap.paper import pipeline

NAMES = beams.available()
EXAMPLE = "tapered"
SURVEY = Survey(nside=16, n_channels=30, box_cells=16)
LMAX = SURVEY.lmax
ROUND_FREQS = np.array([900.0, 1000, 1100, 1200, 1300, 1400])  # multiples of 10 MHz: no ripple there


@pytest.fixture
def beam(request, tmp_path):
    """The beam called `name`, with parameters where it must have some."""
    name = request.node.callspec.params["name"]
    needed = [item.name for item in fields(REGISTRY[name]) if not isinstance(item.default, str | int | float)]
    assert set(needed) <= {"path"}, "give the parameters of this beam here"
    if needed:
        np.savetxt(tmp_path / "widths.txt", np.linspace(1.6, 1.0, SURVEY.n_channels))
    return beams.create(name, **{item: str(tmp_path / "widths.txt") for item in needed})


@pytest.fixture(autouse=True, scope="module")
def example():
    """The beam that the book adds is found as the others are."""
    with added("add_a_beam", beams, EXAMPLE, REGISTRY):
        yield


@pytest.mark.parametrize("name", [*NAMES, EXAMPLE])
class TestContract:
    def test_windows(self, name, beam):
        found = beam.of_survey(SURVEY)
        assert found.total.shape == found.telescope.shape == (SURVEY.n_channels, LMAX + 1)
        assert found.total.dtype == np.float64 and np.isfinite(found.total).all()
        assert found.total[:, 0] == pytest.approx(1)
        assert np.abs(found.total).max() <= 1.01
        if found.resmoothing is not None:
            assert found.total == pytest.approx(found.telescope * found.resmoothing)
        assert np.array_equal(found.total, beam.of_survey(SURVEY).total)

    def test_a_shorter_lmax_is_the_beginning(self, name, beam):
        long, short = (beam.windows(SURVEY.freqs, lmax=lmax).total for lmax in (LMAX, 20))
        assert short == pytest.approx(long[:, :21], abs=1e-12)

    def test_text_there_and_back(self, name, beam):
        assert named(str(beam)) == beam

    def test_the_dish_matters_where_it_says_so(self, name, beam):
        wide, narrow = (beam.windows(SURVEY.freqs, lmax=LMAX, dish_diameter=d).total for d in (6, 30))
        assert np.array_equal(wide, narrow) != beam.follows_dish
        for dish in (0, -1, 1350):
            with pytest.raises(InputError, match="dish must be a diameter in m"):
                beam.windows(SURVEY.freqs, lmax=LMAX, dish_diameter=dish)

    def test_frequencies_out_of_order(self, name, beam):
        if beam.by_line:
            pytest.skip("goes by the lines of its file, in the user's order")
        with pytest.raises(InputError, match="ascending"):
            beam.windows(SURVEY.freqs[::-1], lmax=LMAX)

    def test_width_read_back_from_the_windows(self, name, beam):
        if not isinstance(beam, GaussianBeam):
            pytest.skip("has no width of its own")
        widths = beam.fwhm(SURVEY.freqs)
        windows = beam.windows(SURVEY.freqs, lmax=150).total
        assert gaussian_widths(windows) == pytest.approx(widths, rel=1e-6)
        assert gaussian_widths(0.05 * windows) == pytest.approx(widths, rel=1e-6)  # of another normalisation

    def test_in_a_simulation_and_for_a_cube(self, name, beam, tmp_path):
        """The same numbers for both; and the observation is seen through them."""
        small = replace(SURVEY, nside=8)
        observation = pipeline.observation(pipeline.Case(survey=small, beam=beam))
        assert observation.beams == pytest.approx(beam.of_survey(small).total)
        order = np.random.default_rng(1).permutation(small.n_channels)
        np.save(tmp_path / "cube.npy", observation.maps[order])
        if beam.by_line:
            np.savetxt(tmp_path / "widths.txt", np.linspace(1.6, 1.0, SURVEY.n_channels)[order])
        cube = read_cube(tmp_path / "cube.npy", freqs=small.freqs[order], unit="mK", order="RING")
        assert beams_of(cube, beam) == pytest.approx(observation.beams)


def test_classes_and_texts():
    assert all(getattr(beams, REGISTRY[name].__name__) is REGISTRY[name] for name in NAMES)
    with pytest.raises(AttributeError, match="has no attribute 'Square'"):
        _ = beams.Square
    assert named("oscillating:ripple=additive") == Oscillating(ripple="additive")
    assert str(Oscillating(ripple="additive")) == "oscillating:ripple=additive"
    assert str(Oscillating()) == "oscillating"


class TestOscillating:
    def test_polynomial(self):
        fwhm = Oscillating().fwhm(ROUND_FREQS)
        Oscillating().windows([850.0, 1420.0], lmax=10)  # where it was measured
        polynomial = fwhm / diffraction_fwhm(ROUND_FREQS, 13.5)
        assert polynomial == pytest.approx([1.17756, 1.16300, 1.15097, 1.13336, 1.12579, 1.13206], abs=1e-5)
        assert np.rad2deg(fwhm) == pytest.approx([1.6647, 1.4798, 1.3313, 1.2017, 1.1019, 1.0288], abs=1e-4)

    @pytest.mark.parametrize(
        ("ripple", "smooth", "relative"),
        [
            ("bracket", Rippled(amplitude=0), 0.0014),
            ("additive", Evolving(), 0.0014),
            ("additive_strong", Evolving(), 0.007),
        ],
    )
    def test_ripple_amplitude(self, ripple, smooth, relative):
        """At crest and trough, sin = 1 and -1; in arcmin it is as stated."""
        freqs = [1145.0, 1155.0]
        wave = Oscillating(ripple=ripple).fwhm(freqs) - smooth.fwhm(freqs)
        assert wave / smooth.fwhm(freqs) == pytest.approx([relative, -relative], rel=0.1)
        if ripple != "bracket":
            arcmin = {"additive": 0.1, "additive_strong": 0.5}[ripple]
            assert np.rad2deg(wave) * 60 == pytest.approx([arcmin, -arcmin])


def test_gaussian_beam_against_healpy():
    fwhm = np.deg2rad([1.0, 2.0])
    ours = sphere.gaussian_beam(fwhm, 50)
    assert ours == pytest.approx(np.stack([hp.gauss_beam(width, 50) for width in fwhm]), rel=1e-10)


@pytest.mark.parametrize("beam", ["degraded", "degraded:noise=white", "evolving", "oscillating"])
def test_degraded_beam_is_the_worst_everywhere(beam):
    """The degraded beam is the worst everywhere, whether the noise is smoothed with it or not."""
    found = named(beam).of_survey(SURVEY)
    assert (found.resmoothing is None) == (beam != "degraded")
    if beam.startswith("degraded"):
        worst = sphere.gaussian_beam(diffraction_fwhm(SURVEY.freqs[0], 13.5), LMAX)
        assert found.total == pytest.approx(np.broadcast_to(worst, found.total.shape), rel=1e-10)
    else:
        assert found.total is found.telescope
        assert found.telescope[-1, -1] > found.telescope[0, -1]  # higher frequency, sharper beam


@pytest.mark.parametrize(
    ("beam", "freqs", "band"),
    [
        ("meerkat", [971, 1075], "L"),
        ("meerkat", [858, 958], "UHF"),
        ("meerkat:band=L", [971, 1023], "L"),
        ("meerkat_lobes:band=UHF", [971, 1023], "UHF"),
        ("meerkat", [900, 1650], "L"),
    ],
)
def test_band_of_meerkat(beam, freqs, band):
    """The one that holds the frequencies, or that is named: widths as in katbeam's table at each end."""
    chosen = named(beam).chosen_for(freqs)
    assert str(chosen) == f"{named(beam).name}:band={band}" and named(str(chosen)) == chosen
    table = katbeam.JimBeam(f"MKAT-AA-{band}-JIM-2020")
    expected = np.interp(freqs, table.freqMHzlist, table.fwhmlist.mean(axis=0))
    assert np.rad2deg(MeerKAT(band=band).fwhm(freqs)) == pytest.approx(expected, rel=0.004)
    assert np.array_equal(named(beam).windows(freqs, lmax=60).total, chosen.windows(freqs, lmax=60).total)
    error = PerturbedBeam(beam=beam, width=0.01)
    assert error.chosen_for(freqs) == replace(error, beam=str(chosen))


@pytest.mark.parametrize(("freq", "most"), [(900.0, 1e-3), (1400.0, 2e-3)])
def test_lobes_against_a_map_of_the_beam(freq, most):
    """b_l from the coefficients of a map of the beam at the pole, with all of its angles.

    Nothing much is beyond 2 pi D / lambda, where a dish ends, which the Gaussian does not know.
    """
    theta, phi = hp.pix2ang(512, np.arange(12 * 512**2))
    near = np.rad2deg(theta) < 20
    radius, power = np.rad2deg(theta[near]), np.zeros(len(theta))
    model = katbeam.JimBeam("MKAT-AA-L-JIM-2020")
    power[near] = model.I(radius * np.cos(phi[near]), radius * np.sin(phi[near]), freq)
    alm = hp.map2alm(power, lmax=200, iter=1)[:201].real  # m = 0
    expected = np.sqrt(1 / (2 * np.arange(201) + 1)) * alm / alm[0]
    kinds = MeerKATLobes(band="L"), MeerKAT(band="L")
    lobes, gaussian = (one.windows([freq, 1500.0], lmax=600).total[0] for one in kinds)
    assert lobes[:201] == pytest.approx(expected, abs=1e-3)  # what the pixels take
    end = int(2 * np.pi / diffraction_fwhm(np.array([freq]), 13.5)[0])
    assert lobes[end:].max() < most < 5e-3 < gaussian[end] and lobes.min() == 1e-4


class TestPerturbed:
    def test_of_a_gaussian_it_is_one_of_another_width(self):
        wrong = PerturbedBeam(beam="evolving", width=0.02, ripple=0.001, period=7, phase=0.5)
        expected = Evolving().fwhm(SURVEY.freqs) * (1.02 + 0.001 * np.sin(2 * np.pi * SURVEY.freqs / 7 + 0.5))
        assert wrong.of_survey(SURVEY).total == pytest.approx(sphere.gaussian_beam(expected, LMAX), rel=1e-10)
        right = PerturbedBeam(beam="evolving").of_survey(SURVEY).total
        assert right == pytest.approx(Evolving().of_survey(SURVEY).total)

    def test_what_the_analyst_smooths_with_is_known(self):
        wrong = PerturbedBeam(beam="degraded", width=0.1).of_survey(SURVEY)
        true = Degraded().of_survey(SURVEY)
        assert np.array_equal(wrong.resmoothing, true.resmoothing)
        assert (wrong.telescope[:, 5:] < true.telescope[:, 5:]).all()

    def test_one_with_parameters_there_and_back(self):
        wrong = PerturbedBeam(beam="rippled:amplitude=0.2,period=30", width=0.01)
        assert named(str(wrong)) == wrong
        other = replace(wrong, beam="rippled:amplitude=0.2")
        assert wrong.of_survey(SURVEY).total != pytest.approx(other.of_survey(SURVEY).total)

    def test_of_a_file(self, tmp_path):
        """It goes by the lines of the file, counts by what it holds, and keeps the sign of b_l."""
        numbers = Evolving().of_survey(SURVEY).total
        numbers[:, 30:] = -0.01
        np.save(tmp_path / "b.npy", numbers)
        wrong = PerturbedBeam(beam=str(tmp_path / "b.npy"), width=0.5)
        assert wrong.by_line and wrong.digest() == FromFile(path=tmp_path / "b.npy").digest()
        assert wrong.of_survey(SURVEY).total[:, 30:] == pytest.approx(-(0.01**2.25))
        assert not PerturbedBeam().by_line and PerturbedBeam().follows_dish


def test_ripple_and_width_of_rippled():
    """FWHM / (lambda / D), less that without a ripple, is A sin(2 pi nu / period + phase)."""
    freqs = np.linspace(900, 1400, 300)
    beam, smooth = Rippled(amplitude=0.6, period=33, phase=1.1), Rippled(amplitude=0)
    wave = (beam.fwhm(freqs) - smooth.fwhm(freqs)) / diffraction_fwhm(freqs, 13.5)
    assert wave == pytest.approx(0.01 * np.sin(2 * np.pi * freqs / 33 + 1.1), abs=1e-9)
    assert smooth.fwhm(ROUND_FREQS) == pytest.approx(Oscillating().fwhm(ROUND_FREQS))


class TestFromFile:
    def test_b_l(self, tmp_path):
        """As they are, negative side lobes too, to the last l that is asked for."""
        transfer = Evolving().of_survey(SURVEY).total
        transfer[:, 30:] = -0.01
        np.save(tmp_path / "b.npy", np.hstack([transfer, np.zeros((SURVEY.n_channels, 5))]))
        beam = FromFile(path=tmp_path / "b.npy")
        assert np.array_equal(beam.of_survey(SURVEY).total, transfer)

    def test_results_depend_on_what_the_file_holds(self, tmp_path):
        path = tmp_path / "w.txt"
        np.savetxt(path, np.full(SURVEY.n_channels, 1.0))
        before, digest = FromFile(path=path), FromFile(path=path).digest()
        case = pipeline.Case(survey=replace(SURVEY, nside=8), beam=before)
        first = pipeline.observation(case).beams
        np.savetxt(path, np.full(SURVEY.n_channels, 2.0))
        assert FromFile(path=path) == before and FromFile(path=path).digest() != digest
        assert pipeline.observation(case).beams[0, 20] < first[0, 20]

    def test_b_l_that_end_too_early_for_a_survey(self, tmp_path):
        """What else cannot be a beam is in bad_inputs.py, of a cube."""
        np.save(tmp_path / "b.npy", np.ones((30, 10)))
        with pytest.raises(InputError, match="must reach l = 47 for nside 16, got b_l to 9"):
            pipeline.Case(survey=SURVEY, beam=FromFile(path=tmp_path / "b.npy"))


def test_the_width_of_a_beam_that_is_no_gaussian_is_read_at_a_tenth():
    beam = 1 / (1 + (np.arange(300.0) / 20) ** 2)  # above a tenth up to l = 59
    expected = np.sqrt(8 * np.log(2) * -2 * np.log(beam[59]) / (59 * 60))
    assert gaussian_widths([beam]) == pytest.approx([expected])
