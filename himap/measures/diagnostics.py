"""Quality of a cleaning, measured against the truth."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.errors import InputError
from himap.measures.spectra import PowerSpectra

BUMP = (0.25, 0.38)
"""k around 2 pi / 20 MHz, 1/MHz, where the ripple of the oscillating beam appears."""

FREQUENCY_BANDS = {"0-0.03": (0, 0.03), "0.03-0.1": (0.03, 0.1), "k > 0.1": (0.1, np.inf)}
"""Bands of k, 1/MHz."""

BANDS = {
    f"C/C0, {first}-{last}": ("angular", first - 0.5, last + 0.5)
    for first, last in ((2, 4), (5, 9), (10, 19), (20, 39), (40, 99), (100, 200))
} | {f"P/P0, {name}": ("frequency", *ends) for name, ends in FREQUENCY_BANDS.items()}
"""{name: ("angular" or "frequency", lower and upper limit of l or k, both excluded)}."""

JUDGED = ("C/C0, 10-19", "C/C0, 20-39", "C/C0, 40-99", "P/P0, 0.03-0.1", "P/P0, k > 0.1")
"""Bands used to judge cleanings: below are few multipoles, and slow modes are lost with any beam."""

FAILING = 0.1
"""A cleaning *fails* if its mean |C/C0 - 1| for 10 < l < 200, or up to 2 nside, exceeds this."""

MSE_DEFINITIONS = {
    "relative": lambda over, true: np.mean((over - 1) ** 2),
    "logarithmic": lambda over, true: np.mean(np.log(over) ** 2),
    "absolute": lambda over, true: np.average((over - 1) ** 2, weights=np.square(true, dtype=float)),
}
"""{reading of the mean squared error of a spectrum S, which the paper does not define: function of S / S_true
and S_true}; "absolute" is the sum of (S - S_true)^2 over that of S_true^2."""


def ratio(recovered, true):
    """Recovered over true spectrum, element by element (paper, lower panels of Figs. 1 and 2).

    Raises
    ------
    InputError
        If spectra have different shapes, or the true one is not positive.
    """
    recovered, true = np.asarray(recovered, dtype=float), np.asarray(true, dtype=float)
    if recovered.shape != true.shape:
        raise InputError(f"both spectra must have one shape, got {recovered.shape} and {true.shape}.")
    if not (true > 0).all():
        raise InputError("the true spectrum must be positive to be divided by; leave out l = 0 or k = 0.")
    return recovered / true


def bands(angular, frequency, table=BANDS, *, complete=True):
    """Bands that contain some of l (n_l,) and k (n_k,), 1/MHz, {name: (kind, which elements are inside)}.

    Parameters
    ----------
    angular, frequency
        l and k, ascending; l may be centres of bins.
    table
        Bands in the form of `BANDS`.
    complete
        Whether l must reach the end of a band.
    """
    x = {"angular": angular, "frequency": frequency}
    found = {name: (kind, _within(x[kind], low, high)) for name, (kind, low, high) in table.items()}
    return {
        name: (kind, inside)
        for name, (kind, inside) in found.items()
        if inside.any() and not (complete and kind == "angular" and table[name][2] > angular[-1] + 0.5)
    }


def band_means(ratios, angular, frequency, table=BANDS, *, complete=True):
    """Means of ratios over the `bands` that some l (n_l,) and k (n_k,), 1/MHz, reach, {band: (...)}.

    `ratios` are {"angular": (..., n_l), "frequency": (..., n_k)}, or other values at these l and k.
    """
    reached = bands(angular, frequency, table, complete=complete)
    return {name: ratios[kind][..., inside].mean(axis=-1) for name, (kind, inside) in reached.items()}


def plain_band(name):
    """Convert the name of a band of ratios to that of a band of the spectrum."""
    ratio, _, where = name.partition(", ")
    return f"C(l), l {where}" if ratio == "C/C0" else f"P(k), k {where.removeprefix('k ')}"


def _within(x, low, high):
    return (np.asarray(x) > low) & (np.asarray(x) < high)


def inside(x, values, low, high):
    """The `values` with low < x < high.

    Raises
    ------
    InputError
        If there are none.
    """
    there = _within(x, low, high)
    if not there.any():
        raise InputError(
            f"nothing lies between {low} and {high}: the values go from {np.min(x):g} to {np.max(x):g}. More "
            "channels reach higher wavenumbers, a wider band lower ones, a larger nside higher multipoles."
        )
    return values[there]


def mean_squared_error(recovered, true, definition="relative"):
    """Mean squared error of one spectrum, a number without unit; see `MSE_DEFINITIONS`.

    The total of the paper's Fig. 3 is taken as the sum of the errors of C_l and of P(k), so that both
    count equally although their units differ. It is infinite if the recovered spectrum is not finite, or,
    for "logarithmic", not positive, for example of a failed run.

    Raises
    ------
    InputError
        For an unknown definition, or spectra that `ratio` refuses.
    """
    if definition not in MSE_DEFINITIONS:
        raise InputError(f"unknown definition {definition!r}; there are {', '.join(MSE_DEFINITIONS)}.")
    over = ratio(recovered, true)
    if not np.isfinite(over).all() or (definition == "logarithmic" and over.min() <= 0):
        return np.inf
    return float(MSE_DEFINITIONS[definition](over, true))


def flagged_lines(errors):
    """Lines of sight with ``|mean(MSE) - MSE| > sigma(MSE)``, (n_pix,) bool (paper, Sect. 5.1)."""
    return np.abs(errors.mean() - errors) > errors.std()


def error_variance(recovered, true):
    """Variance over channels of R_l = (C_l true - C_l) / C_l true, (n_l,) (paper, Eqs. A.2 and A.3).

    Both are (n_channels, n_l). This is a variance about the mean over channels, so an error that is the same
    in all channels does not contribute.
    """
    return np.var(1 - ratio(recovered, true), axis=0)


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """Quality of the result of a method, measured against the truth.

    Attributes
    ----------
    power_spectra
        `PowerSpectra` of the residual.
    correlation
        Pearson r with the truth in every channel, (n_channels,).
    line_errors
        Mean squared error of every line of sight, (n_pix,), mK^2.
    converged, n_iterations
        As in `himap.removal.base.Separation`.
    mixing
        The mixing matrix of the method, (n_channels, n_sources).
    cut_truth
        `PowerSpectra` of the truth up to the multipole at which the residual ends, a second measure: all
        others use the truth at every multipole. None if the residual does not end.
    diagnostics
        As in `himap.removal.base.Separation`.
    """

    power_spectra: PowerSpectra
    correlation: np.ndarray
    line_errors: np.ndarray
    converged: bool
    n_iterations: int
    mixing: np.ndarray
    cut_truth: PowerSpectra | None = None
    diagnostics: dict | None = None


AVERAGES = {
    "means": lambda recovered, true: (recovered.mean(axis=0), true.mean(axis=0)),
    "ratios": lambda recovered, true: (
        true.mean(axis=0) * ratio(recovered, true).mean(axis=0),
        true.mean(axis=0),
    ),
    "middle": lambda recovered, true: (recovered[len(true) // 2], true[len(true) // 2]),
}
"""{average over channels: function from recovered and true C_l (n_channels, n_l) to one of each, (n_l,)}.
C/C0 is their quotient: of the means, the mean of the quotients, or that of the middle channel."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Both spectra of a residual and of the truth.

    Attributes
    ----------
    degrees, angular, true_angular
        l, from 2, and C_l averaged over channels by one of `AVERAGES`, mK^2, (n_l,).
    k, frequency, true_frequency
        k, above 0, 1/MHz, and P(k), mK^2 MHz, (n_k,).
    """

    degrees: np.ndarray
    angular: np.ndarray
    true_angular: np.ndarray
    k: np.ndarray
    frequency: np.ndarray
    true_frequency: np.ndarray

    @classmethod
    def of(cls, recovered, true, *, l_top, average="means"):
        """Compare two `PowerSpectra`, for 2 <= l <= l_top where the recovered one has C_l, and k > 0.

        C_l is averaged over channels by one of `AVERAGES`.
        """
        degrees = true.angular.degrees[: len(recovered.angular.degrees)]
        inside = np.flatnonzero((degrees >= 2) & (degrees <= l_top))
        angular, true_angular = AVERAGES[average](recovered.angular.cl[:, inside], true.angular.cl[:, inside])
        return cls(
            degrees=degrees[inside],
            angular=angular,
            true_angular=true_angular,
            k=true.frequency.k[1:],
            frequency=recovered.frequency.power[1:],
            true_frequency=true.frequency.power[1:],
        )

    @property
    def angular_ratio(self):
        """C/C0, (n_l,)."""
        return ratio(self.angular, self.true_angular)

    @property
    def frequency_ratio(self):
        """P/P0, (n_k,)."""
        return ratio(self.frequency, self.true_frequency)

    @property
    def ratios(self):
        """{"angular": C/C0, "frequency": P/P0}, for `band_means`."""
        return {"angular": self.angular_ratio, "frequency": self.frequency_ratio}

    def wide_band_means(self):
        """Means of both ratios over two bands of l and three of k, and the highest P/P0 near k = 0.31.

        Returns
        -------
        dict
            {name: value}, without empty bands.
        """
        ends = [(low, min(high, int(self.degrees[-1]))) for low, high in ((1, 10), (10, 200))]
        table = {f"C/C0, {low} < l < {high}": ("angular", low, high) for low, high in ends}
        for low, high in FREQUENCY_BANDS.values():
            name = f"P/P0, k > {low}" if high == np.inf else f"P/P0, {low} < k < {high}"
            table[name] = "frequency", low, high
        means = band_means(self.ratios, self.degrees, self.k, table, complete=False)
        if _within(self.k, *BUMP).any():
            means["P/P0, highest near k = 0.31"] = inside(self.k, self.frequency_ratio, *BUMP).max()
        return {name: float(value) for name, value in means.items()}

    @property
    def fails(self):
        """Whether the mean |C/C0 - 1| for 10 < l < 200 exceeds `FAILING`; False if l ends before."""
        inside = _within(self.degrees, 10, 200)
        return bool(inside.any() and not np.abs(self.angular_ratio[inside] - 1).mean() <= FAILING)

    def in_bins_of(self, other):
        """The same with C_l averaged over the bins of `other`, all of one width, as far as l reaches."""
        width = other.degrees[1] - other.degrees[0]
        inside = np.abs(self.degrees - other.degrees[:, None]) < width / 2
        covered = inside.sum(axis=1) == round(width)
        bins = inside[covered] / width
        return replace(
            self,
            degrees=other.degrees[covered],
            angular=bins @ self.angular,
            true_angular=bins @ self.true_angular,
        )

    def total_error(self, definition="relative", *, lmax=200):
        """Mean squared error of C_l, l <= lmax, plus that of P(k); see `mean_squared_error`."""
        low = self.degrees <= lmax
        return mean_squared_error(self.angular[low], self.true_angular[low], definition) + mean_squared_error(
            self.frequency, self.true_frequency, definition
        )
