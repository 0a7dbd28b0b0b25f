"""Verdicts by shares of members, on made-up findings."""

import math
from dataclasses import replace

import pytest
from ledgers import entry_of, judged

from himap.paper.claims import CLAIMS, FAILED, INAPPLICABLE, REPRODUCED, UNDECIDED
from himap.paper.claims.base import Finding, Part, parts_of, places_of
from himap.paper.claims.entries import wilson
from himap.paper.ledger_table import measured

ABSENT = f"{FAILED} (premise absent in 1 of 2 parts)"
PRESENT = f"{UNDECIDED} (holds where its premise is present)"


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
    ("shares", "label"),
    [
        ("PCA/ICA 1.0, SD 0.9, POL 0.84", REPRODUCED),
        ("PCA/ICA 1.0, SD 1.0, POL 0.0", "in part (for 2 of 3 parts; not for POL)"),
        ("PCA/ICA 1.0, SD 0.5, POL 0.1", "in part (for 1 of 3 parts; not for POL; undecided for SD)"),
        ("PCA/ICA 1.0, SD 0.5, POL 1.0", UNDECIDED),
        ("PCA/ICA 0.1, SD 0.5, POL 0.1", f"{UNDECIDED} (not for PCA/ICA, POL)"),  # it may hold for one
        ("PCA/ICA 0.1, SD 0.0, POL 0.16", FAILED),
        # A method holds if all its parts do, and a claim that holds for no method is not in part.
        ("GMCA 1, GMCA 0, SD 1, SD 0", FAILED),
        ("GMCA 1, GMCA 0, SD 1", "in part (for 2 of 3 parts; not for GMCA)"),
        # A part about no single method is by itself.
        ("GMCA 1, SD 1, ? 0", "in part (for 2 of 3 parts; not: 2)"),
        ("GMCA 1, SD 1, ? 0.5", UNDECIDED),
        ("GMCA 0, SD 0, ? 1", FAILED),
    ],
)
def test_a_claim_about_several_methods(shares, label):
    pairs = [one.split() for one in shares.split(", ")]
    parts = [(f"{n}", float(share), name.strip("?")) for n, (name, share) in enumerate(pairs)]
    assert members(*parts).label == label


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
    alone = members(("a", 1, "PCA/ICA"), n=8).shares.loc["a"]  # the same cleaning, eight times
    assert (alone["low"], alone["high"]) == wilson(1, 1)
    assert wilson(8, 8) == pytest.approx((8 / 9, 1)) and wilson(0, 1) == pytest.approx((0, 0.5))
    assert wilson(3, 10, z=1.96) == pytest.approx((0.1078, 0.6032), abs=1e-4)  # 95 %, as tabulated


def test_where_it_does_not_apply_it_is_no_member():
    held, void = (Part("a", True),), ()
    assert judged([held], [void]).verdict == REPRODUCED
    assert judged([void], [void]).verdict == INAPPLICABLE
    assert judged([held, void, (Part("a", False),)]).shares["mean"]["a"] == 0.5


@pytest.mark.parametrize(
    ("n_absent", "n_lower", "n_higher", "label"),
    [(9, 1, 0, ABSENT), (5, 0, 5, FAILED), (5, 5, 0, PRESENT), (4, 5, 1, UNDECIDED), (1, 9, 0, REPRODUCED)],
)
def test_a_premise_that_is_absent_counts_as_not_reproduced_and_is_said(n_absent, n_lower, n_higher, label):
    held = [None] * n_absent + [True] * n_lower + [False] * n_higher
    entry = judged([(Part("lower", one, True, "SD"), Part("k", True, True, "SD")) for one in held])
    assert entry.label == label
    assert entry.shares["absent"]["lower"] == n_absent / 10


@pytest.mark.parametrize(("held", "label"), [([None], f"{FAILED} (premise absent)"), ([True, False], FAILED)])
def test_a_premise_is_absent_if_it_is_in_all_parts(held, label):
    lower = Part("lower", None, True, "SD")
    assert judged([(lower, Part("k", one, True, "SD")) for one in held]).label == label


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


def test_members_without_a_number_keep_their_weight():
    """One of the four restarts of a sky has a number, two of those of another: each counts the same."""
    numbers = {(0, 0): 10.0, (0, 1): math.nan, (0, 2): math.nan, (0, 3): math.nan}
    numbers |= {(1, 0): 1.0, (1, 1): 1.1, (1, 2): math.nan, (1, 3): math.nan}
    entry = entry_of({member: Finding(value, (), "") for member, value in numbers.items()})
    assert entry.values[0] == 1.1
    assert measured(entry).endswith("in 3 of 8 members")


def test_what_no_restart_changes_is_one_draw():
    """Of the sky alone, unlike what is about no single method and has another number in each restart."""
    parts = (Part("a", True),)
    low = {
        spread: entry_of({(0, k): Finding(1.0 + spread * k, parts, "") for k in range(8)}).shares["low"]["a"]
        for spread in (0, 1)
    }
    assert low == pytest.approx({0: wilson(1, 1)[0], 1: wilson(8, 8)[0]})


@pytest.mark.parametrize(("ica", "held"), [(2, False), (1, True), (None, None)])
def test_pca_and_ica_are_one_part_that_of_the_worse(ica, held):
    found = parts_of({"PCA": 1, "ICA": ica, "l < 10": 3}, lambda x: x < 2, "small", method="GMCA")
    assert found == (
        Part("PCA/ICA small", held, True, "PCA/ICA"),
        Part("l < 10 small", False, True, "GMCA"),
    )


def test_claims_on_sdecgmca_have_a_main_part_about_it_or_where_none_applies_a_statement():
    assert members(("a", 1, "SD"), ("b", 1, "POL")).about_sd
    assert not judged([(Part("a", True, False, "SD"), Part("b", True))]).about_sd
    assert not judged([()]).about_sd
    assert replace(judged([()]), claim=CLAIMS["N2"]).about_sd
