"""Masks of the sky: their weights, and the bins of l that they require."""

import numpy as np

from himap.core.checks import real_array
from himap.core.errors import InputError


def mask_weights(mask, n_pix):
    """Convert a mask to float64 weights, (n_pix,); None keeps the full sky.

    Raises
    ------
    InputError
        If the mask has the wrong shape or weights outside 0 to 1, or keeps nothing.
    """
    if mask is None:
        return np.ones(n_pix)
    try:
        is_bool = np.asarray(mask).dtype == bool and not np.ma.is_masked(mask)
    except ValueError:  # rows of unequal length
        is_bool = False
    if not is_bool:
        mask = real_array("the mask", mask)
    weights = np.asarray(mask, dtype=np.float64)
    if weights.shape != (n_pix,):
        raise InputError(f"the mask must have shape (n_pix,) = ({n_pix},), got {weights.shape}.")
    if not (np.isfinite(weights).all() and weights.min() >= 0 and weights.max() <= 1):
        raise InputError("the mask must be True where kept, or weights between 0 and 1; got values outside.")
    if not weights.any():
        raise InputError("the mask keeps no pixel; True (or 1) means kept.")
    return weights


def bin_matrix(lmax, width):
    """Matrix of averages over bins of `width` multipoles from l = 2 on, (n_bins, lmax + 1).

    Before these is one bin of l = 0 and 1, or one each if `width` is 1: spectra are compared from l = 2.
    """
    first = [0, 1] if width == 1 else [0]
    edges = np.concatenate([first, np.arange(2, lmax + 1, width), [lmax + 1]])
    if edges[-1] - edges[-2] < width and len(edges) > 3:
        edges = np.delete(edges, -2)  # the last bin takes the remainder
    degree = np.arange(lmax + 1)
    inside = (degree >= edges[:-1, None]) & (degree < edges[1:, None])
    return inside / inside.sum(axis=1, keepdims=True)
