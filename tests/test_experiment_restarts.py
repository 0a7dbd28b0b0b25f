"""The ensemble of SDecGMCA: its candidates, and what is recorded of a member."""

from dataclasses import replace

import ledgers
import pytest

from himap.app.stored import RESULTS
from himap.paper import cleaned
from himap.paper.ensembles import failures
from himap.paper.experiments import restarts
from himap.paper.experiments.claims import JudgedSky
from himap.paper.readings import candidates
from himap.paper.record import Record
from himap.removal.sdecgmca.readings import READINGS, resolved

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
