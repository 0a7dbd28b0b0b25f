"""What every claim has in common: its entry in the ledger, and measures that many share."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from himap.measures.diagnostics import BUMP, band_max, band_mean, band_median, largest_deviation
from himap.paper.claims.verdicts import RECOVERED, Finding, parts_of

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
BEAMS = ("degraded", "evolving", "oscillating")
LEFT_IN = "{}, peaks left in"
"""Name of the case of a beam where no peaks are masked."""

LOW_K = 0.1  # 1/MHz, below which the paper calls k low


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
        Of the paper, the figure empty where it has none; and where the companion shows it.
    check
        Function from `Realisation` to `himap.paper.claims.verdicts.Finding`.
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


def method_claim(
    id, beam, statement, *, measure, test, words, extreme, sentence, reading, methods=tuple(METHODS), **entry
):
    """Enter a claim that each of some methods passes one test: a main part for each of them.

    Parameters
    ----------
    id, beam, statement, entry
        As of `claim`; the beam is the case that is measured.
    measure, methods
        Function from a `Comparison` to a number, and the methods whose number counts.
    test, words
        Function from a number to whether it passes, and what it says if it does, such as "within 10 %".
    extreme
        `max` or `min`: which of the numbers is that of the claim.
    sentence
        What the numbers are.
    reading
        How the words of the paper are read.
    """

    def check(realisation):
        values = by_method(realisation.of(beam), measure, methods)
        return Finding(
            value=extreme(values.values()),
            parts=parts_of(values, test, words),
            sentence=f"{sentence}: {listing(values)}.",
        )

    check.__doc__ = reading
    claim(id, beam, statement, **entry)(check)


def recovered(deviation):
    """Whether a deviation from 1 is within the 10 % of the paper."""
    return deviation < RECOVERED


def by_method(comparisons, measure, methods=tuple(METHODS)):
    """{short name: measure(comparison)} of some methods."""
    return {METHODS[name]: measure(comparisons[name]) for name in methods}


def listing(values, form="{:.3g}"):
    """The values of methods, one after the other."""
    return ", ".join(f"{name} {form.format(value)}" for name, value in values.items())


def listing_by_beam(values, form="{:.3g}"):
    """{beam: {method: value}}, one beam after the other."""
    return "; ".join(f"{beam}: {listing(row, form)}" for beam, row in values.items())


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


def frequency_median(low, high=np.inf):
    """Function to the median P/P0 for low < k < high, which a peak in a few k does not move."""
    return lambda comparison: band_median(comparison.k, comparison.frequency_ratio, low, high)


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
