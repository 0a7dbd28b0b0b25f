"""Spectra of a cleaned cube, corrected by mocks for signal loss and foreground residual."""

from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.cubes.brightness import Parts
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures.bootstrap import sigma
from himap.measures.low_rank_spectra import FAINT, masked_alms
from himap.measures.transfer import (
    HarmonicPower,
    TransferFunction,
    expected_power,
    harmonic_power,
    mock_power,
    quotient,
)
from himap.removal.analysis import n_iter_of_faint
from himap.removal.smooth_posterior import N_SMOOTH, foreground_given, products_of


@dataclass(frozen=True, kw_only=True)
class Corrected:
    """One spectrum of a cleaned cube, corrected for signal loss and foreground residual.

    Attributes
    ----------
    x
        l, or k in 1/MHz, (n,).
    residual
        As the method leaves it, C_l averaged over channels in mK^2, or P(k) in mK^2 MHz.
    share
        The transfer function.
    corrected
        The corrected spectrum; NaN where nothing comes back.
    errors
        Relative errors of mocks that are corrected by each other, (n_mocks, n); of one mock none, (0, n).
    sample
        Of each mock, (n_mocks, n): sample variance and noise (`TransferFunction.sample`), in no error bar.
    expected
        The mean power of the mocks in the place of `corrected`.
    systematic
        What was estimated as foreground residual and subtracted, over the transfer function, in the unit of
        the spectrum. As that estimate rests on assumptions, it is the systematic error of `corrected`.
    truth
        The spectrum of the truth, NaN where it is not known.
    drawn
        As of `CubeTransfer`: if not, the foreground residual is not known, and `systematic` is no error.
    """

    x: np.ndarray
    residual: np.ndarray
    share: np.ndarray
    corrected: np.ndarray
    errors: np.ndarray
    sample: np.ndarray
    expected: np.ndarray
    systematic: np.ndarray
    truth: np.ndarray
    drawn: bool

    @property
    def knows_truth(self):
        """Whether the truth is known anywhere."""
        return bool(np.isfinite(self.truth).any())

    @property
    def foreground(self):
        """The part of the residual that was subtracted, in its unit; in bins of l nearly."""
        return self.share * self.systematic

    def sigma(self, bins, of="errors"):
        """Relative error bars of means over bins, rows of weights (n_bins, n); NaN where one mock is all.

        `of` "sample" those of sample variance and noise.
        """
        relative = getattr(self, of)
        return sigma(relative @ np.transpose(bins)) if len(relative) > 1 else np.full(len(bins), np.nan)

    def errors_in(self, inside):
        """Relative error bar, systematic error and sample variance of the mean over `inside`, (n,) bool.

        Of the systematic error the means of powers are compared, of the others the ratios at each l or k.
        """
        bins, systematic = [inside / inside.sum()], self.systematic[inside].mean()
        systematic = abs(systematic / self.corrected[inside].mean())
        return self.sigma(bins)[0], systematic, self.sigma(bins, "sample")[0]


@dataclass(frozen=True, kw_only=True)
class CubeTransfer(TransferFunction):
    """The `TransferFunction` of a cleaned cube, and the power of its mocks in parts of the sky.

    Attributes
    ----------
    drawn
        Whether members have a foreground that was drawn, and not the one that the method estimated.
    residual
        The `HarmonicPower` of the residual of the cube.
    left
        That of what the method leaves of the foreground, as estimated from the cube; that of
        each member is subtracted from the output in `mocks` already. None where it is not drawn.
    parts
        The `Parts`.
    powers
        P(k) of each mock in each of them, mK^2 MHz, (n_mocks, n_parts, n_k).
    """

    drawn: bool
    residual: HarmonicPower
    left: HarmonicPower | None
    parts: Parts
    powers: np.ndarray

    @property
    def without_foreground(self):
        """The `HarmonicPower` of the residual less what is estimated of the foreground."""
        return self.residual if self.left is None else self.residual.less(self.left)


