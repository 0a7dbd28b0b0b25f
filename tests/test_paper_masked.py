"""The ways to treat a bright plane, on the same pixels."""

from dataclasses import replace

import numpy as np
import pytest

from himap.core.survey import Survey
from himap.instrument.beams import Oscillating
from himap.maps import sphere
from himap.measures.spectra import angular_power, frequency_power
from himap.paper import cleaned, pipeline
from himap.paper.masked import WAYS, Region, by_depth, compared, residual
from himap.removal import PCA, BeamSubspace

SURVEY = Survey.preset("ci", nside=16, n_channels=12, box_cells=16)
CASE = pipeline.Case(survey=SURVEY, beam=Oscillating())
REGION = Region(latitude=12)
REMOVER = BeamSubspace(n_sources=3)


def test_a_region():
    latitude = sphere.pixel_latitude(16)
    assert np.array_equal(REGION.mask(16), np.abs(latitude) > 12)
    assert np.array_equal(REGION.mask(16, margin=4), np.abs(latitude) > 16)
    cap = Region(latitude=53.13, north=True).mask(64)
    assert cap.mean() == pytest.approx(0.1, abs=0.002) and not cap[sphere.pixel_latitude(64) < 53].any()


def test_inside_is_what_the_method_leaves_of_the_region():
    observed, kept = pipeline.observation(CASE), REGION.mask(16)
    basis = np.where(kept, pipeline.peak_masked(CASE).maps, np.nan)
    seen = {"freqs": observed.freqs, "beams": observed.beams}
    for remover in (REMOVER, PCA(n_sources=3)):
        expected = remover.clean(observed.maps, **seen, separate_on=basis, mask=kept).residual
        assert residual(CASE, remover, REGION, "inside") == pytest.approx(expected, abs=1e-3)


def test_without_a_mask_it_is_what_is_left_of_the_whole_sky():
    assert np.array_equal(residual(CASE, REMOVER, REGION, "no mask"), cleaned.residual(CASE, REMOVER))
    assert not np.array_equal(residual(CASE, REMOVER, REGION, "dimmed"), cleaned.residual(CASE, REMOVER))


@pytest.mark.parametrize(("way", "taper"), [("no mask", "none"), ("inside", "none"), ("no mask", "hann")])
def test_spectra_are_those_of_the_cubes_inside(way, taper):
    case, mask = replace(CASE, survey=replace(SURVEY, taper=taper)), REGION.mask(16, margin=4)
    left, true = residual(case, REMOVER, REGION, way), pipeline.truth(case)
    found = compared(case, REMOVER, REGION, way)
    for cube, angular, along in (
        (left, found.angular, found.frequency),
        (true, found.true_angular, found.true_frequency),
    ):
        power = angular_power(cube, mask=mask)
        expected = power.mean[(power.degrees >= 2) & (power.degrees <= 32)]
        assert angular == pytest.approx(expected, rel=0.02)
        expected = frequency_power(cube, SURVEY.channel_width, mask=mask, taper=taper)
        assert along == pytest.approx(expected.power[1:], rel=1e-3)


def test_every_way_is_measured():
    results = {way: compared(CASE, REMOVER, REGION, way) for way in WAYS}
    degrees = {tuple(one.degrees) for way, one in results.items() if way != "post-masked"}
    assert len(degrees) == 1
    assert len({one.frequency.tobytes() for one in results.values()}) == len(WAYS)


def test_errors_by_depth_add_up():
    edges = (0.0, 4.0, 8.0, 90.0)
    rms = by_depth(CASE, REMOVER, REGION, "inside", edges)
    kept, depth = REGION.mask(16), REGION.depth(16)
    wrong = (residual(CASE, REMOVER, REGION, "inside") - pipeline.truth(CASE))[:, kept]
    wrong -= wrong.mean(axis=1, keepdims=True)
    numbers = np.histogram(depth[kept], edges)[0]
    assert numbers @ rms**2 / numbers.sum() == pytest.approx(np.mean(wrong**2), rel=1e-4)
