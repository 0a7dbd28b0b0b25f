"""Signal loss and foreground residual of a cleaned cube, from mocks that replace its HI and noise."""

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
        Whether the foregrounds of members are drawn, instead of being the one estimated by the method.
    residual
        The `HarmonicPower` of the residual of the cube.
    left
        That of the foreground residual, as estimated from the cube; for each member it is already
        subtracted from the output in `mocks`. None if foregrounds are not drawn.
    parts
        The `Parts`.
    powers
        P(k) of each mock in each part, mK^2 MHz, (n_mocks, n_parts, n_k).
    in_pixels
        P(k) of each mock in all observed pixels, (n_mocks, n_k).
    """

    drawn: bool
    residual: HarmonicPower
    left: HarmonicPower | None
    parts: Parts
    powers: np.ndarray
    in_pixels: np.ndarray

    @property
    def without_foreground(self):
        """The `HarmonicPower` of the residual minus the estimated foreground residual."""
        return self.residual if self.left is None else self.residual.less(self.left)


def measure_transfer(cleaned, mocks, *, beams=None):
    """Bootstrap of a cleaning: mocks replace the HI and noise of the cube and are cleaned in the same way.

    With the beams of a full sky without gaps, in more than `N_SMOOTH` channels, the foreground of each member
    is drawn from the distribution estimated for that of the cube (`SmoothForeground`), including what the
    method does not remove. Otherwise it is the foreground estimated by the method. The residual of a drawn
    foreground is estimated from each member and the other mocks, as it is from the cube
    (`SmoothForeground.residual_spectra`), so the errors of members include that of this estimate.

    Mocks have the gaps of the cube and are cleaned with its weights. In missing voxels the mock, its
    recovered signal and the residual of the cube are all 0, so their ratios are unbiased.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    mocks
        Maps of mocks, (n_channels, n_seen) each, mK, observed through the beam of the cube; computed one at a
        time if from a generator, and stored in temporary files if foregrounds are drawn. Values in missing
        voxels are ignored.
    beams
        b_l of the cube, (n_channels, lmax + 1).

    Returns
    -------
    CubeTransfer

    Raises
    ------
    InputError
        No mock, a mock with another shape than the cube, a repeated mock, or too narrow a band with beams.
    """
    cube = cleaned.cube
    _ = cube.nside  # refuses images in the plane
    drawn = beams is not None and cube.whole_sky and cube.missing is None and len(cube.freqs) > N_SMOOTH
    parts, known = Parts.of(cleaned), None
    members, in_parts, in_pixels, mock_powers = _analysed(cube, parts, mocks), [], [], []
    with TemporaryDirectory() as folder:
        if drawn:  # all mocks are used twice
            members = [_in_files(Path(folder) / str(n), arrays) for n, arrays in enumerate(members)]
            # Without the known foreground of the data, so their modes are not kept.
            data = replace(cleaned.data, weights=None, beams=beams, seed=None, known={})
            lmax = min(3 * cube.nside, data.beams.shape[1]) - 1
            fields = (sphere.alms_upto(alms, lmax) for alms, *_ in members)
            known = foreground_given(data, products_of(fields, lmax), len(members)) if members else None
        for n, (alms, mock, powers, power) in enumerate(members):
            if any(np.array_equal(powers, others) for others in in_parts):
                raise InputError(f"mocks must differ, but number {n + 1} repeats an earlier one.")
            before = cleaned.separation
            if drawn:  # independent of the mock, which may have the same seed
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
    """The `HarmonicPower` of the foreground residual of a `CleanedCube`; `known` for its `Data`."""
    spectra = known.residual_spectra(data, cleaned.separation, cleaned.basis.beams)
    return expected_power(spectra, cleaned.cube.channel_width)


def _analysed(cube, parts, mocks):
    """Yield the coefficients of each mock, its maps, and its powers in parts of the sky and in all of it.

    The maps are unchanged; the other results are for the mock without its means, with 0 in missing voxels.
    """
    for mock in mocks:
        mock = checked_cube("a mock", mock)
        if mock.shape != cube.maps.shape:
            raise InputError(
                f"a mock must have the channels and observed pixels of the cube, {cube.maps.shape}, got "
                f"{mock.shape}."
            )
        seen = cube.without_gaps(mock)
        power = frequency_power(seen, cube.channel_width).power
        yield alms_of(cube, seen), mock, parts.powers(seen, cube.channel_width), power


def _in_files(path, arrays):
    """Store arrays as files next to a path; a list of them, mapped into memory when used."""
    files = [path.with_suffix(f".{n}.npy") for n in range(len(arrays))]
    try:
        for file, array in zip(files, arrays, strict=True):
            np.save(file, array)
    except OSError as error:
        size = sum(array.nbytes for array in arrays) / 1e9
        raise InputError(
            f"the mocks cannot be stored in {path.parent.parent}, {size:.2g} GB each ({error}); set TMPDIR "
            "to another folder for temporary files."
        ) from None
    return [np.load(file, mmap_mode="r") for file in files]


def _member_power(cleaned, mock, alms, before, known, beams):
    """The `MockPower` of a mock with the coefficients `alms` as a member of the bootstrap.

    Its foreground is that of the `Separation` `before`. If the `SmoothForeground` `known` is given, the
    foreground residual is estimated with it and the beams b_l, and subtracted from the output.
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
    # Both cubes are 0 in the gaps.
    change = after.foreground + -before.foreground
    back = change.subtract_from(mock, after.means - before.means)
    back = alms_of(cube, np.where(cube.missing, 0, back), after.lmax)
    return mock_power(to_end, back, cube.channel_width)


def alms_of(cube, maps, lmax=None):
    """Coefficients of maps (n_channels, n_seen) of a cube, minus their means, up to `lmax` if given."""
    alms = masked_alms(cube.on_sphere(maps), mask=cube.sky_mask)
    return alms if lmax is None else sphere.alms_upto(alms, lmax)


def mock_power_of_change(cube, maps, alms, before, after):
    """The `MockPower` of a signal, recovered with a change equal to the change of the foreground.

    Parameters
    ----------
    cube
        The `Cube`, without missing voxels.
    maps, alms
        The input, (n_channels, n_seen), mK, and its coefficients (`alms_of`); terms of the change that are
        negligible relative to it are omitted.
    before, after
        The `Separation` of the original foreground, and that of the changed one.
    """
    faint = FAINT * float(maps.var(axis=1, dtype=np.float64).sum())
    change = (before.foreground + -after.foreground).truncate(faint)
    if not len(change.maps):  # no change
        change = LowRankCube(spectra=np.zeros((len(cube.freqs), 1)), maps=np.zeros((1, cube.maps.shape[1])))
    return mock_power(alms, replace(change, maps=cube.on_sphere(change.maps)), cube.channel_width)
