"""Beams of a telescope: one file per beam, behind one interface.

Every module of this package is discovered automatically, so a new beam is one new file.
"""

import json
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

from himap.core.errors import InputError
from himap.core.reading import is_file
from himap.core.registry import Registry
from himap.instrument.beams.base import REGISTRY

__all__ = ["available", "create", "named"]

_BEAMS = Registry("beam", __name__, __path__, REGISTRY)


def available():
    """Names of the beams, sorted."""
    return _BEAMS.names()


def create(name, **parameters):
    """The beam called `name`, a `Beam`; raises InputError for an unknown name, parameter or value."""
    return _BEAMS.create(name, **parameters)


def named(text):
    """The beam described by a text: NAME, NAME:PARAMETER=VALUE,... or the path of a file (`FromFile`).

    The inverse of ``str(beam)``.

    Raises
    ------
    InputError
        If the text is neither (the message lists the names), or if `create` refuses it.

    Examples
    --------
    >>> named("oscillating:ripple=additive")
    Oscillating(ripple='additive')
    """
    if not isinstance(text, str | Path):
        raise InputError(f"a beam is a name or the path of a file, got {text!r}.")
    name, _, parameters = str(text).partition(":")
    if not (is_file(text) or "/" in name or Path(name).suffix):  # else a path, perhaps of no file
        name = _BEAMS.find(name)
    if not _BEAMS.holds(name):
        return create("file", path=str(text))
    values, kinds = {}, {item.name: item.type for item in fields(REGISTRY[name])}
    for pair in filter(None, parameters.split(",")):
        key, _, value = pair.partition("=")
        if key.lower() in values:
            raise InputError(f"a parameter of the beam {text} is given twice; give it once.")
        values[key.lower()] = value
        if kinds.get(key.lower()) is not str:
            with suppress(ValueError):  # the beam itself refuses text in place of a number
                values[key.lower()] = json.loads(value)
    return create(name, **values)


def __getattr__(name):
    return _BEAMS.attribute(name)
