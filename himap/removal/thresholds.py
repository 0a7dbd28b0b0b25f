"""Thresholds on the coefficients of sparse sources: below them is noise."""

import numpy as np

__all__ = ["NORMAL", "share_threshold"]

NORMAL = 1.4826
"""Standard deviation of normal numbers over the median of their absolute values."""


def share_threshold(sizes, floor, share):
    """Threshold that keeps the largest `share` (0 to 1) of the absolute values `sizes` above `floor`."""
    above = sizes[sizes > floor]
    n_dropped = len(above) - int(np.ceil(share * len(above)))
    return np.partition(above, n_dropped - 1)[n_dropped - 1] if n_dropped else floor
