"""Small calls of every product, method and beam: `himap verify` compares their results with stored ones.

They use nside 16, 24 channels and a box of 16 cells; code with a branch for resolution is also called at
nside 64. Methods and beams that are not listed here have their default parameters. SDecGMCA runs one
iteration of each kind, because its numbers are chaotic after a few. No call covers:

- skies of templates and of PySM, whose files are not shipped, and small scales beyond a template's;
- HI of a smoothed density;
- readings of SDecGMCA except the default, its noise by channels, and thresholds on HEALPix pixels;
- GNILC with a prior, contrasts of FastICA and penalties of GMCA except the default;
- readings of the ripple and of Degraded's noise except the default, b_l in a file;
- mocks of another bias, a region of one cap, data processed in blocks because they are large.

Such code counts as equal if all other code gives equal numbers: check changes of it in another way.
"""

import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from himap import removal
from himap.core.survey import Survey
from himap.instrument import beams
from himap.paper import choice, cleaned, evidence, leakage, masked, mocks, pipeline
from himap.paper.experiments import (
    EXPERIMENTS,
    authors,
    beam_errors,
    boxes,
    claims,
    flags,
    measuring_code,
    methods,
    n_sources,
    readings,
    restarts,
    transfer,
)
from himap.paper.grid import Sky
from himap.paper.realisation import Realisation
from himap.sky.galaxy import Dimming, Galaxy
from himap.store.store import describe

SURVEY = Survey(nside=16, n_channels=24, box_cells=16)
FINE = Survey(nside=64, n_channels=12, box_cells=16)
CASE = pipeline.Case(survey=SURVEY, galaxy=Galaxy(source="synthetic"), beam=beams.Oscillating())
SMOOTHED = replace(CASE, beam=beams.Degraded())
FINE_CASE = replace(CASE, survey=FINE)
TAPERED = replace(CASE, survey=replace(SURVEY, taper="hann"))
RIPPLE_CASE = replace(CASE, survey=replace(SURVEY, n_channels=64))  # its k include the ripple
REGION = masked.Region(latitude=20.0)
PLAIN = removal.PCA(n_sources=3)
AWARE = removal.BeamSubspace(n_sources=3, lmax=32)
ONE_ITERATION = {"n_sources": 3, "lmax": 32, "n_scales": 3, "n_warmup": 1, "n_refinement": 1}
ONCE = ONE_ITERATION | {"warmup_tolerance": 1e30, "tolerance": 1e30}
ONE_STEP = removal.SDecGMCA(**ONCE, beyond="cut")
RIPPLED = beams.Rippled()
MOCKS = (mocks.Mock(seed=7), mocks.Mock(seed=8))
REALISATION = Realisation(
    survey=RIPPLE_CASE.survey, galaxy=CASE.galaxy, n_sources=(2, 3), options=tuple(ONCE.items())
)
JUDGED = claims.JudgedSky({"default": [REALISATION, replace(REALISATION, restart=1)]})

