"""Readings of the paper's SDecGMCA: which there are, and what they lead to on a tiny sky."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from ledgers import SHORT, TINY, outcome, run

from himap.app.stored import RESULTS
from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.maps import sphere
from himap.paper.claims import CLAIMS, REPRODUCED
from himap.paper.experiments import claims, restarts
from himap.paper.experiments import readings as experiment
from himap.paper.experiments.claims import judge
from himap.paper.methods import sdecgmca_for
from himap.paper.readings import (
    BANDS,
    COLUMNS,
    Reading,
    candidates,
    find_reading,
    outcomes,
    ranked_candidates,
    readings,
    shares_first,
    statement_counts,
)
from himap.paper.readings_table import candidates_table, shares_table
from himap.paper.realisation import Realisation
from himap.paper.record import Record
from himap.removal.sdecgmca.readings import OPTIONS, READINGS, resolved

CHOSEN = {
    name: Reading(label=name, options=(*given, *SHORT))
    for name, given in {"default": (), "letter": (("reading", "letter"),)}.items()
}


class TestReadings:
    def test_every_choice_is_there_once_with_the_values_that_its_options_give(self):
        """But for those that exclude each other; a method has every choice as the reading says."""
        changes, default = [], READINGS["default"]
        for reading in readings().values():
            method = sdecgmca_for(Realisation().oscillating, **dict(reading.options))
            assert {name: getattr(method, name) for name in reading.values} == reading.values
            if reading.changed:
                assert reading.values == default | dict([reading.changed])
                changes.append(reading.changed)
        assert len(set(changes)) == len(changes) and set(readings()) > set(READINGS)
        for change in ((name, value) for name, one in OPTIONS.items() for value in one.choices):
            if change not in changes and default | dict([change]) != default:
                with pytest.raises(InputError):
                    resolved("default", default | dict([change]))

    def test_one_that_has_a_name_goes_by_it(self, monkeypatch):
        monkeypatch.setitem(READINGS, "default", READINGS["letter"] | {"sign": "free"})
        there = readings()
        assert there["letter"].changed == ("sign", "nonnegative")
        assert there["letter"].title == "letter (sign = nonnegative)" and "sign = nonnegative" not in there
        assert there["code"].title == "code" and there["code"].changed is None
        assert there["last = repeated"].title == "last = repeated"
        assert there["last = repeated"].departures == {"sign": "free"}

    def test_departures_are_from_what_the_text_says(self):
        there = readings()
        assert there["letter"].departures == there["instrument-noise"].departures == {}
        assert len(there["code"].departures) == 5 and there["code"].departures["sign"] == "free"
        assert all(set(option.against) < set(option.choices) for option in OPTIONS.values())

    @pytest.mark.parametrize(
        ("last", "beyond"), [("repeated", "regularised"), ("unregularised", "projection")]
    )
    def test_beyond_200_it_goes_on_as_its_last_step_can(self, last, beyond):
        sky = Realisation(
            survey=Survey(nside=8, n_channels=30, box_cells=16),
            options=(("reading", "letter"), ("last", last)),
        )
        _, method, peaks = sky._beyond("evolving")
        assert (method.last, method.beyond, peaks) == (last, beyond, True)


@pytest.fixture(scope="module")
def tiny():
    """Outcomes of two readings on one tiny sky, and the realisation."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment, "readings", lambda: CHOSEN)
        (sky,) = experiment.skies(**TINY, n_sources_max=2, n_realisations=1, n_restarts=1)
        yield outcomes(experiment.EXPERIMENT.table([sky])), sky.realisations["default"][0]


