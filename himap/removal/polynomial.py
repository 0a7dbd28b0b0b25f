"""Polynomial fit along each line of sight (paper, Sect. 3.2.1)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.maps.low_rank import LowRankCube, blocks
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.peaks import baseline_basis, check_clipping, least_channels, smooth_baselines

_DEGREE = 31  # of polynomials in log nu that represent the exponential of a fit to rounding
_MOST_BEYOND = 10.0  # in log T above all observed values: the limit of extrapolation to missing channels


@dataclass(frozen=True, kw_only=True)
class Polynomial(ForegroundRemover):
    """A polynomial in frequency, fitted to each line of sight.

    T(nu, p) = sum_n a_n(p) nu^n, n = 0..order (Eq. 18). It is fitted a second time without channels more than
    `n_sigma` standard deviations from the first fit. The mixing matrix A holds polynomials that are
    orthonormal over the channels instead of powers of nu, the sources S their coefficients: the same fit.

    With ``variable="logarithm"``, log T is a polynomial of log nu, as in other works; A and S then describe
    log(T / mean along the line).

    With weights of voxels the fit minimises weighted squares; weights of pixels change nothing.
    """

    name: ClassVar[str] = "polynomial"
    uses: ClassVar[frozenset] = frozenset({"weights"})
    order: int = parameter(6, "order of the polynomial", minimum=1)
    n_sigma: float = parameter(5.0, "channels further from the first fit are excluded", minimum=0, above=True)
    variable: str = parameter(
        "temperature",
        "what is fitted: temperature as a polynomial of frequency, or both in logarithms",
        choices=("temperature", "logarithm"),
        off="temperature",
    )

    def check(self, n_channels):
        """Refuse an order or threshold that could leave too few channels (`peaks.check_clipping`)."""
        super().check(n_channels)
        check_clipping(n_channels, self.order, self.n_sigma)

    def least_channels(self, n_channels):
        return least_channels(n_channels, self.order, self.n_sigma)

    def _separate(self, data):
        # The paper fits the total temperature, and clips outliers from that fit.
        options = {"order": self.order, "n_sigma": self.n_sigma, "weights": data.weights}
        lines, freqs, low_rank = data.total, data.freqs, None
        if self.variable == "logarithm":
            (lines, scale), place = _logarithms(data), np.log(freqs / freqs[0])
            freqs = freqs[0] + (freqs[-1] - freqs[0]) * place / place[-1]  # even in log nu, from end to end
        baselines = smooth_baselines(lines, freqs, **options)
        if self.variable == "logarithm":
            spectra = baseline_basis(freqs, min(_DEGREE, len(freqs) - 1))
            if np.ndim(data.weights) == 2:  # with missing voxels, fits may be too steep for polynomials
                spectra = np.eye(len(freqs))
            highest, fits = lines.max() + _MOST_BEYOND, np.empty((spectra.shape[1], len(scale)))
            for block in blocks(len(scale)):
                exponents = np.minimum(baselines.basis @ baselines.second[:, block], highest)
                fits[:, block] = spectra.T @ (np.exp(exponents) * scale[block])
            low_rank = LowRankCube(spectra=spectra, maps=fits)
        return Separation(
            low_rank=low_rank,
            mixing=baselines.basis,
            sources=baselines.second,
            means=np.zeros(len(freqs)),
        )


def _logarithms(data):
    """log(T / mean of the line), (n_channels, n_pix), 0 in missing voxels; and that mean, (n_pix,)."""
    total = data.total
    seen = data.weights > 0 if np.ndim(data.weights) == 2 else np.ones(1, dtype=bool)
    n_bad = np.count_nonzero((total <= 0) & seen)
    if n_bad:
        raise InputError(
            f"variable='logarithm' fits the logarithm of the total brightness, but {n_bad} of {total.size} "
            "voxels are not positive; give maps from which no mean was removed, or use "
            "variable='temperature'."
        )
    scale = np.mean(total, axis=0, dtype=np.float64, where=seen)
    lines = np.zeros_like(total)
    np.log(total / scale.astype(total.dtype), out=lines, where=seen)
    return lines, scale
