"""The parameters of a notebook: declared in its cell, passed as text, checked before anything runs."""

import pytest

from himap.app.parameters import check_parameters, describe_parameters, parse_texts, read_parameters
from himap.core.errors import InputError

CELL = """
preset: str = "quick"  # the preset
n_sources: int = 3  # how many, # or more
share: float = 0.5
masked: bool = True
degrees: list[int] = [2, 10]  # a list
options: dict = {}
folder: str | None = None  # a folder
beam: str = "oscillating"
n_max: int | None = 5
survey: dict = {"seed": 1}  # Survey fields
"""
DECLARED = read_parameters(CELL)


def test_reading_the_cell():
    known = {p.name: p for p in DECLARED}
    assert [known["n_sources"].kind, known["n_sources"].default] == ["int", 3]
    assert known["n_sources"].help == "how many, # or more"
    assert known["share"].help == ""
    assert known["folder"].kinds == {"str", "None"} and known["degrees"].default == [2, 10]


GIVEN = {
    "n_sources": {"4": 4, "4.0": 4},
    "share": {"1": 1.0, "1e-3": 1e-3},
    "masked": {"false": False, "False": False},
    "degrees": {"[3, 4]": [3, 4], "(3, 4)": [3, 4]},
    "options": {'{"a": {"b": null}}': {"a": {"b": None}}},
    "folder": {"sky/maps": "sky/maps", "2025": "2025", '"2025"': "2025", "null": None},
    "preset": {"ci": "ci"},
    "beam": {"Oscillating": "oscillating", "Rippled:amplitude=1": "Rippled:amplitude=1"},
    "n_max": {"null": None, "None": None},
}
"""{parameter: {text on the command line: value}}."""


@pytest.mark.parametrize(
    "name, text, value", [(name, *pair) for name in GIVEN for pair in GIVEN[name].items()]
)
def test_values_from_the_command_line(name, text, value):
    checked = check_parameters(DECLARED, parse_texts(DECLARED, {name: text}))
    assert checked == {name: value}
    assert type(checked[name]) is type(value)


def test_survey_fields_are_parameters_where_the_cell_has_a_survey():
    checked = check_parameters(DECLARED, {"preset": "ci", "nside": 32, "survey": {"n_channels": 50}})
    assert checked == {"preset": "ci", "survey": {"seed": 1, "n_channels": 50, "nside": 32}}
    texts = parse_texts(DECLARED, {"noise_reading": "variance", "nside": "32"})
    assert check_parameters(DECLARED, texts) == {
        "survey": {"seed": 1, "noise_reading": "variance", "nside": 32}
    }
    described = describe_parameters(DECLARED)
    assert "nside: int = (preset)  HEALPix" in described
    assert "noise_reading: str = (preset)  sigma_N of the noise formula" in described
    alone = read_parameters("n: int = 3")
    assert describe_parameters(alone) == "  n: int = 3"
    for bad in [{"nside": 32}, {"preset": "ci"}]:
        with pytest.raises(InputError, match="unknown parameter"):
            check_parameters(alone, bad)
