"""What a piece of work needs of the chain, made in order, several at a time, and kept or not.

The one place that knows which product comes before which; the products themselves only ask for what they
need.
"""

from contextlib import contextmanager

from himap.core.memory import check_memory
from himap.paper import cleaned, pipeline
from himap.store.parallel import dask_address, make_all, n_jobs


def observing_steps(cases):
    """[(product, [arguments of each call])] from nothing to peak-masked observations and their truth."""
    skies = {case.survey.sky: None for case in cases}
    galaxies = {(case.survey.sky, case.galaxy): None for case in cases}
    bright = {(case.survey.sky, case.galaxy, case.dimming): None for case in cases}
    case_calls = [(case,) for case in dict.fromkeys(cases)]
    return [
        (pipeline.components_of_sky, list(galaxies)),  # a bad template shows before the long work
        (pipeline.hi_of_sky, [(sky,) for sky in skies]),
        (pipeline.hi_alms_of_sky, [(sky,) for sky in skies]),
        (pipeline.noise_alms, [(survey,) for survey in dict.fromkeys(case.survey for case in cases)]),
        (pipeline.foreground_modes_of_sky, list(bright)),
        (pipeline.observation, case_calls),
        (pipeline.peak_masked, case_calls),
        (pipeline.true_spectra, case_calls),
        (pipeline.foreground_seen, case_calls),
    ]


def make_observations(cases):
    """Make what is not there yet, several at a time; returns what was made, [(product, arguments)]."""
    made = []
    for product, calls in observing_steps(cases):
        missing = [(product, call) for call in calls if not product.is_cached(*call)]
        make_all(product, [call for _, call in missing], product.name)
        made += missing
    return made


def make(assessments, *, facts=(), keep_separations=False, keep_observations=True):
    """Make the assessments of some methods on some cases, and before them what they share.

    Parameters
    ----------
    assessments
        The arguments of each `cleaned.assessment`: (case, remover, mask_peaks, post_mask).
    facts
        [(product, arguments)] of what else is measured on these cases (`himap.paper.evidence`).
    keep_separations
        Whether what the methods find is kept, or only what is measured on it.
    keep_observations
        Whether what is as large as a cube and was made now stays. If not, one case is done after the other,
        so that a disk holds no more than one, but for a Dask cluster, which gets all at once. What was there
        before stays in any case.

    Returns
    -------
    int
        How many assessments were made now.

    Raises
    ------
    InputError
        It will not fit into memory, or what the products refuse.
    """
    work = [*facts] + [(cleaned.separation, call[:3]) for call in assessments if keep_separations]
    work += [(cleaned.assessment, call) for call in assessments]
    missing = [(product, call) for product, call in work if not product.is_cached(*call)]
    if not missing:
        return 0
    n_missing = sum(product is cleaned.assessment for product, _ in missing)
    cases = list(dict.fromkeys(case for case, *_ in assessments))
    check_memory(cases[0].survey, jobs=n_jobs(), steps=["cleaning"])
    rounds = [cases] if keep_observations or dask_address() else [[case] for case in cases]
    made = []
    for n, now in enumerate(rounds):
        skies = [case.survey.sky for case in now]
        own = [one for one in missing if one[1][0] in [*now, *skies]]
        missing = [one for one in missing if one not in own]
        if own:
            made += make_observations(now) + _make_analyses([call for product, call in own if call[0] in now])
            for product in dict.fromkeys(product for product, _ in own):
                calls = [call for other, call in own if other is product]
                make_all(product, calls, product.name)
        if not keep_observations:
            later = observing_steps([case for others in rounds[n + 1 :] for case in others])
            made = _forgotten(made, {(product, call) for product, calls in later for call in calls})
    return n_missing


@contextmanager
def temporary_observations(cases):
    """Observations of some cases, made where they are missing; what was made is deleted at the end."""
    made = make_observations(cases)
    try:
        yield
    finally:
        _forgotten(made, set())


@contextmanager
def temporary_separations(calls):
    """Separations, made where they are missing; what was made is deleted at the end.

    All that is measured meanwhile reads them, and does not separate again.

    Parameters
    ----------
    calls
        Pairs (case, remover), of cases that are observed (`temporary_observations`).
    """
    missing = [(*call, True) for call in calls if not cleaned.separation.is_cached(*call)]
    made = _make_analyses(missing)
    make_all(cleaned.separation, missing, "separations")
    try:
        yield
    finally:
        _forgotten(made + [(cleaned.separation, call) for call in missing], set())


def _make_analyses(calls):
    """Make the analyses that these calls need; returns what was made, [(product, arguments)]."""
    made = []
    cleanings = [call[:3] for call in calls if len(call) > 1]
    asked = {
        pipeline.analysis: lambda remover: "sphere" in remover.uses,
        pipeline.foreground_analysed: lambda remover: remover.ends,
    }
    for product, asks in asked.items():
        wanted = {(case, peaks): None for case, remover, peaks in cleanings if asks(remover)}
        missing = [call for call in wanted if not product.is_cached(*call)]
        make_all(product, missing, "analysis")
        made += [(product, call) for call in missing]
    return made


def _forgotten(made, needed):
    """Forget what was made, [(product, arguments)], but for what is small or needed; returns what is left."""
    small = (pipeline.true_spectra, pipeline.components_of_sky)
    left = [one for one in made if one in needed]
    for product, call in made:
        if product not in small and (product, call) not in needed:
            product.forget(*call)
    return left
