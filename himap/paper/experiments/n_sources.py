"""How often criteria without the truth find the best number of sources, and the cost of other numbers."""

from dataclasses import replace

import numpy as np
import pandas as pd

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.paper import cleaned
from himap.paper.choice import eigenvalues, minka, recommended, source_number_criteria
from himap.paper.grid import cases_and_methods, make_products, skies_of, with_labels
from himap.paper.mocks import own_recovery, recovered
from himap.paper.record import Experiment
from himap.removal import create
from himap.store.store import product

CRITERIA = {
    "bic": "information criterion (BIC)",
    "aic": "information criterion (AIC)",
    "eigenvalues": "eigenvalues above the line",
    "stability": "spectra move by less than 10 %",
    "mocks": "corrected spectra move by less than 3 %",
    "minka": "evidence (Minka 2000)",
}
"""Criteria that recommend a number of sources without the truth."""

COLUMNS = {
    "beam": str,
    "noise": float,  # factor on the noise of the instrument
    "method": str,
    "criterion": str,  # one of `CRITERIA`
    "recommended": int,  # recommended number of sources, 0 for none
    "best": int,  # the number whose spectra are nearest to the truth
    # Deviation from 1 of the worst band of C/C0 (10 <= l < 100) and P/P0 (k > 0.03) for either: the former
    # NaN if that number was not tried.
    "bias": float,
    "least_bias": float,
}


def skies(*, beams, noises, methods, n_sources_max=8, n_mocks=2, **settings):
    """A list of `Sky`, with a case for each beam and noise, and every method with 1 to n_sources_max sources.

    Beams and methods are names, noises are factors on the noise, the first of them 1; settings are as in
    `cases_and_methods`. InputError for a number outside its range, no beam, noise or method, or errors of a
    method or of `cases_and_methods`.
    """
    whole_number("n_mocks", n_mocks, 1, 1000)
    whole_number("n_sources_max", n_sources_max, 2, 100)
    bad = [one for one in noises if isinstance(one, bool) or not isinstance(one, int | float) or not one > 0]
    if not beams or bad or not noises or noises[0] != 1:
        raise InputError(
            f"there must be beams, and factors on the noise, 1 first, above 0; got {list(noises)!r}."
        )
    if not all(isinstance(name, str) for name in (*beams, *methods)):
        raise InputError(f"beams and methods are lists of names, got {beams!r} and {methods!r}.")
    counts = range(1, n_sources_max + 1)
    removers = [create(name, n_sources=n) for name in dict.fromkeys(methods) for n in counts]
    observed = []
    for beam in beams:
        cases, _ = cases_and_methods(beam=beam, other_beams=beams, methods=(), **settings)
        for remover in removers:
            remover.check(cases[0].survey.n_channels)
        for noise in noises:
            noisier = [replace(one.survey, t_obs=one.survey.t_obs / noise**2) for one in cases]
            pairs = zip(cases, noisier, strict=True)
            observed.append(([replace(case, survey=survey) for case, survey in pairs], removers))
    return skies_of(*observed, n_mocks=n_mocks)


@product(name="measured_n_sources")
def measure(sky):
    """Recommendation of every criterion for every case and method of a `Sky`, and the best number."""
    rows = []
    for case, every in sky.methods.items():
        by_name = {}
        for remover in every:
            by_name[remover.name] = (*by_name.get(remover.name, ()), remover)
        work = [(minka, (case,))]
        for removers in by_name.values():
            work += [(made, (case, one)) for made in (own_recovery, cleaned.assessment) for one in removers]
            work += [(recovered, (case, removers, mock)) for mock in sky.mocks]
            work.append((eigenvalues, (case, "beams" in removers[0].uses)))
        make_products(work)
        noise = float(np.sqrt(sky.survey.t_obs / case.survey.t_obs))
        for name, removers in by_name.items():
            criteria = source_number_criteria(case, removers, sky.mocks)
            numbers = recommended(criteria, eigenvalues(case, "beams" in removers[0].uses))
            bias = criteria["error"].to_dict()
            first = {"beam": str(case.beam), "noise": noise, "method": name}
            best = {"best": min(bias, key=bias.get), "least_bias": min(bias.values())}
            for criterion, number in (numbers | ({"minka": minka(case)} if name == "pca" else {})).items():
                row = {"criterion": criterion, "recommended": int(number or 0), "bias": bias.get(number)}
                rows.append(first | row | best)
    return rows


def _summary(table):
    """How often each criterion is right, how far off it is, and the median bias over all observations."""
    more = (table["recommended"] - table["best"]).where(table["recommended"] > 0)
    names = ["less", "one less", "right", "one more", "more"]
    kind = pd.cut(more, [-np.inf, -2, -1, 0, 1, np.inf], labels=names).astype(object).fillna("none")
    known = table.assign(kind=kind, least_bias=table["least_bias"].where(table["bias"].notna()))
    groups = known.groupby(["method", "criterion"], sort=False)
    medians = groups[["bias", "least_bias"]].median().map("{:.3f}".format).replace("nan", "")
    columns = ["right", "one more", "more", "one less", "less", "none"]
    counts = groups["kind"].value_counts().unstack().reindex(medians.index, columns=columns)
    shown = counts.fillna(0).map("{:.0f}".format).join(medians).reset_index()
    shown["criterion"] = shown["criterion"].map(CRITERIA)
    return with_labels(shown.rename(columns={"least_bias": "least bias"}))


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
)
