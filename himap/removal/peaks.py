"""Peak masking before a method runs: fit a smooth baseline, clip outliers, fit the baseline again.

A bright HI source biases a smooth fit. The baseline of every line of sight is therefore fitted twice, the
second time without the channels that stand out from the first fit (paper, Sects. 3.2.1 and 4.1, App. B).
The foreground is estimated from the masked maps and subtracted from the original ones.
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
"""Choices of the standard deviation in which peaks are measured; the paper does not say which."""


@dataclass(frozen=True, kw_only=True)
class Baselines:
    """Two polynomials along each line of sight, as coefficients of an orthonormal basis.

    Attributes
    ----------
    basis
        Polynomials in frequency, orthonormal over the channels, (n_channels, order + 1).
    first, second
        The fits to all channels, and to those not `flagged`, (order + 1, n_pix), mK.
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
        The maps, with flagged voxels replaced by the second baseline, (n_channels, n_pix) float32, mK.
    flagged
        The replaced voxels, (n_channels, n_pix) bool.
    """

    maps: np.ndarray
    flagged: np.ndarray


def mask_peaks(maps, freqs, *, order=6, n_sigma=5.0, spread="line", weights=None):
    """Replace peaks along each line of sight by a smooth baseline (paper, Sect. 4.1, App. B).

    Returns `PeakMasked`; parameters and errors are those of `smooth_baselines`, and `maps` does not change.
    """
    baselines = smooth_baselines(maps, freqs, order=order, n_sigma=n_sigma, spread=spread, weights=weights)
    smooth = np.array(maps, dtype=np.float32)
    for row, replaced, polynomials in zip(smooth, baselines.flagged, baselines.basis, strict=True):
        row[replaced] = polynomials @ baselines.second[:, replaced]
    return PeakMasked(maps=smooth, flagged=baselines.flagged)


def smooth_baselines(maps, freqs, *, order=6, n_sigma=5.0, spread="line", weights=None):
    """Fit a polynomial in frequency to each line of sight, clip, and fit clipped lines again (Eq. 18).

    A channel is flagged if it is more than `n_sigma` standard deviations above or below the first fit. By
    default this is the standard deviation of the residual of the line of sight over all its channels, peaks
    included. Fewer than 1 / n_sigma^2 of the channels can be that far out, so with few channels no peak is
    ever flagged (`can_stand_out`), and a sine never is. Lines of sight without flags, and those with too few
    unflagged channels for another fit, keep the first.

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
        Which standard deviation, a name in `SPREADS`.
    weights
        (n_channels, n_pix), finite, 0 in missing voxels. Fits and deviation are weighted, and a channel
        stands out by sqrt(w) times its distance. Weights of pixels, (n_pix,), change nothing.

    Returns
    -------
    Baselines

    Raises
    ------
    InputError
        If maps are not finite or do not fit the frequencies; if the order leaves no channel to spare, the
        threshold could leave a line of sight too few channels, or one has too few with weight; if the
        spread is unknown, or is not that of the line while weights are given.
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
            deviation = np.sqrt(np.einsum("ij,ij->j", pull, pull) / n_seen)  # the residual has no mean
        elif spread == "mad":
            deviation = _NORMAL * np.median(pull, axis=0)
        out = np.greater(pull, n_sigma * deviation, out=flagged[:, block])
        second[:, block] = first[:, block]
        clipped = out.any(axis=0) & (np.count_nonzero(~out, axis=0) >= order + 2)
        if clipped.any():  # fit only residuals, so the bright baseline costs no digits
            rest = np.where(out, 0, shares)[:, clipped]
            second[:, block][:, clipped] += least_squares(basis, lines[:, clipped], rest)

    in_threads(fit, maps.shape[1], "peak masking")
    return Baselines(basis=basis, first=first, second=second, flagged=flagged)


def baseline_basis(freqs, order=6):
    """Polynomials in frequency (MHz, ascending), orthonormal over the channels, (n_channels, order + 1)."""
    # Legendre polynomials of the band are already nearly orthogonal, so QR keeps every digit; powers of a
    # frequency in MHz would have a condition number of 1e36. Signs are such that all rise at the upper end.
    u = (2 * freqs - freqs[0] - freqs[-1]) / (freqs[-1] - freqs[0])
    basis, triangle = np.linalg.qr(np.polynomial.legendre.legvander(u, order))
    return basis * np.sign(np.diag(triangle))


def _deviation_of_sky(maps, basis, spread, weights):
    """Standard deviation from the fits, by channel, (n_channels, 1), or of the cube; None for a line."""
    if spread not in SPREADS:
        raise InputError(f"spread must be one of {', '.join(SPREADS)}, got {spread!r}.")
    if weights is not None and spread != "line":
        raise InputError(f"with weights of voxels the spread must be that of the line, got {spread!r}.")
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
    """Whether any channel can be flagged if deviations are those of the line of sight.

    With n channels, a single peak is sqrt(n (1 - h)) deviations from the fit, which follows a share h of it,
    the leverage of its channel; nothing is farther out. So by default no peak shows in 29 even channels.
    """
    leverage = np.sum(baseline_basis(freqs, order) ** 2, axis=1)
    return bool(len(freqs) * (1 - leverage.min()) > n_sigma**2)


def check_clipping(n_channels, order, n_sigma):
    """Raise InputError if an order leaves no channel to spare, or a threshold could leave too few."""
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
    """Smallest number of observed channels, of `n_channels`, that such a fit needs on a line of sight."""
    enough = (n for n in range(order + 2, n_channels) if n - _most_flagged(n, n_sigma) >= order + 2)
    return next(enough, n_channels)


def _most_flagged(n_channels, n_sigma):
    """m outliers alone have a variance above m n_sigma^2 / n, so there are fewer than n / n_sigma^2."""
    return int(np.ceil(n_channels / n_sigma**2)) - 1
