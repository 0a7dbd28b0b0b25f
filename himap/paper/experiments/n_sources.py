"""How often criteria that do not use the truth find the right number of sources, and what others cost."""

from dataclasses import replace

import numpy as np
import pandas as pd

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.figures import styles
from himap.paper import cleaned
from himap.paper.choice import eigenvalues, minka, views_of
from himap.paper.grid import Sky, cases_and_methods, make_products
from himap.paper.mocks import first_mocks, own_recovery, recovered
from himap.paper.record import Experiment
from himap.removal import create

CRITERIA = {
    "bic": "information criterion (BIC)",
    "aic": "information criterion (AIC)",
    "eigenvalues": "eigenvalues above the line",
    "stability": "spectra move by less than 10 %",
    "mocks": "corrected spectra move by less than 3 %",
    "minka": "evidence (Minka 2000)",
}
"""What recommends a number of sources without the truth."""

COLUMNS = {
    "beam": str,
    "noise": float,
    "method": str,
    "criterion": str,
    "recommended": int,
    "best": int,
    "bias": float,
    "least_bias": float,
}
"""Factor on the noise of the instrument; one of `CRITERIA`; the number of sources that it recommends, 0 for
none, and the one whose spectra are nearest to the truth; and how far the worst band of C/C0 (10 <= l < 100)
and P/P0 (k > 0.03) is from 1 with either, the former NaN where that number was not tried."""


def skies(*, beams, noises, methods, n_sources_max=8, n_mocks=2, **settings):
    """A list of `Sky`, with a case for each beam and noise, and each method with each number of sources.

    Parameters
    ----------
    beams
        Names of beams.
    noises
        Factors on the noise, the first of them 1.
    methods
        Names of methods that have a number of sources.
    n_sources_max, n_mocks
        Numbers from 1 to this one are tried; how many mocks.
    settings
        As of `cases_and_methods`, but for the beam.

    Raises
    ------
    InputError
        A number outside its range, no beam, noise or method, or what a method or `cases_and_methods` refuses.
    """
    whole_number("n_mocks", n_mocks, 1, 1000)
    whole_number("n_sources_max", n_sources_max, 2, 100)
    bad = [one for one in noises if isinstance(one, bool) or not isinstance(one, int | float) or not one > 0]
    if not beams or bad or not noises or noises[0] != 1:
        raise InputError(
            f"there must be beams, and factors on the noise, 1 first, above 0; got {list(noises)!r}."
        )
    counts = range(1, n_sources_max + 1)
    removers = [create(name, n_sources=n) for name in dict.fromkeys(methods) for n in counts]
    by_beam = [cases_and_methods(beam=beam, methods=(), **settings)[0] for beam in beams]
    for remover in removers:
        remover.check(by_beam[0][0].survey.n_channels)
    mocks = tuple(first_mocks(n_mocks, by_beam[0]))
    return [
        Sky(methods={_noisier(case, noise): removers for case in cases for noise in noises}, mocks=mocks)
        for cases in zip(*by_beam, strict=True)
    ]


def _noisier(case, factor):
    return replace(case, survey=replace(case.survey, t_obs=case.survey.t_obs / factor**2))


def measure(sky):
    """What every criterion recommends for every case and method of a `Sky`, and what is best."""
    return [
        {"beam": str(case.beam), "noise": float(np.sqrt(sky.survey.t_obs / case.survey.t_obs))} | row
        for case, removers in sky.methods.items()
        for row in _of_case(case, removers, sky.mocks)
    ]


def _of_case(case, removers, mocks):
    by_name = {}
    for remover in removers:
        by_name.setdefault(remover.name, []).append(remover)
    work = [(minka, (case,))]
    for several in by_name.values():
        work += [
            (made, (case, remover)) for made in (own_recovery, cleaned.assessment) for remover in several
        ]
        work += [(recovered, (case, tuple(several), mock)) for mock in mocks]
        work.append((eigenvalues, (case, "beams" in several[0].uses)))
    make_products(work)
    return [row for name, several in by_name.items() for row in _rows(case, name, several, mocks)]


def _rows(case, name, removers, mocks):
    views = views_of(case, removers, mocks)
    recommended = views.advised() | ({"minka": minka(case)} if name == "pca" else {})
    bias = dict(zip(views.counts.tolist(), views.error.tolist(), strict=True))
    return [
        {
            "method": name,
            "criterion": criterion,
            "recommended": int(number or 0),
            "best": views.best,
            "bias": bias.get(number),
            "least_bias": min(bias.values()),
        }
        for criterion, number in recommended.items()
    ]


def _summary(table):
    """How often each criterion is right, or wrong by how much, and the median bias over all observations."""
    more = (table["recommended"] - table["best"]).where(table["recommended"] > 0)
    rows = []
    for (method, criterion), own in table.groupby(["method", "criterion"], sort=False):
        off = more[own.index]
        counts = [off == 0, off == 1, off > 1, off == -1, off < -1, off.isna()]
        tried = own.dropna(subset="bias")[["bias", "least_bias"]].median()
        costs = ["" if np.isnan(value) else f"{value:.3f}" for value in tried]
        label = styles.numbered(method, None)
        rows.append([label, CRITERIA[criterion], *(str(one.sum()) for one in counts), *costs])
    counted = ["right", "one more", "more", "one less", "less", "none"]
    return pd.DataFrame(rows, columns=["method", "criterion", *counted, "bias", "least bias"])


EXPERIMENT = Experiment(
    name="n_sources",
    chapter="22_how_many",
    columns=COLUMNS,
    key=("beam", "noise", "method"),
    skies=skies,
    measure=measure,
    summary=_summary,
    defaults={"n_realisations": 5},
    without=("results",),
    stated=("n_realisations", "n_mocks"),
)
