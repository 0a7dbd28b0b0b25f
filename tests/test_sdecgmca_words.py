"""What captions say of SDecGMCA: its reading, in what it departs from the text, and where it ends."""

import pytest

from himap.paper.captions import in_short, of_sdecgmca
from himap.removal import SDecGMCA

ENDS = "; it ends at ℓ = 128 and is compared with the truth at all multipoles"
SILENT = (
    "and, where it is silent, noise of the thresholds (that of the instrument, carried through the inversion)"
)


@pytest.mark.parametrize(
    ("reading", "options", "words"),
    [
        ("instrument-noise", {}, f"has the reading “instrument-noise”: the paper's text {SILENT}{ENDS}"),
        ("letter", {"sign": "free"}, f"“letter”: the paper's text except for sign of A (as it comes){ENDS}"),
        ("letter", {"last": "repeated"}, "the paper's text and, where it is silent, the last S (Eq. 23 with"),
        (
            "code",
            {},
            "“code”: the paper's text except for 5 choices and, where it is silent, smallest eigenvalue",
        ),
        ("follow-up", {}, "its regularised inversion is continued beyond ℓ = 128"),
        ("letter", {"beyond": "projection"}, "it is continued beyond ℓ = 128 without regularisation"),
    ],
)
def test_words_of_a_caption(reading, options, words):
    said = of_sdecgmca(SDecGMCA(reading=reading, **options), 64)
    assert said.startswith("SDecGMCA has the reading “") and words in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"reading": "follow-up"},
            "(the text except for 6 choices, with 4 choices), continued beyond ℓ = 128",
        ),
        ({}, "reading “default” (the text except for beyond = projection), continued beyond"),
        (
            {"reading": "letter", "sign": "free", "lmax": 30},
            "(the text except for sign = free), up to ℓ = 30",
        ),
        (
            {"reading": "instrument-noise", "beyond": "projection"},
            "except for beyond = projection, with thresholds = analytic), continued beyond",
        ),
    ],
)
def test_words_in_short(options, words):
    assert words in in_short(SDecGMCA(**options), 64)


def test_a_failure_is_judged_as_far_as_the_maps_go():
    for nside, end in ((64, "10 < ℓ ≤ 128"), (128, "10 < ℓ < 200")):
        assert f"|C/C0 - 1| at {end} exceeds 10 %" in in_short(SDecGMCA(), nside, n_restarts=4)
