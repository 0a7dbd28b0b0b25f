"""Masks of the sky: their weights, and power spectra freed from the coupling of multipoles that they make."""

import warnings

import numpy as np

from himap.core.checks import real_array
from himap.core.errors import InputError
from himap.maps import sphere

_MAX_CONDITION = 1e6  # beyond it decoupling amplifies rounding of float32 maps to the size of the signal


def mask_weights(mask, n_pix):
    """The mask as float64 weights, (n_pix,); None keeps the full sky.

    Raises
    ------
    InputError
        A mask of the wrong shape, with weights outside 0 to 1, or that keeps nothing.
    """
    if mask is None:
        return np.ones(n_pix)
    if np.asarray(mask).dtype != bool:
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
    """Averages over bins of `width` multipoles, (n_bins, lmax + 1); l = 0 is a separate bin."""
    edges = np.concatenate([[0], np.arange(1, lmax + 1, width), [lmax + 1]])
    if edges[-1] - edges[-2] < width and len(edges) > 3:
        edges = np.delete(edges, -2)  # the last bin takes the remainder
    degree = np.arange(lmax + 1)
    inside = (degree >= edges[:-1, None]) & (degree < edges[1:, None])
    return inside / inside.sum(axis=1, keepdims=True)


def decoupled(pseudo, weights, bins):
    """Binned C_l from pseudo-C_l (MASTER, Hivon et al. 2002), or their ratio to the kept sky with a warning.

    Parameters
    ----------
    pseudo
        (n_channels, lmax + 1), mK^2.
    weights
        (n_pix,), those of `mask_weights`.
    bins
        From `bin_matrix`.

    Returns
    -------
    cl
        (n_channels, n_bins), mK^2.
    """
    mask_cl = sphere.power_spectrum(sphere.analyse(weights))
    binned = bins @ sphere.coupling_matrix(mask_cl, bins.shape[1] - 1) @ (bins > 0).T
    condition = np.linalg.cond(binned)
    if condition > _MAX_CONDITION:
        f_sky = np.mean(weights**2)
        warnings.warn(
            f"the mask keeps {f_sky:.1%} of the sky and its coupling matrix has condition number "
            f"{condition:.1e}: C_l are divided by that fraction instead of decoupled; use wider bins.",
            stacklevel=3,
        )
        return pseudo @ bins.T / f_sky
    return np.linalg.solve(binned, bins @ pseudo.T).T
