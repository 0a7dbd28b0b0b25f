"""Elements of claims: their words and parts, and the measures and tests that many share.

A word of the paper means one number, the same in every claim that uses it, except *significant*, which the
paper uses for changes of very different size: its number is stated in the claim. If the paper gives a limit
as approximate, such as l ~ 40, it is that number itself.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from himap.measures.diagnostics import BUMP, inside

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
"""Name of the case of a beam if no peaks are masked."""
CLIPPED = {spread: f"oscillating, sigma of the {spread}" for spread in ("channel", "cube")}
"""{spread of the peak masking other than the line's (`himap.removal.peaks.SPREADS`): name of the case}."""

LOW_K = 0.1  # 1/MHz, below which the paper calls k low
RECOVERED = 0.1  # |ratio - 1| below which a spectrum counts as recovered: the 10 % of the paper
CLEAR = 1.1  # ratio to the truth above which there is an excess, or a peak
STRONG = 1.5  # ratio to the truth above which an excess is *strong*
MUCH = 2  # *much larger*: at least this many times as large
ORDERS = 100  # too high *by orders of magnitude*: two of them or more, in the median
LEAST_ORDER = 10  # too high *across all scales*: by this factor at every multipole
MOST = 0.5  # *most* of some voxels or lines of sight, or of an excess: more than this share
CONSISTENT = 0.95  # *consistently*, *within x %*, *about x %*: at this share or more of the l, k or channels
NOTABLE = 0.2  # *notable*: more than this share of all, or of what it was
EQUAL = 0.01  # two numbers within this of each other are equal, where a part compares two

PLACE = ": place "
"""Marks the name of a part that is a place, which is not main and holds in members that have it there."""

REPRODUCED = "reproduced"
IN_PART = "in part"
UNDECIDED = "undecided"
FAILED = "not reproduced"
INAPPLICABLE = "does not apply"
"""The verdicts, from best to worst; and that for maps or a scan without what the claim is about."""

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


@dataclass(frozen=True)
class Part:
    """One part of a claim."""

    name: str  # the statement, in a few words
    held: bool | None  # None if its premise is absent, such as a peak to lower; counts as False
    main: bool = True  # whether it is what the paper's sentence is about: the verdict follows from these
    method: str = ""  # short name of its method, or "PCA/ICA"; empty for several or none


@dataclass(frozen=True)
class Finding:
    """The parts of a claim in one member: a sky, and a restart of SDecGMCA."""

    value: float  # the measured number, NaN if it cannot be measured
    parts: tuple  # of `Part`; empty if the claim does not apply
    sentence: str  # the numbers behind every part


@dataclass(frozen=True)
class Claim:
    """One claim of the paper."""

    id: str
    beam: str
    section: str  # of the paper
    figure: str  # of the paper; empty if there is none
    number: str  # the measured quantity
    paper: str  # its value in the paper, or the limit that its words are read as
    notebook: str  # the chapter that shows it
    check: Callable  # from `Realisation` to `Finding`
    statement: str  # what the paper claims, in our words
    reading: str  # how the words of the paper are read


def claim(id, beam, section, figure, number, paper, *, notebook=""):
    """Decorator: register a function from `Realisation` to `Finding` as the `Claim` with these attributes.

    The first line of its docstring is the statement, the rest the reading; the default `notebook` is that of
    the section.
    """

    def register(check):
        statement, _, reading = check.__doc__.partition("\n")
        words = statement, " ".join(reading.split())
        place = notebook or SECTIONS[section][1]
        REGISTRY[id] = Claim(id, beam, section, figure, number, paper, place, check, *words)
        return check

    return register


def finding(value, parts, wording, form="{:.3g}"):
    """A `Finding` with the sentence `wording`: text, or {text: numbers as for `listing`} after it.

    There is no number if the premises of all main parts are absent.
    """
    if not isinstance(wording, str):
        wording = "; ".join(f"{what}: {listing(numbers, form)}" for what, numbers in wording.items()) + "."
    parts = tuple(parts)
    absent = all(part.held is None for part in parts if part.main)
    return Finding(math.nan if absent else value, parts, wording)


def not_applicable(sentence):
    """The `Finding` if maps or scan lack what the claim is about, as the sentence says."""
    return Finding(math.nan, (), sentence)


def listing(values, form="{:.3g}"):
    """The numbers of {name: number}, in sequence; or of {beam: {name: number}}."""
    if any(isinstance(value, dict) for value in values.values()):
        return "; ".join(f"{beam}: {listing(row, form)}" for beam, row in values.items())
    return ", ".join(f"{name} {form.format(value)}" for name, value in values.items())


def parts_of(values, test, words, *, main=True, method=""):
    """A `Part` for each {name: value}: whether `test(value)` is true; premise absent if the value is None.

    PCA and ICA have the same foreground residual, and are one part: that of the worse of the two, so it holds
    if it does for both. A part is about the method after which it is named, otherwise about `method`.
    """
    joint = {}
    for name, value in values.items():
        held = None if value is None else bool(test(value))
        joint.setdefault("PCA/ICA" if name in ("PCA", "ICA") else name, []).append(held)
    alone = {"PCA/ICA", *METHODS.values()}
    return tuple(
        Part(f"{name} {words}", all_hold(several), main, name if name in alone else method)
        for name, several in joint.items()
    )


def places_of(best):
    """A `Part` for each {name: place}, such as the number of sources with the smallest error."""
    return tuple(Part(f"{name}{PLACE}{place}", True, False, "SD") for name, place in best.items())


def all_hold(held):
    """False if one of them is False, else None if one is undecided or its premise is absent, else True."""
    return False if False in held else None if None in held else True


def is_smaller(one, other):
    """Whether a number is smaller than another, by more than the dead band `EQUAL`."""
    return bool(one < other * (1 - EQUAL if other > 0 else 1 + EQUAL))


def without_sd(values):
    """{name: number} for the methods other than SD."""
    return {name: value for name, value in values.items() if name != "SD"}


def sd_least(values):
    """Whether SD has the smallest of {name: number}, by more than the dead band."""
    return is_smaller(values["SD"], np.min([*without_sd(values).values()]))  # False for NaN


def below(limit):
    """Function from a number to whether it is below a limit."""
    return lambda value: value < limit


def above(limit):
    """Function from a number to whether it is above a limit."""
    return lambda value: value > limit


def smaller(value):
    """Whether a ratio of two numbers means that the first is smaller, by more than the dead band."""
    return is_smaller(value, 1)


def larger(value):
    """Whether it means that the first is larger, by more than the dead band."""
    return is_smaller(1, value)


recovered = below(RECOVERED)
"""Whether a deviation from 1 is within the 10 % of the paper."""


def each(sky, case, measure, methods=tuple(METHODS)):
    """A measure for some methods on a case of a `Realisation`, {short name: number}."""
    comparisons = sky.of(case)
    return {METHODS[name]: measure(comparisons[name]) for name in methods}


def _most(values):
    """The value that a share `CONSISTENT` of the values does not exceed."""
    return np.quantile(values, CONSISTENT, method="inverted_cdf")


STATISTICS = {
    "mean": np.mean,
    "median": np.median,
    "lowest": np.min,
    "highest": np.max,
    "error": lambda ratios: np.mean(np.abs(ratios - 1)),
    "deviation": lambda ratios: np.max(np.abs(ratios - 1)),
    "within": lambda ratios: _most(np.abs(ratios - 1)),
    "below": _most,
    "recovered": lambda ratios: np.mean(np.abs(ratios - 1) < RECOVERED),
}
"""{name: function} of the ratios in a band: "error" is the mean |ratio - 1|, "deviation" the largest, and
"within" the value that 95 % of these do not exceed; "below" is the value that 95 % of the ratios do not
exceed, and "recovered" the share of ratios that are recovered.
"""


def in_band(statistic, x, ratios, low, high=np.inf):
    """One of `STATISTICS` of the ratios with low < x < high."""
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
