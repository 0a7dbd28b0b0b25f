"""What a method loses of a cube of one's own, from mocks put into it; and its spectra, corrected."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.maps import sphere
from himap.measures.low_rank_spectra import FAINT, masked_alms
from himap.measures.transfer import TransferFunction, mock_power, mock_power_of_cubes
from himap.removal.data import means_of


@dataclass(frozen=True, kw_only=True)
class Corrected:
    """One spectrum of a cleaned cube, corrected for what cleaning takes.

    Attributes
    ----------
    x
        l, or k in 1/MHz, (n,).
    left
        As the method leaves it, C_l averaged over channels in mK^2, or P(k) in mK^2 MHz.
    share
        The transfer function.
    errors
        Relative errors of mocks that are corrected by each other, (n_mocks, n); of one mock none, (0, n).
    """

    x: np.ndarray
    left: np.ndarray
    share: np.ndarray
    errors: np.ndarray

    @property
    def corrected(self):
        """left / share; NaN where nothing comes back."""
        return np.divide(self.left, self.share, out=np.full(len(self.x), np.nan), where=self.share > 0)

    def sigma(self, bins):
        """Relative error bars of means over bins, rows of weights (n_bins, n); NaN where one mock is all."""
        if not len(self.errors):
            return np.full(len(bins), np.nan)
        return np.sqrt(np.mean((self.errors @ np.transpose(bins)) ** 2, axis=0))


def measure_transfer(cleaned, mocks):
    """The `TransferFunction` of a method on a cube, from mocks that are cleaned with it as it was.

    Mocks go through the gaps of a cube and are cleaned with its weights. Where a voxel is missing both the
    mock and what comes back of it count as 0, as does what is left of the cube: gaps take the same of all
    three, so that the ratio is what the method loses, and what it makes up in a gap is not in it.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    mocks
        Maps of mocks, (n_channels, n_seen) each, mK, seen through the beam of the cube; made one at a time if
        they are a generator. What they have where a voxel is missing counts nothing.

    Raises
    ------
    InputError
        No mock, or one of another shape than the cube.
    """
    cube, without = cleaned.cube, cleaned.separation
    cube.check_sphere()
    back_of = _back_of_seen if cube.missing is None else _back_through_gaps
    recoveries = []
    for mock in mocks:
        mock = checked_cube("a mock", mock)
        if mock.shape != cube.maps.shape:
            raise InputError(
                f"a mock must have the channels and seen pixels of the cube, {cube.maps.shape}, got "
                f"{mock.shape}."
            )
        if cube.missing is not None:
            mock = np.where(cube.missing, np.zeros((), mock.dtype), mock)
        recoveries.append(back_of(cube, mock, without, cleaned.cleaning.with_mock(mock).separation))
    return TransferFunction(mocks=tuple(recoveries))


def _back_of_seen(cube, mock, without, found):
    """The `MockPower` of a mock, from the `Separation` without and with it; no voxel is missing."""
    variance = float(mock.var(axis=1, dtype=np.float64).sum())
    wrong = (without.foreground + -found.foreground).truncate(FAINT * variance)
    alms = masked_alms(cube.on_sphere(mock), mask=cube.sky_mask)
    if found.lmax is not None:
        alms = sphere.alms_upto(alms, found.lmax)
    wrong = replace(wrong, maps=cube.on_sphere(wrong.maps))
    return mock_power(alms, wrong, cube.channel_width)


def _back_through_gaps(cube, mock, without, found):
    """The same where voxels are missing, of both cubes with 0 there."""
    back = (found.foreground + -without.foreground).subtract_from(mock, found.means - without.means)
    cubes = (mock - means_of(mock, cube.weights)[:, None]).astype(mock.dtype), back
    alms, missing = [], cube.missing
    for maps in cubes:
        maps[missing] = 0
        alms.append(masked_alms(cube.on_sphere(maps), mask=cube.sky_mask))
    return mock_power_of_cubes(*alms, cube.channel_width)


def correct(spectra, transfer):
    """Both spectra of a cleaned cube, corrected, {"angular": `Corrected`, "frequency": `Corrected`}.

    Parameters
    ----------
    spectra
        Its `PowerSpectra`, in bins of l where a mask asks for them.
    transfer
        The `TransferFunction` from `measure_transfer`.
    """
    angular, frequency = spectra.angular, spectra.frequency
    return {
        "angular": _corrected(angular.degrees, angular.mean, transfer, "angular", transfer.degrees[2:]),
        "frequency": _corrected(frequency.k, frequency.power, transfer, "frequency", transfer.k[1:]),
    }


def _corrected(x, left, transfer, kind, known_at):
    """In the bins of `x`, all of one width, that lie where the transfer function is known."""
    half = (x[1] - x[0]) / 2
    inside = (x >= known_at[0]) & (x <= known_at[-1])
    x, left = x[inside], left[inside]
    bins = np.abs(known_at - x[:, None]) < half
    bins = bins / np.maximum(bins.sum(axis=1, keepdims=True), 1)
    known = slice(-len(known_at), None)
    errors = transfer.errors(kind)[:, known] if len(transfer.mocks) > 1 else np.empty((0, len(known_at)))
    share = getattr(transfer, kind)[known]
    return Corrected(x=x, left=left, share=bins @ share, errors=errors @ bins.T)