class TestEvaluate:
    def test_every_reading_claim_and_restart(self, tiny):
        found, sky = tiny
        assert tuple(found) == tuple(CHOSEN)
        for one in found.values():
            assert tuple(one.entries) == tuple(CLAIMS)
            members = one.numbers.index.tolist()
            assert members == [(sky.survey.seed, k) for k in range(len(members))] != []
            assert all(entry.members.index.tolist() == members for entry in one.entries.values())

    def test_the_verdicts_are_those_of_the_ledger(self, tiny):
        found, sky = tiny
        for claim, finding in judge(replace(sky, options=CHOSEN["letter"].options)).items():
            one = found["letter"].entries[claim]
            assert one.shares["mean"].to_dict() == {part.name: bool(part.held) for part in finding.parts}
            assert one.members["value"].iloc[0] == pytest.approx(finding.value, nan_ok=True)

    @pytest.mark.parametrize("label", CHOSEN)
    def test_a_run_is_what_the_assessment_says(self, tiny, label):
        found, sky = tiny
        one = replace(sky, options=CHOSEN[label].options)
        comparison, assessed = one.of("oscillating")["sdecgmca"], one.assessed("sdecgmca")
        ratio, degrees = comparison.angular_ratio, comparison.degrees
        numbers = found[label].numbers.iloc[0]
        there = [name for name in BANDS if name in numbers]
        # The maps end at l = 16, and the least k is 0.05 / MHz.
        sky, line = list(BANDS)[:3], list(BANDS)[-2:]
        assert there == [*sky, *line] and sky[-1] == "C/C0, 10 to 19"
        for name in there:
            curve, low, high = BANDS[name]
            x = {"angular": degrees, "frequency": comparison.k}[curve]
            inside = (x > low) & (x < high)
            assert numbers[name] == pytest.approx(comparison.ratios[curve][inside].mean())
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
        comparison, curves = sky.of("oscillating")["sdecgmca"], found["default"].curves
        for quantity, x, ratio in (
            ("C/C0", comparison.degrees, comparison.angular_ratio),  # each has its own bin
            ("P/P0", comparison.k, comparison.frequency_ratio),
        ):
            curve = curves[(curves["quantity"] == quantity) & (curves["restart"] == 0)]
            assert curve["x"].to_numpy() == pytest.approx(x)
            assert curve["value"].to_numpy() == pytest.approx(ratio)
        x = np.arange(2.0, 500)
        at, means = zip(*restarts._binned(x, 3 * x), strict=True)
        assert at[:3] == (2, 3, 4) and at[-1] > 450 and len(at) <= 40
        assert means == pytest.approx(3 * np.array(at))

    def test_rows_of_another_version(self):
        row = dict.fromkeys(COLUMNS) | {"reading": "default", "restart": 0, "quantity": "D1"}
        for name, value in (("reading", "backwards"), ("quantity", "Z9")):
            rows = experiment.EXPERIMENT.frame([{"seed": 7} | row | {name: value}])
            with pytest.raises(InputError, match=f"of another version of himap, {value}; measure it again"):
                outcomes(rows)