_PRODUCTS = {
    pipeline.hi_of_sky: [(SURVEY.sky,), (replace(SURVEY.sky, hi_bias="contrast"),)],
    pipeline.hi_alms_of_sky: [(SURVEY.sky,)],
    pipeline.noise_alms: [(SURVEY,)],
    pipeline.components_of_sky: [(SURVEY.sky, CASE.galaxy), (FINE.sky, CASE.galaxy)],
    pipeline.foreground_modes_of_sky: [
        (SURVEY.sky, CASE.galaxy, None),
        (SURVEY.sky, CASE.galaxy, Dimming()),
    ],
    pipeline.observation: [(CASE,), (SMOOTHED,)],
    pipeline.peak_masked: [(CASE,)],
    pipeline.covariance: [(CASE,)],
    pipeline.analysis: [(CASE,), (CASE, False), (FINE_CASE,)],
    pipeline.signal_analysed: [(CASE,)],
    pipeline.foreground_seen: [(CASE,)],
    pipeline.foreground_analysed: [(CASE,)],
    pipeline.true_spectra: [(CASE,), (SMOOTHED,), (TAPERED,)],
    cleaned.fit: [(CASE, removal.SDecGMCA(**ONCE).iteration)],
    cleaned.separation: [(CASE, PLAIN), (CASE, PLAIN, False), (CASE, AWARE)],
    cleaned.assessment: [(CASE, PLAIN), (CASE, AWARE), (TAPERED, removal.Polynomial(variable="logarithm"))],
    cleaned.post_masked: [(CASE, PLAIN)],
    evidence.sky_brightness: [(SURVEY.sky, CASE.galaxy)],
    evidence.masked_voxels: [(CASE,)],
    evidence.noise_and_hi: [(CASE,), (SMOOTHED,)],
    evidence.spectra_without_sources: [(SMOOTHED, removal.Parametric())],
    evidence.dimmed_spectra: [(CASE, PLAIN, Dimming())],
    evidence.error_of_flagged_lines: [(CASE, PLAIN)],
    evidence.peak_without_lines: [(CASE, PLAIN)],
    choice.eigenvalues: [(CASE,), (CASE, True)],
    choice.minka: [(CASE,)],
    mocks.hi_alms_of_mock: [
        (replace(SURVEY, seed=7).sky, mocks.Mock(seed=7, gaussian=True, abundance=1.5)),
    ],
    mocks.recovered: [(CASE, (PLAIN, AWARE), mocks.Mock(seed=7))],
    mocks.foreground_like: [(CASE, (mocks.Mock(seed=7),))],
    mocks.foreground_left: [(CASE, AWARE, (mocks.Mock(seed=7),))],
    mocks.resampled: [(CASE, (PLAIN, AWARE), mocks.Mock(seed=7), (mocks.Mock(seed=7), mocks.Mock(seed=8)))],
    mocks.own_recovery: [(CASE, PLAIN), (CASE, AWARE)],
    masked.separation: [(CASE, PLAIN, REGION), (CASE, AWARE, REGION)],
    masked.compared: [(CASE, PLAIN, REGION, way) for way in masked.WAYS],
    masked.by_depth: [(CASE, PLAIN, REGION, "inside")],
    leakage.error_parts: [(CASE, PLAIN)],
    leakage.decompose: [(CASE, PLAIN), (CASE, removal.SmoothSpectra())],
    leakage.expected_loss: [(CASE, removal.SmoothSpectra())],
    authors.member: [(RIPPLE_CASE, ONE_STEP)],
    authors.first_mixings: [(CASE, removal.SDecGMCA(**ONCE), 1)],
    beam_errors.recovery_assuming: [(CASE, PLAIN, RIPPLED), (CASE, AWARE, RIPPLED)],
}
_EXPERIMENTS = {
    authors: (Sky(methods={RIPPLE_CASE: [ONE_STEP, replace(ONE_STEP, restart=1)]}), {}),
    beam_errors: (
        Sky(methods={CASE: [PLAIN, AWARE]}, beams={("width", 0.0): CASE.beam, ("ripple", 0.1): RIPPLED}),
        {"methods": [("pca", 3)]},
    ),
    boxes: (SMOOTHED, {}),
    **dict.fromkeys((claims, flags, readings, restarts), (JUDGED, {"n_restarts": 2})),
    methods: (
        Sky(methods={CASE: [PLAIN, AWARE]}, mocks=MOCKS, corrected=("pca",)),
        {"beams": ["oscillating"], "methods": [("pca", 3)], "corrected": ["pca"]},
    ),
    n_sources: (
        Sky(methods={CASE: [replace(PLAIN, n_sources=n) for n in (3, 4, 5)]}, mocks=MOCKS),
        {"beams": ["oscillating"], "noises": [1, 2], "methods": ["pca"]},
    ),
    transfer: (Sky(methods={CASE: [PLAIN, AWARE]}, mocks=MOCKS), {"methods": [("pca", 3)]}),
}
"""{module of an experiment: (a sky to measure, parameters of its skies)}."""

_CHOSEN_METHODS = (
    PLAIN,
    removal.FastICA(n_sources=3),
    removal.GMCA(n_sources=3, n_scales=3),
    AWARE,
    removal.SDecGMCA(**ONCE),
    # With these bounds its search ends in the same way on all machines.
    removal.GaussianProcess(shortest=400.0, longest_hi=2.0),
)


