"""Readings of the paper's SDecGMCA: which there are, and what they lead to on a tiny sky."""

import math
from dataclasses import replace

import numpy as np
import pytest
from outcomes import outcome, run

from himap.errors import InputError
from himap.maps import sphere
from himap.paper import pipeline
from himap.paper import readings as readings_module
from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.ledger import NUDGES, judge, realisations
from himap.paper.methods import sdecgmca_for
from himap.paper.readings import ANGULAR_BANDS, FREQUENCY_BANDS, evaluate, readings
from himap.paper.realisation import Realisation
from himap.removal.sdecgmca.readings import OPTIONS, READINGS
from himap.survey import Survey

SURVEY = {"nside": 8, "box_cells": 16, "n_channels": 25, "freq_max": 1025.0}
TINY = {"preset": "ci", "survey": SURVEY, "n_sources_max": 2}
CHOSEN = ("default", "last = unregularised")


class TestReadings:
    def test_every_choice_is_there_once(self):
        changes = [reading.changed for reading in readings().values() if reading.changed]
        default = READINGS["default"]
        wanted = [
            (name, value)
            for name, option in OPTIONS.items()
            for value in option.choices
            if value != default[name]
        ]
        assert sorted(map(str, changes)) == sorted(map(str, wanted))
        assert set(readings()) > set(READINGS)

    def test_the_options_give_these_values(self):
        """The method that a realisation makes of them has every choice as the reading says."""
        for reading in readings().values():
            method = sdecgmca_for(Realisation().oscillating, **dict(reading.options))
            assert {name: getattr(method, name) for name in reading.values} == reading.values
            if reading.changed:
                name, value = reading.changed
                assert reading.values == READINGS["default"] | {name: value}

    def test_one_that_has_a_name_goes_by_it(self):
        there = readings()
        assert there["letter"].changed == ("thresholds", "mad")
        assert there["letter"].title == "letter (thresholds = mad)"
        assert there["code"].title == "code" and there["code"].changed is None
        assert "thresholds = mad" not in there
        assert there["last = repeated"].title == "last = repeated"

    def test_distance_from_the_text_counts_what_it_speaks_of(self):
        there = readings()
        assert [there[name].distance for name in ("letter", "default", "last = repeated", "sign = free")] == [
            0,
            0,
            0,
            1,
        ]
        assert there["floor = 1e-09"].distance == 0
        assert there["code"].distance == 6

    def test_the_text_speaks_against_choices_that_there_are_and_never_against_the_letter(self):
        for name, option in OPTIONS.items():
            assert set(option.against) < set(option.choices)
            assert READINGS["letter"][name] not in option.against

    def test_options_that_exclude_each_other_are_left_out(self, monkeypatch):
        monkeypatch.setitem(READINGS, "default", READINGS["default"] | {"beyond": "regularised"})
        there = readings()
        assert "last = repeated" in there
        assert not {"last = unregularised", "last = thresholded"} & set(there)

    @pytest.mark.parametrize(
        ("last", "beyond"), [("repeated", "regularised"), ("unregularised", "projection")]
    )
    def test_beyond_200_it_goes_on_as_its_last_step_can(self, last, beyond):
        sky = Realisation(survey=Survey(nside=8, n_channels=30, box_cells=16), options=(("last", last),))
        _, method, peaks, post = sky._beyond("evolving")
        assert (method.last, method.beyond, peaks, post) == (last, beyond, True, False)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Outcomes of two readings on one tiny sky, and the realisation; the cache is that of all tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HIMAP_CACHE", str(tmp_path_factory.getbasetemp() / "himap-cache"))
        some = {label: readings()[label] for label in CHOSEN}
        patch.setattr(readings_module, "readings", lambda: some)
        (sky,) = realisations(**TINY, n_realisations=1)
        yield evaluate([sky]), sky


