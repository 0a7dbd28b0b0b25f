"""What the products of the chain hold (`himap.pipeline` makes them)."""

from dataclasses import dataclass

import numpy as np

from himap.spectra import AngularPower, FrequencyPower

__all__ = ["Assessment", "Modes", "Residual", "Spectra"]


@dataclass(frozen=True, kw_only=True)
class Modes:
    """A cube as `spectra` (n_channels, n_modes) @ maps with coefficients `alms` (n_modes, n_alm), mK."""

    spectra: np.ndarray
    alms: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Residual:
    """What a method leaves, `maps` (n_channels, n_pix) in mK, and the rest of its `Separation`."""

    maps: np.ndarray
    mixing: np.ndarray
    sources: np.ndarray
    converged: bool
    n_iterations: int
    flagged: np.ndarray | None


@dataclass(frozen=True, kw_only=True)
class Spectra:
    """Both spectra of one cube."""

    angular: AngularPower
    frequency: FrequencyPower


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """How well a method did on a case, measured against the truth.

    Attributes
    ----------
    spectra
        `Spectra` of what it leaves.
    correlation
        Pearson r with the truth in every channel, (n_channels,).
    line_errors
        Mean squared error of every line of sight, (n_pix,), mK^2.
    masked, masked_truth
        `Spectra` without the lines of sight that `diagnostics.flagged_lines` flags, of what is left and of
        the truth; None unless asked for.
    converged, n_iterations
        As in `Residual`.
    """

    spectra: Spectra
    correlation: np.ndarray
    line_errors: np.ndarray
    masked: Spectra | None
    masked_truth: Spectra | None
    converged: bool
    n_iterations: int
