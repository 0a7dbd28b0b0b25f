"""Weights of pixels and voxels, hits or inverse variances, of which only ratios matter; 0 is not seen."""

import numpy as np

from himap.checks import real_array
from himap.errors import InputError

__all__ = ["check_lines", "checked_weights", "weighted_means"]


def checked_weights(weights, shape, kept=None):
    """Weights of maps in their simplest form, and the pixels that have any.

    Parameters
    ----------
    weights
        (n_pix,) or (n_channels, n_pix): finite, 0 or more.
    shape
        Of the maps, (n_channels, n_pix).
    kept
        (n_pix,) bool, or None for all: nothing else is looked at.

    Returns
    -------
    tuple
        Pixels that are kept and seen in some channel, (n_pix,) bool, or None where that are all; and weights,
        0 elsewhere: (n_channels, n_pix); (n_pix,) where they are the same in all channels; None where they
        are the same in all voxels.

    Raises
    ------
    InputError
        Another shape, something that is no weight, or none at all in the maps or in a channel.
    """
    values = _checked_values(weights, shape)
    seen = values > 0 if values.ndim == 1 else values.any(axis=0)
    seen = seen if kept is None else seen & kept
    if not seen.any():
        raise InputError("the weights are 0 in all pixels that are kept; 0 means not seen.")
    values = np.where(seen, values, np.zeros((), values.dtype))
    if values.ndim == 2:
        empty = np.flatnonzero(~values.any(axis=1))
        if len(empty):
            raise InputError(
                f"the weights are 0 in all pixels of channel {empty[0]} and {len(empty) - 1} more; leave "
                "these channels out of the maps."
            )
        if all(np.array_equal(row, values[0]) for row in values[1:]):
            values = values[0]
    if values.ndim == 1 and np.ptp(values[seen]) == 0:
        values = None
    return None if kept is None and seen.all() else seen, values


def _checked_values(weights, shape):
    weights = np.asarray(weights, dtype=float) if np.asarray(weights).dtype == bool else weights
    values = real_array("weights", weights)
    if len(shape) != 2 or values.shape not in (shape, shape[1:]):
        raise InputError(
            f"weights must have shape (n_pix,) or (n_channels, n_pix), that of the maps, {shape}; got "
            f"{values.shape}."
        )
    if values.dtype != np.float32:
        values = values.astype(np.float64, copy=False)
    n_bad = sum(np.count_nonzero(~((row >= 0) & np.isfinite(row))) for row in np.atleast_2d(values))
    if n_bad:
        raise InputError(f"weights must be finite and 0 or more, got {n_bad} that are not; 0 means not seen.")
    return values


def check_lines(weights, least, label):
    """Refuse weights (n_channels, n_pix) that leave a line of sight fewer than `least` channels.

    Raises
    ------
    InputError
        There is one; `label` is what needs more of them.
    """
    n_few = np.count_nonzero(np.count_nonzero(weights, axis=0) < least)
    if n_few:
        raise InputError(
            f"{label} needs {least} channels on a line of sight that are not missing, and {n_few} of "
            f"{weights.shape[1]} have fewer; leave these out with a mask."
        )


def weighted_means(maps, weights):
    """The weighted mean of every channel of maps (n_channels, n_pix), (n_channels,) float64."""
    rows = np.broadcast_to(weights, maps.shape)
    return np.array([np.average(row, weights=w.astype(float)) for row, w in zip(maps, rows, strict=True)])
