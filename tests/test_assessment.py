"""Everything that is measured on what a method leaves, against the same of the cube that it leaves."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from skies import correlation, line_errors

from himap.core.survey import Survey
from himap.instrument.beams import Degraded, Oscillating
from himap.measures import diagnostics
from himap.measures.spectra import angular_power, frequency_power
from himap.paper import cleaned, pipeline
from himap.removal import GMCA, PCA, BeamSubspace, FastICA, Parametric, Polynomial, SDecGMCA
from himap.removal.base import Separation
from himap.removal.spectral_filter import on_sky
from himap.sky.galaxy import Dimming

SURVEY = Survey.preset("ci", nside=16, n_channels=24, box_cells=16)
SHORT = {"n_sources": 3, "n_warmup": 10, "n_refinement": 3, "regularisation": 1e-2, "share": 0.7}
METHODS = [
    PCA(n_sources=3),
    FastICA(n_sources=3),
    GMCA(n_sources=3, max_iterations=60),
    Polynomial(order=4),
    Parametric(),
    BeamSubspace(n_sources=3),
    SDecGMCA(**SHORT),
    SDecGMCA(**SHORT, reading="letter"),
    SDecGMCA(**SHORT, reading="letter", lmax=12),
    SDecGMCA(**SHORT, beyond="projection", mixing_scales="detail"),
]


FAINTER = Dimming(weight=1e-2, edge=90.0)  # so that the rounding of cubes in float32 does not show


def case_of(beam, survey=SURVEY):
    return pipeline.Case(survey=survey, beam=beam, dimming=FAINTER)


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
@pytest.mark.parametrize("beam", [Degraded(), Oscillating()], ids=lambda beam: beam.name)
@pytest.mark.parametrize("remover", METHODS, ids=lambda method: method.name)
def test_error_and_measures_are_those_of_the_cubes(beam, remover):
    """Of what is left and the truth, up to where the method ends."""
    case, width = case_of(beam), SURVEY.channel_width
    lmax = cleaned.separation(case, remover).lmax
    left, truth, cut_truth = cleaned.residual(case, remover), pipeline.truth(case), pipeline.truth(case, lmax)
    left = left if lmax is None else pipeline.cut_cube(left, lmax)
    cut = getattr(remover, "beyond", "") == "cut"

    error = cleaned.error(case, remover).lines(slice(None))
    rest, true = (maps - maps.mean(axis=1, keepdims=True, dtype=float) for maps in (left, cut_truth))
    rounding = 1e-6 * rest.std()  # in float32, of a run that failed; others leave nothing of note
    assert (error - (rest - true)).std() < (0.02 if cut else 0.005) * true.std() + rounding

    found = cleaned.assessment(case, remover)
    degrees = found.power_spectra.angular.degrees
    seen = slice(2, int(min(degrees[-1], 1.5 * SURVEY.nside)))  # beyond, HEALPix has no good quadrature
    cl = angular_power(left).upto(degrees[-1]).mean
    assert found.power_spectra.angular.mean[seen] == pytest.approx(cl[seen], rel=0.01)
    power = frequency_power(left, width).power
    assert found.power_spectra.frequency.power[1:] == pytest.approx(power[1:], rel=5e-3)
    assert found.correlation == pytest.approx(correlation(left, truth), abs=2e-3)
    errors = line_errors(left, truth)
    # What is left up to some l comes out of an analysis, whose quadrature changes HI too, near the poles.
    close = 0.02 * truth.var() if cut else 0.01 * errors.mean()
    off = np.abs(found.line_errors - errors) > 0.05 * errors + close
    assert off.mean() < (0.01 if cut else 1e-9)
    assert (found.cut_truth is None) == (lmax is None)
    if found.cut_truth is not None:
        power = frequency_power(cut_truth, width).power
        assert found.cut_truth.frequency.power[1:] == pytest.approx(power[1:], rel=5e-3)

    mask = ~diagnostics.flagged_lines(found.line_errors)
    assert 0 < np.count_nonzero(~mask) < len(mask) / 2
    for masked, maps in zip(cleaned.post_masked(case, remover), (left, truth), strict=True):
        expected, degrees = angular_power(maps, mask=mask), masked.angular.degrees
        inside = (degrees > 2) & (degrees < seen.stop)
        at = np.searchsorted(expected.degrees, degrees[inside])
        assert masked.angular.mean[inside] == pytest.approx(expected.mean[at], rel=0.03)
        power = frequency_power(maps, width, mask=mask).power
        assert masked.frequency.power[1:] == pytest.approx(power[1:], rel=5e-3)


def test_a_taper_is_that_of_every_spectrum_along_the_line_of_sight():
    case, method = case_of(Degraded(), replace(SURVEY, taper="hann")), PCA(n_sources=3)
    left, truth, width = cleaned.residual(case, method), pipeline.truth(case), SURVEY.channel_width
    found = cleaned.assessment(case, method)
    mask = ~diagnostics.flagged_lines(found.line_errors)
    spectra = zip((left, truth), cleaned.post_masked(case, method), strict=True)
    whole = found.power_spectra, pipeline.true_spectra(case)
    for (maps, masked), power in zip(spectra, whole, strict=True):
        for one, kept in ((power, None), (masked, mask)):
            expected = frequency_power(maps, width, mask=kept, taper="hann").power[1:]
            assert one.frequency.power[1:] == pytest.approx(expected, rel=5e-3)
            assert not np.allclose(expected, frequency_power(maps, width, mask=kept).power[1:], rtol=0.02)


@pytest.mark.parametrize("mask_peaks", [True, False])
def test_a_method_that_ends_with_and_without_peak_masking(mask_peaks):
    """On the sky as bright as it is, to the rounding of its maps."""
    case = pipeline.Case(survey=SURVEY, beam=Oscillating())
    remover = SDecGMCA(**SHORT, reading="letter")
    truth = pipeline.truth(case, cleaned.separation(case, remover, mask_peaks).lmax)
    left = pipeline.cut_cube(cleaned.residual(case, remover, mask_peaks), 2 * SURVEY.nside)
    wrong = left - truth - (left - truth).mean(axis=1, keepdims=True)
    rounding = 3e-7 * pipeline.observation(case).maps.std()
    found = cleaned.error(case, remover, mask_peaks).lines(slice(None))
    assert (found - wrong).std() < 0.02 * truth.std() + rounding


@pytest.mark.parametrize("spread", ["line", "cube"])
def test_peaks_with_a_mock_are_masked_in_the_deviation_of_the_case(spread):
    case = case_of(Oscillating())
    cleaning = cleaned.cleaning(case, PCA(n_sources=2), spread)
    again = cleaning.with_mock(np.zeros_like(cleaning.data.maps))
    assert np.array_equal(again.basis.maps, pipeline.basis(case, spread))


def test_nothing_wrong_is_no_error(monkeypatch):
    """A method that finds the foreground itself leaves an error without any term, and the truth."""
    case = case_of(Degraded())
    there = on_sky(pipeline.foreground_seen(case), SURVEY.nside)
    found = Separation(mixing=there.spectra, sources=there.maps)
    monkeypatch.setattr(cleaned, "separation", lambda *call: found)
    assert cleaned.error(case, PCA()).spectra.shape == (SURVEY.n_channels, 0)
    assessed = cleaned.assessment.compute(case, PCA())
    true = pipeline.true_spectra(case)
    assert assessed.power_spectra.angular.cl == pytest.approx(true.angular.cl, rel=1e-6)
    assert np.array_equal(assessed.power_spectra.frequency.power, true.frequency.power)
    assert assessed.correlation == pytest.approx(1) and not assessed.line_errors.any()


def test_an_assessment_holds_no_cube_but_the_truth():
    """What it allocates at its peak is less than its coefficients, or 0.6 of it."""
    case = case_of(Degraded(), replace(SURVEY, n_channels=200, nside=64))
    remover = PCA(n_sources=3)
    cleaned.separation(case, remover)
    cleaned.assessment.compute(case, remover)  # makes what is shared, and tables of transforms
    tracemalloc.start()
    cleaned.assessment.compute(case, remover)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.6 * pipeline.observation(case).truth.nbytes
