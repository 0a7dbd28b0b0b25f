"""Parameters of a notebook: those declared in its tagged cell, and values passed by the user.

The cell tagged ``parameters`` holds lines ``name: type = default  # help``. Fields of `Survey` that the cell
does not list are also parameters, if the cell has a dict ``survey`` for fields that differ from the
preset.
"""

import ast
import json
import sys
from dataclasses import dataclass, fields

from himap.core.errors import InputError, nearest
from himap.core.reading import is_file
from himap.core.registry import plain_name
from himap.core.survey import Survey

_KINDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "a string",
    "bool": "true or false",
    "list": "a list",
    "dict": 'a dict such as {"name": 1}',
    "None": "null",
}
_OF_PRESET = ...
"""Default of fields of `Survey`."""

_NO_LITERAL = (ValueError, SyntaxError, TypeError, RecursionError, MemoryError)  # {[1]: 2}, 9999 brackets


@dataclass(frozen=True)
class Parameter:
    """A line of the parameters cell; `kind` is its type as text, from `_KINDS`, several joined by ``|``."""

    name: str
    kind: str
    default: object
    help: str

    @property
    def kinds(self):
        return {kind.partition("[")[0].strip() for kind in self.kind.split("|")}

    def convert(self, value):
        """Convert `value` to the type of the parameter (2 to a float, 2.0 to an int), or InputError."""
        kind = _kind_of(value)
        if kind in self.kinds:
            return list(value) if kind == "list" else value
        if kind == "int" and "float" in self.kinds and abs(value) <= sys.float_info.max:
            return float(value)
        if kind == "float" and "int" in self.kinds and value.is_integer():
            return int(value)
        expected = " or ".join(words for kind, words in _KINDS.items() if kind in self.kinds)
        about = f" ({self.help})" if self.help else ""
        raise InputError(f"parameter {self.name}{about} must be {expected}, got {value!r}.")


def read_parameters(source):
    """Parameters declared in the source of a parameters cell, a list of `Parameter`.

    InputError for an invalid line, or a type that cannot be passed.
    """
    declared, lines = [], source.encode().splitlines()
    for node in ast.parse(source).body:
        comment = lines[node.end_lineno - 1][node.end_col_offset :].decode().lstrip("# ")
        try:
            default, kind = ast.literal_eval(node.value), ast.unparse(node.annotation)
            declared.append(Parameter(node.target.id, kind, default, comment))
            valid = declared[-1].kinds <= _KINDS.keys()
        except (AttributeError, ValueError, TypeError):
            valid = False
        if not valid:
            raise InputError(
                "a line of the parameters cell is `name: type = default  # help`, with a literal default and "
                f"a type among {', '.join(_KINDS)}; got `{ast.unparse(node)}`."
            )
    return declared


def all_parameters(declared):
    """{name: `Parameter`} of the declared ones and, with ``survey``, the other fields of `Survey`."""
    known = {parameter.name: parameter for parameter in declared}
    for item in fields(Survey) if "survey" in known else ():
        field = Parameter(item.name, item.type.__name__, _OF_PRESET, item.metadata["help"])
        known.setdefault(item.name, field)
    return known


def parse_texts(declared, texts):
    """Values from {name: text} of a command line: JSON or a Python literal, otherwise the text itself.

    For a parameter that can be a string, the text is unchanged, unless it is a JSON string.
    """
    known, values = all_parameters(declared), {}
    for name, text in texts.items():
        values[name] = text
        for parse in (json.loads, ast.literal_eval):  # the second for None, True, ['single quotes']
            try:
                value = parse(text)
            except _NO_LITERAL:
                continue
            kinds = known[name].kinds if name in known else set()
            if "str" not in kinds or _kind_of(value) in kinds:
                values[name] = value
            break
    return values


def check_parameters(declared, given):
    """Check the parameters of a notebook before anything runs.

    `declared` is a list of `Parameter`, `given` {name: value}, which may include fields of `Survey`. Returns
    the values in the declared types, with fields of `Survey` under ``survey``. InputError for an unknown name
    (the message lists the known ones), a value of the wrong type, or a preset or field refused by
    `Survey`.
    """
    known = all_parameters(declared)
    unknown = [name for name in given if name not in known]
    if unknown:
        names = ", ".join(f"{name}{nearest(name, known)}" for name in unknown)
        many = "s" * (len(unknown) > 1)
        raise InputError(f"unknown parameter{many} {names}; known are {', '.join(known)}.")
    values = {name: known[name].convert(value) for name, value in given.items()}
    if isinstance(beam := values.get("beam"), str) and beam.isalpha() and not is_file(beam):
        values["beam"] = plain_name(beam)  # "Oscillating" is also the paper's beam
    survey = {name: values.pop(name) for name in given if known[name].default is _OF_PRESET}
    if not all(isinstance(name, str) for name in values.get("survey", {})):
        raise InputError(f"survey must be a dict of fields by name, got {values['survey']!r}.")
    twice = [name for name in survey if values.get("survey", {}).get(name, survey[name]) != survey[name]]
    if twice:
        raise InputError(f"{', '.join(twice)} given twice, alone and in survey, with other values; give one.")
    if survey or "survey" in values:
        values["survey"] = {**known["survey"].default, **values.get("survey", {}), **survey}
    if "preset" in known:
        name = values.get("preset", known["preset"].default)
        Survey.preset(name, **values.get("survey", {}))
    return values


def describe_parameters(declared):
    """A line for each parameter, with type, default and help; then the fields of `Survey`."""
    lines = []
    for one in all_parameters(declared).values():
        default = "(preset)" if one.default is _OF_PRESET else repr(one.default)
        lines.append(f"  {one.name}: {one.kind} = {default}  {one.help}".rstrip())
    return "\n".join(lines)


def _kind_of(value):
    return {tuple: "list", type(None): "None"}.get(type(value), type(value).__name__)
