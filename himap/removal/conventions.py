"""Scale, order and sign of sources, which no data can tell."""

import numpy as np

__all__ = ["ordered"]


def ordered(mixing, sources):
    """A and S with columns of unit length, by variance of the sources, largest entry positive.

    The product A S stays as it is; scale, order and sign of sources are a matter of convention.
    """
    length = np.linalg.norm(mixing, axis=0)
    largest = mixing[np.abs(mixing).argmax(axis=0), np.arange(len(length))]
    factor = np.copysign(length, largest)
    order = np.argsort(-(length**2) * np.mean(sources**2, axis=1), kind="stable")
    return (mixing / factor)[:, order], (sources * factor[:, None])[order]
