"""Foreground removal: one file per method, behind one interface.

Every file of this package is found by itself, so a new method is one new file.
"""

from himap.core.registry import Registry
from himap.removal.base import REGISTRY

__all__ = ["available", "create"]

_METHODS = Registry("method", __name__, __path__, REGISTRY)


def available():
    """Names of the methods, sorted."""
    return _METHODS.names()


def create(name, **parameters):
    """The method called `name`, a `ForegroundRemover`.

    Raises
    ------
    InputError
        An unknown name or parameter (the message lists what exists), or a bad value.
    """
    return _METHODS.create(name, **parameters)


def __getattr__(name):
    return _METHODS.attribute(name)
