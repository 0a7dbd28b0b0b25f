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


@pytest.mark.parametrize(
    "name, text, value",
    [
        ("n_sources", "4", 4),
        ("n_sources", "4.0", 4),
        ("share", "1", 1.0),
        ("share", "1e-3", 1e-3),
        ("masked", "false", False),
        ("masked", "False", False),
        ("degrees", "[3, 4]", [3, 4]),
        ("degrees", "(3, 4)", [3, 4]),
        ("options", '{"a": {"b": null}}', {"a": {"b": None}}),
        ("folder", "sky/maps", "sky/maps"),
        ("folder", "2025", "2025"),
        ("folder", '"2025"', "2025"),
        ("folder", "null", None),
        ("preset", "ci", "ci"),
        ("beam", "Oscillating", "oscillating"),
        ("beam", "Rippled:amplitude=1", "Rippled:amplitude=1"),
        ("n_max", "null", None),
        ("n_max", "None", None),
    ],
)
def test_values_from_the_command_line(name, text, value):
    checked = check_parameters(DECLARED, parse_texts(DECLARED, {name: text}))
    assert checked == {name: value}
    assert type(checked[name]) is type(value)


@pytest.mark.parametrize(
    "name, text, expected",
    [
        ("n_sources", "three", "a whole number, got 'three'"),
        ("n_sources", "3.5", "a whole number, got 3.5"),
        ("n_sources", "true", "a whole number, got True"),
        ("n_sources", "null", "a whole number, got None"),
        ("share", "half", "a number, got 'half'"),
        ("masked", "1", "true or false, got 1"),
        ("degrees", "3", "a list, got 3"),
        ("options", "[]", "a dict such as .* got \\[\\]"),
        ("options", "{[1]: 2}", "a dict such as .* got '{"),
        ("degrees", "[" * 100_000, "a list, got '\\["),
        ("n_max", "x", "a whole number or null, got 'x'"),
    ],
)
def test_values_of_another_type_are_refused(name, text, expected):
    with pytest.raises(InputError, match=f"parameter {name}( .*)? must be {expected}"):
        check_parameters(DECLARED, parse_texts(DECLARED, {name: text}))


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


@pytest.mark.parametrize(
    "given, message",
    [
        ({"n_sorces": 3}, r"unknown parameter n_sorces \(did you mean n_sources\?\); .* share, .*seed"),
        ({"nsid": 3}, "did you mean nside"),
        ({"zzz": 3, "qqq": 1}, "unknown parameters zzz, qqq; there are preset, n_sources"),
        ({"noise_reading": "power"}, "noise_reading must be deviation or variance"),
        (parse_texts(DECLARED, {"noise_reading": "1"}), "noise_reading must be deviation or variance"),
        ({"nside": 65}, "nside must be a power of two, got 65"),
        ({"survey": {"nsides": 64}}, "unknown Survey field nsides"),
        ({"preset": "big"}, "unknown preset 'big'; there are ci"),
        ({"survey": {"seed": 7}, "seed": 8}, "seed given twice, alone and in survey"),
    ],
)
def test_names_and_the_survey_are_checked_before_anything_runs(given, message):
    with pytest.raises(InputError, match=message):
        check_parameters(DECLARED, given)
