"""Choose the number of sources to remove without the truth: criteria on the residual for each number.

Numbers of sources are `counts`, ascending by one. `variances` (n, n_channels), mK^2, are those of the
residuals. `spectra` is a list with arrays for each number, such as C_l and P(k).
"""

import numpy as np

STABLE = 0.1
"""Relative change of a spectrum for one more source, averaged over scales, below which it is stable."""

_STANDS_OUT = 3.0  # times the line of HI and noise: an eigenvalue with foreground in it
_BULK = (0.2, 0.8)  # range of components that are certainly HI and noise


def eigenvalue_line(values):
    """Fit a straight line to the logarithms of the eigenvalues of HI and noise, extrapolated to the others.

    `values` (n,) descend. The line is fitted to those from a fifth to four fifths of their number that are
    above the rounding of the first, and never to the first itself unless there are only two.
    """
    number = np.arange(len(values))
    first, last = (int(share * len(values)) for share in _BULK)
    first = max(first, 1) if len(values) > 2 else first
    bulk = slice(first, max(last, first + 2))
    least = max(values[0] * np.finfo(float).eps, np.finfo(float).tiny)
    slope, offset = np.polyfit(number[bulk], np.log(np.maximum(values[bulk], least)), 1)
    return np.exp(offset + slope * number)


def n_significant(values):
    """Number of leading eigenvalues above three times the `eigenvalue_line`."""
    return int(np.argmin(values > _STANDS_OUT * eigenvalue_line(values)))


def information(variances, counts, n_pix, *, n_seen=None, kind="bic"):
    """An information criterion per voxel, minus its minimum, (n,).

    The mean over channels of ln(variance), plus ln(n_pix) / n_pix ("bic", Schwarz 1978) or 2 / n_pix ("aic",
    Akaike 1974) for each number in the mixing matrix and the sources, over the number of channels. If voxels
    are missing, `n_seen` (n_channels,) is the number observed in each channel: it weights the logarithms, and
    its mean replaces n_pix, except in the count of numbers in the sources.
    """
    n_channels = variances.shape[1]
    n_samples = n_pix if n_seen is None else np.mean(n_seen)
    price = {"bic": np.log(n_samples), "aic": 2.0}[kind] / n_samples
    values = np.average(np.log(variances), axis=1, weights=n_seen)
    values += counts * price * (n_channels + n_pix) / n_channels
    return values - values.min()


def changes(spectra):
    """Relative change of spectra to the next number, averaged over scales, of the largest one, (n - 1,)."""
    return np.array(
        [
            max(float(np.mean(np.abs(b / a - 1))) for a, b in zip(fewer, more, strict=True))
            for fewer, more in zip(spectra[:-1], spectra[1:], strict=True)
        ]
    )


def settled(change, counts, limit=STABLE):
    """The first number from which spectra change by less than `limit` with one more, or None."""
    stable = change < limit
    return int(counts[stable.argmax()]) if stable.any() else None
