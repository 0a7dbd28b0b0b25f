"""The turns of SDecGMCA: S from A, thresholds, A from S; warm-up and refinement (paper, Sect. 3.3)."""

from dataclasses import dataclass

import numpy as np

from himap.core.progress import progress
from himap.removal.harmonic import degrees

_MOST_MORE = 50  # iterations of the warm-up beyond its least number, and of the refinement, as in C21's code
_LAST_MOST = 25  # turns of the last S


@dataclass(frozen=True, kw_only=True)
class Step:
    """What one iteration gives.

    Attributes
    ----------
    mixing
        A, columns of unit length, (n_channels, n_sources).
    sources
        S after its thresholds, real modes (n_sources, (lmax + 1)^2).
    refining
        False in the warm-up.
    settled
        Whether S changed by less than the tolerance of its stage.
    """

    mixing: np.ndarray
    sources: np.ndarray
    refining: bool
    settled: bool


def iterations(method, problem, scales, mixing, *, done=0):
    """The `Step` of every iteration in turn.

    Parameters
    ----------
    method
        `SDecGMCA`, for its parameters.
    problem, scales
        `Problem` and `Scales`.
    mixing
        A at the start, (n_channels, n_sources).
    done
        Iterations of the warm-up that led to this A; in the warm-up A is all that the next one needs.
    """
    sources = None
    for refining in (False, True):
        least, tolerance = (
            (method.n_refinement, method.tolerance)
            if refining
            else (method.n_warmup, method.warmup_tolerance)
        )
        memory = scales.empty_memory(mixing.shape[1]) if refining and method.reweighted else None
        most = max(least, _MOST_MORE) if refining else least + _MOST_MORE
        first = 1 if refining else 1 + done
        for count in progress(range(first, most + 1), "refinement" if refining else "warm-up"):
            share = method.share if refining else min(method.share / least * count, method.share)
            epsilon = _epsilon(method, problem, mixing, sources, refining)
            inverses = problem.inverses(mixing, epsilon)
            noise = problem.source_noise(inverses) if scales.analytic else None
            last, (sources, memory) = sources, scales(problem.sources(inverses), noise, share, memory)
            mixing = _mixing(method, problem, scales, sources, mixing)
            settled = last is not None and _change(last, sources) <= tolerance
            yield Step(mixing=mixing, sources=sources, refining=refining, settled=settled)
            if settled and count >= least:
                break


def last_sources(method, problem, scales, mixing, sources):
    """S of the last A (paper, Eq. 23), real modes (n_sources, (lmax + 1)^2).

    `sources` are those of the last iteration, up to their own lmax; where `problem` goes further, epsilon is
    that of strategy #3 there unless S is found in several turns.
    """
    if method.last == "unregularised":
        return problem.sources(problem.inverses(mixing, 0))
    of_matrices = problem.of_matrices(mixing, method.regularisation)
    if method.last == "once":
        epsilon = np.repeat(of_matrices, mixing.shape[1], axis=1)
        if method.last_coefficients == "spectrum":
            own = problem.of_spectra(sources, method.regularisation)
            epsilon[: len(own)] = own
        return problem.sources(problem.inverses(mixing, epsilon))
    return _repeated(method, problem, scales, mixing, of_matrices)


def _repeated(method, problem, scales, mixing, epsilon):
    """S in turns with the epsilon of its own spectra, with thresholds or without."""
    inverses, last, memory = problem.inverses(mixing, epsilon), None, None
    with_thresholds = method.last == "thresholded"
    for count in range(_LAST_MOST + 1):
        sources = problem.sources(inverses)
        if with_thresholds:
            noise = problem.source_noise(inverses) if scales.analytic else None
            sources, memory = scales(sources, noise, 1.0, memory)
            if count == 0 and method.reweighted:
                memory = scales.empty_memory(len(sources))
        # The first S is that of strategy #3, which the turns only start from.
        if count > 1 and _change(last, sources) < method.last_tolerance:
            break
        last = sources
        if method.last_coefficients == "spectrum":
            inverses = problem.inverses(mixing, problem.of_spectra(sources, method.regularisation))
    return sources


def _epsilon(method, problem, mixing, sources, refining):
    if refining and method.coefficients == "spectrum":
        return problem.of_spectra(sources, method.regularisation)
    return problem.of_matrices(mixing, method.regularisation)


def _mixing(method, problem, scales, sources, last):
    """A from S, with its sign and columns of unit length; that of a source that vanished stays as it was."""
    window = scales.detail if method.mixing_scales == "detail" else np.ones(problem.lmax + 1)
    mixing = problem.fit(sources * window[degrees(problem.lmax)], window)
    if method.sign == "nonnegative":
        mixing = np.maximum(mixing * np.where(mixing.sum(axis=0) < 0, -1, 1), 0)
    length = np.linalg.norm(mixing, axis=0)
    return np.where(length > 0, mixing / np.where(length > 0, length, 1), last)


def _change(last, sources):
    """Relative change of the sources, for the stopping rules (paper, Sect. 3.3)."""
    size = np.linalg.norm(sources)
    return np.linalg.norm(sources - last) / size if size else 0.0
