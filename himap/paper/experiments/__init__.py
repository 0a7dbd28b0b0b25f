"""The stored measurements: one file each, with its `EXPERIMENT`."""

from importlib import import_module

from himap.core.errors import InputError
from himap.store.fingerprint import CodeTree

__all__ = ["EXPERIMENTS", "find_experiment", "measuring_code"]

EXPERIMENTS = (
    "authors",
    "beam_errors",
    "boxes",
    "claims",
    "flags",
    "methods",
    "n_sources",
    "readings",
    "restarts",
    "transfer",
)
"""Names of the experiments."""


def find_experiment(name):
    """The `himap.paper.record.Experiment` of that name; InputError, which lists all, if there is none."""
    if name not in EXPERIMENTS:
        raise InputError(f"unknown experiment {name!r}; there are {', '.join(EXPERIMENTS)}.")
    return import_module(f"{__name__}.{name}").EXPERIMENT


def measuring_code(name, tree=None):
    """Fingerprint of the code of the experiment `name`, as on disk or in a `CodeTree`."""
    source = f"from himap.paper.experiments.{name} import measure, skies"
    return (tree or CodeTree()).source_fingerprint(source)
