"""Every claim of the paper on several skies, with a verdict: the ledger."""

from dataclasses import dataclass, replace

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.survey import PRESETS
from himap.instrument.beams.paper import Oscillating
from himap.paper import cleaned, ledger_table
from himap.paper.claims import CLAIMS
from himap.paper.claims.base import not_applicable
from himap.paper.claims.entries import COLUMNS, entries, finding_rows
from himap.paper.grid import cases_of
from himap.paper.methods import BEAM_AWARE
from himap.paper.readings import find_reading
from himap.paper.realisation import Realisation
from himap.paper.record import Experiment
from himap.removal.restarts import has_restarts
from himap.sky.galaxy import Dimming
from himap.store.store import product

_PAPER_TOP = 200  # l up to which the paper shows angular spectra
_UP_TO_TOP = (  # claims on multipoles up to it, or near it
    *("D1", "E1", "E2", "O1", "O3", "O6", "R1", "N1", "N3", "N4", "N5", "M4", "M5", "G1", "G3", "G4"),
    *("S1", "A2", "V4", "V6", "V7"),
)
_ON_PEAKS = ("B1", "B2", "B3")


@dataclass(frozen=True)
class JudgedSky:
    """One sky to judge claims on, {reading of SDecGMCA: list of the `Realisation` of each restart}."""

    realisations: dict

    @property
    def members(self):
        """All `Realisation`, a list."""
        return [one for members in self.realisations.values() for one in members]

    @property
    def survey(self):
        return self.members[0].survey

    @property
    def galaxy(self):
        return self.members[0].galaxy


def realisations(
    *,
    ripple="bracket",
    plane_weight=0.1,
    plane_edge=15.0,
    n_sources_min=2,
    n_sources_max=20,
    n_realisations=5,
    method="sdecgmca",
    average="means",
    polynomial="temperature",
    **settings,
):
    """A list of `Realisation` that differ only in the seed: that of the survey, and the following ones.

    Parameters are those of the chapter: the reading of the ripple, the `Dimming`, the ends of the scan, the
    method that replaces SDecGMCA, the average of C_l over channels, and the variable of the polynomial. Fewer
    than 5 skies say little about verdicts that depend on the sky. Settings and errors raised are as in
    `himap.paper.grid.cases_of` and `Realisation`.
    """
    return [
        Realisation(
            survey=case.survey,
            galaxy=case.galaxy,
            oscillating=case.beam,
            dimming=Dimming(weight=plane_weight, edge=plane_edge),
            n_sources=tuple(range(n_sources_min, n_sources_max + 1)),
            method=method,
            average=average,
            polynomial=polynomial,
        )
        for case in cases_of(Oscillating(ripple=ripple), n_realisations=n_realisations, **settings)
    ]


def judged_skies(several, readings, n_restarts):
    """A list of `JudgedSky` from some `Realisation`, each with `n_restarts` of every `Reading` of SDecGMCA.

    A method without restarts has one.
    """
    whole_number("n_restarts", n_restarts, 1, 1000)
    n_restarts = n_restarts if has_restarts(BEAM_AWARE[several[0].method][0]) else 1
    return [
        JudgedSky(
            {
                one.label: [replace(sky, options=one.options, restart=k) for k in range(n_restarts)]
                for one in readings
            }
        )
        for sky in several
    ]


def other_restarts(sky, restarts):
    """A `JudgedSky` without some restarts; None if no other remains."""
    members = {
        label: [one for one in several if one.restart not in restarts]
        for label, several in sky.realisations.items()
    }
    return JudgedSky(members) if any(members.values()) else None


def skies(*, n_restarts=2, reading="default", **settings):
    """A list of `JudgedSky`, each with `n_restarts`; other parameters as in `realisations`."""
    return judged_skies(realisations(**settings), [find_reading(reading)], n_restarts)


def judge(realisation):
    """{id: `Finding`} for every claim on one realisation, in the order of the paper.

    A claim does not apply if the maps lack the scales that it is about.
    """
    findings = {}
    for id, claim in CLAIMS.items():
        try:
            findings[id] = claim.check(realisation)
        except InputError as error:
            findings[id] = not_applicable(f"Not on these maps: {error}")
    return findings


@product(name="measured_claims")
def measure(sky):
    """Findings on every claim on a `JudgedSky`, rows with `himap.paper.claims.entries.COLUMNS`."""
    return [row for one in sky.members for row in finding_rows(judge(one), one.restart)]


def prepare(several):
    """Compute products for some `JudgedSky`: readings and restarts share observations and other methods."""
    members = [one for sky in several for one in sky.members]
    assessments = dict.fromkeys(call for one in members for call in one.assessments)
    facts = dict.fromkeys(fact for one in members for fact in one.facts.values())
    cleaned.make_by_case([*((cleaned.assessment, call) for call in assessments), *facts])


def _summary(rows):
    """A row for each claim, and the number of claims with each verdict."""
    several = entries(rows)
    table = ledger_table.plain_table(several)
    count = [f"{n} {verdict}" for verdict, n in ledger_table.summary(several).items() if n]
    table.loc[len(table)] = ["all", "", ", ".join(count), *[""] * (table.shape[1] - 3)]
    return table


def too_coarse(survey):
    """The ids of claims for which maps or HI cells of a `Survey` are too coarse, a tuple."""
    cell, widest = (one.box_size / one.box_cells for one in (survey, PRESETS["laptop"]))
    return (_UP_TO_TOP if 2 * survey.nside < _PAPER_TOP else ()) + (_ON_PEAKS if cell > widest else ())


def _remark(sky):
    """Explain the brackets, and list claims for which a sky is too coarse."""
    said = "In brackets: the 1σ interval of a share, the 16 to 84 % of the members of a number."
    survey, coarse, why = sky.survey, too_coarse(sky.survey), []
    if _UP_TO_TOP[0] in coarse:
        top = 2 * survey.nside
        why.append(f"{', '.join(_UP_TO_TOP)}, as these maps end at l = {top} and not at {_PAPER_TOP}")
    if _ON_PEAKS[0] in coarse:
        cell = f"{survey.box_size / survey.box_cells:.0f} Mpc/h wide and not 1.5"
        why.append(f"B1 to B3, which are about peaks, as cells of HI are {cell}")
    if why:
        said += f" Too coarse to judge: {'; '.join(why)}. The verdicts of the book are at --preset laptop."
    return said


EXPERIMENT = Experiment(
    name="claims",
    chapter="15_claims",
    columns=COLUMNS,
    key=("restart", "claim"),
    skies=skies,
    measure=measure,
    summary=_summary,
    remark=_remark,
    prepare=prepare,
    other_restarts=other_restarts,
    defaults={"n_realisations": 5, "n_restarts": 2, "n_sources_max": 20},
    words=("sentence",),
)