class TestEvaluate:
    def test_every_reading_claim_and_noise_level(self, tiny):
        outcomes, sky = tiny
        assert tuple(outcomes) == CHOSEN
        for one in outcomes.values():
            assert tuple(one.judged) == tuple(CLAIMS)
            assert all(tuple(by_seed) == (sky.survey.seed,) for by_seed in one.judged.values())
            assert [run.noise_level for run in one.runs] == [1.0, *NUDGES]
            assert {run.seed for run in one.runs} == {sky.survey.seed}

    def test_the_verdicts_are_those_of_the_ledger(self, tiny):
        outcomes, sky = tiny
        found = judge(replace(sky, options=(("last", "unregularised"),)))
        for claim, finding in found.items():
            (one,) = outcomes["last = unregularised"].judged[claim].values()
            assert (one.verdict, one.n_held, one.n_parts) == (
                finding.verdict,
                finding.n_held,
                len(finding.parts),
            )
            assert one.value == pytest.approx(finding.value, nan_ok=True)

    def test_observations_do_not_stay(self, tiny):
        _, sky = tiny
        cases = [case for case, *_ in sky.cases.values()]
        for product in (pipeline.observation, pipeline.peak_masked, pipeline.analysis):
            assert not [case for case in cases if product.is_cached(case)], product.name

    @pytest.mark.parametrize("label", CHOSEN)
    def test_a_run_is_what_the_assessment_says(self, tiny, label):
        outcomes, sky = tiny
        one = replace(sky, options=readings()[label].options)
        comparison, assessed = one.of("oscillating")["sdecgmca"], one.assessed("sdecgmca")
        ratio, degrees = comparison.angular_ratio, comparison.degrees
        found = outcomes[label].runs[0]
        assert list(found.angular) == ["2 to 4", "5 to 9", "10 to 19"]  # the maps end at l = 16
        for (low, high), mean in zip(ANGULAR_BANDS[:3], found.angular.values(), strict=True):
            assert mean == pytest.approx(ratio[(degrees >= low) & (degrees <= high)].mean())
        assert list(found.frequency) == list(FREQUENCY_BANDS)[1:]  # the least k is 0.05 / MHz
        for name, mean in found.frequency.items():
            low, high = FREQUENCY_BANDS[name]
            inside = (comparison.k > low) & (comparison.k < high)
            assert mean == pytest.approx(comparison.frequency_ratio[inside].mean())
        errors = np.abs(ratio[(degrees > 10) & (degrees < 200)] - 1)
        assert (found.mean_error, found.largest_error) == pytest.approx((errors.mean(), errors.max()))
        errors = assessed.line_errors
        out = np.abs(errors - errors.mean()) > errors.std()
        latitude = np.abs(sphere.pixel_latitude(8))
        assert found.flagged == pytest.approx(out.mean())
        assert found.near_plane == pytest.approx((latitude[out] < 10).mean(), nan_ok=True)
        assert (found.n_iterations, found.settled) == (assessed.n_iterations, assessed.converged)
        assert found.bump == pytest.approx(
            comparison.frequency_ratio[(comparison.k > 0.25) & (comparison.k < 0.38)].max()
        )

    def test_curves_are_means_in_bins(self, tiny):
        outcomes, sky = tiny
        comparison, found = sky.of("oscillating")["sdecgmca"], outcomes["default"].runs[0]
        assert found.degrees == pytest.approx(comparison.degrees)  # so few that each has its own bin
        assert found.angular_ratio == pytest.approx(comparison.angular_ratio)
        x = np.arange(2.0, 500)
        at, means = readings_module._binned(x, 3 * x)
        assert at[:3] == (2, 3, 4) and at[-1] > 450 and len(at) <= 40
        assert means == pytest.approx(3 * np.array(at))

    def test_no_realisation(self):
        with pytest.raises(InputError, match="one realisation or more, got none"):
            evaluate([])

    @pytest.mark.parametrize(
        "options", [{"method": "beam_subspace"}, {"reading": "letter"}], ids=["method", "reading"]
    )
    def test_realisations_of_another_method_or_reading(self, options):
        with pytest.raises(InputError, match="give realisations of its default reading"):
            evaluate(realisations(**TINY, n_realisations=1, **options))


class TestOutcome:
    def test_verdict_is_that_of_most_seeds_or_the_worse(self):
        one = outcome({"D1": [REPRODUCED, FAILED], "D2": [IN_PART] * 2 + [FAILED], "E1": INAPPLICABLE})
        assert [one.verdict(claim) for claim in ("D1", "D2", "E1")] == [FAILED, IN_PART, INAPPLICABLE]
        assert [one.holds(claim) for claim in ("D1", "D2", "E1")] == [False, True, False]
        assert one.verdict("S1") is None and one.holds("S1") is None

    def test_a_judgement_says_how_many_parts_hold(self):
        (one,) = outcome({"D1": IN_PART}).judged["D1"].values()
        assert one.label == "in part (1 of 2)" and one.holds
        (one,) = outcome({"D1": FAILED}).judged["D1"].values()
        assert one.label == FAILED and not one.holds

    def test_to_fail_is_twice_the_error_of_the_paper(self):
        runs = [run(mean_error=error) for error in (0.05, 0.0999, 0.1001, math.inf)]
        assert [one.fails for one in runs] == [False, False, True, True]
        assert outcome({"D1": REPRODUCED}, runs=runs).n_failing == 2
