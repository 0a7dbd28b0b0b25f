"""How well transfer functions correct each method: against the truth, over several skies, with error bars."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from himap.checks import whole_number
from himap.errors import InputError
from himap.figures import styles
from himap.instrument.beams import named
from himap.measures import diagnostics
from himap.measures.transfer import DEFINITIONS, bands
from himap.paper import pipeline, plan
from himap.paper.methods import paper_beams, sdecgmca_for
from himap.paper.mocks import own_recovery, recovered, transfer_functions
from himap.products.parallel import make_all
from himap.removal import create
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = [
    "HEADER",
    "Correction",
    "cases_and_methods",
    "corrections",
    "evaluate",
    "grouped",
    "recoveries",
    "summary",
]


@dataclass(frozen=True, kw_only=True)
class Correction:
    """Power over that of the truth in one band, of one method on one sky, as it is left and corrected.

    Attributes
    ----------
    seed, method, n_sources, band
        Of the sky; of the method, 0 if it has no number of sources; such as "C/C0, 10-19".
    raw
        Mean of the ratio in the band, as the method leaves it.
    corrected, by_auto
        The same once it is divided by the transfer function of cross power, and by that of auto power.
    sigma
        What the mocks say of the scatter of `corrected`.
    """

    command: ClassVar[str] = "corrections"
    seed: int
    method: str
    n_sources: int
    band: str
    raw: float
    corrected: float
    by_auto: float
    sigma: float


def corrections(seed, remover, own, transfer):
    """The `Correction` of each band, a list.

    Parameters
    ----------
    seed, remover
        Of the sky, and the method.
    own
        The `Recovery` of the truth.
    transfer
        The `TransferFunction` of two mocks or more.
    """
    cross, auto = (replace(transfer, definition=name) for name in DEFINITIONS)
    rows = []
    known_at = {"angular": own.put_in.degrees, "frequency": own.put_in.k}
    for name, (kind, inside) in bands(**known_at).items():
        ratio = diagnostics.ratio(getattr(own.came_back, kind)[inside], getattr(own.put_in, kind)[inside])
        errors = cross.errors(kind)[:, inside].mean(axis=1)
        rows.append(
            Correction(
                seed=seed,
                method=remover.name,
                n_sources=getattr(remover, "n_sources", 0),
                band=name,
                raw=float(ratio.mean()),
                corrected=float((ratio / getattr(cross, kind)[inside]).mean()),
                by_auto=float((ratio / getattr(auto, kind)[inside]).mean()),
                sigma=float(np.sqrt(np.mean(errors**2))),
            )
        )
    return rows


def cases_and_methods(
    *,
    preset="quick",
    survey=None,
    galaxy="synthetic",
    template_dir=None,
    small_scales=True,
    beam="oscillating",
    ripple="bracket",
    methods=(("beam_subspace", 3),),
    reading="default",
    n_realisations=20,
):
    """Skies as cases, alike but for the seed, and the methods that are corrected on them, two lists.

    Parameters
    ----------
    preset, survey, galaxy, template_dir, small_scales
        As in `himap.paper.study.Study`.
    beam, ripple
        Name of the beam, and the reading of the oscillating one.
    methods
        Pairs (name, number of sources); None for a method that has no number.
    reading
        Of SDecGMCA, if it is among them.
    n_realisations
        How many skies: the seed of the survey, and those after it.

    Raises
    ------
    InputError
        A bad value of any of them.
    """
    whole_number("n_realisations", n_realisations, 1, 1000)
    selected = paper_beams(ripple=ripple).get(beam) or named(beam)
    first = pipeline.Case(
        survey=Survey.preset(preset, **(survey or {})),
        galaxy=Galaxy(source=galaxy, template_dir=template_dir, small_scales=small_scales),
        beam=selected,
    )
    removers = [_remover(pair, selected, reading) for pair in methods]
    for remover in removers:
        remover.check(first.survey.n_channels)
    seeds = range(first.survey.seed, first.survey.seed + n_realisations)
    return [replace(first, survey=replace(first.survey, seed=seed)) for seed in seeds], removers


def _remover(pair, beam, reading):
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise InputError(
            "each of the methods is [name, number of sources], such as ['pca', 5], or ['gnilc', null]; got "
            f"{pair!r}."
        )
    name, n_sources = pair
    if n_sources is None:  # of a method that has none
        return create(name)
    if name == "sdecgmca":
        return sdecgmca_for(beam, n_sources=n_sources, reading=reading)
    return create(name, n_sources=n_sources)


def evaluate(cases, removers, mocks):
    """The `Correction` of every band, method and case, a list; what is as large as a cube does not stay.

    Parameters
    ----------
    cases
        `pipeline.Case` each, of other seeds than the mocks.
    removers, mocks
        As in `transfer_functions`; two mocks or more.

    Raises
    ------
    InputError
        Fewer than two mocks, or what `transfer_functions` refuses.
    """
    if len(mocks) < 2:
        raise InputError(f"error bars need two mocks or more, got {len(mocks)}.")
    names = [remover.name for remover in removers]
    rows = []
    for case in cases:
        for _, remover, own, transfer in recoveries({case: removers}, mocks, names):
            rows += corrections(case.survey.seed, remover, own, transfer)
    return rows


def recoveries(sky, mocks, corrected):
    """What methods keep of the truth of one sky, and of mocks.

    Parameters
    ----------
    sky
        {case: [method]}, `pipeline.Case` of one sky through several beams; what is as large as a cube does
        not stay.
    mocks
        As in `transfer_functions`.
    corrected
        Names of the methods that have a transfer function.

    Returns
    -------
    list
        (case, method, `Recovery` of the truth, `TransferFunction` or None).
    """
    wanted = {case: [one for one in removers if one.name in corrected] for case, removers in sky.items()}
    missing = [case for case in sky if not _are_cached(case, sky[case], wanted[case], mocks)]
    calls = [(case, remover) for case, removers in sky.items() for remover in removers]
    again = [call for call in calls if call[0] in missing]
    with plan.passing_observations(missing), plan.passing_separations(again):
        found = {case: transfer_functions(case, own, mocks) if own else {} for case, own in wanted.items()}
        make_all(own_recovery, calls, "truths")
    return [(*call, own_recovery(*call), found[call[0]].get(call[1])) for call in calls]


def _are_cached(case, removers, corrected, mocks):
    """Whether nothing of a case needs its observation any more."""
    known = [recovered.is_cached(case, tuple(corrected), mock) for mock in mocks if corrected]
    return all(known) and all(own_recovery.is_cached(case, remover) for remover in removers)


HEADER = ("method", "band", "left", "corrected", "by auto", "scatter", "foretold", "within 1σ")
"""Columns of `summary`."""


def summary(rows):
    """One line of texts for each method and band, over all skies, a list of tuples; see `HEADER`."""
    lines = []
    for (method, n_sources, band), found in grouped(rows).items():
        values = np.array([[row.raw, row.corrected, row.by_auto, row.sigma] for row in found])
        left, corrected, by_auto, foretold = values.mean(axis=0)
        scatter = values[:, 1].std(ddof=1) if len(found) > 1 else math.nan
        within = sum(abs(row.corrected - 1) < row.sigma for row in found)
        means = (f"{left:.4f}", f"{corrected:.4f}", f"{by_auto:.4f}")
        numbers = (*means, f"{scatter:.4f}", f"{foretold:.4f}")
        lines.append((styles.numbered(method, n_sources), band, *numbers, f"{within} of {len(found)}"))
    return lines


def grouped(rows):
    """{(method, n_sources, band): [`Correction` of each sky]}, in the order of the rows."""
    found = {}
    for row in rows:
        found.setdefault((row.method, row.n_sources, row.band), []).append(row)
    return found
