"""What captions say of SDecGMCA: its reading, in what it departs from the text, and where it ends."""

import pytest

from himap.paper.captions import in_short, of_sdecgmca
from himap.removal import SDecGMCA

TEXT = "the paper's text"
ENDS = "; it ends at ℓ = 128 and is compared with the truth at all multipoles"
SIGN = "except for sign of A (as it comes)"
SILENT = (
    "and, where it is silent, noise of the thresholds (that of the instrument, carried through the inversion)"
)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reading": "instrument-noise"}, f"has the reading “instrument-noise”: {TEXT} {SILENT}{ENDS}"),
        ({"reading": "letter"}, f"SDecGMCA has the reading “letter”: {TEXT}{ENDS}"),
        ({"reading": "letter", "sign": "free"}, f"“letter”: {TEXT} {SIGN}{ENDS}"),
        ({"reading": "instrument-noise", "sign": "free"}, f"{TEXT} {SIGN} {SILENT}{ENDS}"),
        (
            {"reading": "letter", "last": "repeated"},
            f"{TEXT} and, where it is silent, the last S (Eq. 23 with",
        ),
        ({"reading": "code"}, f"“code”: {TEXT} except for 6 choices and, where it is silent, smallest eigen"),
        ({"reading": "follow-up"}, "its regularised inversion is continued beyond ℓ = 128"),
        ({"reading": "letter", "beyond": "projection"}, "continued beyond ℓ = 128 without regularisation"),
        ({"reading": "letter", "lmax": 30}, "it ends at ℓ = 30 and"),
    ],
)
def test_in_full(options, words):
    assert words in of_sdecgmca(SDecGMCA(**options), 64)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "“default” (the text except for 7 choices, with floor = 1e-09, last = repeated), continued"),
        ({"reading": "letter"}, "SDecGMCA: reading “letter” (the text), up to ℓ = 128"),
        ({"reading": "letter", "sign": "free", "lmax": 30}, "except for sign = free), up to ℓ = 30"),
        ({"reading": "code"}, "the text except for 6 choices, with floor = 1e-09, last_floor = 1e-09"),
        (
            {"reading": "instrument-noise", "beyond": "projection"},
            "except for beyond = projection, with thresholds = analytic), continued beyond",
        ),
    ],
)
def test_in_short(options, words):
    assert words in in_short(SDecGMCA(**options), 64)
