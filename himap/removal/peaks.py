"""Peaks masked before any method runs: a smooth baseline, outliers clipped, the baseline again.

A bright HI source pulls a smooth fit towards itself. The baseline of every line of sight is therefore
fitted twice, the second time without the channels that stand out from the first (paper, Sects. 3.2.1
and 4.1, App. B). The masked maps serve to find the foreground; it is subtracted from the original ones.
"""

import numbers
from dataclasses import dataclass

import numpy as np

from himap.core.checks import checked_cube, checked_freqs, whole_number
from himap.core.errors import InputError
from himap.maps.low_rank import blocks, in_threads
from himap.removal.data import check_channels
from himap.removal.weighted_pca import least_squares

_NORMAL = 1.4826  # standard deviation over median absolute deviation

SPREADS = {
    "line": "of the line of sight over its channels",
    "channel": "of the channel over the sky",
    "cube": "of the cube",
    "mad": "of the line of sight, by its median absolute deviation",
}
"""Whose standard deviation a peak is measured in, which the paper does not say."""


@dataclass(frozen=True, kw_only=True)
class Baselines:
    """Two polynomials along each line of sight, as coefficients of an orthonormal basis.

    Attributes
    ----------
    basis
        Polynomials in frequency, orthonormal over the channels, (n_channels, order + 1).
    first, second
        The fits to all channels, and without those `flagged`, (order + 1, n_pix), mK.
    flagged
        Channels that stand out from the first fit, (n_channels, n_pix) bool.
    """

    basis: np.ndarray
    first: np.ndarray
    second: np.ndarray
    flagged: np.ndarray


@dataclass(frozen=True, kw_only=True)
class PeakMasked:
    """A cube without its peaks.

    Attributes
    ----------
    maps
        The maps, with the second baseline in place of what is flagged, (n_channels, n_pix) float32, mK.
    flagged
        What was replaced, (n_channels, n_pix) bool.
    """

    maps: np.ndarray
    flagged: np.ndarray


def mask_peaks(maps, freqs, *, order=6, n_sigma=5.0, spread="line", weights=None):
    """Replace peaks along each line of sight by a smooth baseline (paper, Sect. 4.1, App. B).

    A `PeakMasked`; parameters and errors are those of `smooth_baselines`, and `maps` does not change.
    """
    baselines = smooth_baselines(maps, freqs, order=order, n_sigma=n_sigma, spread=spread, weights=weights)
    smooth = np.array(maps, dtype=np.float32)
    for row, replaced, polynomials in zip(smooth, baselines.flagged, baselines.basis, strict=True):
        row[replaced] = polynomials @ baselines.second[:, replaced]
    return PeakMasked(maps=smooth, flagged=baselines.flagged)


def smooth_baselines(maps, freqs, *, order=6, n_sigma=5.0, spread="line", weights=None):
    """Fit a polynomial in frequency to each line of sight, clip, and fit again what was clipped (Eq. 18).

    A channel is flagged where it is further than `n_sigma` standard deviations, above or below, from the
    first fit. By default the deviation is that of this line of sight over all its channels, peaks included,
    once the fit is subtracted. Fewer than 1 / n_sigma^2 of the channels can be that far out, so that few
    channels never show a peak (`can_stand_out`), and no sine ever does. Lines of sight without a
    flag, and those with too few channels without one for another fit, keep the first.

    Parameters
    ----------
    maps
        Lines of sight, (n_channels, n_pix), mK.
    freqs
        Channel centres, MHz, ascending, (n_channels,).
    order
        Order of the polynomial.
    n_sigma
        Threshold in standard deviations.
    spread
        Whose deviation that is, a name in `SPREADS`.
    weights
        (n_channels, n_pix), 0 where a voxel is missing, and that is finite. Fits and deviation are weighted,
        and a channel stands out by sqrt(w) times its distance. Weights of pixels, (n_pix,), change nothing.

    Returns
    -------
    Baselines

    Raises
    ------
    InputError
        Maps that are not finite or do not fit the frequencies; an order that leaves no channel to spare; a
        threshold so low that a line of sight could keep too few channels; one with too few that have weight;
        an unknown spread, or weights with one that is not that of the line.
    """
    maps = checked_cube("maps", maps, min_channels=2)
    freqs = checked_freqs(freqs, len(maps))
    check_clipping(len(maps), order, n_sigma)
    weights = None if np.ndim(weights) < 2 else weights
    if weights is not None:
        check_channels(weights, least_channels(len(maps), order, n_sigma), f"a polynomial of order {order}")
    basis = baseline_basis(freqs, order)
    given = _deviation_of_sky(maps, basis, spread, weights)
    first = np.empty((order + 1, maps.shape[1]))
    second = np.empty_like(first)
    flagged = np.empty(maps.shape, dtype=bool)

    def fit(block):
        lines, shares, n_seen = maps[:, block].astype(np.float64), 1.0, len(maps)
        if weights is not None:
            shares = weights[:, block].astype(np.float64) / weights[:, block].max(axis=0)
            n_seen = np.count_nonzero(shares, axis=0)
        first[:, block] = basis.T @ lines if weights is None else least_squares(basis, lines, shares)
        lines -= basis @ first[:, block]
        pull = np.sqrt(shares) * np.abs(lines)
        deviation = given
        if spread == "line":
            deviation = np.sqrt(np.einsum("ij,ij->j", pull, pull) / n_seen)  # the fit leaves no mean
        elif spread == "mad":
            deviation = _NORMAL * np.median(pull, axis=0)
        out = np.greater(pull, n_sigma * deviation, out=flagged[:, block])
        second[:, block] = first[:, block]
        clipped = out.any(axis=0) & (np.count_nonzero(~out, axis=0) >= order + 2)
        if clipped.any():  # of residuals alone, so that the bright baseline costs no digits
            rest = np.where(out, 0, shares)[:, clipped]
            second[:, block][:, clipped] += least_squares(basis, lines[:, clipped], rest)

    in_threads(fit, maps.shape[1], "peak masking")
    return Baselines(basis=basis, first=first, second=second, flagged=flagged)


