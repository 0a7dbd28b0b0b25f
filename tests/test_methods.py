"""The methods and beams as the paper uses them."""

from himap.instrument.beams import Evolving, MeerKAT, Oscillating
from himap.paper.grid import cases_and_methods
from himap.paper.methods import (
    BSS,
    TABLE_1,
    beam_aware_for,
    methods_for,
    paper_beams,
    sdecgmca_for,
    table_1,
)


def test_table_1():
    counts = {name: sdecgmca_for(beam).n_sources for name, beam in paper_beams().items()}
    assert counts == {"degraded": 3, "evolving": 4, "oscillating": 5}
    assert sdecgmca_for(Evolving(), share=0.5).share == 0.5
    assert beam_aware_for(Evolving()) == sdecgmca_for(Evolving())
    assert sdecgmca_for(Evolving()).regularisation == 5e-3


def test_another_beam_gets_the_row_of_the_oscillating_one():
    assert table_1(MeerKAT()) == TABLE_1["oscillating"]


def test_the_reading_of_the_ripple():
    assert paper_beams(ripple="additive")["oscillating"] == Oscillating(ripple="additive")


def test_beam_and_method_are_the_same_however_their_names_are_spelled():
    ripple = {"ripple": "additive", "preset": "ci", "n_realisations": 1}
    cases = [cases_and_methods(beam=name, **ripple)[0] for name in ("oscillating", "Oscillating")]
    assert cases[0] == cases[1] and cases[0][0].beam == Oscillating(ripple="additive")
    settings = {"beam": "evolving", "reading": "code", "preset": "ci", "n_realisations": 1}
    found = [cases_and_methods(methods=[(name, 4)], **settings)[1] for name in ("sdecgmca", "SDecGMCA")]
    assert found[0] == found[1] == [sdecgmca_for(Evolving(), n_sources=4, reading="code")]


def test_six_methods():
    six = methods_for(Evolving(), 7, share=0.4)
    assert [one.name for one in six] == [*BSS, "polynomial", "parametric"]
    assert {one.n_sources for one in six if one.name in BSS} == {7}
    assert six[3].share == 0.4
