"""Readings of the paper's SDecGMCA: which there are, and what they lead to on a tiny sky."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ledgers import judged
from outcomes import outcome, run

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.maps import sphere
from himap.paper import pipeline
from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED, UNDECIDED, Part
from himap.paper.experiments import readings as experiment
from himap.paper.experiments import restarts
from himap.paper.experiments.claims import judge
from himap.paper.methods import sdecgmca_for
from himap.paper.readings import (
    BANDS,
    COLUMNS,
    Outcome,
    Reading,
    candidates,
    charity,
    default_reading,
    outcomes,
    readings,
)
from himap.paper.readings_table import candidates_table
from himap.paper.realisation import Realisation
from himap.removal.sdecgmca.readings import OPTIONS, READINGS, resolved

SURVEY = {"nside": 8, "box_cells": 16, "n_channels": 25, "freq_max": 1025.0}
TINY = {"preset": "ci", "survey": SURVEY, "n_sources_max": 2}
SHORT = ("n_warmup", 2), ("n_refinement", 2), ("warmup_tolerance", 1e300), ("tolerance", 1e300)
CHOSEN = {
    name: Reading(label=name, options=(*given, *SHORT))
    for name, given in {"default": (), "letter": (("reading", "letter"),)}.items()
}


class TestReadings:
    def test_every_choice_is_there_once(self):
        changes = [reading.changed for reading in readings().values() if reading.changed]
        assert len(set(changes)) == len(changes) and set(readings()) > set(READINGS)
        default = READINGS["default"]
        for name, option in OPTIONS.items():
            for value in option.choices:
                try:
                    resolved("default", default | {name: value})
                except InputError:  # options that exclude each other
                    assert (name, value) not in changes
                else:
                    assert ((name, value) in changes) == (value != default[name])

    def test_the_options_give_these_values(self):
        """The method that a realisation makes of them has every choice as the reading says."""
        for reading in readings().values():
            method = sdecgmca_for(Realisation().oscillating, **dict(reading.options))
            assert {name: getattr(method, name) for name in reading.values} == reading.values
            if reading.changed:
                name, value = reading.changed
                assert reading.values == READINGS["default"] | {name: value}

    def test_one_that_has_a_name_goes_by_it(self, monkeypatch):
        monkeypatch.setitem(READINGS, "default", READINGS["letter"] | {"sign": "free"})
        there = readings()
        assert there["letter"].changed == ("sign", "nonnegative")
        assert there["letter"].title == "letter (sign = nonnegative)" and "sign = nonnegative" not in there
        assert there["code"].title == "code" and there["code"].changed is None
        assert there["last = repeated"].title == "last = repeated"
        assert there["last = repeated"].departures == {"sign": "free"}

    def test_distance_from_the_text_counts_what_it_is_about(self):
        there = readings()
        assert there["letter"].distance == there["instrument-noise"].distance == 0
        assert there["code"].distance == len(there["code"].departures) == 6

    def test_the_text_speaks_against_choices_that_there_are_and_never_against_the_letter(self):
        for name, option in OPTIONS.items():
            assert set(option.against) < set(option.choices)
            assert READINGS["letter"][name] not in option.against

    @pytest.mark.parametrize(
        ("last", "beyond"), [("repeated", "regularised"), ("unregularised", "projection")]
    )
    def test_beyond_200_it_goes_on_as_its_last_step_can(self, last, beyond):
        sky = Realisation(
            survey=Survey(nside=8, n_channels=30, box_cells=16),
            options=(("reading", "letter"), ("last", last)),
        )
        _, method, peaks, post = sky._beyond("evolving")
        assert (method.last, method.beyond, peaks, post) == (last, beyond, True, False)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Outcomes of two readings on one tiny sky, and the realisation; the cache is that of all tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HIMAP_CACHE", str(tmp_path_factory.getbasetemp() / "himap-cache"))
        patch.setattr(experiment, "readings", lambda: CHOSEN)
        (sky,) = experiment.skies(**TINY, n_realisations=1, n_restarts=1)
        yield outcomes(experiment.EXPERIMENT.table([sky])), sky.realisations["default"][0]


class TestEvaluate:
    def test_every_reading_claim_and_restart(self, tiny):
        found, sky = tiny
        assert tuple(found) == tuple(CHOSEN)
        for one in found.values():
            assert tuple(one.entries) == tuple(CLAIMS)
            members = [(sky.survey.seed, k) for k in range(len(one.runs))]
            assert all(list(entry.findings) == members for entry in one.entries.values())
            assert [(run.seed, run.restart) for run in one.runs] == members

    def test_the_verdicts_are_those_of_the_ledger(self, tiny):
        found, sky = tiny
        for claim, finding in judge(replace(sky, options=CHOSEN["letter"].options)).items():
            (one,) = found["letter"].entries[claim].findings.values()
            assert one.parts == finding.parts
            assert one.value == pytest.approx(finding.value, nan_ok=True)

    def test_observations_do_not_stay(self, tiny):
        _, sky = tiny
        cases = [case for case, *_ in sky.cases.values()]
        for product in (pipeline.observation, pipeline.peak_masked, pipeline.analysis):
            assert not [case for case in cases if product.is_cached(case)], product.name

    @pytest.mark.parametrize("label", CHOSEN)
    def test_a_run_is_what_the_assessment_says(self, tiny, label):
        found, sky = tiny
        one = replace(sky, options=CHOSEN[label].options)
        comparison, assessed = one.of("oscillating")["sdecgmca"], one.assessed("sdecgmca")
        ratio, degrees = comparison.angular_ratio, comparison.degrees
        numbers = found[label].runs[0].numbers
        there = [name for name in BANDS if name in numbers]
        # The maps end at l = 16, and the least k is 0.05 / MHz.
        sky, line = list(BANDS)[:3], list(BANDS)[-2:]
        assert there == [*sky, *line] and sky[-1] == "C/C0, 10 to 19"
        for name in there:
            curve, low, high = BANDS[name]
            x = {"angular": degrees, "frequency": comparison.k}[curve]
            values = comparison.ratios[curve]
            assert numbers[name] == pytest.approx(values[(x > low) & (x < high)].mean())
        errors = np.abs(ratio[(degrees > 10) & (degrees < 200)] - 1)
        assert numbers["mean error"] == pytest.approx(errors.mean())
        assert numbers["largest error"] == pytest.approx(errors.max())
        errors = assessed.line_errors
        out = np.abs(errors - errors.mean()) > errors.std()
        latitude = np.abs(sphere.pixel_latitude(8))
        assert numbers["flagged"] == pytest.approx(out.mean())
        assert numbers["near the plane"] == pytest.approx((latitude[out] < 10).mean(), nan_ok=True)
        assert (numbers["iterations"], numbers["converged"]) == (assessed.n_iterations, assessed.converged)
        assert numbers["bump"] == pytest.approx(
            comparison.frequency_ratio[(comparison.k > 0.25) & (comparison.k < 0.38)].max()
        )

    def test_curves_are_means_in_bins(self, tiny):
        found, sky = tiny
        comparison, one = sky.of("oscillating")["sdecgmca"], found["default"].runs[0]
        at, ratio = one.curves["C/C0"]
        assert at == pytest.approx(comparison.degrees)  # so few that each has its own bin
        assert ratio == pytest.approx(comparison.angular_ratio)
        x = np.arange(2.0, 500)
        at, means = zip(*restarts._binned(x, 3 * x), strict=True)
        assert at[:3] == (2, 3, 4) and at[-1] > 450 and len(at) <= 40
        assert means == pytest.approx(3 * np.array(at))

    def test_rows_of_another_version(self, tiny):
        row = dict.fromkeys(COLUMNS) | {"reading": "default", "restart": 0, "quantity": "D1"}
        for name, value in (("reading", "backwards"), ("quantity", "Z9")):
            rows = experiment.EXPERIMENT.frame([{"seed": 7} | row | {name: value}])
            with pytest.raises(InputError, match=f"of another version of himap, {value}; measure it again"):
                outcomes(rows)


class TestDefault:
    """The most charitable candidate, on made-up outcomes."""

    @staticmethod
    def outcome(*shares):
        """One claim with a main part on SDecGMCA for each share, over ten restarts, and parts of others."""
        members = [
            (
                *(Part(f"{n}", k < 10 * share, True, "SD") for n, share in enumerate(shares)),
                Part("other", True, True, "PCA/ICA"),
                Part("not main", True, False, "SD"),
            )
            for k in range(10)
        ]
        return Outcome(entries={"D1": judged(members)}, runs=())

    def test_a_main_part_counts_the_share_in_which_it_holds(self):
        assert charity(self.outcome(0.3, 0.9).entries.values()) == pytest.approx(1.2)
        entries = {"M2": judged([(Part("lower peak", None, True, "SD"),)]), "O6": judged([()])}
        assert charity(entries.values()) == 0  # premise absent, and does not apply

    def test_the_default_is_the_most_charitable_and_of_two_that_nearer_to_the_text(self):
        found = {
            "code": self.outcome(0.3, 0.9),
            "letter": self.outcome(0.6, 0.6),
            "follow-up": self.outcome(1),
        }
        assert readings()["letter"].distance < readings()["code"].distance
        assert default_reading(found) == "letter"
        assert default_reading(found | {"code": self.outcome(0.4, 0.9)}) == "code"
        single = next(label for label, one in readings().items() if label not in candidates() and one.changed)
        assert default_reading(found | {single: self.outcome(1, 1)}) == "letter"  # no candidate
        table = candidates_table(found)
        assert table["candidate"].tolist()[0] == "letter" and table["which"][0] == "none"
        assert table["statements on SD that hold"].tolist() == ["1.2", "1.2", "1.0"]

    def test_a_record_of_restarts_is_judged_by_what_it_has_of_the_oscillating_beam(self):
        empty = dict.fromkeys(restarts.EXPERIMENT.columns) | {"seed": 7, "n_sources": 0}
        rows = [
            empty | {"reading": label, "restart": k, "quantity": "D1", "part": "a", "method": "SD"}
            for label in ("code", "letter, beyond = projection")
            for k in range(2)
        ]
        for row in rows:
            row |= {"main": True, "held": row["reading"] != "code" or row["restart"] == 0}
        for case, value in (("degraded", 0.5), ("oscillating", 0.02)):
            numbers = {"case": case, "quantity": "mean error", "value": value, "restart": 0}
            rows.append(empty | {"reading": "code"} | numbers)
        found = outcomes(restarts.EXPERIMENT.frame(rows))
        assert [run.numbers["mean error"] for run in found["code"].runs] == [0.02]
        counts = {label: charity(one.entries.values()) for label, one in found.items()}
        assert counts == {"code": 0.5, "letter, beyond = projection": 1.0}
        assert default_reading(found) == "letter, beyond = projection"

    def test_what_departs_from_the_text_is_named(self):
        assert readings()["letter"].departures == {}
        assert readings()["code"].departures["sign"] == "free"


class TestOutcome:
    def test_verdict_is_that_of_the_ledger(self):
        one = outcome({"D1": [REPRODUCED, FAILED], "D2": [IN_PART] * 2, "E1": INAPPLICABLE})
        assert [one.verdict(claim) for claim in ("D1", "D2", "E1")] == [UNDECIDED, IN_PART, INAPPLICABLE]
        assert [one.holds(claim) for claim in ("D1", "D2", "E1")] == [False, True, False]
        assert one.verdict("S1") is None and one.holds("S1") is None

    def test_to_fail_is_twice_the_error_of_the_paper(self):
        runs = [run(mean_error=error) for error in (0.05, 0.0999, 0.1001, math.inf)]
        assert [one.fails for one in runs] == [False, False, True, True]
        assert outcome({"D1": REPRODUCED}, runs=runs).n_failing == 2
