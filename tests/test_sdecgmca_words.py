"""What captions say of SDecGMCA: its reading, in what it departs from the text, and where it ends."""

import pytest

from himap.paper.captions import of_sdecgmca
from himap.removal import SDecGMCA

WORD, SILENT = "every word of the paper's text", "which does not say the "
ENDS = "and ends at ℓ = 128, as does the truth that it is divided by"


@pytest.mark.parametrize(
    "options, words",
    [
        ({}, f"SDecGMCA is read as “default”, {WORD} ({SILENT}noise of the thresholds), {ENDS}"),
        ({"reading": "letter"}, f"SDecGMCA is read as “letter”, {WORD}, {ENDS}"),
        ({"reading": "letter", "sign": "free"}, "“letter”, the paper's text but for the sign of A, "),
        ({"sign": "free"}, f"text but for the sign of A ({SILENT}noise of the thresholds), "),
        ({"reading": "code"}, f"“code”, the paper's text but for 7 choices ({SILENT}smallest eigenvalue of"),
        ({"reading": "follow-up"}, "goes on beyond ℓ = 128 with its regularised inversion"),
        ({"beyond": "projection"}, "goes on beyond ℓ = 128 without regularisation"),
        ({"lmax": 30}, "ends at ℓ = 30,"),
    ],
)
def test_words(options, words):
    assert words in of_sdecgmca(SDecGMCA(**options), 64)