def baseline_basis(freqs, order=6):
    """Polynomials in frequency (MHz, ascending), orthonormal over the channels, (n_channels, order + 1)."""
    # Legendre polynomials of the band are nearly orthogonal already, so that QR keeps every digit; powers of
    # a frequency in MHz would have a condition number of 1e36. All rise at the upper end.
    u = (2 * freqs - freqs[0] - freqs[-1]) / (freqs[-1] - freqs[0])
    basis, triangle = np.linalg.qr(np.polynomial.legendre.legvander(u, order))
    return basis * np.sign(np.diag(triangle))


def _deviation_of_sky(maps, basis, spread, weights):
    """Deviation from the fits of each channel, (n_channels, 1), or of the cube; None of a line of sight."""
    if spread not in SPREADS:
        raise InputError(f"spread must be one of {', '.join(SPREADS)}, got {spread!r}.")
    if weights is not None and spread != "line":
        raise InputError(f"where voxels have weights the spread is that of the line, got {spread!r}.")
    if spread in ("line", "mad"):
        return None
    squares = np.zeros((len(maps), 1))
    for block in blocks(maps.shape[1]):
        lines = maps[:, block].astype(np.float64)
        lines -= basis @ (basis.T @ lines)
        squares += np.sum(lines**2, axis=1, keepdims=True)
    variance = squares / maps.shape[1]
    return np.sqrt(variance.mean() if spread == "cube" else variance)


def can_stand_out(freqs, order=6, n_sigma=5.0):
    """Whether any channel can be flagged, where deviations are those of the line of sight.

    Of n channels a single peak is sqrt(n (1 - h)) deviations from the fit, which has a share h of it, the
    leverage of its channel; nothing is farther out. So by default 29 evenly spaced channels show none.
    """
    leverage = np.sum(baseline_basis(freqs, order) ** 2, axis=1)
    return bool(len(freqs) * (1 - leverage.min()) > n_sigma**2)


def check_clipping(n_channels, order, n_sigma):
    """InputError for an order that leaves no channel to spare, or a threshold that could leave too few."""
    whole_number("order", order, 1, n_channels - 2)
    real = isinstance(n_sigma, numbers.Real) and not isinstance(n_sigma, bool)
    if not real or not 0 < n_sigma < np.inf:
        raise InputError(f"n_sigma must be a positive number of standard deviations, got {n_sigma!r}.")
    most = _most_flagged(n_channels, n_sigma)
    if n_channels - most < order + 2:
        raise InputError(
            f"n_sigma = {n_sigma:g} could flag {most} of {n_channels} channels, too many to fit "
            f"order {order} to the rest; use a higher n_sigma or a lower order."
        )


def least_channels(n_channels, order=6, n_sigma=5.0):
    """How many channels that are not missing, of `n_channels`, a line of sight needs for such a fit."""
    enough = (n for n in range(order + 2, n_channels) if n - _most_flagged(n, n_sigma) >= order + 2)
    return next(enough, n_channels)


def _most_flagged(n_channels, n_sigma):
    """m outliers alone have a variance above m n_sigma^2 / n, so that there are fewer than n / n_sigma^2."""
    return int(np.ceil(n_channels / n_sigma**2)) - 1
