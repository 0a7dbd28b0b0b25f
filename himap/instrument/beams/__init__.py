"""Beams of a telescope: one file per beam, behind one interface.

Every file of this package is found by itself, so a new beam is one new file.
"""

import json
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
    """The beam that a text means: NAME, NAME:PARAMETER=VALUE,... or the path of a file (`FromFile`).

    The reverse of ``str(beam)``.

    Raises
    ------
    InputError
        Neither; the message lists the names. Or what `create` refuses.

    Examples
    --------
    >>> named("oscillating:ripple=additive")
    Oscillating(ripple='additive')
    """
    if not isinstance(text, str | Path):
        raise InputError(f"a beam is a name or the path of a file, got {text!r}.")
    name, _, parameters = str(text).partition(":")
    if not is_file(text):
        name = _BEAMS.find(name)
    if _BEAMS.holds(name):
        pairs = [pair.partition("=") for pair in parameters.split(",") if pair]
        values = {key.lower(): _value(name, key.lower(), value) for key, _, value in pairs}
        if len(values) < len(pairs):
            raise InputError(f"a parameter of the beam {text} is given twice; give it once.")
        return create(name, **values)
    return create("file", path=str(text))


def _value(name, key, text):
    """The value that a text means: as it is for parameters that are texts, else a number."""
    kinds = {item.name: item.type for item in fields(REGISTRY[name])}
    if kinds.get(key) is str:
        return text
    try:
        return json.loads(text)
    except ValueError:
        return text


def __getattr__(name):
    return _BEAMS.attribute(name)
