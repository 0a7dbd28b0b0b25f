"""SDecGMCA from many starts, measured in the same way as runs of its authors' public code.

Iteration, sky and measures are those of the stored ensemble of that code
(`himap.paper.authors_code.read_authors_ensemble`): the reading "code", with thresholds on HEALPix pixels.
"""

import itertools
from dataclasses import replace

import numpy as np
from scipy.linalg import subspace_angles

from himap.core.checks import whole_number
from himap.instrument.beams.paper import Oscillating
from himap.measures.diagnostics import BUMP, Comparison, band_means, inside
from himap.measures.low_rank_spectra import line_errors
from himap.paper import cleaned, pipeline
from himap.paper.grid import cases_of, skies_of
from himap.paper.methods import sdecgmca_for
from himap.paper.readings import BANDS, flagged_shares
from himap.paper.record import Experiment
from himap.store.store import product

N_ITERATIONS = 30
"""Number of iterations whose A is stored."""

FLOORS = (1e-9, 1e-14)
"""Floors of the last S: that of the authors' code, and rounding."""

_L_MAX = 64
_BANDS = {
    "C/C0, 2 to 9": ("angular", 1.5, 9.5),
    f"C/C0, 10 to {_L_MAX}": ("angular", 9.5, _L_MAX + 0.5),
} | {name: band for name, band in BANDS.items() if band[0] == "frequency"}


def of_code(beam, *, restart=0, **options):
    """The `SDecGMCA` equivalent to the authors' code, from one start, except for `options`."""
    return sdecgmca_for(beam, **{"reading": "code", "pixels": "healpix", "restart": restart} | options)


def skies(*, ripple="bracket", n_sources=5, n_restarts=16, **settings):
    """A list of `Sky`, each with the methods of `n_restarts` starts; settings and errors as in `cases_of`."""
    whole_number("n_restarts", n_restarts, 1, 1000)
    cases = cases_of(Oscillating(ripple=ripple), **settings)
    methods = [of_code(cases[0].beam, restart=k, n_sources=n_sources) for k in range(n_restarts)]
    methods[0].check(cases[0].survey.n_channels)
    return skies_of((cases, methods))


@product(name="measured_authors")
def measure(sky):
    """Numbers for every start on a `Sky`, rows with the columns "restart", "quantity", "x" and "value"."""
    rows = []
    for case, methods in sky.methods.items():
        cleaned.make_by_case([(made, (case, one)) for made in (member, first_mixings) for one in methods])
        plain = first_mixings(case, methods[0])
        for one in methods:
            numbers = member(case, one)
            curves = growth(first_mixings(case, one), plain if one.restart else None)
            curves["condition"] |= numbers["condition"]
            rows += rows_of(one.restart, numbers | curves)
    return rows


def rows_of(restart, curves):
    """Rows for {quantity: {x: value}} of one start."""
    return [
        {"restart": restart, "quantity": quantity, "x": float(x), "value": float(value)}
        for quantity, curve in curves.items()
        for x, value in curve.items()
    ]


@product
def first_mixings(case, remover, n_iterations=N_ITERATIONS):
    """A of an `SDecGMCA` at the start and after each of the first iterations, (n, n_channels, n_sources).

    There are fewer if the iteration ends before.
    """
    mixture, scales, start = remover.problem(cleaned.cleaning(case, remover).basis)
    steps = itertools.islice(remover.iterate(mixture, scales, start), n_iterations)
    return np.array([start, *(step.mixing for step in steps)])


def growth(mixings, plain=None):
    """Condition number of A by iteration, and its angle from the columns of another run.

    `mixings` are A after each iteration, (n, n_channels, n_sources), and `plain` those of the other run, or
    None. Returns {"condition": {iteration: number}, "angle": {iteration: sine of the largest angle}}.
    """
    curves = {"condition": dict(enumerate(np.linalg.cond(mixings)))}
    if plain is not None:
        pairs = zip(mixings, plain, strict=True)
        curves["angle"] = {n: np.sin(subspace_angles(one, two).max()) for n, (one, two) in enumerate(pairs)}
    return curves


@product
def member(case, remover):
    """Numbers for one start, {quantity: {iteration, or floor of the last S: value}}."""
    last = {floor: replace(remover, last_floor=floor) for floor in FLOORS}
    found = cleaned.separation(case, last[FLOORS[0]]).diagnostics
    ends = [found["n_warmup"], found["n_warmup"] + found["n_refinement"]]
    changes = [found["warmup_change"], found["refinement_change"]]
    converged = np.array(changes) <= [remover.warmup_tolerance, remover.tolerance]
    numbers = {}
    for floor, one in last.items():
        result = cleaned.assessment(case, one)
        whole, cut = (
            Comparison.of(result.power_spectra, truth, l_top=_L_MAX)
            for truth in (pipeline.true_spectra(case), result.cut_truth)
        )
        error = np.abs(whole.angular_ratio - 1)
        numbers[floor] = {
            **flagged_shares(line_errors(cleaned.error(case, one)), none=0),
            "mean error": inside(whole.degrees, error, 9, _L_MAX + 1).mean(),
            **_ratios(whole),
            **{f"{name}, cut": ratio for name, ratio in _ratios(cut).items() if not name.startswith("C")},
        }
    return {
        "condition": {ends[1]: found["condition"]},
        "change": dict(zip(ends, changes, strict=True)),
        "converged": dict(zip(ends, converged.astype(float), strict=True)),
    } | {name: {floor: float(one[name]) for floor, one in numbers.items()} for name in numbers[FLOORS[0]]}


def _ratios(one):
    """Mean ratios of a `Comparison` in `_BANDS`, and the highest P/P0 near k = 0.31."""
    means = band_means(one.ratios, one.degrees, one.k, _BANDS, complete=False)
    return means | {"bump": inside(one.k, one.frequency_ratio, *BUMP).max()}


def _summary(rows):
    """Quantiles over restarts of every number, except those of the first iterations."""
    last = rows[(rows["x"] > 0) & ((rows["x"] < 1) | (rows["x"] > N_ITERATIONS))]
    table = last.groupby(["quantity", "x"], sort=False)["value"].quantile([0.16, 0.5, 0.84]).unstack()
    table.columns = ["16 %", "median", "84 %"]
    return table.reset_index().map(lambda value: f"{value:.3g}" if isinstance(value, float) else value)


EXPERIMENT = Experiment(
    name="authors",
    chapter="27_restarts",
    columns={"restart": int, "quantity": str, "x": float, "value": float},
    key=("restart", "quantity"),
    skies=skies,
    measure=measure,
    summary=_summary,
    defaults={"preset": "ci", "n_realisations": 1, "n_restarts": 16},
    without=("reading", "results", "records", "flags", "reference"),
)
