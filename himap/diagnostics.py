"""How good a cleaning is, measured with the truth at hand."""

import numpy as np

from himap.errors import InputError

__all__ = ["band_mean", "largest_deviation", "ratio"]


def ratio(recovered, true):
    """Recovered over true spectrum, element by element (paper, lower panels of Figs. 1 and 2).

    Raises
    ------
    InputError
        Spectra of different shapes, or a true one that is not positive.
    """
    recovered, true = np.asarray(recovered, dtype=float), np.asarray(true, dtype=float)
    if recovered.shape != true.shape:
        raise InputError(f"both spectra must have one shape, got {recovered.shape} and {true.shape}.")
    if not (true > 0).all():
        raise InputError("the true spectrum must be positive to be divided by; leave out l = 0 or k = 0.")
    return recovered / true


def band_mean(x, values, low, high):
    """Mean of `values` where low < x < high."""
    return float(values[_inside(x, low, high)].mean())


def largest_deviation(x, ratios, low, high):
    """Largest |ratio - 1| where low < x < high, and the x it is at."""
    inside = _inside(x, low, high)
    deviation = np.abs(ratios[inside] - 1)
    worst = deviation.argmax()
    return float(deviation[worst]), float(np.asarray(x)[inside][worst])


def _inside(x, low, high):
    x = np.asarray(x)
    inside = (x > low) & (x < high)
    if not inside.any():
        raise InputError(
            f"nothing lies between {low} and {high}: the values go from {x.min():g} to {x.max():g}."
        )
    return inside
