"""The stored measurements: one file for each, with its `EXPERIMENT`."""

from importlib import import_module

from himap.core.errors import InputError

__all__ = ["EXPERIMENTS", "find_experiment"]

EXPERIMENTS = {
    "authors": "SDecGMCA from many starts, as the runs of its authors' code were measured.",
    "beam_errors": "What it costs a method to assume a wrong beam.",
    "boxes": "HI in boxes of half as many and of twice as many cells: spectra and peaks.",
    "claims": "Every claim of the paper, with a verdict.",
    "flags": "How often what is known without the truth says that SDecGMCA failed.",
    "methods": "All methods side by side, through each beam.",
    "n_sources": "How often a criterion finds the right number of sources.",
    "readings": "Every claim under every reading of the paper's SDecGMCA.",
    "restarts": "SDecGMCA from several starts: spectra, diagnostics and claims.",
    "transfer": "How well spectra are corrected by mocks, and how often their error bars are right.",
}
"""{name: what is measured}."""


def find_experiment(name):
    """The `himap.paper.record.Experiment` of that name.

    Raises
    ------
    InputError
        There is none; the message lists what exists.
    """
    if name not in EXPERIMENTS:
        raise InputError(f"unknown experiment {name!r}; there are {', '.join(EXPERIMENTS)}.")
    return import_module(f"{__name__}.{name}").EXPERIMENT
