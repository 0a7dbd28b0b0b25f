"""Spectra of a cleaned cube, corrected by mocks for signal loss and foreground residual."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.cubes.spectra import spectra_of
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures.bootstrap import bootstrap_of, sigma
from himap.measures.low_rank_spectra import FAINT, masked_alms
from himap.measures.transfer import harmonic_power, mock_power, mock_power_of_cubes
from himap.removal.cleaning import one_more
from himap.removal.data import means_of

MOST = 2
"""How many numbers of sources spectra are corrected with: that of the cleaning, and one more."""


@dataclass(frozen=True, kw_only=True)
class Corrected:
    """One spectrum of a cleaned cube, corrected for what cleaning takes and leaves.

    Attributes
    ----------
    x
        l, or k in 1/MHz, (n,).
    residual
        As the method leaves it, C_l averaged over channels in mK^2, or P(k) in mK^2 MHz.
    share
        The transfer function, with the number of sources that the correction is made with.
    corrected
        The corrected spectrum; NaN where nothing comes back.
    errors
        Relative errors of mocks that are corrected by each other, (n_mocks, n); of one mock none, (0, n).
    sample
        Power of each mock over their mean, less 1, (n_mocks, n): sample variance and noise, in no error bar.
    expected
        The mean power of the mocks in the place of `corrected`.
    systematic
        What was estimated from the mocks as foreground residual and subtracted, over the transfer function,
        in the unit of the spectrum. Nothing in the data says how good this estimate is, so it is the
        systematic error of `corrected`.
    foreground
        All foreground residual of `residual`, likewise: more, if the correction is made with one source more.
    one_more
        What `corrected` has more than the correction by the same members with one source more, likewise.
    truth
        The spectrum of the truth, NaN where it is not known.
    n_sources
        Of the correction; None of a method that has none.
    explained
        Whether one source more removes HI alone, as far as can be seen.
    """

    x: np.ndarray
    residual: np.ndarray
    share: np.ndarray
    corrected: np.ndarray
    errors: np.ndarray
    sample: np.ndarray
    expected: np.ndarray
    systematic: np.ndarray
    foreground: np.ndarray | None = None
    one_more: np.ndarray | None = None
    truth: np.ndarray | None = None
    n_sources: int | None = None
    explained: bool = True

    @property
    def knows_truth(self):
        """Whether the truth is known anywhere."""
        return bool(np.isfinite(self.truth).any())

    def sigma(self, bins, of="errors"):
        """Relative error bars of means over bins, rows of weights (n_bins, n); NaN where one mock is all.

        `of` "sample" those of sample variance and noise.
        """
        relative = getattr(self, of)
        return sigma(relative @ np.transpose(bins)) if len(relative) > 1 else np.full(len(bins), np.nan)


def measure_transfer(cleaned, mocks):
    """The bootstrap of a cleaning: mocks in the place of the HI and noise of the cube, cleaned as it was.

    Mocks go through the gaps of a cube and are cleaned with its weights. Where a voxel is missing the mock,
    what comes back of it and the residual of the cube all count as 0, so that their ratios are right.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    mocks
        Maps of mocks, (n_channels, n_seen) each, mK, seen through the beam of the cube; made one at a time if
        they are a generator. What they have where a voxel is missing counts nothing.

    Returns
    -------
    list
        (`CleanedCube`, `Bootstrap`) with the method's number of sources, and so on to `MOST` of them; of a
        method without such a number one.

    Raises
    ------
    InputError
        No mock, one of another shape than the cube, or fewer channels than sources.
    """
    cube = cleaned.cube
    _ = cube.nside  # refuses an image in the plane
    several = [cleaned]
    while len(several) < MOST and one_more(several[-1].method) != several[-1].method:
        several.append(several[-1].with_one_more)
    most = getattr(several[-1].with_one_more.method, "n_sources", 0)
    if most > len(cube.freqs):
        raise InputError(
            f"spectra are corrected with up to {len(several)} sources more than are removed, {most}, and the "
            f"cube has {len(cube.freqs)} channels: remove fewer sources."
        )
    powers = [[] for _ in several]
    for mock in mocks:
        mock = checked_cube("a mock", mock)
        if mock.shape != cube.maps.shape:
            raise InputError(
                f"a mock must have the channels and seen pixels of the cube, {cube.maps.shape}, got "
                f"{mock.shape}."
            )
        for one, members in zip(several, powers, strict=True):
            member = one.resampled(mock)
            both = {each.method: each for each in (member, member.with_one_more)}
            members.append([_mock_power(one, each, mock) for each in both.values()])
    return [(one, bootstrap_of(members)) for one, members in zip(several, powers, strict=True)]


def _mock_power(cleaned, member, mock):
    """The `MockPower` of a member of the bootstrap of a `CleanedCube`, whose truth is a mock."""
    cube, other = cleaned.cube, member.separation
    if cube.missing is None:
        faint = FAINT * float(mock.var(axis=1, dtype=np.float64).sum())
        alms = alms_of(cube, mock, other.lmax)
        return mock_power_of_change(cube, alms, cleaned.separation, other, faint)
    # Both cubes have 0 in the gaps.
    change = other.foreground + -cleaned.separation.foreground
    back = change.subtract_from(mock, other.means - cleaned.separation.means)
    mock = (mock - means_of(mock, cube.weights)[:, None]).astype(mock.dtype)
    alms = (alms_of(cube, np.where(cube.missing, 0, maps)) for maps in (mock, back))
    return mock_power_of_cubes(*alms, cube.channel_width)


def alms_of(cube, maps, lmax=None):
    """Coefficients of maps (n_channels, n_seen) of a cube, less their means, to `lmax` if one is given."""
    alms = masked_alms(cube.on_sphere(maps), mask=cube.sky_mask)
    return alms if lmax is None else sphere.alms_upto(alms, lmax)


def mock_power_of_change(cube, alms, before, after, faint):
    """The `MockPower` of what came back as more than it was by as much as the foreground changed.

    Parameters
    ----------
    cube
        The `Cube`, without missing voxels.
    alms
        Coefficients of what was put in (`alms_of`).
    before, after
        The `Separation` that the foreground is of, and the one that it is then of.
    faint
        Variance, mK^2, summed over channels, of terms of the change that are left out.
    """
    change = (before.foreground + -after.foreground).truncate(faint)
    if not len(change.maps):  # nothing moves
        change = LowRankCube(spectra=np.zeros((len(cube.freqs), 1)), maps=np.zeros((1, cube.maps.shape[1])))
    return mock_power(alms, replace(change, maps=cube.on_sphere(change.maps)), cube.channel_width)


def correct(measured, spectra, truth=None):
    """Both spectra of a cleaned cube, corrected, {"angular": `Corrected`, "frequency": `Corrected`}.

    The number of sources is the first whose foreground explains what one source more takes from the cube
    (`himap.measures.bootstrap.Bootstrap.explains`), or the last that was measured.

    Parameters
    ----------
    measured
        What `measure_transfer` returns.
    spectra
        The `PowerSpectra` of the cleaned cube, in bins of l where a mask asks for them.
    truth
        The `Comparison` with the truth, if there is one.
    """
    lmax = len(measured[0][1].own.degrees) - 1
    several = [one for one, _ in measured] + [measured[-1][0].with_one_more]
    powers = [
        harmonic_power(alms_of(one.cube, one.residual, lmax), one.cube.channel_width) for one in several
    ]
    explaining = [n for n, (_, transfer) in enumerate(measured) if transfer.explains(*powers[n : n + 2])]
    used = explaining[0] if explaining else len(measured) - 1
    (_, first), (cleaned, last) = measured[0], measured[used]
    shown, places = _both(spectra), {"angular": spectra.angular.degrees, "frequency": spectra.frequency.k}
    # The power of pixels and of coefficients to lmax differ, and that of a mask: alike for spectra alike.
    nearer, corrected = shown if used == 0 else _both(spectra_of(cleaned)), {}
    true = {} if truth is None else {"angular": (truth.degrees, truth.true_angular)}
    if truth is not None:
        true["frequency"] = truth.k, truth.true_frequency
    for kind, x in places.items():
        transfers = (first.own, powers[0]), (last.own, powers[used]), (last.more, powers[used + 1])
        own, one, more = (_in_bins(kind, x, transfer, power) for transfer, power in transfers)
        inside = np.isin(x, one.x)
        own_scale, scale = shown[kind][inside] / own.residual, nearer[kind][inside] / one.residual
        corrected[kind] = replace(
            one,
            residual=shown[kind][inside],
            corrected=one.corrected * scale,
            expected=one.expected * scale,
            systematic=one.systematic * scale,
            foreground=(own.corrected + own.systematic) * own_scale - one.corrected * scale,
            one_more=(one.corrected - more.corrected) * scale,
            truth=np.interp(one.x, *true.get(kind, ([0], [np.nan])), left=np.nan, right=np.nan),
            n_sources=getattr(cleaned.method, "n_sources", None),
            explained=bool(explaining),
        )
    return corrected


def _both(spectra):
    return {"angular": spectra.angular.mean, "frequency": spectra.frequency.power}


def _in_bins(kind, x, transfer, power):
    """The `Corrected` of one spectrum, in bins at the places `x`, from the `HarmonicPower` of a residual."""
    known = slice(2, None) if kind == "angular" else slice(1, None)
    known_at = (transfer.degrees if kind == "angular" else transfer.k)[known]
    half, inside = (x[1] - x[0]) / 2, (x >= known_at[0]) & (x <= known_at[-1])
    bins = np.abs(known_at - x[inside, None]) < half
    bins = bins / np.maximum(bins.sum(axis=1, keepdims=True), 1)
    left, share = getattr(power, kind), getattr(transfer, kind)
    corrected = np.where(share > 0, transfer.corrected(kind, left), np.nan)
    several = len(transfer.mocks) > 1
    return Corrected(
        x=x[inside],
        residual=bins @ left[known],
        share=bins @ share[known],
        corrected=bins @ corrected[known],
        errors=(transfer.errors(kind)[:, known] if several else np.empty((0, len(known_at)))) @ bins.T,
        sample=transfer.sample(kind)[:, known] @ bins.T,
        expected=bins @ np.mean([getattr(mock.input, kind) for mock in transfer.mocks], axis=0)[known],
        systematic=bins @ transfer.foreground(kind)[known],
    )
