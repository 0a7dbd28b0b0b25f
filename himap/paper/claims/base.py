"""What every claim has in common: its entry in the ledger, and measures that many share."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from himap.measures.diagnostics import (
    BUMP,
    band_max,
    band_mean,
    band_median,
    band_quantile,
    largest_deviation,
)
from himap.paper.claims.verdicts import (
    CONSISTENT,
    METHODS,
    RECOVERED,
    Finding,
    Part,
    is_smaller,
    parts_of,
)

BLIND = ("pca", "fastica", "gmca")
BEAMS = ("degraded", "evolving", "oscillating")
LEFT_IN = "{}, peaks left in"
"""Name of the case of a beam where no peaks are masked."""
CLIPPED = {spread: f"oscillating, sigma of the {spread}" for spread in ("channel", "cube")}
"""{spread of the peak masking other than the line's (`himap.removal.peaks.SPREADS`): name of the case}."""

LOW_K = 0.1  # 1/MHz, below which the paper calls k low

REGISTRY = {}
"""{id: `Claim`}."""


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


def claim(id, beam, statement, **entry):
    """Decorator: enter a function from `Realisation` to `Finding`; its docstring is the reading."""

    def register(check):
        REGISTRY[id] = Claim(id=id, beam=beam, statement=statement, check=check, **entry)
        return check

    return register


def largest(values):
    """The largest of {name: number}."""
    return max(values.values())


def number_claim(
    id, beam, statement, *, values, test, words, sentence, reading, value=largest, also=(), **entry
):
    """Enter a claim that several numbers pass one test: a main part for each of them.

    Parameters
    ----------
    id, beam, statement, entry
        As of `claim`.
    values
        Function from a `Realisation` to the numbers, such as `each`, {name: number}.
    test, words
        Function from a number to whether it passes, and what it says if it does, such as "within 10 %".
    value
        Function from the numbers, {name: number}, to that of the claim, such as `largest`.
    sentence
        What the numbers are.
    reading
        How the words of the paper are read.
    also
        {name: function from the numbers to whether it holds} of other main parts; those are about SD whose
        name begins so.
    """

    def check(realisation):
        numbers = values(realisation)
        parts = parts_of(numbers, test, words)
        for name, holds in dict(also).items():
            parts += (Part(name, bool(holds(numbers)), method="SD" if name.startswith("SD ") else ""),)
        return Finding(value(numbers), parts, f"{sentence}: {listing(numbers)}.")

    check.__doc__ = reading
    claim(id, beam, statement, **entry)(check)


def each(case, measure, methods=tuple(METHODS)):
    """Function from a `Realisation` to a measure of some methods on a case, {short name: number}."""
    return lambda realisation: by_method(realisation.of(case), measure, methods)


def smallest(values):
    """The smallest of {name: number}."""
    return min(values.values())


def sd_least(values):
    """Whether SD has the smallest of {name: number}, by more than the dead band."""
    return is_smaller(values["SD"], min(value for name, value in values.items() if name != "SD"))


def below(limit):
    """Function from a number to whether it is below a limit."""
    return lambda value: value < limit


def smaller(value):
    """Whether a ratio of two numbers says that the first is smaller, by more than the dead band."""
    return is_smaller(value, 1)


def larger(value):
    """Whether it says that the first is larger."""
    return is_smaller(1, value)


def above(limit):
    """Function from a number to whether it is above a limit."""
    return lambda value: value > limit


recovered = below(RECOVERED)
"""Whether a deviation from 1 is within the 10 % of the paper."""


def by_method(comparisons, measure, methods=tuple(METHODS)):
    """{short name: measure(comparison)} of some methods."""
    return {METHODS[name]: measure(comparisons[name]) for name in methods}


def listing(values, form="{:.3g}"):
    """The values of methods, one after the other."""
    return ", ".join(f"{name} {form.format(value)}" for name, value in values.items())


def listing_by_beam(values, form="{:.3g}"):
    """{beam: {method: value}}, one beam after the other."""
    return "; ".join(f"{beam}: {listing(row, form)}" for beam, row in values.items())


STATISTICS = {
    "mean": band_mean,
    "median": band_median,
    "highest": band_max,
    "error": lambda x, ratios, low, high: band_mean(x, np.abs(ratios - 1), low, high),
    "deviation": lambda x, ratios, low, high: largest_deviation(x, ratios, low, high)[0],
    "within": lambda x, ratios, low, high: band_quantile(x, np.abs(ratios - 1), low, high, CONSISTENT),
    "below": lambda x, ratios, low, high: band_quantile(x, ratios, low, high, CONSISTENT),
}
"""{name: function} of the ratios in a band: "error" is the mean |ratio - 1|, "deviation" the largest, and
"within" what 95 % of them do not exceed; "below" is what 95 % of the ratios do not exceed.
"""


def angular_band(statistic, low, high):
    """Function from a `Comparison` to one of `STATISTICS` of C/C0 for low < l < high."""
    measure = STATISTICS[statistic]
    return lambda comparison: measure(comparison.degrees, comparison.angular_ratio, low, high)


def frequency_band(statistic, low=0, high=np.inf):
    """Function from a `Comparison` to one of `STATISTICS` of P/P0 for low < k < high."""
    measure = STATISTICS[statistic]
    return lambda comparison: measure(comparison.k, comparison.frequency_ratio, low, high)


bump = frequency_band("highest", *BUMP)
"""Highest P/P0 near k = 0.31, of a `Comparison`."""


def total(comparison):
    """Total MSE of both spectra."""
    return comparison.total_error()


def over_each(over, under):
    """{name: value} over {name: value}, both with the same names."""
    return {name: value / under[name] for name, value in over.items()}
