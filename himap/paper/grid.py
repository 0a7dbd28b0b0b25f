"""Grids of skies and methods for experiments, and the products measured on each sky."""

from dataclasses import dataclass, replace

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.figures import styles
from himap.paper import cleaned, pipeline
from himap.paper.methods import beam_called, check_reading, sdecgmca_for
from himap.paper.mocks import Mock, first_mocks, own_recovery, recovered, transfer_functions
from himap.removal import create
from himap.sky.galaxy import Galaxy
from himap.store.parallel import make_all
from himap.store.store import temporary


@dataclass(frozen=True, kw_only=True)
class Sky:
    """One sky of an experiment. InputError without a method."""

    methods: dict  # {`pipeline.Case`: [method]}: the sky through each beam, and its methods
    mocks: tuple = ()  # of `himap.paper.mocks.Mock`, of other skies
    corrected: tuple | None = None  # names of methods corrected by transfer functions; None for all
    beams: dict | None = None  # {(kind, error): assumed `Beam`}, for the experiment `beam_errors`

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


def cases_of(
    beam,
    *,
    preset="quick",
    survey=None,
    galaxy="synthetic",
    template_dir=None,
    small_scales=True,
    n_realisations=20,
):
    """A list of `pipeline.Case` that differ only in their seed: that of the survey, and the following ones.

    `beam` is a `Beam`; the others are as in `himap.paper.study.Study`. Invalid values raise InputError.
    """
    whole_number("n_realisations", n_realisations, 1, 1000)
    first = pipeline.Case(
        survey=Survey.preset(preset, **(survey or {})),
        galaxy=Galaxy(source=galaxy, template_dir=template_dir, small_scales=small_scales),
        beam=beam,
    )
    seeds = range(first.survey.seed, first.survey.seed + n_realisations)
    return [replace(first, survey=replace(first.survey, seed=seed)) for seed in seeds]


def cases_and_methods(
    *,
    beam="oscillating",
    other_beams=(),
    ripple="bracket",
    methods=(("beam_subspace", 3),),
    reading="default",
    **settings,
):
    """Cases that differ only in their seed, and the methods that clean them, two lists.

    `ripple` is the reading of the oscillating beam, as in `beam_called`, and `reading` that of SDecGMCA.
    Methods are pairs (name, number of sources), None for a method without. Settings and errors are as in
    `cases_of`; a survey with a taper and a reading without SDecGMCA are also refused.
    """
    selected = beam_called(beam, ripple=ripple, others=other_beams)
    cases, removers = cases_of(selected, **settings), []
    cases[0].survey.check_untapered()
    for pair in methods:
        if not isinstance(pair, list | tuple) or len(pair) != 2:
            raise InputError(
                "each of the methods is [name, number of sources], such as ['pca', 5], or ['gnilc', null]; "
                f"got {pair!r}."
            )
        name, n_sources = pair
        remover = create(name, **({} if n_sources is None else {"n_sources": n_sources}))
        if remover.name == "sdecgmca" and n_sources is not None:
            remover = sdecgmca_for(selected, n_sources=n_sources, reading=reading)
        remover.check(cases[0].survey.n_channels)
        removers.append(remover)
    check_reading(reading, removers)
    return cases, removers


def skies_of(*observed, n_mocks=0, **attributes):
    """A list of `Sky` from pairs (cases, methods), one for each beam, as from `cases_and_methods`.

    Each sky has `n_mocks` mocks, with seeds that no sky has; `attributes` are other attributes of `Sky`.
    """
    mocks = tuple(first_mocks(n_mocks, observed[0][0]))
    return [
        Sky(
            methods=dict(zip(cases, (methods for _, methods in observed), strict=True)),
            mocks=mocks,
            **attributes,
        )
        for cases in zip(*(cases for cases, _ in observed), strict=True)
    ]


def make_products(work):
    """Compute products of cases; delete observations and separations that are only computed for them.

    `work` is [(product, arguments)], the first argument a `pipeline.Case`. Products in the cache are not
    recomputed, and need no observation. Coefficients of HI and noise of each `Mock` among the arguments are
    computed first, once for all, and kept; their maps are not.
    """
    surveys = {}
    for product, call in work:
        mocks = [one for one in call if isinstance(one, Mock)]
        if mocks and not product.is_cached(*call):
            surveys |= {replace(call[0].survey, seed=mock.seed): None for mock in mocks}
    with temporary(pipeline.hi_of_sky):
        cleaned.make_hi(survey.sky for survey in surveys)
        make_all([(pipeline.noise_alms, (survey,)) for survey in surveys], "noise of mocks")
    cleaned.make_by_case(work)


def measured_recoveries(sky):
    """The recovery of the truth of a `Sky` by each method, and of its mocks by methods that are corrected.

    Returns a list of (case, method, `MockPower` of the truth, `TransferFunction` or None).
    """
    pairs = [(case, remover) for case, removers in sky.methods.items() for remover in removers]
    corrected = {
        case: tuple(one for one in removers if sky.corrected is None or one.name in sky.corrected)
        for case, removers in sky.methods.items()
    }
    calls = [(case, several, mock) for case, several in corrected.items() if several for mock in sky.mocks]
    make_products([(recovered, call) for call in calls] + [(own_recovery, pair) for pair in pairs])
    transfers = {
        case: transfer_functions(case, several, sky.mocks) if several else {}
        for case, several in corrected.items()
    }
    return [(*pair, own_recovery(*pair), transfers[pair[0]].get(pair[1])) for pair in pairs]


def method_columns(remover):
    """{"method": name, "n_sources": number}, 0 for a method without."""
    return {"method": remover.name, "n_sources": getattr(remover, "n_sources", 0)}


def band_rows(power, **spectra):
    """A row for each band reached by a `MockPower`, with the means of {column: {kind: values}} in it."""
    means = {name: power.band_means(values) for name, values in spectra.items()}
    return [
        {"band": band} | {name: float(mean[band]) for name, mean in means.items()}
        for band in next(iter(means.values()))
    ]


def with_labels(table):
    """The same table, with the number of sources in the label of a method instead of a column."""
    numbers = table.get("n_sources", [0] * len(table))
    labels = [styles.numbered(*pair) for pair in zip(table["method"], numbers, strict=True)]
    return table.assign(method=labels).drop(columns="n_sources", errors="ignore")
