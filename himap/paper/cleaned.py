"""Results of methods on observations, as products: separations, their quality, and spectra.

Cubes are made only on request (`residual`): a method subtracts a few spectra times maps, and measurements
follow from these.
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
    """The `Cleaning` of a case by `remover`, from existing products; its results are not stored.

    With `mask_peaks` the foreground is estimated in the peak-masked maps, as in `pipeline.basis`.
    """
    data = data_of(case, pipeline.observation(case).maps, seed=case.survey.rng(f"removal {remover.name}"))
    basis = replace(data, maps=pipeline.basis(case, mask_peaks)) if mask_peaks else data
    basis.known["covariance"] = lambda: pipeline.covariance(case, mask_peaks)
    basis.known["modes"] = lambda: pipeline.analysis(case, mask_peaks)
    if hasattr(remover, "iteration"):  # not by class, as an edit of the class would make all products stale
        key = basis.key_of(remover.iteration)
        basis.known[key] = lambda: fit(case, remover.iteration, mask_peaks)
    spread = mask_peaks if isinstance(mask_peaks, str) else "line"
    return Cleaning(data=data, method=remover, basis=basis, spread=spread)


def data_of(case, maps, seed=None):
    """Maps of a case, (n_channels, n_pix), as `Data` with its instrument."""
    observed = pipeline.observation(case)
    return Data(
        maps=maps, freqs=observed.freqs, beams=observed.beams, noise=noise_sigma(case.survey), seed=seed
    )


@product
def fit(case, remover, mask_peaks=True):
    """The last `Step` of an `SDecGMCA.iteration` on a case, shared by readings that differ in the last S."""
    data = cleaning(case, remover, mask_peaks).basis
    del data.known[data.key_of(remover)]  # that is this product
    with threadpool_limits(1, user_api="blas"):
        return remover.fit(data)


@product
def separation(case, remover, mask_peaks=True):
    """The `Separation` of a case by `remover`, a `ForegroundRemover` such as PCA(n_sources=3).

    With `mask_peaks` the foreground is estimated in the peak-masked maps; it is subtracted from the observed
    ones. The method is an object, not a name, so that the result depends only on the code of that method.
    """
    remover.check(case.survey.n_channels)
    return cleaning(case, remover, mask_peaks).separation


def ensemble(calls):
    """The `Ensemble` of calls of `separation` that differ in the restart of their method."""
    first, members = cleaning(*calls[0]), []
    for call in calls:
        members.append(first.with_method(call[1]))
        vars(members[-1])["separation"] = separation(*call)
    return Ensemble(members=tuple(members))


def residual(case, remover, mask_peaks=True, channels=slice(None)):
    """The residual cube of `remover`, mK, (n_channels, n_pix) float32, or some channels; not stored."""
    found, known = separation(case, remover, mask_peaks), cleaning(case, remover, mask_peaks)
    return found.residual(known.data.maps, known.basis, channels)


def error(case, remover, mask_peaks=True):
    """Residual of `remover` minus truth, a `LowRankCube` less its channel means; not stored.

    An observation is truth plus foreground, so this is the foreground minus its estimate. If the method ends
    at some l, both residual and truth are limited to that l.
    """
    return error_of(case, separation(case, remover, mask_peaks), mask_peaks)


def error_of(case, separation, mask_peaks=True):
    """The same for any `Separation` of a case."""
    endless = separation.lmax is None
    there = pipeline.foreground_seen(case) if endless else pipeline.foreground_analysed(case, mask_peaks)
    return difference(case, on_sky(there, case.survey.nside, separation.lmax), separation.foreground)


def difference(case, one, other):
    """One `LowRankCube` minus another, without terms too faint for the spectra of the case."""
    return (one + -other).truncate(FAINT * float(pipeline.true_spectra(case).angular.variance.sum()))


@product
def assessment(case, remover, mask_peaks=True):
    """The `Assessment` of the residual of a case, separated as in `separation`, against the truth.

    Only the cube of the truth is needed: everything follows from the error, a few spectra times maps. A
    method that ends at some l is nevertheless compared with the truth at every l, and lacks all beyond: its
    `cut_truth` is a second measure.
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
    if cut is not None:  # the full error is not of low rank: one channel of the residual at a time
        errors, correlation = np.zeros(truth.shape[1]), np.empty(len(truth))
        for n, (row, spectrum, true) in enumerate(zip(low, wrong.spectra, truth, strict=True)):
            residual = row + spectrum @ wrong.maps
            errors += (residual - true + true.mean(dtype=np.float64)) ** 2 / len(truth)
            correlation[n] = np.corrcoef(residual, true)[0, 1]
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
    """`PowerSpectra` of residual and truth without lines of sight with exceptional errors, a pair.

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


def compared(*call, masked=False, average="means"):
    """The `Comparison` of the residual with the truth, for arguments of `assessment`.

    With `masked`, lines of sight with exceptional errors are excluded from the residual and from the truth.
    `average` is as in `Comparison.of`.
    """
    case, *_ = call
    pair = post_masked(*call) if masked else (assessment(*call).power_spectra, pipeline.true_spectra(case))
    return Comparison.of(*pair, l_top=2 * case.survey.nside, average=average)


def make(work):
    """Compute missing products, [(product, arguments)], several at a time.

    They start in this order. The first argument is a `pipeline.Case`, or the `Survey` of a sky. InputError if
    they do not fit into memory, or if a product refuses its input.
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
    """Compute the coefficients of HI of some `Survey.sky`, as many at once as fit into memory."""
    if skies := dict.fromkeys(skies):
        at_once = fitting(next(iter(skies)), "HI light cone")
        make_all([(pipeline.hi_alms_of_sky, (sky,)) for sky in skies], "HI", at_once=at_once)


def make_by_case(work):
    """Like `make`, but observations and separations computed for it are deleted afterwards.

    Cases are computed one after the other, so the disk holds only one; a Dask cluster gets all at once.
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
