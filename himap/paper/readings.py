"""What the readings of SDecGMCA lead to: every claim, and both spectra, under each of them.

The paper leaves choices about SDecGMCA open (`himap.removal.sdecgmca.readings`). Each reading is judged on
the same skies, and at noise levels a thousandth apart, which should change nothing of account.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from himap.errors import InputError
from himap.maps import sphere
from himap.measures.diagnostics import BUMP
from himap.paper.claims import IN_PART, REPRODUCED
from himap.paper.claims.base import angular_deviation, angular_error, bump
from himap.paper.claims.verdicts import most_common
from himap.paper.ledger import NUDGES, judge
from himap.paper.realisation import make
from himap.products.parallel import dask_address
from himap.removal.sdecgmca.readings import OPTIONS, READINGS, resolved

__all__ = [
    "ANGULAR_BANDS",
    "FAILING",
    "FREQUENCY_BANDS",
    "NEAR_PLANE",
    "Judgement",
    "Outcome",
    "Reading",
    "Run",
    "evaluate",
    "readings",
]

FAILING = 0.1
"""Mean |C/C0 - 1| at 10 < l < 200 above which a run fails: twice the paper's 5 %."""

ANGULAR_BANDS = ((2, 4), (5, 9), (10, 19), (20, 39), (40, 99), (100, 200))
"""First and last l of the bands of C/C0."""

FREQUENCY_BANDS = {
    "k < 0.03": (0, 0.03),
    "0.03 to 0.1": (0.03, 0.1),
    "k > 0.1": (0.1, math.inf),
}
"""Ends of the bands of P/P0, 1/MHz."""

NEAR_PLANE = 10.0
"""Galactic latitude below which a line of sight is near the plane, deg."""

_N_BINS = 40  # of a curve, at most
_EDGE = 200  # of l that the paper recovers


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One way to read the paper on SDecGMCA.

    Attributes
    ----------
    label
        A name in `READINGS`, or the option that differs from the default, such as "last = repeated".
    options
        Pairs (name, value) for `himap.paper.realisation.Realisation`.
    changed
        (option, value) where it is the default but for that; else None.
    """

    label: str
    options: tuple
    changed: tuple | None = None

    @property
    def title(self):
        """The label, and of a reading with a name the one option that it changes."""
        if self.changed is None or self.label not in READINGS:
            return self.label
        return f"{self.label} ({_words(*self.changed)})"

    @property
    def values(self):
        """{option: value} of all options."""
        given = dict(self.options)
        return READINGS[given.pop("reading", "default")] | given

    @property
    def unlike(self):
        """How many values are not those of the letter."""
        return sum(
            self.values[name] != value for name, value in READINGS["letter"].items() if name in OPTIONS
        )

    @property
    def distance(self):
        """How many values the paper's text speaks against."""
        return sum(self.values[name] in option.against for name, option in OPTIONS.items())


def readings():
    """{label: `Reading`}: those with a name, and the default with one option changed at a time.

    A change that makes of the default a reading with a name is that reading; options that exclude each other
    are left out.
    """
    default = READINGS["default"]
    found = {
        name: Reading(label=name, options=() if name == "default" else (("reading", name),))
        for name in READINGS
    }
    for option, value in ((name, value) for name, one in OPTIONS.items() for value in one.choices):
        values = default | {option: value}
        if value == default[option] or _refused(values):
            continue
        twins = [name for name, named in READINGS.items() if named == values]
        label = twins[0] if twins else _words(option, value)
        options = found[label].options if twins else ((option, value),)
        found[label] = Reading(label=label, options=options, changed=(option, value))
    return found


def _words(option, value):
    return f"{option} = {value}"


def _refused(values):
    try:
        resolved("default", values)
    except InputError:
        return True
    return False


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The verdict on one claim, how many of its parts hold, and the measured number, NaN if there is none."""

    verdict: str
    n_held: int
    n_parts: int
    value: float

    @property
    def holds(self):
        """Whether all that the paper's sentence is about holds: reproduced, or in part."""
        return self.verdict in (REPRODUCED, IN_PART)

    @property
    def label(self):
        """The verdict; *in part* with how many parts hold."""
        return f"{IN_PART} ({self.n_held} of {self.n_parts})" if self.verdict == IN_PART else self.verdict


