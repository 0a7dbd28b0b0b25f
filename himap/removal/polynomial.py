"""Polynomial fit along each line of sight (paper, Sect. 3.2.1)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.peaks import check_clipping, least_channels, smooth_baselines


@dataclass(frozen=True, kw_only=True)
class Polynomial(ForegroundRemover):
    """A polynomial in frequency, fitted to each line of sight.

    T(nu, p) = sum_n a_n(p) nu^n, n = 0..order (Eq. 18), fitted again without the channels that the first fit
    leaves more than `n_sigma` standard deviations away. The mixing matrix A holds polynomials that are
    orthonormal over the channels instead of powers of nu, the sources S their coefficients: the same fit.

    With weights of voxels it has the least weighted squares; those of pixels change nothing.
    """

    name: ClassVar[str] = "polynomial"
    uses: ClassVar[frozenset] = frozenset({"weights"})
    order: int = parameter(6, "order of the polynomial", minimum=1)
    n_sigma: float = parameter(5.0, "channels further from the first fit are left out", minimum=0, above=True)

    def check(self, n_channels):
        """Refuse an order or threshold that leaves too few channels (`peaks.check_clipping`)."""
        super().check(n_channels)
        check_clipping(n_channels, self.order, self.n_sigma)

    def least_channels(self, n_channels):
        return least_channels(n_channels, self.order, self.n_sigma)

    def _separate(self, data):
        # The paper fits the total temperature, and clips what stands out from it.
        baselines = smooth_baselines(
            data.total, data.freqs, order=self.order, n_sigma=self.n_sigma, weights=data.weights
        )
        return Separation(mixing=baselines.basis, sources=baselines.second, means=np.zeros(len(data.freqs)))
