"""Foreground removal: one file per method, behind one interface.

Every file of this package is found by itself, so a new method is one new file.
"""

from himap.core.registry import Registry
from himap.removal.base import REGISTRY

__all__ = ["available", "create", "describe", "using"]

_METHODS = Registry("method", __name__, __path__, REGISTRY)
available, create, __getattr__ = _METHODS.names, _METHODS.create, _METHODS.attribute


def describe(name):
    """What a method is, what it uses, and its parameters, as text; InputError for an unknown name."""
    about, *parameters = _METHODS.describe(name).splitlines()
    uses = ", ".join(sorted(REGISTRY[_METHODS.find(name)].uses)) or "maps alone"
    return "\n".join([about, f"Uses: {uses}", *parameters])


def using(what):
    """Names of the methods that use something, such as "weights" (`ForegroundRemover.uses`)."""
    return [name for name in available() if what in REGISTRY[name].uses]
