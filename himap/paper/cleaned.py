"""What methods make of observations, as products: what they find, what it is worth, and spectra of it.

Cubes are made only where they are asked for (`residual`): what a method takes is a few spectra times maps,
and what is measured follows from these.
"""

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from himap.core.memory import check_memory, fitting
from himap.instrument.noise import noise_sigma
from himap.maps import sphere
from himap.measures import diagnostics
from himap.measures.diagnostics import Assessment, Comparison
from himap.measures.low_rank_spectra import (
    FAINT,
    Moments,
    frequency_power_without,
    line_errors,
    masked_alms,
    masked_power,
    recovered_power,
)
from himap.measures.spectra import PowerSpectra
from himap.paper import pipeline
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data
from himap.removal.restarts import Ensemble
from himap.removal.spectral_filter import on_sky
from himap.store.parallel import dask_address, make_all, n_jobs
from himap.store.store import product, temporary


def cleaning(case, remover, mask_peaks=True):
    """The `Cleaning` of a case by `remover`, from the products that there are; what it finds is not kept.

    With `mask_peaks` the foreground is found in the peak-masked maps, as in `pipeline.basis`.
    """
    data = data_of(case, pipeline.observation(case).maps, seed=case.survey.rng(f"removal {remover.name}"))
    basis = replace(data, maps=pipeline.basis(case, mask_peaks)) if mask_peaks else data
    basis.known["covariance"] = lambda: pipeline.covariance(case, mask_peaks)
    basis.known["modes"] = lambda: pipeline.analysis(case, mask_peaks)
    if hasattr(remover, "iteration"):  # named by no class, or an edit of that would make all stale
        key = basis.key_of(remover.iteration)
        basis.known[key] = lambda: fit(case, remover.iteration, mask_peaks)
    spread = mask_peaks if isinstance(mask_peaks, str) else "line"
    return Cleaning(data=data, method=remover, basis=basis, spread=spread)


def data_of(case, maps, seed=None):
    """Maps of a case, (n_channels, n_pix), as the `Data` of its instrument."""
    observed = pipeline.observation(case)
    return Data(
        maps=maps, freqs=observed.freqs, beams=observed.beams, noise=noise_sigma(case.survey), seed=seed
    )


@product
def fit(case, remover, mask_peaks=True):
    """The last `Step` of a case by an `SDecGMCA.iteration`, which readings of its last S share."""
    data = cleaning(case, remover, mask_peaks).basis
    del data.known[data.key_of(remover)]  # which is this product
    with threadpool_limits(1, user_api="blas"):
        return remover.fit(data)


@product
def separation(case, remover, mask_peaks=True):
    """The `Separation` that `remover`, a `ForegroundRemover` such as PCA(n_sources=3), makes of a case.

    With `mask_peaks` the foreground is found in the peak-masked maps; it is subtracted from those observed.
    The method comes as an object, not by name, so that its result depends on the code of that method alone.
    """
    remover.check(case.survey.n_channels)
    return cleaning(case, remover, mask_peaks).separation


def ensemble(calls):
    """The `Ensemble` of arguments of `separation` that differ in the restart of their method."""
    first, members = cleaning(*calls[0]), []
    for call in calls:
        members.append(first.with_method(call[1]))
        vars(members[-1])["separation"] = separation(*call)
    return Ensemble(members=tuple(members))


def residual(case, remover, mask_peaks=True, channels=slice(None)):
    """The cube that `remover` leaves, mK, (n_channels, n_pix) float32, or some of its channels; not kept."""
    found, known = separation(case, remover, mask_peaks), cleaning(case, remover, mask_peaks)
    return found.residual(known.data.maps, known.basis, channels)


def error(case, remover, mask_peaks=True):
    """What `remover` leaves more than the truth, a `LowRankCube` less its channel means; not kept.

    An observation is the truth and the foreground, so this is the foreground less that which was found. Where
    the method ends at some l, it is that of the residual up to there against the truth up to there.
    """
    return error_of(case, separation(case, remover, mask_peaks), mask_peaks)


def error_of(case, separation, mask_peaks=True):
    """The same of any `Separation` of a case."""
    endless = separation.lmax is None
    there = pipeline.foreground_seen(case) if endless else pipeline.foreground_analysed(case, mask_peaks)
    return difference(case, on_sky(there, case.survey.nside, separation.lmax), separation.foreground)


def difference(case, one, other):
    """One `LowRankCube` less another, without the terms that no spectrum of the case shows."""
    return (one + -other).truncate(FAINT * float(pipeline.true_spectra(case).angular.variance.sum()))


