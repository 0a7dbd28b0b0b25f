"""The ledger: what of the paper is reproduced, over several realisations of sky and noise."""

import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from himap.checks import whole_number
from himap.errors import InputError
from himap.instrument.beams.oscillating import Oscillating
from himap.outputs import whole_file
from himap.paper.claims import CLAIMS, IN_PART, Finding, Part
from himap.paper.claims.verdicts import most_common, void
from himap.paper.realisation import Realisation, make
from himap.products.parallel import dask_address
from himap.sky.dimming import Dimming
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = ["NUDGES", "RECORDED", "Entry", "evaluate", "judge", "read_ledger", "realisations", "write_ledger"]

RECORDED = Path(__file__).resolve().parents[2] / "book" / "results" / "claims_laptop.json"
"""The ledger that the book shows, in a checkout."""

NUDGES = (0.999, 1.001)
"""Noise levels a thousandth away from that of the survey, which should change nothing of account."""

_FORMAT = 2  # of the file: the first had no main parts
_WORDS = ("id", "beam", "statement", "number", "paper", "section", "figure", "notebook", "reading")


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One row: a claim and what every realisation says of it.

    Attributes
    ----------
    claim
        {field: text} of a `himap.paper.claims.Claim`: id, beam, statement, number, paper, section, figure,
        notebook and reading.
    findings
        {seed: `Finding`}, of the first seed first.
    nudged
        {noise level: `Finding`} of the first seed, where SDecGMCA is told so much of the noise there is.
    """

    claim: dict
    findings: dict
    nudged: dict = field(default_factory=dict)

    @property
    def verdict(self):
        """That of most realisations; of two that as many have, the worse, in the order of `VERDICTS`."""
        return most_common(finding.verdict for finding in self.findings.values())

    @property
    def label(self):
        """The verdict; *in part* with how many parts hold, the least and the most over its realisations."""
        if self.verdict != IN_PART:
            return self.verdict
        partly = [finding for finding in self.findings.values() if finding.verdict == IN_PART]
        held = sorted({finding.n_held for finding in partly})
        totals = sorted({len(finding.parts) for finding in partly})
        return f"{IN_PART} ({_span(held)} of {_span(totals)})"

    @property
    def agreeing(self):
        """How many realisations have the verdict of the entry."""
        return sum(finding.verdict == self.verdict for finding in self.findings.values())

    @property
    def values(self):
        """The measured number: median, lowest and highest over realisations; NaN if there is none."""
        values = [finding.value for finding in self.findings.values() if math.isfinite(finding.value)]
        return (float(np.median(values)), min(values), max(values)) if values else (math.nan,) * 3

    @property
    def nudged_values(self):
        """Lowest and highest number of the first seed under a thousandth of noise; NaN where not tried."""
        first = next(iter(self.findings.values()))
        values = [finding.value for finding in (first, *self.nudged.values()) if math.isfinite(finding.value)]
        return (min(values), max(values)) if self.nudged and values else (math.nan,) * 2

    @property
    def nudged_verdicts(self):
        """The verdicts of the first seed under a thousandth of noise that differ from its own, sorted."""
        first = next(iter(self.findings.values()))
        return sorted({finding.verdict for finding in self.nudged.values()} - {first.verdict})

    @property
    def sentence(self):
        """The numbers behind it, of the first realisation."""
        return next(iter(self.findings.values())).sentence

    def failed_parts(self):
        """{part: in how many realisations it does not hold}, of the parts that fail in some."""
        count = {}
        for finding in self.findings.values():
            for part in finding.parts:
                if not part.held:
                    count[part.name] = count.get(part.name, 0) + 1
        return count


def _span(numbers):
    """One number, or the first and the last of several."""
    return f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"


def realisations(
    *,
    preset="quick",
    survey=None,
    galaxy="synthetic",
    template_dir=None,
    small_scales=True,
    oscillating=None,
    plane_weight=0.1,
    plane_edge=15.0,
    n_sources_min=2,
    n_sources_max=20,
    n_realisations=5,
    reading="default",
    method="sdecgmca",
):
    """A list of `Realisation`, alike but for the seed: that of the survey, and those after it.

    Parameters
    ----------
    preset, survey, galaxy, template_dir, small_scales
        As in `himap.paper.study.Study`.
    oscillating
        The `Beam` in the place of the oscillating one; that itself unless given.
    plane_weight, plane_edge
        Of the `Dimming`.
    n_sources_min, n_sources_max
        Ends of the scan.
    n_realisations
        How many; fewer than 5 say little about verdicts that depend on the realisation.
    reading
        Of what the paper leaves open about SDecGMCA, or "default".
    method
        What stands in the place of SDecGMCA, as in `Realisation`.

    Raises
    ------
    InputError
        A bad value of any of them.
    """
    whole_number("n_realisations", n_realisations, 1, 1000)
    first = Realisation(
        survey=Survey.preset(preset, **(survey or {})),
        galaxy=Galaxy(source=galaxy, template_dir=template_dir, small_scales=small_scales),
        oscillating=Oscillating() if oscillating is None else oscillating,
        dimming=Dimming(weight=plane_weight, edge=plane_edge),
        n_sources=tuple(range(n_sources_min, n_sources_max + 1)),
        method=method,
        options=() if reading == "default" else (("reading", reading),),
    )
    seeds = range(first.survey.seed, first.survey.seed + n_realisations)
    return [replace(first, survey=replace(first.survey, seed=seed)) for seed in seeds]


def evaluate(realisations, *, nudges=()):
    """The ledger, a list of `Entry` in the order of the paper.

    Every realisation is computed in turn, on a Dask cluster all of them together; what the cache holds is
    not computed again.

    Parameters
    ----------
    realisations
        A list of `Realisation`.
    nudges
        Noise levels at which the first of them is judged too, such as `NUDGES`.

    Raises
    ------
    InputError
        No realisation; or a method in the place of SDecGMCA that cannot be told the noise, for nudges.
    """
    if not realisations:
        raise InputError("a ledger needs one realisation or more, got none.")
    first, *others = realisations
    nudged = [replace(first, noise_level=level) for level in nudges]
    families = [[first, *nudged], *([sky] for sky in others)]
    if dask_address():
        make([sky for family in families for sky in family])
    judged = []
    for family in families:
        make(family)  # the same cubes, which do not stay
        judged.append([judge(sky) for sky in family])
    (_, *by_level), seeds = judged[0], [sky.survey.seed for sky in realisations]
    return [
        Entry(
            claim={name: getattr(claim, name) for name in _WORDS},
            findings={seed: found[id] for seed, (found, *_) in zip(seeds, judged, strict=True)},
            nudged={level: found[id] for level, found in zip(nudges, by_level, strict=True)},
        )
        for id, claim in CLAIMS.items()
    ]


def judge(realisation):
    """{id: `Finding`} of every claim on one realisation, in the order of the paper."""
    return {id: _checked(claim, realisation) for id, claim in CLAIMS.items()}


def _checked(claim, realisation):
    """The finding; the claim does not apply where the maps do not hold the scales that it is about."""
    try:
        return claim.check(realisation)
    except InputError as error:
        return void(f"Not on these maps: {error}")


def write_ledger(entries, path, about):
    """Write a ledger as JSON; `about` says what made it, {name: value}. The file is whole or not there."""
    rows = [
        entry.claim
        | {"verdict": entry.label, "median_lowest_highest": [_or_none(v) for v in entry.values]}
        | {"realisations": [{"seed": seed} | _as_dict(found) for seed, found in entry.findings.items()]}
        | {"nudged": [{"noise_level": level} | _as_dict(found) for level, found in entry.nudged.items()]}
        for entry in entries
    ]
    content = {"format": _FORMAT, "about": about, "claims": rows}
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")


def _as_dict(finding):
    return {
        "value": _or_none(float(finding.value)),
        "verdict": finding.verdict,
        "parts": [{"name": part.name, "held": bool(part.held), "main": part.main} for part in finding.parts],
        "sentence": finding.sentence,
    }


def read_ledger(path):
    """(entries, about) of a file that `write_ledger` wrote.

    Raises
    ------
    InputError
        No such file, another kind of file, or a ledger in the format of an older himap.
    """
    try:
        content = json.loads(Path(path).read_text())
        older = "claims" in content and content.get("format") != _FORMAT
        entries = [] if older else [_entry(row) for row in content["claims"]]
        about = content["about"]
    except FileNotFoundError:
        raise InputError(f"there is no ledger {path}; `himap claims` writes one.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not a ledger that `himap claims` wrote ({error}).") from None
    if older:
        raise InputError(
            f"{path} is a ledger in the format of another version of himap, without main parts; measure it "
            "anew with `himap claims`."
        )
    return entries, about


def _entry(row):
    return Entry(
        claim={name: row[name] for name in _WORDS},
        findings={found["seed"]: _finding(found) for found in row["realisations"]},
        nudged={found["noise_level"]: _finding(found) for found in row["nudged"]},
    )


def _finding(found):
    value = found["value"]
    return Finding(
        value=math.nan if value is None else value,
        parts=tuple(Part(**part) for part in found["parts"]),
        sentence=found["sentence"],
    )


def _or_none(value):
    return value if math.isfinite(value) else None
