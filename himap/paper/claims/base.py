"""What every claim has in common: its entry in the ledger, and measures that many share."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from himap.measures.diagnostics import BUMP, inside
from himap.paper.claims.verdicts import CONSISTENT, METHODS, RECOVERED, Finding, is_smaller

BLIND = ("pca", "fastica", "gmca")
BEAMS = ("degraded", "evolving", "oscillating")
LEFT_IN = "{}, peaks left in"
"""Name of the case of a beam where no peaks are masked."""
CLIPPED = {spread: f"oscillating, sigma of the {spread}" for spread in ("channel", "cube")}
"""{spread of the peak masking other than the line's (`himap.removal.peaks.SPREADS`): name of the case}."""

LOW_K = 0.1  # 1/MHz, below which the paper calls k low

SECTIONS = {
    "1": ("Sect. 1: the sky", "01_simulations"),
    "2.2": ("Sect. 2.2: the instrument", "02_beams_and_noise"),
    "3.2": ("Sect. 3.2: fits along lines of sight", "08_parametric"),
    "3.3": ("Sect. 3.3: the iteration of SDecGMCA", "09_sdecgmca"),
    "4.2": ("Sect. 4.2: methods and beams", "10_results"),
    "4.3": ("Sect. 4.3: the number of sources", "11_ns_scan"),
    "4.1, B": ("Sect. 4.1 and App. B: masking of peaks", "03_peak_masking"),
    "5.1": ("Sect. 5.1: lines of sight left out", "12_post_masking"),
    "5.2": ("Sect. 5.2: the Galaxy dimmed", "13_dimmed_galaxy"),
    "6": ("Sect. 6: conclusions", "10_results"),
    "A": ("App. A: diagnostics", "14_diagnostics"),
}
"""{section of the paper: (its title, the chapter that shows its claims unless they say otherwise)}, in the
order of the ledger."""

REGISTRY = {}
"""{id: `Claim`}."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim of the paper.

    Attributes
    ----------
    id, beam
        As in the ledger.
    number, paper
        What is measured, and what the paper gives for it.
    section, figure, notebook
        Of the paper, the figure empty where it has none; and where the companion shows it.
    check
        Function from `Realisation` to `himap.paper.claims.verdicts.Finding`, whose docstring begins with the
        claim, in our words.
    """

    id: str
    beam: str
    number: str
    paper: str
    section: str
    figure: str
    notebook: str
    check: Callable

    @property
    def statement(self):
        """What the paper claims."""
        return self.check.__doc__.partition("\n")[0]

    @property
    def reading(self):
        """How the words of the paper are read."""
        return " ".join(self.check.__doc__.partition("\n")[2].split())


def claim(id, beam, section, figure, number, paper, *, notebook=""):
    """Decorator: enter a function from `Realisation` to `Finding` as the `Claim` with these attributes.

    Its docstring is statement and reading; without `notebook` the chapter is that of the section.
    """

    def register(check):
        place = {"section": section, "figure": figure, "notebook": notebook or SECTIONS[section][1]}
        REGISTRY[id] = Claim(id=id, beam=beam, number=number, paper=paper, **place, check=check)
        return check

    return register


def each(sky, case, measure, methods=tuple(METHODS)):
    """A measure of some methods on a case of a `Realisation`, {short name: number}."""
    comparisons = sky.of(case)
    return {METHODS[name]: measure(comparisons[name]) for name in methods}


def quotients(over, under):
    """{name: value} over {name: value}, both with the same names."""
    return {name: value / under[name] for name, value in over.items()}


def finding(value, parts, wording, form="{:.3g}"):
    """A `Finding` whose sentence is `wording`: text, or {what: numbers as of `listing`} behind it."""
    if not isinstance(wording, str):
        wording = "; ".join(f"{what}: {listing(numbers, form)}" for what, numbers in wording.items()) + "."
    return Finding(value, parts, wording)


def listing(values, form="{:.3g}"):
    """The numbers of {name: number}, one after the other; or of {beam: {name: number}}."""
    if any(isinstance(value, dict) for value in values.values()):
        return "; ".join(f"{beam}: {listing(row, form)}" for beam, row in values.items())
    return ", ".join(f"{name} {form.format(value)}" for name, value in values.items())


def sd_least(values):
    """Whether SD has the smallest of {name: number}, by more than the dead band."""
    return is_smaller(values["SD"], min(value for name, value in values.items() if name != "SD"))


def below(limit):
    """Function from a number to whether it is below a limit."""
    return lambda value: value < limit


def above(limit):
    """Function from a number to whether it is above a limit."""
    return lambda value: value > limit


def smaller(value):
    """Whether a ratio of two numbers says that the first is smaller, by more than the dead band."""
    return is_smaller(value, 1)


def larger(value):
    """Whether it says that the first is larger."""
    return is_smaller(1, value)


recovered = below(RECOVERED)
"""Whether a deviation from 1 is within the 10 % of the paper."""


def _most(values):
    """What a share `CONSISTENT` of some values does not exceed."""
    return np.quantile(values, CONSISTENT, method="inverted_cdf")


STATISTICS = {
    "mean": np.mean,
    "median": np.median,
    "highest": np.max,
    "error": lambda ratios: np.mean(np.abs(ratios - 1)),
    "deviation": lambda ratios: np.max(np.abs(ratios - 1)),
    "within": lambda ratios: _most(np.abs(ratios - 1)),
    "below": _most,
}
"""{name: function} of the ratios in a band: "error" is the mean |ratio - 1|, "deviation" the largest, and
"within" what 95 % of them do not exceed; "below" is what 95 % of the ratios do not exceed.
"""


def in_band(statistic, x, ratios, low, high):
    """One of `STATISTICS` of the ratios where low < x < high."""
    return float(STATISTICS[statistic](inside(x, ratios, low, high)))


def angular_band(statistic, low, high):
    """Function from a `Comparison` to one of `STATISTICS` of C/C0 for low < l < high."""
    return lambda one: in_band(statistic, one.degrees, one.angular_ratio, low, high)


def frequency_band(statistic, low=0, high=np.inf):
    """Function from a `Comparison` to one of `STATISTICS` of P/P0 for low < k < high."""
    return lambda one: in_band(statistic, one.k, one.frequency_ratio, low, high)


mean_error = angular_band("error", 10, 200)
"""Mean |C/C0 - 1| at 10 < l < 200, which the paper recovers, or up to 2 nside, of a `Comparison`."""

bump = frequency_band("highest", *BUMP)
"""Highest P/P0 near k = 0.31, of a `Comparison`."""


def total(comparison):
    """Total MSE of both spectra."""
    return comparison.total_error()
