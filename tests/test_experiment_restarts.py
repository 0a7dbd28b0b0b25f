"""The ensemble of SDecGMCA: its candidates, what is recorded of a member, and how often flags are right."""

from dataclasses import replace

import ledgers
import numpy as np
import pytest

from himap.app.stored import RESULTS
from himap.paper import cleaned
from himap.paper.ensembles import failures
from himap.paper.experiments import flags, restarts
from himap.paper.experiments.claims import JudgedSky
from himap.paper.readings import candidates
from himap.paper.record import Record
from himap.paper.restarts import FLAGS, chosen_failures, flag_rates, flag_table, members_of
from himap.removal.sdecgmca.readings import READINGS, resolved
from himap.store import cache

SURVEY = ledgers.TINY["survey"] | {"seed": 11}  # a sky of its own
TINY = {"preset": "ci", "survey": SURVEY, "n_realisations": 1, "n_restarts": 2, "n_sources_max": 2}


@pytest.fixture(scope="module")
def sky():
    """Two members whose iterations end soon."""
    (sky,) = restarts.skies(**TINY, reading="code")
    members = sky.realisations["code"]
    return JudgedSky({"code": [replace(one, options=(*one.options, *ledgers.SHORT)) for one in members]})


@pytest.fixture(scope="module")
def table(sky):
    """Without what the claims are judged on, and so without their verdicts, which are tested with them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(restarts, "judge", lambda member: {})
        return replace(restarts.EXPERIMENT, prepare=lambda skies: None).table([sky])


def test_candidates_are_the_named_readings_with_every_end():
    values = [tuple(sorted(map(str, one.values.items()))) for one in candidates().values()]
    assert len(set(values)) == len(values) == 3 * (len(READINGS) - 1)
    default = resolved("default", dict.fromkeys(READINGS["default"]))
    assert default in [one.values for one in candidates().values()]


def test_members_of_all_candidates_share_a_fit():
    (sky,) = restarts.skies(**TINY | {"n_restarts": 1})
    methods = [member.calls("oscillating")["sdecgmca"][1] for (member,) in sky.realisations.values()]
    assert len({method.iteration for method in methods}) == 4  # code and code-rounding are one


def test_the_scan_is_sparse_beyond_eight():
    (sky,) = restarts.skies(**TINY | {"n_sources_max": 11}, reading="code")
    assert sky.realisations["code"][0].n_sources == (2, 3, 4, 5, 6, 7, 8, 10)
    (sky,) = restarts.skies(**TINY | {"n_sources_min": 11, "n_sources_max": 14}, reading="code")
    assert sky.realisations["code"][0].n_sources == (11,)


def test_rows_of_each_case_and_member(table):
    numbers = table[table["quantity"] == "mean error"]
    assert numbers.groupby("restart").size().tolist() == [len(restarts.CASES) + 1] * 2
    assert set(numbers["case"]) == {*restarts.CASES, restarts.SCAN}
    assert {"n_warmup", "refinement_change", "condition", "cost", "floored"} <= set(table["quantity"])


def test_a_member_has_more_than_its_reading(sky, table):
    """The numbers and curves of both are tested with the readings."""
    call = sky.realisations["code"][1].calls("oscillating")["sdecgmca"]
    rows = table[(table["case"] == "oscillating") & (table["restart"] == 1)].set_index("quantity")
    whole, masked = (cleaned.compared(*call, masked=masked) for masked in (False, True))
    assert rows.loc["total error", "value"] == pytest.approx(whole.total_error())
    assert rows.loc["P/P0, masked", "value"].iloc[0] == pytest.approx(masked.frequency_ratio[0])
    assert rows.loc["r", "value"].between(-1, 1).all()


def test_many_readings_have_claims_and_numbers_but_no_curves(sky, monkeypatch):
    monkeypatch.setattr(restarts, "judge", lambda member: {})
    members = sky.realisations["code"][:1]
    several = JudgedSky({"code": members, "letter": members})
    rows = restarts.measure(several)
    assert {row["reading"] for row in rows} == {"code", "letter"}
    assert not [row for row in rows if row["quantity"] == "C/C0"]
    assert {row["case"] for row in rows} == set(restarts.CASES)


def test_the_summary_counts_them_in_the_row_of_their_case():
    rows = Record.load(restarts.EXPERIMENT, RESULTS / "restarts_laptop_default.json").rows
    expected = [f"{one.failed} of {one.members}" for one in failures(rows).itertuples()]
    keys = failures(rows)[["case", "n_sources"]].astype(str)
    found = restarts.EXPERIMENT.summary(rows).set_index(["case", "n_sources"])["failed"]
    assert found.to_dict() == dict(zip(keys.itertuples(index=False, name=None), expected, strict=True))


def test_the_summary_of_a_case_without_a_finite_number(table):
    lost = table.assign(value=table["value"].mask(table["case"] == "evolving"))
    row = restarts.EXPERIMENT.summary(lost).set_index("case").loc["evolving"]
    assert (row["failed"], row["mean error"]) == ("2 of 2", "–")


ERRORS = np.array([[0.05, 0.05, 0.5, 0.05], [0.05, 0.05, 0.05, 9.0]])  # two ensembles of four members


def table_of(**quantities):
    """A table of two ensembles, {quantity: (2, 4)}."""
    return flags.EXPERIMENT.frame(
        [
            {"seed": seed, "reading": "code", "restart": restart, "quantity": name, "value": float(value)}
            for name, values in {"mean error": ERRORS, **quantities}.items()
            for seed, row in enumerate(values)
            for restart, value in enumerate(row)
        ]
    )


def test_a_flag_that_is_always_right():
    """Thresholds count where there is one; ranks need none."""
    rates = flag_rates(table_of(distance=ERRORS))
    assert rates.loc["distance"].to_dict() == {
        "hits": 1,  # 0.5 is not above the threshold
        "n_failed": 2,
        "false_alarms": 0,
        "n_sound": 6,
        "ranked": 1.0,
    }
    assert flag_rates(table_of(distance=-ERRORS)).loc["distance", "ranked"] == 0
    assert flag_rates(table_of(distance=0 * ERRORS)).loc["distance", "ranked"] == 0.5


def test_the_cost_is_compared_within_an_ensemble():
    """Data of another sky have another cost."""
    cost = np.array([[1.0, 2, 9, 2], [101.0, 200, 200, 900]])
    rates = flag_rates(table_of(cost=cost)).loc["cost"]
    assert (rates["hits"], rates["false_alarms"], rates["ranked"]) == (2, 0, 1.0)


def test_either_of_those_that_are_used():
    contrast = np.array([[1, 1, 9, 1], [1, 1, 1, 1.0]])
    distance = np.array([[0, 0, 0, 0], [0, 0, 1, 1.0]])
    rates = flag_rates(table_of(contrast=contrast, distance=distance, condition=1e9 + 0 * ERRORS))
    assert rates.loc["either", ["hits", "false_alarms"]].tolist() == [2, 1]
    assert rates.loc["condition", ["hits", "false_alarms"]].tolist() == [2, 6]


def test_chosen_members():
    """Three members have the least condition, and it chooses none."""
    ranked = ERRORS + 1e-3 * np.arange(4)
    found = chosen_failures(table_of(distance=ranked, cost=-ranked, condition=ERRORS))
    assert found == {"any": (2, 8), "distance": (0, 2), "cost": (2, 2)}


def test_a_table_without_failures():
    table = table_of(distance=ERRORS)
    table.loc[table["quantity"] == "mean error", "value"] = 0.01
    shown = flag_table(table).set_index("flag")
    assert shown.loc[FLAGS["distance"][0], "hit rate"] == "–"
    assert shown.loc["none: any member", "least of it fails"] == "0 of 8 (0 %)"


def test_members_are_told_apart_by_reading_and_seed():
    table = table_of(cost=ERRORS)
    other = table.assign(reading="letter")
    both = members_of(flags.EXPERIMENT.frame([*table.to_dict("records"), *other.to_dict("records")]))
    assert both["ensemble"].nunique() == 4 and both["failed"].sum() == 4


def test_members_whose_error_is_not_finite_fail():
    table = table_of(cost=ERRORS)
    errors = table["quantity"] == "mean error"
    assert members_of(table.assign(value=table["value"].mask(errors)))["failed"].tolist() == [True] * 8
    lost = (table["seed"] == 1) & (table["restart"] == 0)
    assert len(members_of(table.assign(value=table["value"].mask(lost)))) == 8


def test_a_tiny_sky(tmp_path, monkeypatch):
    """Each member has every quantity, the medoid no distance; no map or separation stays in the cache."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    survey = {"nside": 8, "n_channels": 16, "box_cells": 16}
    (sky,) = flags.skies(preset="ci", survey=survey, n_realisations=1, n_restarts=2)
    table = flags.EXPERIMENT.frame([{"seed": 1} | row for row in flags.measure(sky)])
    kept = {entry.product for entry in cache.cache_info()}
    assert kept == {"measured_flags", "assessment", "components_of_sky", "true_spectra"}
    assert list(table.columns) == ["seed", *flags.COLUMNS]
    members = members_of(table)
    assert len(members) == 6 and members.notna().all().all()
    assert (members.groupby("ensemble")["distance"].min() == 0).all()
