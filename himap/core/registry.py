"""Registries of classes: a package with one named class in each file."""

import importlib.util
import pkgutil
import re
from dataclasses import MISSING, fields
from importlib import import_module

from himap.core.errors import InputError, nearest


def plain_name(name):
    """A name in lower case, without blanks, hyphens and the like."""
    return re.sub(r"[\W_]", "", str(name)).lower()


class Registry:
    """The classes registered by the files of a package.

    Messages call a class a `kind`. `package` and `path` are ``__name__`` and ``__path__`` of the package,
    `classes` is {name: class}, filled by their common base class in ``__init_subclass__``.
    """

    def __init__(self, kind, package, path, classes):
        self._kind, self._package, self._path, self._classes = kind, package, path, classes

    def names(self):
        """The names, sorted; imports every file of the package."""
        for module in pkgutil.iter_modules(self._path):
            import_module(f"{self._package}.{module.name}")
        return sorted(self._classes)

    def holds(self, name):
        """Whether there is a class called `name`.

        The file of that name is imported first, then all: a new file changes nothing for others.
        """
        if not isinstance(name, str):
            return False
        if name.isidentifier() and name[0] != "_" and importlib.util.find_spec(f"{self._package}.{name}"):
            import_module(f"{self._package}.{name}")
        return name in self._classes or name in self.names()

    def find(self, name):
        """The name of the intended class, ignoring case, blanks and hyphens; InputError if there is none."""
        if self.holds(name):
            return name
        names = {plain_name(each): each for each in self.names()}
        if plain_name(name) not in names:
            hint = nearest(str(name).lower(), names.values())
            raise InputError(f"unknown {self._kind} {name!r}{hint}; there are {', '.join(names.values())}.")
        return names[plain_name(name)]

    def describe(self, name):
        """Description of a class, and its parameters with their defaults, as text."""
        kind = self._classes[self.find(name)]
        lines = [kind.__doc__.splitlines()[0]]
        for item in fields(kind):
            default = "(must be given)" if item.default is MISSING else f"= {item.default!r}"
            lines.append(f"  {item.name} {default}  {item.metadata['help']}")
        return "\n".join(lines)

    def create(self, name, **parameters):
        """Make an object of the class called `name`; choices among several words may be in any case.

        InputError for an unknown name or parameter (the message lists the valid ones), or an invalid value.
        """
        name = self.find(name)
        kind = self._classes[name]
        known = {item.name: item.metadata["help"] for item in fields(kind)}
        for key in sorted(set(parameters) - set(known)):
            listing = "; ".join(f"{item}: {help}" for item, help in known.items()) or "none"
            hint = nearest(key, known)
            raise InputError(f"{name} has no parameter {key!r}{hint}; its parameters are {listing}.")
        for item in fields(kind):
            words = {each.lower(): each for each in item.metadata["choices"] if isinstance(each, str)}
            value = parameters.get(item.name)
            if isinstance(value, str):
                parameters[item.name] = words.get(value.lower(), value)
        return kind(**parameters)

    def attribute(self, name):
        """The class with the *Python* name `name`, such as PCA, for the package's ``__getattr__``."""
        if name[:1].isupper():  # lower-case names are modules, which Python finds
            self.names()
            for kind in self._classes.values():
                if kind.__name__ == name and kind.__module__.startswith(f"{self._package}."):
                    return kind
        raise AttributeError(f"module {self._package!r} has no attribute {name!r}")
