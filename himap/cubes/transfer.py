"""Signal loss and foreground residual of a cleaned cube, from mocks in the place of its HI and noise."""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.cubes.brightness import Parts
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures.low_rank_spectra import FAINT, masked_alms
from himap.measures.spectra import frequency_power
from himap.measures.transfer import (
    HarmonicPower,
    TransferFunction,
    expected_power,
    harmonic_power,
    mock_power,
)
from himap.removal.smooth_posterior import N_SMOOTH, foreground_given, products_of


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
    in_pixels
        That in all seen pixels, (n_mocks, n_k).
    """

    drawn: bool
    residual: HarmonicPower
    left: HarmonicPower | None
    parts: Parts
    powers: np.ndarray
    in_pixels: np.ndarray

    @property
    def without_foreground(self):
        """The `HarmonicPower` of the residual less what is estimated of the foreground."""
        return self.residual if self.left is None else self.residual.less(self.left)


def measure_transfer(cleaned, mocks, *, beams=None):
    """The bootstrap of a cleaning: mocks in the place of the HI and noise of the cube, cleaned as it was.

    With the beams of a full sphere without gaps, in more than `N_SMOOTH` channels, the foreground of every
    member is drawn from what is known of that of the cube (`SmoothForeground`), so that it has what the
    method leaves in the residual too. Else it is the one that the method estimated. What the method leaves of
    a drawn foreground is estimated from each member and the other mocks, as it is from the cube
    (`SmoothForeground.residual_spectra`): members have the errors of that.

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
    members, in_parts, in_pixels, mock_powers = _analysed(cube, parts, mocks), [], [], []
    with TemporaryDirectory() as folder:
        if drawn:  # all mocks are looked at twice
            members = [_in_files(Path(folder) / str(n), arrays) for n, arrays in enumerate(members)]
            # With nothing that is known of the data already, so that these do not keep their modes.
            data = replace(cleaned.data, weights=None, beams=beams, seed=None, known={})
            lmax = min(3 * cube.nside, data.beams.shape[1]) - 1
            fields = (sphere.alms_upto(alms, lmax) for alms, *_ in members)
            known = foreground_given(data, products_of(fields, lmax), len(members)) if members else None
        for n, (alms, mock, powers, power) in enumerate(members):
            if any(np.array_equal(powers, others) for others in in_parts):
                raise InputError(f"mocks must differ, and number {n + 1} is one of those before it.")
            before = cleaned.separation
            if drawn:  # from another stream than the mock, which may be drawn from the same number
                rng = np.random.default_rng(np.random.SeedSequence(n, spawn_key=(1,)))
                before = known.draw(data, rng)
            mock_powers.append(_member_power(cleaned, mock, alms, before, known, beams))
            in_parts.append(np.array(powers))
            in_pixels.append(np.array(power))
        left = None if known is None else _left(cleaned, data, known)
    residual = alms_of(cube, cleaned.residual, cleaned.separation.lmax)
    return CubeTransfer(
        mocks=tuple(mock_powers),
        drawn=drawn,
        residual=harmonic_power(residual, cube.channel_width),
        left=left,
        parts=parts,
        powers=np.array(in_parts),
        in_pixels=np.array(in_pixels),
    )


def _left(cleaned, data, known):
    """The `HarmonicPower` of what is left of the foreground of a `CleanedCube`, `known` of its `Data`."""
    spectra = known.residual_spectra(data, cleaned.separation, cleaned.basis.beams)
    return expected_power(spectra, cleaned.cube.channel_width)


def _analysed(cube, parts, mocks):
    """Of one mock after the other its coefficients, maps, and powers in parts of the sky and in all of it.

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
        power = frequency_power(seen, cube.channel_width).power
        yield alms_of(cube, seen), mock, parts.powers(seen, cube.channel_width), power


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
    """Coefficients of maps (n_channels, n_seen) of a cube, less their means, to `lmax` if one is given."""
    alms = masked_alms(cube.on_sphere(maps), mask=cube.sky_mask)
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
