"""What captions say of SDecGMCA: its reading, in what it departs from the text, and where it ends."""

import pytest

from himap.paper.captions import of_sdecgmca
from himap.removal import SDecGMCA

ENDS = "and ends at ℓ = 128, as does the truth that it is divided by"


@pytest.mark.parametrize(
    "options, words",
    [
        ({}, f"SDecGMCA is read as “default”, the paper's text but for the sign of A, {ENDS}"),
        ({"reading": "letter"}, f"SDecGMCA is read as “letter”, every word of the paper's text, {ENDS}"),
        ({"reading": "letter", "sign": "free"}, "“letter”, the paper's text but for the sign of A, "),
        ({"reading": "code"}, "“code”, the paper's text but for 8 choices, "),
        ({"reading": "follow-up"}, "goes on beyond ℓ = 128 with its regularised inversion"),
        ({"beyond": "projection"}, "goes on beyond ℓ = 128 without regularisation"),
        ({"lmax": 30}, "ends at ℓ = 30,"),
    ],
)
def test_words(options, words):
    assert words in of_sdecgmca(SDecGMCA(**options), 64)
