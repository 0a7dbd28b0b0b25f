"""How often criteria that do not know the truth find the right number of sources, and what others cost."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from himap.checks import whole_number
from himap.errors import InputError
from himap.figures import styles
from himap.paper import cleaned, plan
from himap.paper.choice import eigenvalues, minka, views_of
from himap.paper.mocks import make_mocks, own_recovery, recovered
from himap.products.parallel import make_all
from himap.removal import create

__all__ = [
    "CRITERIA",
    "HEADER",
    "Suggested",
    "cases_over",
    "confusion",
    "evaluate",
    "summary",
]

CRITERIA = {
    "bic": "information criterion (BIC)",
    "aic": "information criterion (AIC)",
    "eigenvalues": "eigenvalues above the line",
    "stability": "spectra move by less than 10 %",
    "mocks": "corrected spectra move by less than 3 %",
    "minka": "evidence (Minka 2000)",
}
"""What says how many sources, without the truth."""


@dataclass(frozen=True, kw_only=True)
class Suggested:
    """What one criterion says of one method on one sky, and what is right.

    Attributes
    ----------
    seed, beam, noise
        Of the sky; name of the beam; factor on the noise of the instrument.
    method, criterion
        Names; of the criterion one of `CRITERIA`.
    advised
        The number of sources that the criterion is for; 0 where it is for none.
    best
        The number that is nearest to the truth.
    cost, least
        How far the worst band of C/C0 (10 <= l < 100) and P/P0 (k > 0.03) is from 1 with the number that is
        advised, None where that is none or was not tried, and with the best.
    """

    command: ClassVar[str] = "suggestions"
    seed: int
    beam: str
    noise: float
    method: str
    criterion: str
    advised: int
    best: int
    cost: float | None
    least: float


def evaluate(cases, methods, mocks, counts):
    """What every criterion says of every method on every case, a list of `Suggested`.

    Parameters
    ----------
    cases
        `pipeline.Case` each; the noise of the instrument is told from `t_obs`, relative to the first one's.
    methods
        Names of methods that have a number of sources.
    mocks
        `himap.paper.mocks.Mock`, of other skies than the cases.
    counts
        Numbers of sources to try, ascending by one.

    Raises
    ------
    InputError
        A method without sources, or what one refuses.
    """
    counts = np.array(list(counts))
    removers = {name: tuple(create(name, n_sources=int(n)) for n in counts) for name in methods}
    for several in removers.values():
        several[-1].check(cases[0].survey.n_channels)
    rows = []
    for case in cases:
        work = _work(case, removers.values(), mocks)
        missing = [(made, call) for made, call in work if not made.is_cached(*call)]
        again = [(case, remover) for several in removers.values() for remover in several] if missing else []
        with plan.passing_observations([case] if missing else []), plan.passing_separations(again):
            if missing:
                make_mocks([case.survey], mocks)
            for made in dict.fromkeys(made for made, _ in missing):
                calls = [call for other, call in missing if other is made]
                make_all(made, calls, made.name.rpartition(".")[2])
        noise = float(np.sqrt(cases[0].survey.t_obs / case.survey.t_obs))
        for name, several in removers.items():
            rows += _rows(case, name, several, mocks, counts, noise)
    return rows


def _work(case, removers, mocks):
    """[(product, arguments)] of all that is measured on a case."""
    work = [(minka, (case,))]
    for several in removers:
        work += [(own_recovery, (case, remover)) for remover in several]
        work += [(cleaned.assessment, (case, remover)) for remover in several]
        work += [(recovered, (case, several, mock)) for mock in mocks]
        work.append((eigenvalues, (case, "beams" in several[0].uses)))
    return work


def _rows(case, name, removers, mocks, counts, noise):
    views = views_of(case, removers, mocks)
    advised = views.advised() | ({"minka": minka(case)} if name == "pca" else {})
    return [
        Suggested(
            seed=case.survey.seed,
            beam=case.beam.name,
            noise=noise,
            method=name,
            criterion=criterion,
            advised=int(number or 0),
            best=views.best,
            cost=float(views.error[number - counts[0]]) if number in counts else None,
            least=float(views.error.min()),
        )
        for criterion, number in advised.items()
    ]


def confusion(rows):
    """{(method, criterion): counts of skies by advised less best, {difference or None: number}}."""
    found = {}
    for row in rows:
        counts = found.setdefault((row.method, row.criterion), {})
        difference = row.advised - row.best if row.advised else None
        counts[difference] = counts.get(difference, 0) + 1
    return found


HEADER = ("method", "criterion", "right", "one more", "more", "one less", "less", "none", "cost", "least")
"""Columns of `summary`."""


def summary(rows):
    """One line of texts for each method and criterion over all skies, a list of tuples; see `HEADER`."""
    lines = []
    for (method, criterion), counts in confusion(rows).items():
        own = [row for row in rows if (row.method, row.criterion) == (method, criterion)]
        told = [(row.cost, row.least) for row in own if row.cost is not None]
        cost, least = (f"{value:.3f}" for value in np.median(told, axis=0)) if told else ("", "")
        numbers = (
            counts.get(0, 0),
            counts.get(1, 0),
            sum(n for difference, n in counts.items() if difference is not None and difference > 1),
            counts.get(-1, 0),
            sum(n for difference, n in counts.items() if difference is not None and difference < -1),
            counts.get(None, 0),
        )
        lines.append((styles.numbered(method, None), CRITERIA[criterion], *map(str, numbers), cost, least))
    return lines


def cases_over(first, *, beams, noises, n_realisations):
    """Cases alike but for seed, beam and noise, a list: the first has the noise of the instrument.

    Parameters
    ----------
    first
        A `pipeline.Case`.
    beams
        Each a `Beam`.
    noises
        Factors on the noise, the first of them 1.
    n_realisations
        Skies: the seed of `first`, and those after it.

    Raises
    ------
    InputError
        A number outside its range, or no beam or noise.
    """
    whole_number("n_realisations", n_realisations, 1, 1000)
    bad = [one for one in noises if isinstance(one, bool) or not isinstance(one, int | float) or not one > 0]
    if not beams or bad or not noises or noises[0] != 1:
        raise InputError(
            f"there must be beams, and factors on the noise, 1 first, above 0; got {list(noises)!r}."
        )
    return [
        replace(
            first, beam=beam, survey=replace(first.survey, seed=seed, t_obs=first.survey.t_obs / noise**2)
        )
        for seed in range(first.survey.seed, first.survey.seed + n_realisations)
        for beam in beams
        for noise in noises
    ]
