"""What claims are judged on besides assessments: brightness of the sky, and what the masked voxels hold."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from himap.core.survey import Survey
from himap.instrument.beams import Evolving
from himap.instrument.observe import Observation
from himap.maps import sphere
from himap.paper import evidence, pipeline
from himap.removal.peaks import PeakMasked
from himap.sky.galaxy import Galaxy

SURVEY = Survey(nside=8, n_channels=30, box_cells=16)


def test_brightness_is_the_rms_of_both_cubes():
    found = evidence.sky_brightness(SURVEY.sky, Galaxy())
    high = np.abs(sphere.pixel_latitude(8)) > 30
    cubes = [
        np.array(one, dtype=float) for one in (pipeline.foregrounds(SURVEY, Galaxy()), pipeline.hi(SURVEY))
    ]
    expected = [[np.sqrt(np.mean(cube[:, region] ** 2)) for cube in cubes] for region in (slice(None), high)]
    assert found == pytest.approx(np.array(expected), rel=1e-6)
    assert found[0, 0] > found[1, 0] > found[1, 1]


def _with_peaks(case, monkeypatch, hi, noise, foreground):
    """Peaks of each kind, {(channel, pixel): mK}, on lines of sight that are smooth else; all are flagged."""
    shape = (SURVEY.n_channels, SURVEY.n_pix)
    smooth = np.linspace(2, 1, shape[0])[:, None] * np.ones(shape)
    parts = []
    for peaks in (hi, noise, foreground):
        cube = smooth.astype(np.float32).copy()
        for place, height in peaks.items():
            cube[place] += height
        parts.append(cube)
    truth = parts[0] + parts[1]
    observed = Observation(
        maps=truth + parts[2],
        truth=truth,
        freqs=SURVEY.freqs,
        channel_width=SURVEY.channel_width,
        beams=case.beam.of_survey(SURVEY).total,
    )
    monkeypatch.setattr(pipeline, "observation", lambda case: observed)
    flagged = np.zeros(shape, dtype=bool)
    for place in {**hi, **noise, **foreground}:
        flagged[place] = True
    masked = PeakMasked(maps=observed.maps, flagged=flagged)
    monkeypatch.setattr(pipeline, "peak_masked", lambda case, spread: masked)
    monkeypatch.setattr(evidence, "_hi_through_beam", lambda case, lines: parts[0][:, lines])


def test_a_masked_voxel_belongs_to_what_stands_out_most(monkeypatch):
    case = pipeline.Case(survey=SURVEY)
    hi = {(4, 10): 5.0, (9, 20): 4.0, (15, 33): 1.0}
    noise = {(9, 20): 1.0, (15, 33): 3.0, (20, 50): -4.0}
    foreground = {(4, 10): 1.0, (25, 60): 6.0, (15, 33): -0.5, (20, 50): 1.0}
    _with_peaks(case, monkeypatch, hi, noise, foreground)
    assert evidence.masked_voxels.compute(case).tolist() == [2, 2, 1]


def test_no_masked_voxel(monkeypatch):
    case = pipeline.Case(survey=SURVEY)
    _with_peaks(case, monkeypatch, {}, {}, {})
    assert evidence.masked_voxels.compute(case).tolist() == [0, 0, 0]


def test_hi_through_the_beam_is_the_truth_without_the_noise():
    case = pipeline.Case(survey=SURVEY, beam=Evolving())
    lines = np.arange(0, SURVEY.n_pix, 7)
    noise = pipeline.observation(case).truth[:, lines] - evidence._hi_through_beam(case, lines)
    expected = sphere.synthesise(pipeline.noise_alms(SURVEY), 8)[:, lines]
    assert np.corrcoef(noise.ravel(), expected.ravel())[0, 1] > 0.8
    assert np.std(noise) < 1.5 * np.std(expected)


def test_no_cube_is_held_but_hi_through_the_beam(monkeypatch, rng):
    """At the paper's size nearly every line of sight has a peak, and each cube is 1.6 GB."""
    shape = (20, 49152)
    cube = rng.standard_normal(shape).astype(np.float32)
    observed = SimpleNamespace(maps=cube + 1, truth=cube, freqs=np.linspace(900, 920, 20))
    monkeypatch.setattr(pipeline, "observation", lambda case: observed)
    masked = PeakMasked(maps=observed.maps, flagged=rng.random(shape) < 0.2)
    monkeypatch.setattr(pipeline, "peak_masked", lambda case, spread: masked)
    monkeypatch.setattr(evidence, "_hi_through_beam", lambda case, lines: cube[:, lines])
    tracemalloc.start()
    counts = evidence.masked_voxels.compute(None)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert counts.sum() == masked.flagged.sum()
    assert peak < 6 * cube.nbytes
