"""Foreground removal: one file per method, behind one interface.

Every module of this package is discovered automatically, so a new method is one new file.
"""

from himap.core.registry import Registry
from himap.removal.base import REGISTRY

__all__ = ["available", "create", "describe", "using"]

_METHODS = Registry("method", __name__, __path__, REGISTRY)


def available():
    """Names of the methods, sorted."""
    return _METHODS.names()


def describe(name):
    """Describe a method, what it uses and its parameters, as text; InputError for an unknown name."""
    about, *parameters = _METHODS.describe(name).splitlines()
    uses = ", ".join(sorted(REGISTRY[_METHODS.find(name)].uses)) or "maps alone"
    return "\n".join([about, f"Uses: {uses}", *parameters])


def using(what):
    """Names of the methods that use a feature, such as "weights" (`ForegroundRemover.uses`)."""
    return [name for name in available() if what in REGISTRY[name].uses]


def create(name, **parameters):
    """Create the method called `name`, a `ForegroundRemover`.

    Raises
    ------
    InputError
        For an unknown name or parameter (the message lists the valid ones) or an invalid value.
    """
    return _METHODS.create(name, **parameters)


def __getattr__(name):
    return _METHODS.attribute(name)
