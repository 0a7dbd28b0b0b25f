"""Foreground left and HI lost, each by itself, and what a filter foresees of it.

C/C0 near 1 is no proof that HI is kept: what is lost of it and what is left of the foreground may cancel.
"""

from dataclasses import dataclass

import numpy as np

from himap.maps import sphere
from himap.maps.low_rank import centred
from himap.measures.transfer import (
    HarmonicPower,
    MockPower,
    TransferFunction,
    expected_mock_power,
    harmonic_power,
)
from himap.paper import cleaned, pipeline
from himap.paper.losses import error_parts
from himap.removal.analysis import analysed
from himap.removal.smooth_spectra import FilteredSeparation
from himap.store.store import product


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Powers of what a method makes of an observation, each a `HarmonicPower`.

    Attributes
    ----------
    truth
        HI and noise through the beam.
    recovered
        What is left of the observation: HI kept and foreground left.
    kept
        HI and noise less what the method takes of them.
    left
        What it leaves of the foreground.
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
        truth = getattr(self.truth, kind)
        return {
            name: np.divide(getattr(power, kind), truth, out=np.zeros_like(truth), where=truth > 0)
            for name, power in vars(self).items()
            if name != "truth"
        }


@product
def parts(case, remover, mask_peaks=True):
    """The `Parts` of one of the component methods, up to where it ends.

    Parameters
    ----------
    case
        `pipeline.Case`.
    remover
        A `ForegroundRemover` with a number of sources.
    mask_peaks
        As in `cleaned.separation`; False only for a `SmoothSpectra`.
    """
    found = cleaned.separation(case, remover, mask_peaks)
    if isinstance(found, FilteredSeparation):
        left, lost, truth = _filtered(case, remover, found, mask_peaks)
    else:
        left, lost, truth = error_parts(case, remover)
    width, lmax = case.survey.channel_width, case.survey.lmax if found.lmax is None else found.lmax
    alms = [sphere.analyse(cube, lmax, n_iter=sphere.N_ITER_FLAT) for cube in (truth, left, lost)]
    true, foreground, hi = alms
    kept = true - hi
    both = kept + foreground
    powers = {"truth": true, "recovered": both, "kept": kept, "left": foreground}
    found_powers = {name: harmonic_power(one, width) for name, one in powers.items()}
    return Parts(shared=_common(found_powers, harmonic_power(both - true, width)), **found_powers)


def _filtered(case, remover, found, mask_peaks):
    """As `error_parts`: the filter takes of a sum what it takes of its terms."""
    truth = pipeline.truth(case)
    known = centred(truth - (pipeline.observation(case).maps - pipeline.basis(case, mask_peaks)))
    lost = found.filter.foreground(known, analysed(known)).cube()
    return cleaned.error(case, remover, mask_peaks).cube() + lost, lost, centred(truth)


def _common(powers, difference):
    """Cross power of truth and recovered from their powers and that of their difference."""
    power = (powers["truth"].power + powers["recovered"].power - difference.power) / 2
    return HarmonicPower(
        power=power, n_channels=difference.n_channels, channel_width=difference.channel_width
    )


@product
def foreseen(case, remover, mask_peaks=True):
    """What a `SmoothSpectra` knows that it keeps of HI and noise, a `MockPower`, without mocks or truth."""
    found = cleaned.separation(case, remover, mask_peaks)
    return expected_mock_power(found, case.survey.channel_width)


def corrected(case, remover, mask_peaks=True):
    """C/C0 and P/P0 once divided by what the method knows that it keeps, {"angular", "frequency": (n,)}."""
    expected: MockPower = foreseen(case, remover, mask_peaks)
    kept = TransferFunction(mocks=(expected,))
    measured = parts(case, remover, mask_peaks)
    found = {}
    for kind in ("angular", "frequency"):
        ratio, share = measured.ratios(kind)["recovered"], getattr(kept, kind)
        found[kind] = np.divide(ratio, share[: len(ratio)], out=np.zeros_like(ratio), where=ratio > 0)
    return found
