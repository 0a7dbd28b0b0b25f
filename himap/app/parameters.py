"""Parameters of a notebook: what its tagged cell declares, and what a user asks for instead.

The cell tagged ``parameters`` holds lines ``name: type = default  # help``. A field of `Survey`
that the cell does not list is a parameter too, where the cell has a dict ``survey`` for the fields
that differ from the preset.
"""

import ast
import difflib
import io
import json
import tokenize
from dataclasses import dataclass, fields

from himap.core.errors import InputError
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
_SURVEY_FIELDS = {item.name: item for item in fields(Survey)}


@dataclass(frozen=True)
class Parameter:
    """One line of the parameters cell.

    Attributes
    ----------
    name, default, help
        As in the cell.
    kind
        Its type as text: int, float, str, bool, list, dict, None, or some of them joined by ``|``.
    """

    name: str
    kind: str
    default: object
    help: str

    @property
    def kinds(self):
        return {kind.partition("[")[0].strip() for kind in self.kind.split("|")}

    def convert(self, value):
        """`value` as the type of the parameter: whole numbers do for float, and the reverse.

        Raises
        ------
        InputError
            A value of another type.
        """
        kind = _kind_of(value)
        if kind in self.kinds:
            return list(value) if kind == "list" else value
        if kind == "int" and "float" in self.kinds:
            return float(value)
        if kind == "float" and "int" in self.kinds and value.is_integer():
            return int(value)
        wanted = " or ".join(words for kind, words in _KINDS.items() if kind in self.kinds)
        raise InputError(f"parameter {self.name} must be {wanted}, got {value!r}")


def read_parameters(source):
    """The parameters declared in the source of a parameters cell, a list of `Parameter`.

    Raises
    ------
    InputError
        A line of another form, or of a type that cannot be passed.
    """
    comments = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    found = []
    for node in ast.parse(source).body:
        try:
            default = ast.literal_eval(node.value)
            kind = ast.unparse(node.annotation)
            parameter = Parameter(node.target.id, kind, default, comments.get(node.end_lineno, ""))
        except (AttributeError, ValueError, TypeError):
            parameter = None
        if parameter is None or not parameter.kinds <= set(_KINDS):
            raise InputError(
                "a line of the parameters cell is `name: type = default  # help`, with a literal default and "
                f"a type among {', '.join(_KINDS)}; got `{ast.unparse(node)}`."
            )
        found.append(parameter)
    return found


def accepts(declared, name):
    """Whether a notebook with the parameters `declared` takes one called `name`."""
    known = {parameter.name for parameter in declared}
    return name in known or ("survey" in known and name in _SURVEY_FIELDS)


def parse_texts(declared, texts):
    """Values for {name: text} from a command line: JSON or a Python literal, else the text itself.

    A parameter that can be a string takes the text as it is, unless it is a JSON string.
    """
    kinds = {parameter.name: parameter.kinds for parameter in declared}
    return {name: _parse(text, kinds.get(name, set())) for name, text in texts.items()}


def check_parameters(declared, given, preset=None):
    """The parameters to pass to a notebook, checked before anything runs.

    Parameters
    ----------
    declared
        The notebook's parameters, a list of `Parameter`.
    given
        {name: value} that differ from the defaults; fields of `Survey` may be among them.
    preset
        Name of the preset; the same as ``given["preset"]``.

    Returns
    -------
    dict
        The values of `given` in the declared types, Survey fields gathered under ``survey``.

    Raises
    ------
    InputError
        An unknown name or a value of the wrong type (the message lists what there is), or a preset
        or Survey field that `Survey` refuses.
    """
    known = {parameter.name: parameter for parameter in declared}
    given = dict(given) if preset is None else {"preset": preset, **given}
    if preset not in (None, given.get("preset")):
        raise InputError(f"the preset is given twice, as {preset!r} and as {given['preset']!r}; give one.")
    survey = {}
    if "survey" in known:
        fields_given = [name for name in given if name in _SURVEY_FIELDS and name not in known]
        survey = {name: given.pop(name) for name in fields_given}
    unknown = [name for name in given if name not in known]
    if unknown:
        raise _Listing(_unknown(unknown, known), declared)
    try:
        values = {name: known[name].convert(value) for name, value in given.items()}
    except InputError as error:
        raise _Listing(f"{error}; the parameters are:", declared) from None
    if not all(isinstance(name, str) for name in values.get("survey", {})):
        raise InputError(f"survey must be a dict of fields by name, got {values['survey']!r}.")
    if survey or "survey" in values:
        values["survey"] = {**known["survey"].default, **values.get("survey", {}), **survey}
    if "preset" in known:
        name = values.get("preset", known["preset"].default)
        Survey.preset(name, **values.get("survey", {}))
    return values


def describe_parameters(declared):
    """One line for each parameter, with type, default and help; then the fields of `Survey`."""
    lines = [f"  {p.name}: {p.kind} = {p.default!r}  {p.help}".rstrip() for p in declared]
    names = {parameter.name for parameter in declared}
    if "survey" in names:
        lines += [
            f"  {item.name}: {item.type.__name__} = (preset)  {item.metadata['help']}"
            for item in _SURVEY_FIELDS.values()
            if item.name not in names
        ]
    return "\n".join(lines)


class _Listing(InputError):
    """An error with the parameters that there are below its paragraph, one a line."""

    def __init__(self, message, declared):
        super().__init__(message)
        self._listing = describe_parameters(declared)

    def __str__(self):
        return f"{super().__str__()}\n{self._listing}"


def _unknown(unknown, known):
    choices = list(known) + list(_SURVEY_FIELDS) * ("survey" in known)
    close = [match for name in unknown for match in difflib.get_close_matches(name, choices, n=1)]
    hint = f" (did you mean {', '.join(close)}?)" if close else ""
    plural = "s" if len(unknown) > 1 else ""
    return f"unknown parameter{plural} {', '.join(unknown)}{hint}; the parameters are:"


def _parse(text, kinds):
    try:
        value = json.loads(text)
    except ValueError:
        try:
            value = ast.literal_eval(text)  # None, True, ['single quotes']
        except (ValueError, SyntaxError):
            return text
    if "str" in kinds and not isinstance(value, str) and _kind_of(value) not in kinds:
        return text
    return value


def _kind_of(value):
    if value is None:
        return "None"
    return "list" if isinstance(value, tuple) else type(value).__name__
