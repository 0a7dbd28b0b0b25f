"""Products that claims are judged on besides assessments, against cubes."""

import math
import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.instrument.beams import Degraded, Evolving, Oscillating
from himap.maps import sphere
from himap.maps.low_rank import centred
from himap.measures.diagnostics import flagged_lines
from himap.measures.spectra import TAPERS, angular_power, frequency_power
from himap.paper import cleaned, evidence, leakage, pipeline
from himap.paper.realisation import Realisation
from himap.removal import PCA, Parametric, SDecGMCA
from himap.removal.peaks import PeakMasked
from himap.removal.spectral_filter import on_sky
from himap.sky.emission import emission_maps
from himap.sky.galaxy import Dimming, Galaxy

pytestmark = pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")

SURVEY = Survey(nside=8, n_channels=30, box_cells=16)
CASE = pipeline.Case(survey=SURVEY, beam=Oscillating())
PLAIN = PCA(n_sources=3)
FAINTER = replace(CASE, dimming=Dimming(weight=1e-2, edge=90.0))
"""So that the rounding of cubes in float32 does not show, whatever A a processor finds."""
ENDING = SDecGMCA(n_sources=3, lmax=10, n_warmup=4, n_refinement=2, reading="code-rounding")


def test_brightness_is_the_rms_of_both_cubes():
    found = evidence.sky_brightness(SURVEY.sky, Galaxy())
    high = np.abs(sphere.pixel_latitude(8)) > 30
    bright = emission_maps(pipeline.components_of_sky(SURVEY.sky, Galaxy()), SURVEY.freqs)
    cubes = [np.array(one, dtype=float) for one in (bright, pipeline.hi_of_sky(SURVEY.sky))]
    expected = [[np.sqrt(np.mean(cube[:, region] ** 2)) for cube in cubes] for region in (slice(None), high)]
    assert found == pytest.approx(np.array(expected), rel=1e-6)
    assert found[0, 0] > found[1, 0] > found[1, 1]


def _observe(monkeypatch, hi, truth, maps, flagged):
    """In the place of an observation, its peaks, and its HI."""
    observed = SimpleNamespace(maps=maps, truth=truth, freqs=np.linspace(900, 920, len(maps)))
    monkeypatch.setattr(pipeline, "observation", lambda case: observed)
    masked = PeakMasked(maps=maps, flagged=flagged)
    monkeypatch.setattr(pipeline, "peak_masked", lambda case, spread: masked)
    monkeypatch.setattr(pipeline, "hi_seen", lambda case: hi)


def _with_peaks(monkeypatch, hi, noise, foreground):
    """Peaks of each kind, {(channel, pixel): mK}, on lines of sight that are smooth else; all are flagged."""
    shape = (SURVEY.n_channels, SURVEY.n_pix)
    parts, flagged = [], np.zeros(shape, dtype=bool)
    for peaks in (hi, noise, foreground):
        parts.append(np.float32(np.linspace(2, 1, shape[0])[:, None] * np.ones(shape)))
        for place, height in peaks.items():
            parts[-1][place] += height
            flagged[place] = True
    truth = parts[0] + parts[1]
    _observe(monkeypatch, parts[0], truth, truth + parts[2], flagged)


def test_a_masked_voxel_belongs_to_what_stands_out_most(monkeypatch):
    case = pipeline.Case(survey=SURVEY)
    hi = {(4, 10): 5.0, (9, 20): 4.0, (15, 33): 1.0}
    noise = {(9, 20): 1.0, (15, 33): 3.0, (20, 50): -4.0}
    foreground = {(4, 10): 1.0, (25, 60): 6.0, (15, 33): -0.5, (20, 50): 1.0}
    for peaks, expected in (((hi, noise, foreground), [2, 2, 1]), (({}, {}, {}), [0, 0, 0])):
        _with_peaks(monkeypatch, *peaks)
        assert evidence.masked_voxels.compute(case).tolist() == expected


def test_no_cube_is_held_but_hi_through_the_beam(monkeypatch, rng):
    """At the paper's size nearly every line of sight has a peak, and each cube is 1.6 GB."""
    shape = (10, 786432)  # so that the block of each thread is a small part, whatever their number
    cube = rng.standard_normal(shape).astype(np.float32)
    flagged = rng.random(shape) < 0.2
    _observe(monkeypatch, cube, cube, cube + 1, flagged)
    tracemalloc.start()
    counts = evidence.masked_voxels.compute(None)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert counts.sum() == flagged.sum()
    assert peak < 6 * cube.nbytes


@pytest.mark.parametrize("taper", TAPERS)
@pytest.mark.parametrize("beam", [Degraded(), Evolving()])
def test_noise_and_hi_are_those_of_the_truth(beam, taper):
    """Only the degraded beam smooths the noise."""
    case = pipeline.Case(survey=replace(SURVEY, taper=taper), beam=beam)
    found = evidence.noise_and_hi(case)
    hi = pipeline.hi_seen(case)
    for one, cube in zip(found, (pipeline.truth(case) - hi, hi), strict=True):
        inside = slice(2, 2 * SURVEY.nside + 1)
        assert one.angular.mean[inside] == pytest.approx(angular_power(cube).mean[inside], rel=0.02)
        expected = frequency_power(cube, SURVEY.channel_width, taper=taper).power
        assert one.frequency.power[1:] == pytest.approx(expected[1:], rel=1e-5)
    unsmoothed = sphere.power_spectrum(pipeline.noise_alms(SURVEY)).mean(axis=0)
    assert (found[0].angular.mean[16] < 0.995 * unsmoothed[16]) == (beam == Degraded())