@dataclass(frozen=True, kw_only=True)
class Run:
    """SDecGMCA through the oscillating beam, on one sky, told one noise level.

    Attributes
    ----------
    seed, noise_level
        Of the sky; the noise level that it is told, over that of the survey.
    angular, frequency
        {band: mean C/C0} and {band: mean P/P0}, of the bands that the maps hold.
    bump
        Highest P/P0 near k = 0.31 / MHz.
    mean_error, largest_error
        Of |C/C0 - 1| at 10 < l < 200, as far as the maps go.
    flagged, near_plane
        Share of the lines of sight whose error stands out; and of these, within `NEAR_PLANE` of the plane.
    n_iterations, settled
        Of both stages; whether the last one came to rest.
    degrees, angular_ratio, k, frequency_ratio
        C/C0 and P/P0 in bins, tuples.
    """

    seed: int
    noise_level: float
    angular: dict
    frequency: dict
    bump: float
    mean_error: float
    largest_error: float
    flagged: float
    near_plane: float
    n_iterations: int
    settled: bool
    degrees: tuple
    angular_ratio: tuple
    k: tuple
    frequency_ratio: tuple

    @property
    def fails(self):
        """Whether the mean error is above `FAILING`."""
        return self.mean_error > FAILING


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one reading leads to.

    Attributes
    ----------
    judged
        {claim: {seed: `Judgement`}}.
    runs
        A `Run` for each seed and noise level.
    """

    judged: dict
    runs: tuple

    def verdict(self, claim):
        """That of most seeds, of two that as many have the worse, as in the ledger; None if not judged."""
        by_seed = self.judged.get(claim)
        return most_common(one.verdict for one in by_seed.values()) if by_seed else None

    def holds(self, claim):
        """Whether it is reproduced, at least in part; None if it was not judged."""
        verdict = self.verdict(claim)
        return None if verdict is None else verdict in (REPRODUCED, IN_PART)

    @property
    def n_failing(self):
        """How many of the runs fail."""
        return sum(run.fails for run in self.runs)


def evaluate(realisations, *, nudges=NUDGES):
    """{label: `Outcome`} of every reading.

    All readings of one sky are computed together: they share its observations, which do not stay, and what
    the other methods make of them. What the cache holds is not computed again.

    Parameters
    ----------
    realisations
        A list of `Realisation` of SDecGMCA in its default reading, as `himap.paper.ledger.realisations` has
        them.
    nudges
        Noise levels at which SDecGMCA is run through the oscillating beam once more.

    Raises
    ------
    InputError
        No realisation, one of another method or with options of its own.
    """
    if not realisations:
        raise InputError("readings are judged on one realisation or more, got none.")
    if any((sky.method, sky.options, sky.noise_level) != ("sdecgmca", (), 1) for sky in realisations):
        raise InputError("readings are those of SDecGMCA: give realisations of its default reading.")
    skies = [
        {label: replace(sky, options=reading.options) for label, reading in readings().items()}
        for sky in realisations
    ]
    nudged = [
        {label: [replace(sky, noise_level=level) for level in nudges] for label, sky in by_label.items()}
        for by_label in skies
    ]
    if dask_address():
        _make(skies, nudged)
    judged, runs = ({label: [] for label in skies[0]} for _ in range(2))
    for by_label, others in zip(skies, nudged, strict=True):
        _make([by_label], [others])
        for label, sky in by_label.items():
            judged[label].append((sky.survey.seed, judge(sky)))
            runs[label] += [_run(one) for one in (sky, *others[label])]
    return {
        label: Outcome(judged=_by_claim(found), runs=tuple(runs[label])) for label, found in judged.items()
    }


def _make(skies, nudged):
    whole = [sky for by_label in skies for sky in by_label.values()]
    make(
        whole,
        only_oscillating=[sky for by_label in nudged for several in by_label.values() for sky in several],
    )


def _by_claim(found):
    """{claim: {seed: `Judgement`}} of [(seed, {claim: `Finding`})]."""
    return {
        claim: {seed: _judgement(findings[claim]) for seed, findings in found} for claim in dict(found[0][1])
    }


def _judgement(finding):
    return Judgement(
        verdict=finding.verdict,
        n_held=finding.n_held,
        n_parts=len(finding.parts),
        value=float(finding.value),
    )


def _run(sky):
    """What SDecGMCA leaves on the oscillating case of a `Realisation`."""
    assessed, comparison = sky.assessed("sdecgmca"), sky.of("oscillating")["sdecgmca"]
    flagged = sky.flagged("sdecgmca")
    near = np.abs(sphere.pixel_latitude(sky.survey.nside)[flagged]) < NEAR_PLANE
    degrees, angular = comparison.degrees, comparison.angular_ratio
    k, frequency = comparison.k, comparison.frequency_ratio
    return Run(
        seed=sky.survey.seed,
        noise_level=sky.noise_level,
        angular=_means(
            degrees, angular, {f"{low} to {high}": (low - 0.5, high + 0.5) for low, high in ANGULAR_BANDS}
        ),
        frequency=_means(k, frequency, FREQUENCY_BANDS),
        bump=bump(comparison) if ((k > BUMP[0]) & (k < BUMP[1])).any() else math.nan,
        mean_error=angular_error(10, _EDGE)(comparison),
        largest_error=angular_deviation(10, _EDGE)(comparison),
        flagged=float(flagged.mean()),
        near_plane=float(near.mean()) if len(near) else math.nan,
        n_iterations=int(assessed.n_iterations),
        settled=bool(assessed.converged),
        **dict(zip(("degrees", "angular_ratio"), _binned(degrees, angular), strict=True)),
        **dict(zip(("k", "frequency_ratio"), _binned(k, frequency), strict=True)),
    )


def _means(x, values, bands):
    """{band: mean of the values with low < x < high}, of the bands that hold some."""
    inside = {name: values[(x > low) & (x < high)] for name, (low, high) in bands.items()}
    return {name: float(some.mean()) for name, some in inside.items() if len(some)}


def _binned(x, values):
    """Means of both in logarithmic bins of x, tuples, without the bins that are empty."""
    place = np.floor(np.log(x / x[0]) / np.log(x[-1] / x[0]) * _N_BINS * (1 - 1e-9)).astype(int)
    bins = [place == n for n in np.unique(place)]
    return tuple(float(x[one].mean()) for one in bins), tuple(float(values[one].mean()) for one in bins)
