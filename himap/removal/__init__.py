"""Foreground removal: one file per published method, behind one interface.

Every file of this package is found by itself, so a new method is one new file.
"""

import difflib
import pkgutil
from dataclasses import fields
from importlib import import_module

from himap.errors import InputError
from himap.removal.base import REGISTRY

__all__ = ["available", "create"]


def available():
    """Names of the methods, sorted."""
    for module in pkgutil.iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")
    return sorted(REGISTRY)


def create(name, **parameters):
    """The method called `name`, a `ForegroundRemover`.

    Raises
    ------
    InputError
        An unknown name or parameter (the message lists what exists), or a bad value.
    """
    names = available()
    if not isinstance(name, str) or name not in names:
        raise InputError(f"unknown method {name!r}; there are {', '.join(names)}.")
    method = REGISTRY[name]
    known = {item.name: item.metadata["help"] for item in fields(method)}
    for key in sorted(set(parameters) - set(known)):
        near = difflib.get_close_matches(key, known, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        listing = "; ".join(f"{item}: {help}" for item, help in known.items())
        raise InputError(f"{name} has no parameter {key!r}{hint}; its parameters are {listing}.")
    return method(**parameters)
