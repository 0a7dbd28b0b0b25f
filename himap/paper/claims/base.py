"""What every claim has in common: its entry in the ledger, its verdict, and measures that many share."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from himap.measures.diagnostics import BUMP, band_max, band_mean, largest_deviation

__all__ = [
    "BLIND",
    "DIFFERENT",
    "FAILED",
    "LOW_K",
    "METHODS",
    "REGISTRY",
    "REPRODUCED",
    "UNDECIDED",
    "Claim",
    "Finding",
    "angular_deviation",
    "angular_error",
    "angular_mean",
    "bump",
    "by_method",
    "claim",
    "each_part",
    "frequency_deviation",
    "frequency_error",
    "frequency_mean",
    "listing",
    "total",
]

REPRODUCED = "reproduced"
DIFFERENT = "reproduced with a difference"
FAILED = "not reproduced"
UNDECIDED = "not evaluated"

METHODS = {
    "pca": "PCA",
    "fastica": "ICA",
    "gmca": "GMCA",
    "sdecgmca": "SD",
    "polynomial": "POL",
    "parametric": "PAR",
}
"""Short names of the methods in the ledger."""

BLIND = ("pca", "fastica", "gmca")
LOW_K = 0.1  # 1/MHz, below which the paper calls k low


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What one realisation says of one claim.

    Attributes
    ----------
    value
        The measured number, NaN if it cannot be measured.
    parts
        {part of the claim: whether it holds}.
    sentence
        The numbers behind it.
    """

    value: float
    parts: dict
    sentence: str

    @property
    def verdict(self):
        """One of the four verdicts."""
        if not self.parts:
            return UNDECIDED
        n_held = sum(map(bool, self.parts.values()))
        if n_held == len(self.parts):
            return REPRODUCED
        return DIFFERENT if 2 * n_held >= len(self.parts) else FAILED


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim of the paper.

    Attributes
    ----------
    id, beam, statement
        As in the ledger, in our words.
    number, paper
        What is measured, and what the paper gives for it.
    section, figure, notebook
        Of the paper; where the companion shows it.
    check
        Function from `Realisation` to `Finding`.
    """

    id: str
    beam: str
    statement: str
    number: str
    paper: str
    section: str
    figure: str
    notebook: str
    check: Callable

    @property
    def reading(self):
        """How the words of the paper are read."""
        return " ".join(self.check.__doc__.split())


REGISTRY = {}
"""{id: `Claim`}."""


def claim(id, beam, statement, *, number, paper, section, figure, notebook):
    """Decorator: enter a function from `Realisation` to `Finding`; its docstring is the reading."""

    def register(check):
        REGISTRY[id] = Claim(
            id=id,
            beam=beam,
            statement=statement,
            number=number,
            paper=paper,
            section=section,
            figure=figure,
            notebook=notebook,
            check=check,
        )
        return check

    return register


def by_method(comparisons, measure, methods=tuple(METHODS)):
    """{short name: measure(comparison)} of some methods."""
    return {METHODS[name]: measure(comparisons[name]) for name in methods}


def listing(values, form="{:.3g}"):
    """The values of methods, one after the other."""
    return ", ".join(f"{name} {form.format(value)}" for name, value in values.items())


def each_part(values, test, words):
    """A part of the claim for every method."""
    return {f"{name} {words}": test(value) for name, value in values.items()}


def angular_deviation(low, high):
    """Function to the largest |C/C0 - 1| for low < l < high."""
    return lambda comparison: largest_deviation(comparison.degrees, comparison.angular_ratio, low, high)[0]


def frequency_deviation(low, high=np.inf):
    """Function to the largest |P/P0 - 1| for low < k < high."""
    return lambda comparison: largest_deviation(comparison.k, comparison.frequency_ratio, low, high)[0]


def angular_mean(low, high):
    """Function to the mean C/C0 for low < l < high."""
    return lambda comparison: band_mean(comparison.degrees, comparison.angular_ratio, low, high)


def frequency_mean(low, high=np.inf):
    """Function to the mean P/P0 for low < k < high."""
    return lambda comparison: band_mean(comparison.k, comparison.frequency_ratio, low, high)


def angular_error(low, high):
    """Function to the mean |C/C0 - 1| for low < l < high."""
    return lambda comparison: band_mean(comparison.degrees, np.abs(comparison.angular_ratio - 1), low, high)


def frequency_error(low, high=np.inf):
    """Function to the mean |P/P0 - 1| for low < k < high."""
    return lambda comparison: band_mean(comparison.k, np.abs(comparison.frequency_ratio - 1), low, high)


def bump(comparison):
    """Highest P/P0 near k = 0.31."""
    return band_max(comparison.k, comparison.frequency_ratio, *BUMP)


def total(comparison):
    """Total MSE of both spectra."""
    return comparison.total_error()
