"""Every claim of the paper on several skies, with a verdict: the ledger."""

from dataclasses import dataclass, replace

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.instrument.beams.paper import Oscillating
from himap.paper import ledger_table
from himap.paper.claims import CLAIMS
from himap.paper.claims.entries import COLUMNS, entries, finding_rows
from himap.paper.claims.verdicts import not_applicable
from himap.paper.methods import BEAM_AWARE
from himap.paper.realisation import Realisation, make
from himap.paper.record import Experiment
from himap.removal.restarts import has_restarts
from himap.sky.galaxy import Dimming, Galaxy

_PAPER_TOP = 200  # l up to which the paper shows angular spectra
_UP_TO_TOP = ("D1", "E2", "O3", "O6", "R1", "N5", "A2", "V6", "V7")  # claims on multipoles near it


@dataclass(frozen=True)
class JudgedSky:
    """One sky on which claims are judged.

    Attributes
    ----------
    realisations
        {reading of SDecGMCA: list of the `Realisation` of each restart}.
    """

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
    preset="quick",
    survey=None,
    galaxy="synthetic",
    template_dir=None,
    small_scales=True,
    ripple="bracket",
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
    ripple
        Reading of the ripple of the oscillating beam.
    plane_weight, plane_edge
        Of the `Dimming`.
    n_sources_min, n_sources_max
        Ends of the scan.
    n_realisations
        How many; fewer than 5 say little about verdicts that depend on the sky.
    reading
        Of the open choices of SDecGMCA, or "default".
    method
        What is put in the place of SDecGMCA, as in `Realisation`.

    Raises
    ------
    InputError
        A bad value of any of them.
    """
    whole_number("n_realisations", n_realisations, 1, 1000)
    first = Realisation(
        survey=Survey.preset(preset, **(survey or {})),
        galaxy=Galaxy(source=galaxy, template_dir=template_dir, small_scales=small_scales),
        oscillating=Oscillating(ripple=ripple),
        dimming=Dimming(weight=plane_weight, edge=plane_edge),
        n_sources=tuple(range(n_sources_min, n_sources_max + 1)),
        method=method,
        options=options_of(reading),
    )
    seeds = range(first.survey.seed, first.survey.seed + n_realisations)
    return [replace(first, survey=replace(first.survey, seed=seed)) for seed in seeds]


def options_of(reading):
    """Options of the reading of SDecGMCA with a name, as of `Realisation`."""
    return () if reading == "default" else (("reading", reading),)


def restarts(realisation, n_restarts):
    """A list of a `Realisation` from each of some starts of the method in the place of SDecGMCA.

    There is one for a method that has no restarts.
    """
    whole_number("n_restarts", n_restarts, 1, 1000)
    n_restarts = n_restarts if has_restarts(BEAM_AWARE[realisation.method][0]) else 1
    return [replace(realisation, restart=k) for k in range(n_restarts)]


def judged_skies(several, options, n_restarts):
    """A list of `JudgedSky` of some `Realisation`, each with `n_restarts` of every {reading: options}."""
    return [
        JudgedSky(
            {label: restarts(replace(sky, options=given), n_restarts) for label, given in options.items()}
        )
        for sky in several
    ]


def skies(*, n_restarts=2, reading="default", **settings):
    """A list of `JudgedSky`, each with `n_restarts`; other parameters as of `realisations`."""
    return judged_skies(realisations(**settings), {reading: options_of(reading)}, n_restarts)


def judge(realisation):
    """{id: `Finding`} of every claim on one realisation, in the order of the paper.

    A claim does not apply where the maps do not hold the scales that it is about.
    """
    findings = {}
    for id, claim in CLAIMS.items():
        try:
            findings[id] = claim.check(realisation)
        except InputError as error:
            findings[id] = not_applicable(f"Not on these maps: {error}")
    return findings


def measure(sky):
    """Findings on every claim on a `JudgedSky`, rows with `himap.paper.claims.entries.COLUMNS`."""
    return [row for one in sky.members for row in finding_rows(judge(one), one.restart)]


def prepare(several):
    """Compute what some `JudgedSky` need: readings and restarts share observations and other methods."""
    make([one for sky in several for one in sky.members])


def _summary(rows):
    """A row for each claim, and how many have which verdict."""
    several = entries(rows)
    table = ledger_table.plain_table(several)
    count = [f"{n} {verdict}" for verdict, n in ledger_table.summary(several).items() if n]
    table.loc[len(table)] = ["all", "", ", ".join(count), *[""] * (table.shape[1] - 3)]
    return table


def _too_coarse(sky):
    """What the maps of a sky are too coarse to judge; nothing where they reach l = 200 of the paper."""
    survey = sky.survey
    if (top := 2 * survey.nside) >= _PAPER_TOP:
        return ""
    cell = survey.box_size / survey.box_cells
    return (
        f"Too coarse to judge: {', '.join(_UP_TO_TOP)}, as these maps end at l = {top} and not at "
        f"{_PAPER_TOP}; B1 to B3, which are about peaks, as cells of HI are {cell:.0f} Mpc/h wide and not "
        "1.5. The verdicts of the book are at --preset laptop."
    )


EXPERIMENT = Experiment(
    name="claims",
    chapter="15_claims",
    columns=COLUMNS,
    key=("restart", "claim"),
    skies=skies,
    measure=measure,
    summary=_summary,
    remark=_too_coarse,
    prepare=prepare,
    defaults={"n_realisations": 5, "n_restarts": 2},
    stated=("n_realisations", "n_restarts"),
    words=("sentence",),
)