@product
def assessment(case, remover, mask_peaks=True):
    """The `Assessment` of the residual of a case, separated as in `separation`, against the truth.

    No cube but the truth is there for it: all follows from the error, which is a few spectra times maps. A
    method that ends at some l is compared with the truth at every l all the same, and lacks what is beyond:
    its `cut_truth` is a second measure.
    """
    found = separation(case, remover, mask_peaks)
    wrong, lmax, width = error_of(case, found, mask_peaks), found.lmax, case.survey.channel_width
    truth, spectra, cut = pipeline.truth(case), pipeline.true_spectra(case), None
    low, alms = truth, pipeline.truth_alms_of(case)
    if lmax is not None:
        low, alms = pipeline.truth(case, lmax), pipeline.truth_alms(case, lmax)
        cut = pipeline.spectra_of(low, alms, case.survey)
    moments, errors = Moments.of(low, wrong), line_errors(wrong)
    correlation = moments.correlation
    if cut is not None:
        errors, correlation = _against_all(low, wrong, truth)
    return Assessment(
        power_spectra=PowerSpectra(
            angular=recovered_power(alms, wrong, true=(cut or spectra).angular),
            frequency=moments.frequency_power((cut or spectra).frequency, width),
        ),
        correlation=correlation,
        line_errors=errors,
        converged=found.converged,
        n_iterations=found.n_iterations,
        mixing=found.mixing,
        cut_truth=cut,
        diagnostics=found.diagnostics,
    )


@product
def post_masked(case, remover, mask_peaks=True):
    """`PowerSpectra` of residual and truth without the lines of sight whose error stands out, a pair.

    These are the `flagged_lines` of its `assessment` (paper, Sect. 5.1).
    """
    lmax, known = separation(case, remover, mask_peaks).lmax, assessment(case, remover, mask_peaks)
    removed, width = diagnostics.flagged_lines(known.line_errors), case.survey.channel_width
    wrong, truth = error(case, remover, mask_peaks), pipeline.truth(case)
    seen = masked_alms(truth, mask=~removed, alms=pipeline.truth_alms_of(case))
    total = pipeline.true_spectra(case).frequency
    true = PowerSpectra(
        angular=masked_power(seen, ~removed),
        frequency=frequency_power_without(total, removed, width, truth),
    )
    if lmax is not None:  # a mask mixes multipoles
        truth, alms = pipeline.truth(case, lmax), pipeline.truth_alms(case, lmax)
        seen = masked_alms(truth, mask=~removed, alms=sphere.alms_padded(alms, case.survey.lmax))
    total = known.power_spectra.frequency
    recovered = PowerSpectra(
        angular=recovered_power(seen, wrong, mask=~removed).upto(lmax),
        frequency=frequency_power_without(total, removed, width, truth, wrong),
    )
    return recovered, true


def _against_all(low, wrong, truth):
    """Errors of lines of sight and correlations of a residual that ends, with what the truth has beyond.

    That is an error which is not of low rank, so a channel of the residual is made at a time.
    """
    errors, correlation = np.zeros(truth.shape[1]), np.empty(len(truth))
    for n, (row, spectrum, true) in enumerate(zip(low, wrong.spectra, truth, strict=True)):
        residual = row + spectrum @ wrong.maps
        errors += (residual - true + true.mean(dtype=np.float64)) ** 2 / len(truth)
        correlation[n] = np.corrcoef(residual, true)[0, 1]
    return errors, correlation


def compared(*call, masked=False, average="means"):
    """The `Comparison` of the residual with the truth, of arguments of `assessment`.

    With `masked`, without the lines of sight whose error stands out, in the residual and in the truth.
    `average` as of `Comparison.of`.
    """
    case, *_ = call
    pair = post_masked(*call) if masked else (assessment(*call).power_spectra, pipeline.true_spectra(case))
    return Comparison.of(*pair, l_top=2 * case.survey.nside, average=average)


def make(work):
    """Make what is missing of products, [(product, arguments)], several at a time.

    They are begun in this order. The first argument is a `pipeline.Case`, or the `Survey` of a sky.
    InputError if it will not fit into memory, or what the products refuse.
    """
    missing = [(wanted, call) for wanted, call in work if not wanted.is_cached(*call)]
    cases = dict.fromkeys(call[0] for _, call in missing if isinstance(call[0], pipeline.Case))
    if cases:
        survey = next(iter(cases)).survey
        check_memory(survey, "cleaning", jobs=min(n_jobs(), len(missing)))
        make_hi(case.survey.sky for case in cases if not pipeline.observation.is_cached(case))
        masked = [(pipeline.peak_masked, (case,)) for case in cases]
        make_all(masked, "observations", at_once=fitting(survey, "observing"))
    make_all(missing, "results")


def make_hi(skies):
    """Make the coefficients of HI of some `Survey.sky`, as many at once as the memory holds light cones."""
    if skies := dict.fromkeys(skies):
        at_once = fitting(next(iter(skies)), "HI light cone")
        make_all([(pipeline.hi_alms_of_sky, (sky,)) for sky in skies], "HI", at_once=at_once)


def make_by_case(work):
    """`make`, but observations and separations that were made for it do not stay.

    One case is done after the other, so that a disk holds no more than one; a Dask cluster gets all at once.
    """
    skies = {}
    for wanted, call in work:
        case = call[0]
        sky, case = (None, None) if dask_address() else (getattr(case, "survey", case).sky, case)
        if not wanted.is_cached(*call):
            skies.setdefault(sky, {}).setdefault(case, []).append((wanted, call))
    for by_case in skies.values():
        with temporary(*pipeline.OF_SKIES):
            for pieces in by_case.values():
                with temporary(*pipeline.OF_CASES, fit, separation):
                    make(pieces)