def _call_of(product, arguments):
    shown = _SHOWN.get(product, lambda result: result)
    return lambda: shown(product.compute(*arguments))


def _separated(separation):
    """The foreground, and the size of its spectra; the signs of eigenvectors are arbitrary."""
    return separation.foreground.cube(), np.abs(separation.mixing), separation.lmax


def _columns_of(rows):
    """{column: array} of the rows of an experiment, numbers or text; sentences are omitted."""
    columns = {name: [row[name] for row in rows] for name in rows[0] if name != "sentence"}
    return {
        name: np.array(values, dtype=float if any(isinstance(one, float) for one in values) else str)
        for name, values in columns.items()
    }


_ITERATED = ("condition", "change", "converged")  # of an iteration that does not converge
_SHOWN = {
    authors.first_mixings: np.abs,
    authors.member: lambda numbers: {
        name: list(values.values()) for name, values in numbers.items() if name not in _ITERATED
    },
    # Spectra of the residual, at the level of HI; without length and diagnostics of an iteration.
    cleaned.assessment: lambda one: replace(one, mixing=np.abs(one.mixing), n_iterations=0, diagnostics=None),
    cleaned.fit: lambda fit: fit.mixing @ fit.sources,  # whose signs are fixed
    cleaned.separation: _separated,
    masked.separation: _separated,
    choice.eigenvalues: lambda eigenvalues: eigenvalues[:6],  # those above the rounding of the maps
    **dict.fromkeys((one.measure for one in _EXPERIMENTS), _columns_of),
}


def _beam_of_file():
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "widths.txt")
        np.savetxt(path, np.linspace(1.6, 1.1, SURVEY.n_channels))
        return beams.FromFile(path=str(path)).of_survey(SURVEY)


_METHODS = {name: removal.create(name) for name in removal.available()}
_METHODS |= {method.name: method for method in _CHOSEN_METHODS}
_PERTURBED = beams.PerturbedBeam(width=0.1, ripple=0.1)
_NAMES = [name for name in beams.available() if name != beams.FromFile.name]
_BEAMS = {name: partial(beams.create(name).of_survey, SURVEY) for name in _NAMES}
_BEAMS |= {beams.FromFile.name: _beam_of_file, _PERTURBED.name: partial(_PERTURBED.of_survey, SURVEY)}


def further_codes(tree):
    """{name: digest} of further dependencies of the experiments' records, their skies, in a `CodeTree`."""
    return {f"skies_{name}": measuring_code(name, tree)["code"] for name in EXPERIMENTS}


CALLS = (
    {product.name: [_call_of(product, call) for call in calls] for product, calls in _PRODUCTS.items()}
    | {one.measure.name: [_call_of(one.measure, (sky,))] for one, (sky, _) in _EXPERIMENTS.items()}
    | {name: [_call_of(cleaned.assessment, (CASE, method))] for name, method in _METHODS.items()}
    | {name: [call] for name, call in _BEAMS.items()}
    | {
        f"skies_{one.EXPERIMENT.name}": [
            lambda one=one, given=given: describe(one.skies(preset="ci", n_realisations=2, **given))
        ]
        for one, (_, given) in _EXPERIMENTS.items()
    }
)
"""{fixed name: functions without arguments}."""

_RESIDUALS = dict.fromkeys(
    (
        *("assessment", "error_of_flagged_lines", "foreseen", "masked_by_depth", "masked_comparison"),
        *("member", "own_recovery", "parts", "peak_without_lines", "recovered", "recovery_assuming"),
        "spectra_without_sources",
        *_METHODS,
    ),
    3e-4,
)
RTOLS = _RESIDUALS | {"analysis": 1e-3, "gnilc": 1e-3, "gaussian_process": 1e-3, "foreground_like": 1e-4}
RTOLS |= (
    {"resampled": 3e-3, "foreground_left": 3e-3}
    | {one.measure.name: 3e-3 for one in _EXPERIMENTS}
    | {"measured_transfer": 1.5e-2}
)
"""Products on which machines agree less closely: about three times the difference between two processors in
the faint part of a bright foreground in single precision, and where a search ends."""
