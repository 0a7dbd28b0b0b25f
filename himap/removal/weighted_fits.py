"""Linear fits to lines of sight whose channels have weights, or are missing."""

import numpy as np


def least_squares(basis, lines, weights):
    """Coefficients with the least sum of w (x - B a)^2 of each line of sight, (n_coefficients, n).

    Solved twice, the second time for what is left: the normal equations of a bright sky lose digits.

    Parameters
    ----------
    basis
        B, (n_channels, n_coefficients), with columns of one length.
    lines
        x, (n_channels, n) float64; what has no weight must be finite.
    weights
        (n_channels, n) float64, above 0 in as many channels as there are coefficients.
    """
    n_coefficients = basis.shape[1]
    weights = weights / weights.max(axis=0)
    products = (basis[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
    normal = (weights.T @ products).reshape(-1, n_coefficients, n_coefficients)
    found = np.zeros((n_coefficients, lines.shape[1]))
    for _ in range(2):
        pull = (weights * (lines - basis @ found)).T @ basis
        found += np.linalg.solve(normal, pull[:, :, None])[:, :, 0].T
    return found


def weighted_clipping(basis, lines, weights, n_sigma):
    """A weighted fit, what stands out from it, and the fit without that.

    A channel stands out where sqrt(w) |x - B a| is more than `n_sigma` times its rms over the channels of the
    line of sight that have weight; with equal weights as in `himap.removal.peaks.smooth_baselines`.

    Returns
    -------
    tuple
        Coefficients of both fits, (n_coefficients, n), and what stands out, (n_channels, n) bool.
    """
    weights = weights / weights.max(axis=0)
    first = least_squares(basis, lines, weights)
    left = lines - basis @ first
    pull = np.sqrt(weights) * np.abs(left)
    deviation = np.sqrt(np.einsum("ij,ij->j", pull, pull) / np.count_nonzero(weights, axis=0))
    flagged = pull > n_sigma * deviation
    second, clipped = first.copy(), flagged.any(axis=0)
    if clipped.any():
        rest = np.where(flagged, 0, weights)[:, clipped]
        second[:, clipped] += least_squares(basis, left[:, clipped], rest)
    return first, second, flagged
