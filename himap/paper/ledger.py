"""The ledger: what of the paper is reproduced, over several realisations of sky and noise."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from himap.checks import whole_number
from himap.errors import InputError
from himap.instrument.beams.oscillating import Oscillating
from himap.outputs import whole_file
from himap.paper import plan
from himap.paper.claims import CLAIMS, DIFFERENT, FAILED, REPRODUCED, UNDECIDED, Finding
from himap.paper.realisation import Realisation
from himap.products.parallel import dask_address
from himap.sky.dimming import Dimming
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = ["RECORDED", "Entry", "evaluate", "read_ledger", "realisations", "write_ledger"]

RECORDED = Path(__file__).resolve().parents[2] / "book" / "results" / "claims_laptop.json"
"""The ledger that the book shows, in a checkout."""


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
    """

    claim: dict
    findings: dict

    @property
    def verdict(self):
        """That of most realisations, where *reproduced* also counts as reproduced with a difference."""
        verdicts = [finding.verdict for finding in self.findings.values()]
        decided = [verdict for verdict in verdicts if verdict != UNDECIDED]
        if not decided:
            return UNDECIDED
        if 2 * decided.count(REPRODUCED) > len(decided):
            return REPRODUCED
        return DIFFERENT if 2 * decided.count(FAILED) < len(decided) else FAILED

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
    def sentence(self):
        """The numbers behind it, of the first realisation."""
        return next(iter(self.findings.values())).sentence

    def failed_parts(self):
        """{part: in how many realisations it does not hold}, of the parts that fail in some."""
        count = {}
        for finding in self.findings.values():
            for part, held in finding.parts.items():
                if not held:
                    count[part] = count.get(part, 0) + 1
        return count


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
    )
    seeds = range(first.survey.seed, first.survey.seed + n_realisations)
    return [replace(first, survey=replace(first.survey, seed=seed)) for seed in seeds]


def evaluate(realisations):
    """The ledger, a list of `Entry` in the order of the paper.

    Every realisation is computed in turn, on a Dask cluster all of them together; what the cache holds is
    not computed again.
    """
    findings = {id: {} for id in CLAIMS}
    if dask_address():
        calls = [call for realisation in realisations for call in realisation.assessments]
        plan.make(calls, keep_observations=False)
    for realisation in realisations:
        realisation.make()
        for id, claim in CLAIMS.items():
            findings[id][realisation.survey.seed] = _checked(claim, realisation)
    return [Entry(claim=_words(CLAIMS[id]), findings=found) for id, found in findings.items()]


def _checked(claim, realisation):
    """The finding; undecided where the maps do not hold the scales that the claim is about."""
    try:
        return claim.check(realisation)
    except InputError as error:
        return Finding(value=math.nan, parts={}, sentence=f"Not on these maps: {error}")


def _words(claim):
    names = ("id", "beam", "statement", "number", "paper", "section", "figure", "notebook", "reading")
    return {name: getattr(claim, name) for name in names}


def _as_dict(finding):
    return {
        "value": _or_none(float(finding.value)),
        "verdict": finding.verdict,
        "parts": {part: bool(held) for part, held in finding.parts.items()},
        "sentence": finding.sentence,
    }


def write_ledger(entries, path, about):
    """Write a ledger as JSON; `about` says what made it, {name: value}. The file is whole or not there."""
    rows = [
        entry.claim
        | {"verdict": entry.verdict, "median_lowest_highest": [_or_none(v) for v in entry.values]}
        | {"realisations": [{"seed": seed} | _as_dict(found) for seed, found in entry.findings.items()]}
        for entry in entries
    ]
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps({"about": about, "claims": rows}, indent=1) + "\n")


def read_ledger(path):
    """(entries, about) of a file that `write_ledger` wrote.

    Raises
    ------
    InputError
        No such file, or another kind of file.
    """
    try:
        content = json.loads(Path(path).read_text())
        entries = [_entry(row) for row in content["claims"]]
        return entries, content["about"]
    except FileNotFoundError:
        raise InputError(f"there is no ledger {path}; `himap claims` writes one.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not a ledger that `himap claims` wrote ({error}).") from None


def _entry(row):
    findings = {found["seed"]: _finding(**found) for found in row["realisations"]}
    derived = ("verdict", "median_lowest_highest", "realisations")
    return Entry(claim={key: value for key, value in row.items() if key not in derived}, findings=findings)


def _finding(seed, value, verdict, parts, sentence):
    return Finding(value=math.nan if value is None else value, parts=parts, sentence=sentence)


def _or_none(value):
    return value if math.isfinite(value) else None
