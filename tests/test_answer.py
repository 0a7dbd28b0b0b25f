"""The answer page: verdicts on conclusions, and stored curves drawn once more."""

import json

import numpy as np
import pytest
from ledgers import entry

from himap.app.stored_tables import angular_ratios, picture, stored_curves
from himap.core.errors import InputError
from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED, UNDECIDED
from himap.paper.ledger_table import CONCLUSIONS, joint_verdict


class TestConclusions:
    def test_each_rests_on_claims_that_there_are(self):
        assert len(CONCLUSIONS) == 5
        assert all(claims and set(claims.split()) <= set(CLAIMS) for claims in CONCLUSIONS)

    @pytest.mark.parametrize(
        ("verdicts", "expected"),
        [
            ([REPRODUCED, REPRODUCED], REPRODUCED),
            ([REPRODUCED, INAPPLICABLE], REPRODUCED),
            ([REPRODUCED, FAILED], IN_PART),
            ([FAILED, FAILED, INAPPLICABLE], FAILED),
            ([FAILED, UNDECIDED], UNDECIDED),
            ([REPRODUCED, UNDECIDED], IN_PART),
            ([FAILED, IN_PART], IN_PART),
            ([IN_PART, IN_PART], IN_PART),
            ([INAPPLICABLE], INAPPLICABLE),
        ],
    )
    def test_verdict(self, verdicts, expected):
        made = [(REPRODUCED, FAILED) if one == UNDECIDED else (one,) for one in verdicts]
        assert joint_verdict(entry(*one) for one in made) == expected


FIGURES = {
    "figures": [
        {
            "name": "fig-one",
            "paper": "1",
            "parameters": {"preset": "paper", "galaxy": "templates"},
            "execution": {"himap": "0.1.0", "commit": "abc1234", "dirty": False, "seconds": 60},
            "panels": {
                "sky": [
                    {"x": list(range(1, 400)), "y": {"HI + noise": [2.0] * 399, "PCA": [3.0] * 399}},
                    {"x": list(range(5, 201)), "y": {"SDecGMCA": [1.0] * 196, "other": [9.0] * 196}},
                ]
            },
        }
    ]
}


@pytest.fixture
def results(tmp_path):
    (tmp_path / "large").mkdir()
    (tmp_path / "large" / "figures.json").write_text(json.dumps(FIGURES))
    return tmp_path


class TestCurves:
    def test_ratios(self, results):
        (curves,) = stored_curves("large", "fig-one", results).values()
        panel = angular_ratios(curves, title="sky")
        pca, sdecgmca = panel["curves"]  # what is no method is not drawn
        assert (pca[-1]["label"], sdecgmca[-1]["label"]) == ("PCA", "SDecGMCA")
        assert pca[0].tolist() == list(range(2, 201)) and np.all(pca[1] == 1.5)
        assert sdecgmca[0].tolist() == list(range(5, 201)) and np.all(sdecgmca[1] == 0.5)
        assert panel["title"] == "sky"

    def test_an_ensemble_is_its_median_and_its_band(self):
        degrees, name = np.arange(2, 9), "SDecGMCA, median of 4 (1 failed)"
        parts = {"16 %": 0.9, "median": 1.0, "84 %": 1.2, "restart 0": 30.0}
        curves = {f"{name}: {part}": (degrees, np.full(7, value)) for part, value in parts.items()}
        ((_, middle, low, high, look),) = angular_ratios(curves | {"HI + noise": (degrees, np.ones(7))})[
            "curves"
        ]
        assert (look["label"], middle[0], low[0], high[0]) == (name, 1.0, 0.9, 1.2)

    def test_no_such_figure(self, results):
        with pytest.raises(InputError, match="no stored figure fig-two in large; there are fig-one"):
            stored_curves("large", "fig-two", results)

    def test_of_the_book(self):
        """At the paper's size every panel has six methods, at every l from 2 to 200."""
        for curves in stored_curves("paper_templates", "fig-results-angular").values():
            found = angular_ratios(curves)["curves"]
            assert len(found) == 6
            for degrees, ratio, *_ in found:
                assert degrees.tolist() == list(range(2, 201)) and np.all(ratio > 0)


def test_one_picture(results):
    text = picture("large", "fig-one", results)
    assert text.count("large/fig-one.png") == 2
    assert "*The paper's Fig. 1, made again.*" in text
    assert text.endswith("\n\n*paper, templates Galaxy · himap 0.1.0, commit abc1234*")
    known = picture("paper_templates", "fig-results-frequency")
    assert "*The paper's Fig. 2, made again: Frequency power spectrum" in known
    with pytest.raises(InputError, match="no stored figure fig-two in large"):
        picture("large", "fig-two", results)
