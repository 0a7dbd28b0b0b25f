"""Stored ledgers held against one realisation that is judged again."""

from dataclasses import replace

import pytest
from ledgers import entry, finding

from himap.errors import InputError
from himap.paper.checking import check_ledger, same
from himap.paper.claims import FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.ledger import read_ledger, write_ledger

ABOUT = {
    "preset": "ci",
    "galaxy": "synthetic",
    "overrides": [["n_realisations", 2], ["seed", 0]],
    "code": "a",
}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "ledger.json"
    nudged = {0.999: finding(FAILED)}
    rows = [entry(REPRODUCED, IN_PART, nudged=nudged), entry(INAPPLICABLE, FAILED, values=[None, 2], id="N1")]
    write_ledger(rows, path, ABOUT)
    return path


def again(d1=REPRODUCED, value=0.5, n1=INAPPLICABLE):
    return [entry(d1, values=[value]), entry(n1, values=[None], id="N1")]


def about(**changed):
    return ABOUT | {"overrides": [["n_realisations", 1], ["seed", 0]], "code": "b"} | changed


def test_the_same_is_marked_and_kept(path):
    before = read_ledger(path)
    check_ledger(again(value=0.5003), path, about())
    entries, told = read_ledger(path)
    assert entries[0] == before[0][0] and len(entries) == 2
    assert told["code"] == "a" and told["checked"]["code"] == "b"
    assert set(told["checked"]) == {"code", "commit", "dirty"}


@pytest.mark.parametrize(
    ("entries", "made", "message"),
    [
        (again(value=0.502), about(), r"1 of 2 claims are not those of the realisation 0 .* any more, D1"),
        (again(d1=IN_PART), about(), "any more, D1"),
        (again(n1=FAILED), about(), "any more, N1"),
        (again()[:1], about(), "any more, N1"),
        ([replace(one, findings={5: one.findings[0]}) for one in again()], about(), "realisation 5 .*D1, N1"),
        (again(), about(galaxy="pysm3"), r"other parameters \(galaxy\): give those"),
        (again(), about(overrides=[["seed", 0], ["method", "pca"]]), r"\(method=pca\)"),
        (again(), about(overrides=[]), r"\(seed=0\)"),
    ],
)
def test_what_differs_leaves_it_as_it_is(path, entries, made, message):
    before = path.read_text()
    with pytest.raises(InputError, match=message):
        check_ledger(entries, path, made)
    assert path.read_text() == before


def test_numbers_agree_to_a_thousandth():
    assert same([1000.0, "a"], (1000.9, "a")) and same(0.0, 9e-4) and same(float("nan"), float("nan"))
    assert not same(1000.0, 1001.1) and not same([1.0], [1.0, 2.0]) and not same(float("nan"), 1.0)
