"""Principal component analysis (paper, Sect. 3.1.1)."""

from dataclasses import dataclass, replace
from typing import ClassVar

from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.covariance import principal_axes
from himap.removal.weighted_pca import weighted_components


@dataclass(frozen=True, kw_only=True)
class PCA(ForegroundRemover):
    """Principal components of the channel covariance.

    C = X X^T / n_pix = U D U^T (Eq. 15); the columns of U with the largest eigenvalues are the
    mixing matrix A, the sources are S = A^T X, the foreground is A S.

    With weights, A S minimises the weighted squares of the residual, and fills missing voxels
    (`himap.removal.weighted_pca.weighted_components`).
    """

    name: ClassVar[str] = "pca"
    uses: ClassVar[frozenset] = frozenset({"weights"})
    n_sources: int = parameter(3, "number of components to remove", minimum=1)

    def least_channels(self, n_channels):
        return min(self.n_sources + 1, n_channels)

    def _separate(self, data):
        if data.weights is None:
            return principal_components(data, self.n_sources)
        components = weighted_components(data.centred, data.weights, self.n_sources)
        return replace(components, means=data.means + components.means)


def principal_components(data, n_sources):
    """The `Separation` of PCA: the first `n_sources` principal components of `Data` without weights."""
    mixing = principal_axes(data.covariance, n_sources)
    return Separation(mixing=mixing, sources=data.project(mixing.T))
