"""Foreground residual and signal loss of a method, each by itself, and the loss that a filter expects.

C/C0 near 1 is no proof that HI is kept: signal loss and foreground residual may cancel.
"""

from dataclasses import dataclass

import numpy as np

from himap.maps import sphere
from himap.maps.low_rank import LowRankCube, centred, projection
from himap.measures.transfer import (
    HarmonicPower,
    TransferFunction,
    expected_mock_power,
    harmonic_power,
    mock_power_of_cubes,
    quotient,
)
from himap.paper import cleaned, pipeline
from himap.removal.analysis import cube_modes
from himap.removal.smooth_spectra import FilteredSeparation
from himap.removal.spectral_filter import filtered, through_beams
from himap.store.store import product


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Powers of what a method makes of an observation, each a `HarmonicPower`.

    Attributes
    ----------
    truth
        HI and noise through the beam.
    recovered
        The residual of the observation: HI kept and foreground left.
    kept
        HI and noise less what the method subtracts of them.
    left
        The foreground residual.
    shared
        What `recovered` and `truth` have in common.
    """

    truth: HarmonicPower
    recovered: HarmonicPower
    kept: HarmonicPower
    left: HarmonicPower
    shared: HarmonicPower

    def ratios(self, kind):
        """Each part over the truth, {"recovered", "kept", "left", "shared": (n,)}.

        `kind` is "angular", by l, or "frequency", by k; 0 where there is no truth.
        """
        powers = {name: getattr(power, kind) for name, power in vars(self).items()}
        truth = powers.pop("truth")
        return {name: quotient(power, truth) for name, power in powers.items()}


def split_error(case, remover, mask_peaks=True):
    """(foreground residual, HI lost) of a component method, two `LowRankCube`; their difference is the error.

    Such a method subtracts a projection P of the maps, once its mixing matrix is known, so that the residual
    of foreground F and truth T, whose peaks D were masked, is off by

        residual - T = (F - P F) - P (T - D).

    P is on the columns of A, or for a method that knows the beam, on diag(H_l) A at every l; of a filter it
    is the filter. What an epsilon of its inversion keeps back is on the side of the foreground. Of a method
    that ends at some l, all is up to that l.

    Parameters
    ----------
    case
        `pipeline.Case`.
    remover
        A method with a number of sources.
    mask_peaks
        As in `cleaned.separation`.
    """
    observed, found = pipeline.observation(case), cleaned.separation(case, remover, mask_peaks)
    known = centred(observed.truth - (observed.maps - pipeline.basis(case, mask_peaks)))
    if found.lmax is not None:
        known = sphere.cut_cube(known, found.lmax)
    if isinstance(found, FilteredSeparation):
        filter_ = found.filter
        hi_lost = filtered(filter_.spectra, filter_.estimators, known, cube_modes(known))
    elif "beams" in remover.uses:
        relative = observed.beams / observed.beams.max(axis=0)
        hi_lost = through_beams(known, found.mixing, relative, cube_modes(known))
    else:
        basis = np.linalg.qr(found.mixing)[0]
        hi_lost = LowRankCube(spectra=basis, maps=projection(basis.T, known))
    return cleaned.error(case, remover, mask_peaks) + hi_lost, hi_lost


def error_parts(case, remover, mask_peaks=True):
    """(foreground residual, HI lost, truth), cubes (n_channels, n_pix) float32, mK, less their channel means.

    Arguments, and the first two, as of `split_error`; the truth ends where the method does.
    """
    left, lost = split_error(case, remover, mask_peaks)
    lmax = cleaned.separation(case, remover, mask_peaks).lmax
    return left.cube(), lost.cube(), centred(pipeline.truth(case, lmax))


@product(name="parts")
def decompose(case, remover, mask_peaks=True):
    """The `Parts` of a component method, up to where it ends; arguments as of `error_parts`."""
    cubes, found = error_parts(case, remover, mask_peaks), cleaned.separation(case, remover, mask_peaks)
    width, lmax = case.survey.channel_width, case.survey.lmax if found.lmax is None else found.lmax
    left, lost, truth = (sphere.analyse(cube, lmax, n_iter=sphere.N_ITER_FLAT) for cube in cubes)
    kept = truth - lost
    power = mock_power_of_cubes(truth, kept + left, width)
    powers = {name: harmonic_power(alms, width) for name, alms in (("kept", kept), ("left", left))}
    return Parts(truth=power.input, recovered=power.output, shared=power.cross, **powers)


@product(name="foreseen")
def expected_loss(case, remover, mask_peaks=True):
    """What a `SmoothSpectra` knows that it keeps of HI and noise, a `MockPower`, without mocks or truth."""
    found = cleaned.separation(case, remover, mask_peaks)
    return expected_mock_power(found, case.survey.channel_width)


def corrected(case, remover, mask_peaks=True):
    """C/C0 and P/P0 once divided by what the method knows that it keeps, {"angular", "frequency": (n,)}."""
    kept = TransferFunction(mocks=(expected_loss(case, remover, mask_peaks),))
    measured = decompose(case, remover, mask_peaks)
    ratios = {kind: measured.ratios(kind)["recovered"] for kind in ("angular", "frequency")}
    return {kind: quotient(ratio, getattr(kept, kind)[: len(ratio)]) for kind, ratio in ratios.items()}