def measure_transfer(cleaned, mocks, *, beams=None):
    """The bootstrap of a cleaning: mocks in the place of the HI and noise of the cube, cleaned as it was.

    With the beams of a full sphere without gaps, in more than `N_SMOOTH` channels, the foreground of every
    member is drawn from what is known of that of the cube, if its HI and noise are like the mocks
    (`himap.removal.smooth_posterior.SmoothForeground`), so that it has what the method leaves in the residual
    too. Else it is the one that the method estimated. What the method leaves of a drawn foreground is
    estimated from each member and the other mocks, as it is from the cube
    (`himap.removal.smooth_posterior.SmoothForeground.residual_spectra`): members have the errors of that.

    Mocks go through the gaps of a cube and are cleaned with its weights. Where a voxel is missing the mock,
    what comes back of it and the residual of the cube all count as 0, so that their ratios are right.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    mocks
        Maps of mocks, (n_channels, n_seen) each, mK, seen through the beam of the cube; made one at a time if
        they are a generator, and kept in temporary files where foregrounds are drawn. What they have where a
        voxel is missing counts nothing.
    beams
        b_l of the cube, (n_channels, lmax + 1).

    Returns
    -------
    CubeTransfer

    Raises
    ------
    InputError
        No mock, one of another shape than the cube, the same mock again, or with beams too narrow a band.
    """
    cube = cleaned.cube
    _ = cube.nside  # refuses an image in the plane
    drawn = beams is not None and cube.whole_sky and cube.missing is None and len(cube.freqs) > N_SMOOTH
    parts, known = Parts.of(cleaned), None
    members, in_parts, mock_powers = _analysed(cube, parts, mocks), [], []
    with TemporaryDirectory() as folder:
        if drawn:  # all mocks are looked at twice
            members = [_in_files(Path(folder) / str(n), arrays) for n, arrays in enumerate(members)]
            # With nothing that is known of the data already, so that these do not keep their modes.
            data = replace(cleaned.data, weights=None, beams=beams, seed=None, known={})
            lmax = min(3 * cube.nside, data.beams.shape[1]) - 1
            fields = (sphere.alms_upto(alms, lmax) for alms, *_ in members)
            known = foreground_given(data, products_of(fields, lmax), len(members)) if members else None
        for n, (alms, mock, powers) in enumerate(members):
            if any(np.array_equal(powers, others) for others in in_parts):
                raise InputError(f"mocks must differ, and number {n + 1} is one of those before it.")
            before = cleaned.separation
            if drawn:  # from another stream than the mock, which may be drawn from the same number
                rng = np.random.default_rng(np.random.SeedSequence(n, spawn_key=(1,)))
                before = known.draw(data, rng)
            mock_powers.append(_member_power(cleaned, mock, alms, before, known, beams))
            in_parts.append(np.array(powers))
        left = None if known is None else _left(cleaned, data, known)
    residual = alms_of(cube, cleaned.residual, cleaned.separation.lmax)
    return CubeTransfer(
        mocks=tuple(mock_powers),
        drawn=drawn,
        residual=harmonic_power(residual, cube.channel_width),
        left=left,
        parts=parts,
        powers=np.array(in_parts),
    )


def _left(cleaned, data, known):
    """The `HarmonicPower` of what is left of the foreground of a `CleanedCube`, `known` of its `Data`."""
    spectra = known.residual_spectra(data, cleaned.separation, cleaned.basis.beams)
    return expected_power(spectra, cleaned.cube.channel_width)


def _analysed(cube, parts, mocks):
    """Of one mock after the other its coefficients, maps, and powers in parts of the sky.

    The maps are as they came; the others of the mock less its means, and 0 where a voxel is missing.
    """
    for mock in mocks:
        mock = checked_cube("a mock", mock)
        if mock.shape != cube.maps.shape:
            raise InputError(
                f"a mock must have the channels and seen pixels of the cube, {cube.maps.shape}, got "
                f"{mock.shape}."
            )
        seen = cube.without_gaps(mock)
        yield alms_of(cube, seen), mock, parts.powers(seen, cube.channel_width)


def _in_files(path, arrays):
    """The arrays as files next to a path, mapped into memory when they are looked at, a list."""
    files = [path.with_suffix(f".{n}.npy") for n in range(len(arrays))]
    try:
        for file, array in zip(files, arrays, strict=True):
            np.save(file, array)
    except OSError as error:
        size = sum(array.nbytes for array in arrays) / 1e9
        raise InputError(
            f"the mocks cannot be kept in {path.parent.parent}, {size:.2g} GB each ({error}); give another "
            "folder for temporary files (the variable TMPDIR)."
        ) from None
    return [np.load(file, mmap_mode="r") for file in files]


def _member_power(cleaned, mock, alms, before, known, beams):
    """The `MockPower` of a mock with the coefficients `alms` as a member of the bootstrap.

    Its foreground is that of the `Separation` `before`. What the method leaves of it is estimated with the
    `SmoothForeground` `known` and the beams b_l, if there is one, and subtracted from the output.
    """
    cube, member = cleaned.cube, cleaned.resampled(mock, before, None if known is None else alms)
    after = member.separation
    to_end = alms if after.lmax is None else sphere.alms_upto(alms, after.lmax)
    if cube.missing is None:
        power = mock_power_of_change(cube, mock, to_end, before, after)
        if known is None:
            return power
        data = replace(member.data, weights=None, beams=beams, seed=None)
        left = _left(member, data, known.of_member(data, alms))
        return replace(power, output=power.output.less(left))
    # Both cubes have 0 in the gaps.
    change = after.foreground + -before.foreground
    back = change.subtract_from(mock, after.means - before.means)
    back = alms_of(cube, np.where(cube.missing, 0, back), after.lmax)
    return mock_power(to_end, back, cube.channel_width)


