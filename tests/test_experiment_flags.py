"""How often flags are right, on made-up tables, and the experiment on a tiny sky."""

import numpy as np
import pytest

from himap.paper import cleaned
from himap.paper.experiments.flags import COLUMNS, EXPERIMENT, measure, skies
from himap.paper.restarts import FLAGS, chosen_failures, flag_rates, flag_table, members_of
from himap.store import cache

ERRORS = np.array([[0.05, 0.05, 0.5, 0.05], [0.05, 0.05, 0.05, 9.0]])  # two ensembles of four members


def table_of(**quantities):
    """A table of two ensembles, {quantity: (2, 4)}."""
    return EXPERIMENT.frame(
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
    both = members_of(EXPERIMENT.frame([*table.to_dict("records"), *other.to_dict("records")]))
    assert both["ensemble"].nunique() == 4 and both["failed"].sum() == 4


def test_members_whose_error_is_not_finite_fail():
    table = table_of(cost=ERRORS)
    errors = table["quantity"] == "mean error"
    assert members_of(table.assign(value=table["value"].mask(errors)))["failed"].tolist() == [True] * 8
    lost = (table["seed"] == 1) & (table["restart"] == 0)
    assert len(members_of(table.assign(value=table["value"].mask(lost)))) == 8


def test_a_tiny_sky(tmp_path, monkeypatch):
    """Each member has every quantity; the medoid has no distance, as of an ensemble of its residuals.

    No map or separation stays in the cache.
    """
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    survey = {"nside": 8, "n_channels": 16, "box_cells": 16}
    (sky,) = skies(preset="ci", survey=survey, n_realisations=1, n_restarts=2)
    table = EXPERIMENT.frame([{"seed": 1} | row for row in measure(sky)])
    kept = {entry.product for entry in cache.cache_info()}
    assert kept == {"measured_flags", "assessment", "components_of_sky", "true_spectra"}
    assert list(table.columns) == ["seed", *COLUMNS]
    members = members_of(table)
    assert len(members) == 6 and members.notna().all().all()
    assert (members.groupby("ensemble")["distance"].min() == 0).all()
    calls = [one.calls("oscillating")["sdecgmca"][:3] for one in sky.realisations["code"]]
    ensemble = cleaned.ensemble(calls)
    one, two = (member.residual.astype(float) for member in ensemble.members)
    assert ensemble.distances[0, 1] == pytest.approx(np.sqrt(np.mean((one - two) ** 2)), rel=1e-3, abs=1e-5)
