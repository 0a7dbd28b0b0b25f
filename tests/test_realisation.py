"""What one realisation asks of the chain: cases, methods, and where lines of sight are left out."""

import pytest

from himap.errors import InputError
from himap.instrument.beams import Degraded, Evolving, MeerKAT, Oscillating
from himap.paper.methods import BSS, TABLE_1
from himap.paper.realisation import Realisation
from himap.sky.dimming import Dimming
from himap.survey import Survey

SURVEY = Survey(nside=8, n_channels=30, box_cells=16)
DIMMING = Dimming(weight=0.3)
SKY = Realisation(survey=SURVEY, dimming=DIMMING, n_sources=(2, 3))


def test_cases():
    found = {name: (case.beam, case.dimming, *flags) for name, (case, *flags) in SKY.cases.items()}
    assert found == {
        "degraded": (Degraded(), None, True, False),
        "evolving": (Evolving(), None, True, False),
        "oscillating": (Oscillating(), None, True, True),
        "peaks left in": (Oscillating(), None, False, False),
        "dimmed": (Oscillating(), DIMMING, True, False),
    }
    assert {case.survey for case, *_ in SKY.cases.values()} == {SURVEY}


def test_another_beam_in_the_place_of_the_oscillating_one():
    cases = Realisation(survey=SURVEY, oscillating=MeerKAT()).cases
    assert [str(case.beam) for case, *_ in cases.values()] == ["degraded", "evolving", *["meerkat"] * 3]


def test_every_assessment_that_the_claims_need():
    """Six methods on five cases, with the sources of Table 1, and the scan."""
    *calls, two, three = SKY.assessments
    assert len(calls) == 30
    for case, method, *_ in calls:
        assert getattr(method, "n_sources", None) in (None, TABLE_1[case.beam.name]["n_sources"])
    assert [peaks for _, _, peaks, _ in calls].count(False) == 6
    assert [(call[1].name, call[1].n_sources) for call in (two, three)] == [("sdecgmca", 2), ("sdecgmca", 3)]
    assert two[0] == SKY.cases["oscillating"][0]


def test_lines_of_sight_are_left_out_for_what_the_paper_speaks_of():
    masked = [(case, method.name) for case, method, _, post_mask in SKY.assessments if post_mask]
    assert masked == [(SKY.cases["oscillating"][0], name) for name in BSS]


@pytest.mark.parametrize("counts", [(), (0, 1), (30, 31)])
def test_a_scan_that_cannot_be(counts):
    with pytest.raises(InputError, match="the scan needs numbers of sources from 1 up to the 30 channels"):
        Realisation(survey=SURVEY, n_sources=counts)
