"""Grids of skies and methods: what an experiment runs over, and how all that it measures on a sky is made."""

from dataclasses import dataclass, replace

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.instrument.beams import named
from himap.paper import cleaned, pipeline, plan
from himap.paper.methods import paper_beams, sdecgmca_for
from himap.paper.mocks import make_mocks, own_recovery, recovered, transfer_functions
from himap.removal import create
from himap.sky.galaxy import Galaxy
from himap.store.parallel import make_all


@dataclass(frozen=True, kw_only=True)
class Sky:
    """One sky of an experiment.

    Attributes
    ----------
    methods
        {`pipeline.Case`: [method]}: the sky through each beam, and what cleans that.
    mocks
        Tuple of `himap.paper.mocks.Mock`, of other skies.

    Raises
    ------
    InputError
        No method.
    """

    methods: dict
    mocks: tuple = ()

    def __post_init__(self):
        if not all(self.methods.values()):
            raise InputError("there must be methods, one or more, got none.")

    @property
    def survey(self):
        """The `Survey` of the first case."""
        return next(iter(self.methods)).survey

    @property
    def galaxy(self):
        """The `Galaxy`."""
        return next(iter(self.methods)).galaxy


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
    """Cases that differ in their seed only, and the methods that clean them, two lists.

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


def make_products(work):
    """Make what is measured on cases; observations and separations that are made for it are deleted.

    `work` is [(product, arguments)], the first argument a `pipeline.Case`. What the cache holds is not made
    again, and nothing is observed for it.
    """
    missing = [(product, call) for product, call in work if not product.is_cached(*call)]
    cases = list(dict.fromkeys(call[0] for _, call in missing))
    cleanings = dict.fromkeys(pair for product, call in missing for pair in _separations(product, call))
    mocks = dict.fromkeys(call[2] for product, call in missing if product is recovered)
    with plan.temporary_observations(cases), plan.temporary_separations(cleanings):
        if mocks:
            make_mocks([case.survey for case in cases], mocks)
        for product in dict.fromkeys(product for product, _ in missing):
            calls = [call for other, call in missing if other is product]
            make_all(product, calls, product.name.rpartition(".")[2])


def _separations(product, call):
    """Pairs (case, method) of the separations that a product reads."""
    if product is recovered:
        return [(call[0], remover) for remover in call[1]]
    return [call[:2]] if product in (own_recovery, cleaned.assessment) else []


def measured_recoveries(sky, corrected):
    """What methods keep of the truth of a `Sky`, and of its mocks.

    `corrected` are the names of the methods that have a transfer function. Returns a list of (case, method,
    `MockPower` of the truth, `TransferFunction` or None).
    """
    wanted = {
        case: tuple(one for one in removers if one.name in corrected)
        for case, removers in sky.methods.items()
    }
    pairs = [(case, remover) for case, removers in sky.methods.items() for remover in removers]
    work = [(recovered, (case, several, mock)) for case, several in wanted.items() for mock in sky.mocks]
    make_products([one for one in work if one[1][1]] + [(own_recovery, pair) for pair in pairs])
    found = {case: transfer_functions(case, own, sky.mocks) if own else {} for case, own in wanted.items()}
    return [(case, remover, own_recovery(case, remover), found[case].get(remover)) for case, remover in pairs]