class TestWithoutPointSources:
    @pytest.mark.parametrize(
        ("beam", "dimming", "method"),
        [
            (Degraded(), None, Parametric()),
            (Degraded(), Dimming(), Parametric()),
            (CASE.beam, Dimming(), PLAIN),
        ],
    )
    def test_it_is_the_residual_of_the_case(self, beam, dimming, method):
        """With all components; PCA of the case without that dimming."""
        case = replace(CASE, beam=beam, dimming=dimming)
        if method == PLAIN:
            found = evidence.dimmed_spectra.compute(replace(case, dimming=None), method, dimming)
        else:
            found = evidence.spectra_with(pipeline.foreground_seen(case), case, method)
        expected = cleaned.assessment(case, method).power_spectra
        assert found.angular.mean[2:17] == pytest.approx(expected.angular.mean[2:17], rel=1e-3)
        assert found.frequency.power[1:] == pytest.approx(expected.frequency.power[1:], rel=1e-3)

    @pytest.mark.parametrize("dimming", [None, Dimming(weight=0.1)])
    def test_the_galaxy_is_the_rest(self, dimming, monkeypatch):
        monkeypatch.setattr(evidence, "spectra_with", lambda *given: given)
        case = replace(CASE, dimming=dimming)
        foreground, *rest = evidence.spectra_without_sources.compute(case, PLAIN)
        assert rest == [case, PLAIN]
        weights = 1 if dimming is None else dimming.weights(SURVEY.nside)
        maps = emission_maps(Galaxy().components(SURVEY.nside, SURVEY.rng("galaxy")), SURVEY.freqs)
        windows = CASE.beam.of_survey(SURVEY).total
        for row, window, found in zip(maps, windows, on_sky(foreground, SURVEY.nside).cube(), strict=True):
            alm = sphere.multiply_beam(sphere.analyse(weights * row), window)
            expected = sphere.synthesise(alm, SURVEY.nside)
            assert found == pytest.approx(expected, abs=float(1e-5 * expected.std()))

    def test_maps_that_the_method_refuses_have_a_reason(self):
        """At this size the Galaxy alone rings below zero on some lines of sight."""
        case = replace(CASE, beam=Degraded())
        assert "is not; give maps" in evidence.spectra_without_sources.compute(case, Parametric())
        sky = Realisation(survey=SURVEY, n_sources=(2,))
        with pytest.raises(InputError, match="lines of sight is not"):
            sky.without_sources()


@pytest.mark.parametrize("remover", [PLAIN, ENDING])
class TestLines:
    """Lines of sight of the residual and of the truth, from cubes."""

    def test_the_error_of_flagged_lines(self, remover):
        """It is foreground less HI lost; of a method that ends, what is beyond is lost."""
        found = evidence.error_of_flagged_lines(FAINTER, remover)
        residual, truth = centred(cleaned.residual(FAINTER, remover)), centred(pipeline.truth(FAINTER))
        error = (residual - truth).astype(float)
        lines = flagged_lines(cleaned.assessment(FAINTER, remover).line_errors)
        bright = centred(pipeline.observation(FAINTER).maps - pipeline.truth(FAINTER)).astype(float)
        values, axes = np.linalg.eigh(bright @ bright.T / bright.shape[1])
        axes = axes[:, values > truth.var(axis=1).sum()]
        assert found["n_spectra"] == axes.shape[1] and 1 < axes.shape[1] < 8
        for whole, in_spectra, cube in (("error", "in spectra", error), ("truth", "truth in spectra", truth)):
            assert found[whole] == pytest.approx(np.mean(cube[:, lines] ** 2), rel=1e-3)
            expected = np.sum((axes.T @ cube[:, lines]) ** 2) / cube[:, lines].size
            assert found[in_spectra] == pytest.approx(expected, rel=1e-2)
        split = leakage.split_error(FAINTER, remover)[0].lines(lines)
        assert found["foreground residual"] == pytest.approx(np.mean(np.square(split)), rel=1e-6)
        sizes = [found[name] ** 0.5 for name in ("error", "foreground residual", "signal loss")]
        assert max(sizes) < sum(sizes) - max(sizes)  # those of a sum of two
        power, true = (sphere.power_spectrum(sphere.analyse(cube[3])) for cube in (residual, truth))
        ends = (power / true)[12:16].max() < 0.1
        assert (remover is ENDING) == ends == (found["signal loss"] > 0.3 * found["truth"])

    def test_the_peak_without_the_brightest_lines(self, remover):
        k, ratios = evidence.peak_without_lines(CASE, remover)
        residual, truth = cleaned.residual(CASE, remover), pipeline.truth(CASE)
        bright = (pipeline.observation(CASE).maps - truth).mean(axis=0, dtype=float)
        limits, n_pix = np.sort(bright), SURVEY.n_pix
        kept = [bright <= limits[math.ceil((1 - share) * n_pix) - 1] for share in evidence.BRIGHTEST]
        kept.append(bright >= limits[math.ceil(evidence.CONTROL * n_pix)])
        assert len(ratios) == len(kept)
        for row, mask in zip(ratios, kept, strict=True):
            powers = [frequency_power(cube, SURVEY.channel_width, mask=mask) for cube in (residual, truth)]
            assert k == pytest.approx(powers[0].k[1:])
            assert row == pytest.approx(powers[0].power[1:] / powers[1].power[1:], rel=1e-2)
        assert np.ptp(ratios, axis=0).max() > 0.02