class TestDefault:
    """The most charitable candidate, on made-up outcomes."""

    EMPTY = dict.fromkeys(restarts.EXPERIMENT.columns) | {"n_sources": 0, "seed": 7, "restart": 0}

    def rows(self, held, *, claim="D1", method="SD", main=True):
        """Rows of {(label, seed): for each restart {part: whether it holds}} of a claim."""
        empty = self.EMPTY | {"quantity": claim, "method": method, "main": main}
        return [
            empty | {"seed": seed, "reading": label, "restart": restart, "part": part, "held": one}
            for (label, seed), members in held.items()
            for restart, parts in enumerate(members)
            for part, one in parts.items()
        ]

    def counts(self, *rows):
        return statement_counts(restarts.EXPERIMENT.frame([row for several in rows for row in several]))

    def test_a_main_part_counts_the_share_in_which_it_holds(self):
        ten = {("code", 7): [{"a": k < 3, "b": k < 9} for k in range(10)]}
        one, none = {("code", 7): [{"a": True}]}, {("code", 7): [{"a": None}]}
        counts = self.counts(
            self.rows(ten),
            self.rows(one, method="PCA/ICA"),
            self.rows(one, claim="D2", main=False),
            self.rows(none, claim="M2"),  # premise absent
            self.rows({("code", 7): [{None: None}]}, claim="O6"),  # does not apply
        )
        assert counts.loc[7].to_dict() == {"code": pytest.approx(1.2)}

    def test_a_part_that_a_restart_does_not_have_does_not_hold_there(self):
        counts = self.counts(self.rows({("code", 7): [{"a": True, "b": True}, {"a": True}]}))
        assert counts.loc[7, "code"] == 1.5

    def test_the_default_is_the_most_charitable_and_of_two_that_nearer_to_the_text(self):
        counts = pd.DataFrame({"code": [1.2], "letter": [1.2], "follow-up": [1.0]})
        best = ranked_candidates(counts)[0]
        assert best[0] == "letter" and best[2] < len(readings()["code"].departures)
        assert ranked_candidates(counts.assign(code=1.3))[0][0] == "code"
        single = next(label for label, one in readings().items() if label not in candidates() and one.changed)
        assert ranked_candidates(counts.assign(**{single: 2.0}))[0] == best  # no candidate

    def test_counts_by_sky_and_how_often_each_is_first(self):
        held = {"code": (True, True, True), "letter": (True, True, False), "follow-up": (False, False, False)}
        rows = self.rows({(label, 7 + n): [{"a": held[label][n]}] for label in held for n in range(3)})
        numbers = {"case": "oscillating", "quantity": "mean error", "value": 0.02}
        rows += [self.EMPTY | {"reading": label} | numbers for label in held]
        rows = restarts.EXPERIMENT.frame(rows)
        counts = statement_counts(rows)
        assert counts.loc[[7, 8, 9], [*held]].to_numpy().T.tolist() == [[1, 1, 1], [1, 1, 0], [0, 0, 0]]
        first = shares_first(counts)
        # Both are equal where the sky 9 was not drawn: (2 / 3)^3 of the resamples.
        assert first["letter"] == pytest.approx((2 / 3) ** 3 / 2, abs=0.03)
        assert first["follow-up"] == 0 and first.sum() == pytest.approx(1)
        table = candidates_table(rows, counts)
        assert table["candidate"].tolist() == ["code", "letter", "follow-up"]
        assert table["statements on SD that hold"].tolist() == ["1.0", "0.7", "0.0"]
        assert table["on the skies 7, 8, 9"].tolist() == ["1.0, 1.0, 1.0", "1.0, 1.0, 0.0", "0.0, 0.0, 0.0"]
        assert table["which"][1] == "none" and table["first"][2] == "0 %"
        shares = shares_table(outcomes(rows)).set_index("claim")
        assert shares.loc["D1", [*held]].tolist() == ["100", "67", "0"]
        assert (shares.drop(index="D1")[[*held]] == "–").to_numpy().all()

    def test_a_reading_that_is_missing_on_a_sky_is_not_compared(self):
        first = shares_first(pd.DataFrame({"code": [1.0, 1.0], "letter": [math.nan, 2.0]}))
        assert first["code"] == 1 and math.isnan(first["letter"])
        assert shares_first(pd.DataFrame({"code": [1.0, math.nan], "letter": [math.nan, 2.0]})).isna().all()

    def test_a_record_of_restarts_is_judged_by_what_it_has_of_the_oscillating_beam(self):
        held = {"code": (True, False), "letter, beyond = projection": (True, True)}
        rows = self.rows({(label, 7): [{"a": one} for one in several] for label, several in held.items()})
        for case, value in (("degraded", 0.5), ("oscillating", 0.02)):
            numbers = {"case": case, "quantity": "mean error", "value": value}
            rows.append(self.EMPTY | {"reading": "code"} | numbers)
        found = outcomes(restarts.EXPERIMENT.frame(rows))
        assert found["code"].numbers["mean error"].tolist() == [0.02]
        rows.append(rows[-1] | {"quantity": "C/C0, masked", "x": 2.0})
        rows[-2] = rows[-2] | {"value": math.nan}
        found = outcomes(restarts.EXPERIMENT.frame(rows))
        assert found["code"].numbers.columns.tolist() == ["mean error"] and found["code"].fails == "1 of 1"
        counts = {label: one.statements for label, one in found.items()}
        assert counts == {"code": 0.5, "letter, beyond = projection": 1.0}


def test_to_fail_is_twice_the_error_of_the_paper():
    runs = [run(**{"mean error": error}) for error in (0.05, 0.0999, 0.1001, math.inf, math.nan)]
    one = outcome({"D1": REPRODUCED}, runs=runs)
    assert one.n_failing == 3 and one.fails == "3 of 5"


def test_the_default_is_what_the_rule_selects():
    """The first of the ranked candidates at laptop, which is not tied with one of fewer departures."""
    record = Record.load(restarts.EXPERIMENT, RESULTS / "restarts_laptop_candidates.json")
    counts = statement_counts(record.rows)
    (first, *_), *others = ranked_candidates(counts)
    assert find_reading(first).values == READINGS["default"]
    for other, *_ in others:
        behind = counts[first] - counts[other]
        tied = behind.mean() <= behind.sem()
        assert not (tied and len(find_reading(other).departures) < len(find_reading(first).departures))


def test_a_reading_by_its_label():
    assert find_reading("default").options == ()
    label = "code-rounding, beyond = regularised"
    assert find_reading(label).values == READINGS["code-rounding"] | {"beyond": "regularised"}
    sky = claims.skies(preset="ci", n_realisations=1, reading=label)[0]
    assert [dict(one.options)["beyond"] for one in sky.realisations[label]] == ["regularised"] * 2
