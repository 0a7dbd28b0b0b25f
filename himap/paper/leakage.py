"""Foreground residual and signal loss of a method, separately, and the loss that a filter expects.

C/C0 near 1 does not prove that HI is preserved: signal loss and foreground residual may cancel.
"""

from functools import partial

import numpy as np

from himap.maps.low_rank import LowRankCube, blocks, projection
from himap.measures.diagnostics import flagged_lines
from himap.measures.transfer import TransferFunction, expected_mock_power, mock_power, quotient
from himap.paper import cleaned, pipeline
from himap.removal.smooth_spectra import FilteredSeparation
from himap.removal.spectral_filter import filtered, through_beams
from himap.store.store import product


def split_error(case, remover, mask_peaks=True):
    """(foreground residual, HI lost) of a component method, two `LowRankCube`; their difference is the error.

    Given its mixing matrix, such a method subtracts a projection P of the maps. The residual of foreground F
    and truth T, whose peaks D were masked, therefore has the error

        residual - T = (F - P F) - P (T - D).

    P is on the columns of A, or, for a method that knows the beam, on diag(H_l) A at every l; for a filter it
    is the filter. The part held back by an epsilon of its inversion counts as foreground. For a method that
    ends at some l, all parts end there. Arguments are those of `cleaned.separation`, for a method with a
    number of sources.
    """
    found = cleaned.separation(case, remover, mask_peaks)
    signal = case, mask_peaks, found.lmax
    project = partial(projection, maps=pipeline.signal(*signal))
    if isinstance(found, FilteredSeparation):
        filter_, modes = found.filter, pipeline.signal_analysed(*signal)
        hi_lost = filtered(filter_.spectra, filter_.estimators, project, modes)
    elif "beams" in remover.uses:
        beams = pipeline.observation(case).beams
        modes = pipeline.signal_analysed(*signal)
        hi_lost = through_beams(project, found.mixing, beams / beams.max(axis=0), modes)
    else:
        basis = np.linalg.qr(found.mixing)[0]
        hi_lost = LowRankCube(spectra=basis, maps=project(basis.T))
    return cleaned.error(case, remover, mask_peaks) + hi_lost, hi_lost


@product
def error_parts(case, remover, mask_peaks=True):
    """Mean squares of the error of a component method and of its two parts, mK^2, by channel.

    {"foreground residual", "signal loss" or "error": {"flagged", "others" or "all": (n_channels,)}}: on the
    lines of sight of `flagged_lines`, on the others and on all. Arguments as in `split_error`.
    """
    flagged = flagged_lines(cleaned.assessment(case, remover, mask_peaks).line_errors)
    residual, hi_lost = split_error(case, remover, mask_peaks)
    products = {"flagged": 0.0, "all": 0.0}
    for block in blocks(len(flagged)):
        maps, some = residual.maps[:, block], residual.maps[:, block][:, flagged[block]]
        products["all"] += maps @ maps.T
        products["flagged"] += some @ some.T
    products["others"] = products["all"] - products["flagged"]
    n_lines = {"flagged": flagged.sum(), "others": np.sum(~flagged), "all": len(flagged)}
    n_spectra = residual.spectra.shape[1]
    of_error = np.arange(n_spectra) < n_spectra - hi_lost.spectra.shape[1]  # the others belong to the loss
    parts = {"foreground residual": 1, "signal loss": ~of_error, "error": of_error}
    spectra = {name: residual.spectra * columns for name, columns in parts.items()}
    return {
        name: {place: np.sum(one @ products[place] * one, axis=1) / n for place, n in n_lines.items()}
        for name, one in spectra.items()
    }


@product(name="parts")
def decompose(case, remover, mask_peaks=True):
    """{part: `HarmonicPower`} of the result of a component method on an observation, up to its last l.

    Parts are "truth", HI and noise through the beam; "recovered", the residual of the observation; "kept", HI
    and noise less the subtracted part; "left", the foreground residual; and "shared", the cross power of the
    first two. Arguments as in `split_error`.
    """
    residual, hi_lost = split_error(case, remover, mask_peaks)
    alms = pipeline.truth_alms(case, cleaned.separation(case, remover, mask_peaks).lmax)
    recovered, kept, alone = (
        mock_power(cube, error, case.survey.channel_width)
        for cube, error in ((alms, residual + -hi_lost), (alms, -hi_lost), (0 * alms, residual))
    )
    parts = {"truth": recovered.input, "recovered": recovered.output, "shared": recovered.cross}
    return parts | {"kept": kept.output, "left": alone.output}


def ratios(parts, kind):
    """All parts of `decompose` divided by the truth, {part: (n,)}; 0 where there is no truth.

    `kind` is "angular", by l, or "frequency", by k.
    """
    powers = {name: getattr(power, kind) for name, power in parts.items()}
    return {name: quotient(power, powers["truth"]) for name, power in powers.items()}


@product(name="foreseen")
def expected_loss(case, remover, mask_peaks=True):
    """Recovery of HI and noise expected by a `SmoothSpectra`, a `MockPower`, without mocks or truth."""
    found = cleaned.separation(case, remover, mask_peaks)
    return expected_mock_power(found, case.survey.channel_width)


def corrected(case, remover, mask_peaks=True):
    """C/C0 and P/P0 divided by the recovery expected by the method, {"angular", "frequency": (n,)}."""
    kept = TransferFunction(mocks=(expected_loss(case, remover, mask_peaks),))
    parts, over = decompose(case, remover, mask_peaks), {}
    for kind in ("angular", "frequency"):
        ratio = ratios(parts, kind)["recovered"]
        over[kind] = quotient(ratio, getattr(kept, kind)[: len(ratio)])
    return over
