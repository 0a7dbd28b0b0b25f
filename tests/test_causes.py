"""Causes of verdicts from stored records, on records made up for it."""

from itertools import product

import pytest
from ledgers import ABOUT, entry, finding

from himap.app.stored import other_records
from himap.paper.claims import FAILED, INAPPLICABLE, REPRODUCED
from himap.paper.claims.entries import finding_rows
from himap.paper.experiments import find_experiment
from himap.paper.ledger_table import cause
from himap.paper.record import Record

MADE = ABOUT | {"preset": "laptop", "overrides": [["reading", "letter"]]}


def write(folder, name, verdicts, n_restarts=2, **changed):
    """A record of D1: of claims from a verdict, of readings from {reading: verdict}."""
    experiment, rows = find_experiment(name.partition("_")[0]), []
    for restart, (reading, verdict) in product(range(n_restarts), verdicts.items()):
        for row in finding_rows({"D1": finding(verdict)}, restart):
            empty = dict.fromkeys(experiment.columns)
            own = {"reading": reading, "quantity": "D1"} if "reading" in empty else {}
            rows.append({"seed": 1} | empty | {k: v for k, v in row.items() if k in empty} | own)
    record = Record(experiment=experiment, rows=experiment.frame(rows), about=MADE | changed)
    record.save(folder / f"{name}.json")


@pytest.mark.parametrize(
    ("name", "verdicts", "changed", "expected"),
    [
        ("claims_a", {"": REPRODUCED}, {"overrides": []}, "reading default"),
        (
            "claims_a",
            {"": REPRODUCED},
            {"overrides": [["method", "beam_subspace"]]},
            "none found",
        ),
        ("claims_a", {"": REPRODUCED}, {"preset": "paper"}, "the paper's size"),
        (
            "claims_a",
            {"": REPRODUCED},
            {"preset": "paper", "overrides": []},
            "reading default, the paper's size",
        ),
        ("claims_a", {"": FAILED}, {"preset": "paper"}, "none found"),
        ("claims_a", {"": REPRODUCED}, {"preset": "paper", "n_restarts": 1}, "none found"),  # a draw
        (
            "claims_a",
            {"": REPRODUCED},
            {"overrides": [["reading", "letter"], ["average", "ratios"], ["taper", "hann"]]},
            "mean over channels of C/C0, Hann taper along frequency",
        ),
        ("claims_a", {"": REPRODUCED}, {}, "none found"),  # the ledger itself
        (
            "readings",
            {"letter": FAILED, "code": REPRODUCED},
            {"preset": "paper"},
            "reading code, the paper's size",
        ),
        ("readings", {"letter": REPRODUCED, "code": REPRODUCED}, {"preset": "paper"}, "the paper's size"),
        ("readings", {"follow-up": REPRODUCED, "code": REPRODUCED}, {"preset": "paper"}, "the paper's size"),
        (
            "readings",
            {"follow-up": FAILED, "code": REPRODUCED},
            {"preset": "paper"},
            "reading code, the paper's size",
        ),
        ("readings", {"code": REPRODUCED}, {"overrides": []}, "reading code"),
        ("readings", {"code": REPRODUCED}, {"preset": "ci"}, "none found"),  # D1 is about l = 200
        ("claims_a", {"": REPRODUCED}, {"overrides": [["reading", "letter"], ["nside", 64]]}, "none found"),
    ],
)
def test_what_makes_a_claim_hold(tmp_path, name, verdicts, changed, expected):
    write(tmp_path, name, verdicts, **changed)
    assert cause(entry(FAILED), other_records(MADE, tmp_path)) == expected


def test_a_reading_with_another_name_is_that_of_the_ledger(tmp_path):
    write(tmp_path, "readings", {"letter, beyond = projection": REPRODUCED, "letter": FAILED})
    made = MADE | {"overrides": []}
    assert cause(entry(FAILED), other_records(made, tmp_path)) == "none found"


def test_a_claim_that_does_not_apply_has_no_cause(tmp_path):
    write(tmp_path, "claims_a", {"": REPRODUCED}, preset="paper")
    assert cause(entry(INAPPLICABLE), other_records(MADE, tmp_path)) == ""


def test_records_of_another_version_are_left_out(tmp_path):
    (tmp_path / "claims_old.json").write_text('{"format": 1}')
    assert other_records(MADE, tmp_path) == {}
