"""How good a cleaning is, measured with the truth at hand."""

import numpy as np

from himap.core.errors import InputError

BUMP = (0.25, 0.38)
"""k around 2 pi / 20 MHz, 1/MHz, where the ripple of the oscillating beam shows."""

_ANGULAR_BANDS = ((1, 10), (10, 200))
_FREQUENCY_BANDS = ((0, 0.03), (0.03, 0.1), (0.1, np.inf))

MSE_DEFINITIONS = {
    "relative": "mean of (S / S_true - 1)^2",
    "logarithmic": "mean of (ln S / S_true)^2",
    "absolute": "sum of (S - S_true)^2 over sum of S_true^2",
}
"""Readings of the mean squared error between two spectra S, which the paper does not define."""


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


def band_median(x, values, low, high):
    """Median of `values` where low < x < high."""
    return float(np.median(values[_inside(x, low, high)]))


def band_max(x, values, low, high):
    """Largest of `values` where low < x < high."""
    return float(values[_inside(x, low, high)].max())


def band_means(degrees, angular, k, frequency):
    """Means of both ratios over bands, and the highest P/P0 near k = 0.31, {name: value}.

    Parameters
    ----------
    degrees, angular
        l, ascending, and C/C0, (n_l,).
    k, frequency
        k, 1/MHz, and P/P0, (n_k,).

    Returns
    -------
    dict
        Without the bands that hold none of the values.
    """
    numbers = {}
    for low, high in _ANGULAR_BANDS:
        high = min(high, int(degrees[-1]))
        if _within(degrees, low, high).any():
            numbers[f"C/C0, {low} < l < {high}"] = band_mean(degrees, angular, low, high)
    for low, high in _FREQUENCY_BANDS:
        name = f"P/P0, k > {low}" if high == np.inf else f"P/P0, {low} < k < {high}"
        if _within(k, low, high).any():
            numbers[name] = band_mean(k, frequency, low, high)
    if _within(k, *BUMP).any():
        numbers["P/P0, highest near k = 0.31"] = band_max(k, frequency, *BUMP)
    return numbers


def largest_deviation(x, ratios, low, high):
    """Largest |ratio - 1| where low < x < high, and the x it is at."""
    inside = _inside(x, low, high)
    deviation = np.abs(ratios[inside] - 1)
    worst = deviation.argmax()
    return float(deviation[worst]), float(np.asarray(x)[inside][worst])


def mean_squared_error(recovered, true, definition="relative"):
    """Mean squared error of one spectrum, a number without unit; see `MSE_DEFINITIONS`.

    The total of the paper's Fig. 3 is read as the sum of that of C_l and that of P(k), so that both
    count alike although their units differ.

    Raises
    ------
    InputError
        An unknown definition, or spectra that `ratio` refuses.
    """
    if definition not in MSE_DEFINITIONS:
        raise InputError(f"unknown definition {definition!r}; there are {', '.join(MSE_DEFINITIONS)}.")
    over = ratio(recovered, true)
    if definition == "relative":
        return float(np.mean((over - 1) ** 2))
    if definition == "logarithmic":
        return float(np.mean(np.log(over) ** 2))
    return float(np.average((over - 1) ** 2, weights=np.square(true, dtype=float)))


def flagged_lines(errors):
    """Lines of sight with ``|mean(MSE) - MSE| > sigma(MSE)``, (n_pix,) bool (paper, Sect. 5.1)."""
    return np.abs(errors.mean() - errors) > errors.std()


def error_variance(recovered, true):
    """Variance over channels of R_l = (C_l true - C_l) / C_l true, (n_l,) (paper, Eqs. A.2 and A.3).

    Both (n_channels, n_l). It is a variance about the mean over channels, so that a method which is wrong
    everywhere alike has none.
    """
    return np.var(1 - ratio(recovered, true), axis=0)


def _within(x, low, high):
    return (np.asarray(x) > low) & (np.asarray(x) < high)


def _inside(x, low, high):
    inside = _within(x, low, high)
    if not inside.any():
        raise InputError(
            f"nothing lies between {low} and {high}: the values go from {np.min(x):g} to {np.max(x):g}."
        )
    return inside