def alms_of(cube, maps, lmax=None):
    """Coefficients of maps (n_channels, n_seen) of a cube, less their means, to `lmax` if one is given.

    Of maps as faint as HI and noise, all with the same errors, which ratios of their powers do not have.
    """
    n_iter = n_iter_of_faint(cube.nside)
    alms = masked_alms(cube.on_sphere(maps), mask=cube.sky_mask, n_iter=n_iter)
    return alms if lmax is None else sphere.alms_upto(alms, lmax)


def mock_power_of_change(cube, maps, alms, before, after):
    """The `MockPower` of what came back as more than it was by as much as the foreground changed.

    Parameters
    ----------
    cube
        The `Cube`, without missing voxels.
    maps, alms
        What was put in, (n_channels, n_seen), mK, and its coefficients (`alms_of`); terms of the change that
        are faint next to it are left out.
    before, after
        The `Separation` that the foreground is of, and the one that it is then of.
    """
    faint = FAINT * float(maps.var(axis=1, dtype=np.float64).sum())
    change = (before.foreground + -after.foreground).truncate(faint)
    if not len(change.maps):  # nothing moves
        change = LowRankCube(spectra=np.zeros((len(cube.freqs), 1)), maps=np.zeros((1, cube.maps.shape[1])))
    return mock_power(alms, replace(change, maps=cube.on_sphere(change.maps)), cube.channel_width)


def correct(cleaned, transfer, spectra, truth=None):
    """Both spectra of a cleaned cube, corrected, {"angular": `Corrected`, "frequency": `Corrected`}.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    transfer
        Its `CubeTransfer` (`measure_transfer`).
    spectra
        Its `PowerSpectra`, in bins of l where a mask asks for them.
    truth
        The `Comparison` with the truth, if there is one.

    Raises
    ------
    InputError
        A transfer function of another cube.
    """
    n_seen = sum(map(len, transfer.parts.pixels))
    if (n_seen, transfer.powers.shape[-1]) != (cleaned.cube.maps.shape[1], len(spectra.frequency.k)):
        raise InputError(
            f"the transfer function is of another cube, with {n_seen} seen pixels and "
            f"{transfer.powers.shape[-1]} values of P(k): measure it for this one (measure_transfer)."
        )
    shown = {"angular": (spectra.angular.degrees, spectra.angular.mean)}
    shown["frequency"] = spectra.frequency.k, spectra.frequency.power
    true = dict.fromkeys(shown, ([0], [np.nan]))
    if truth is not None:
        true = {"angular": (truth.degrees, truth.true_angular), "frequency": (truth.k, truth.true_frequency)}
    return {kind: _corrected(kind, transfer, shown[kind], true[kind]) for kind in shown}


def _ends(middles):
    """Ends of bins of l that follow each other from l = 0 on, in which each l counts the same, (2, n)."""
    ends = [*accumulate(middles, lambda end, middle: 2 * middle - end, initial=-0.5)]
    return np.array([ends[:-1], ends[1:]])


def _corrected(kind, transfer, shown, true):
    """The `Corrected` of one spectrum, in the bins that are `shown`, by a `CubeTransfer`.

    `shown` and `true` are places, l or k, and the power there, of the residual and of the truth.
    """
    x, residual = shown
    known = slice(2, None) if kind == "angular" else slice(1, None)
    known_at = (transfer.degrees if kind == "angular" else transfer.k)[known]
    inside = (x >= known_at[0]) & (x <= known_at[-1])
    low, high = _ends(x) if kind == "angular" else (x - (x[1] - x[0]) / 2, x + (x[1] - x[0]) / 2)
    bins = (known_at > low[inside, None]) & (known_at < high[inside, None])
    bins = bins / np.maximum(bins.sum(axis=1, keepdims=True), 1)
    residual_power, share = getattr(transfer.residual, kind), getattr(transfer, kind)
    # The power of pixels and of coefficients to lmax differ, and that of a mask: for all spectra alike.
    scale = residual[inside] / (bins @ residual_power[known])
    lost = share <= 0
    found = transfer.corrected(kind, getattr(transfer.without_foreground, kind))
    systematic = quotient(residual_power, share) - found
    corrected = np.where(lost, 0, found)
    several = len(transfer.mocks) > 1
    expected = np.mean([getattr(mock.input, kind) for mock in transfer.mocks], axis=0)
    return Corrected(
        x=x[inside],
        residual=residual[inside],
        share=bins @ share[known],
        corrected=np.where(bins @ lost[known] > 0, np.nan, bins @ corrected[known]) * scale,
        errors=(transfer.errors(kind)[:, known] if several else np.empty((0, len(known_at)))) @ bins.T,
        sample=transfer.sample(kind)[:, known] @ bins.T,
        expected=bins @ expected[known] * scale,
        systematic=bins @ systematic[known] * scale,
        truth=np.interp(x[inside], *true, left=np.nan, right=np.nan),
        drawn=transfer.drawn,
    )
