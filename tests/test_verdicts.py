"""Verdicts by shares of members, on made-up findings."""

import math
from dataclasses import replace

import pytest
from ledgers import entry_of, judged

from himap.paper.claims import CLAIMS, FAILED, INAPPLICABLE, REPRODUCED, UNDECIDED, Finding, Part
from himap.paper.claims.verdicts import parts_of, places_of, wilson


def members(*shares, n=50):
    """One sky with n restarts, and a part for each (name, share in which it holds, method)."""
    parts = [[Part(name, k < share * n, True, method) for name, share, method in shares] for k in range(n)]
    return judged([tuple(several) for several in parts])


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ((1.0,), REPRODUCED),
        ((0.84,), REPRODUCED),
        ((0.82,), UNDECIDED),
        ((0.5,), UNDECIDED),
        ((0.18,), UNDECIDED),
        ((0.16,), FAILED),
        ((1.0, 0.0), FAILED),
        ((1.0, 0.5), UNDECIDED),
        ((0.5, 0.1), FAILED),  # one main part fails, whatever the other does
    ],
)
@pytest.mark.parametrize("method", ["SD", ""])
def test_a_claim_about_one_method_or_none(shares, expected, method):
    entry = members(*((f"{n}", share, method) for n, share in enumerate(shares)))
    assert entry.verdict == entry.label == expected


@pytest.mark.parametrize(
    ("pca", "sd", "pol", "label"),
    [
        (1.0, 0.9, 0.84, "reproduced"),
        (1.0, 1.0, 0.0, "in part (for 2 of 3 parts; not for POL)"),
        (1.0, 0.5, 0.1, "in part (for 1 of 3 parts; not for POL; undecided for SD)"),
        (1.0, 0.5, 1.0, "undecided"),
        (0.1, 0.5, 0.1, "undecided"),  # it holds for no method, and may for one
        (0.1, 0.0, 0.16, "not reproduced"),
    ],
)
def test_a_claim_about_several_methods(pca, sd, pol, label):
    shares = (("PCA/ICA a", pca, "PCA/ICA"), ("SD a", sd, "SD"), ("POL a", pol, "POL"))
    assert members(*shares).label == label


def test_a_method_holds_if_all_its_parts_do():
    """With half of its parts a method does not hold, and a claim that holds for no method is not in part."""
    pair = [
        (f"{name} {word}", share, name) for name in ("GMCA", "SD") for word, share in (("a", 1), ("b", 0))
    ]
    assert members(*pair).label == FAILED
    assert members(*pair[:2], pair[2]).label == "in part (for 2 of 3 parts; not for GMCA)"


def test_a_part_about_no_single_method_is_by_itself():
    both = (("GMCA a", 1, "GMCA"), ("SD a", 1, "SD"))
    assert members(*both, ("those most", 0, "")).label == "in part (for 2 of 3 parts; not for those most)"
    assert members(*both, ("those most", 0.5, "")).label == UNDECIDED
    none = (("GMCA a", 0, "GMCA"), ("SD a", 0, "SD"))
    assert members(*none, ("those most", 1, "")).label == FAILED


def test_other_parts_do_not_count():
    entry = judged([(Part("a", True), Part("b", False, main=False))])
    assert entry.verdict == REPRODUCED and entry.shares["holds"]["b"] is False


def test_skies_weigh_the_same():
    """Sixteen restarts of a sky count as much as two of another."""
    held, failed = (Part("a", True),), (Part("a", False),)
    entry = judged([held] * 16, [failed] * 2)
    assert entry.shares.loc["a", ["mean", "low", "high"]].tolist() == [0.5, 0.0, 1.0]
    assert entry.verdict == UNDECIDED
    assert (entry.n_skies, entry.n_restarts) == (2, 16)


def test_the_interval_of_one_sky_is_that_of_its_restarts():
    share = members(("a", 0.5, "SD"), n=8).shares.loc["a"]
    assert (share["low"], share["high"]) == wilson(4, 8) == pytest.approx((1 / 3, 2 / 3))
    assert wilson(8, 8) == pytest.approx((8 / 9, 1)) and wilson(0, 1) == pytest.approx((0, 0.5))
    assert wilson(3, 10, z=1.96) == pytest.approx((0.1078, 0.6032), abs=1e-4)  # 95 %, as tabulated


def test_where_it_does_not_apply_it_is_no_member():
    held, void = (Part("a", True),), ()
    assert judged([held], [void]).verdict == REPRODUCED
    assert judged([void], [void]).verdict == INAPPLICABLE
    assert judged([held, void, (Part("a", False),)]).shares["mean"]["a"] == 0.5


def test_a_premise_that_is_absent_counts_as_not_reproduced_and_is_said():
    absent, lower, higher = ((Part("lower", held, True, "SD"),) for held in (None, True, False))
    assert judged([absent] * 9 + [lower]).label == "not reproduced (premise absent)"
    assert judged([absent] * 5 + [higher] * 5).label == FAILED
    assert judged([absent] * 5 + [lower] * 5).label == UNDECIDED
    assert judged([absent] + [lower] * 9).label == REPRODUCED
    two = (Part("in l", None, True, "SD"), Part("in k", True, True, "SD"))
    assert judged([two]).label == "not reproduced (premise absent)"
    assert judged([absent] * 9 + [lower]).shares["absent"]["lower"] == 0.9


def test_a_part_that_a_member_does_not_have_does_not_hold_there():
    entry = judged([(Part("a", True), *places_of({"total": n})) for n in (5, 5, 6, 5)])
    assert entry.places == {"total 5": 0.75, "total 6": 0.25}
    assert entry.verdict == REPRODUCED


def test_the_number_is_the_median_with_16_to_84_percent_of_the_members():
    findings = {(0, k): Finding(float(k), (), "") for k in range(101)}
    assert entry_of(findings).values == pytest.approx((50, 16, 84))
    findings[1, 0] = Finding(1000.0, (), "")  # one sky of two, so half of the members
    assert entry_of(findings).values[2] == 1000.0 and entry_of(findings).values[0] >= 100
    assert all(math.isnan(value) for value in judged([()], value=math.nan).values)


def test_pca_and_ica_are_one_part_that_of_the_worse():
    found = [parts_of({"PCA": 1, "ICA": value, "SD": 3}, lambda x: x < 2, "small") for value in (2, 1, None)]
    assert [(part.name, part.method) for part in found[0]] == [
        ("PCA/ICA small", "PCA/ICA"),
        ("SD small", "SD"),
    ]
    assert [[part.held for part in parts] for parts in found] == [
        [False, False],
        [True, False],
        [None, False],
    ]
    (other,) = parts_of({"l < 10": 1}, bool, "in excess", method="GMCA")
    assert (other.name, other.method) == ("l < 10 in excess", "GMCA")


def test_claims_on_sdecgmca_are_those_with_a_main_part_about_it():
    assert members(("a", 1, "SD"), ("b", 1, "POL")).about_sd
    assert not members(("b", 1, "POL")).about_sd
    assert not judged([(Part("a", True, False, "SD"), Part("b", True))]).about_sd


def test_a_claim_that_does_not_apply_is_on_sdecgmca_if_its_statement_is():
    absent = judged([()])
    assert not absent.about_sd
    assert replace(absent, claim=CLAIMS["N2"]).about_sd
