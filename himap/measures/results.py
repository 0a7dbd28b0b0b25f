"""What is measured on a cleaned cube, and how it compares with the truth."""

from dataclasses import dataclass, replace

import numpy as np

from himap.measures import diagnostics
from himap.measures.power_spectra import AngularPower, FrequencyPower


@dataclass(frozen=True, kw_only=True)
class PowerSpectra:
    """Both spectra of one cube."""

    angular: AngularPower
    frequency: FrequencyPower


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """How well a method did on a case, measured against the truth.

    Attributes
    ----------
    power_spectra
        `PowerSpectra` of what it leaves.
    correlation
        Pearson r with the truth in every channel, (n_channels,).
    line_errors
        Mean squared error of every line of sight, (n_pix,), mK^2.
    masked, masked_truth
        `PowerSpectra` without the lines of sight that `diagnostics.flagged_lines` flags, of what is left
        and of the truth; None unless asked for.
    converged, n_iterations
        As in `himap.removal.base.Separation`.
    mixing
        The mixing matrix of the method, (n_channels, n_sources).
    truth
        `PowerSpectra` of the truth cut at the same multipole, where what is left ends at one; all else is
        then measured against that truth. None where the whole truth is the measure.
    """

    power_spectra: PowerSpectra
    correlation: np.ndarray
    line_errors: np.ndarray
    masked: PowerSpectra | None
    masked_truth: PowerSpectra | None
    converged: bool
    n_iterations: int
    mixing: np.ndarray
    truth: PowerSpectra | None = None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Both spectra of what a method leaves, and those of the truth.

    Attributes
    ----------
    degrees, angular, true_angular
        l, from 2, and C_l averaged over channels, mK^2, (n_l,).
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
    def of(cls, recovered, true, *, l_top):
        """From two `PowerSpectra`, for 2 <= l <= l_top and k > 0."""
        inside = (true.angular.degrees >= 2) & (true.angular.degrees <= l_top)
        return cls(
            degrees=true.angular.degrees[inside],
            angular=recovered.angular.mean[inside],
            true_angular=true.angular.mean[inside],
            k=true.frequency.k[1:],
            frequency=recovered.frequency.power[1:],
            true_frequency=true.frequency.power[1:],
        )

    @property
    def angular_ratio(self):
        """C/C0, (n_l,)."""
        return diagnostics.ratio(self.angular, self.true_angular)

    @property
    def frequency_ratio(self):
        """P/P0, (n_k,)."""
        return diagnostics.ratio(self.frequency, self.true_frequency)

    def in_bins_of(self, other):
        """With C_l averaged over the bins of `other`, all of one width, as far as this one covers them."""
        width = other.degrees[1] - other.degrees[0]
        inside = np.abs(self.degrees - other.degrees[:, None]) < width / 2
        whole = inside.sum(axis=1) == round(width)
        bins = inside[whole] / width
        return replace(
            self,
            degrees=other.degrees[whole],
            angular=bins @ self.angular,
            true_angular=bins @ self.true_angular,
        )

    def total_error(self, definition="relative", *, lmax=200):
        """Mean squared error of C_l, l <= lmax, plus that of P(k); see `diagnostics.mean_squared_error`."""
        low = self.degrees <= lmax
        return diagnostics.mean_squared_error(
            self.angular[low], self.true_angular[low], definition
        ) + diagnostics.mean_squared_error(self.frequency, self.true_frequency, definition)
