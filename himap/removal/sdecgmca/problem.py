"""What SDecGMCA solves in turns for A and for S: X_l = diag(H_l) A S_l + N_l (paper, Eq. 21)."""

from dataclasses import dataclass

import numpy as np

from himap.removal import harmonic
from himap.removal.blurred_mixture import BlurredMixture

_FAINTEST = 1e-20  # of the largest C_l of a source: C21's code divides by no less
_VANISHED = 1e-100  # mK^2, far below any C_l: what a source without any is divided by


@dataclass(frozen=True)
class Problem(BlurredMixture):
    """A `BlurredMixture` whose A and S come from regularised normal equations.

    Attributes
    ----------
    floor
        Eigenvalues of the normal equations below this share of the largest are raised to it.
    """

    floor: float = 1e-14

    def normal(self, mixing):
        """A^T H_l^2 A, (n_l, n_sources, n_sources)."""
        n = mixing.shape[1]
        products = (mixing[:, :, None] * mixing[:, None, :]).reshape(len(mixing), -1)
        return (self.beams.T**2 @ products).reshape(-1, n, n)

    def inverses(self, mixing, epsilon):
        """(A^T H_l^2 A + diag(epsilon_l))^-1 A^T H_l (paper, Eq. 23), (n_l, n_sources, n_channels).

        `epsilon` is (n_l, n_sources), or 0.
        """
        normal = self.normal(mixing)
        normal[:, *np.diag_indices(mixing.shape[1])] += epsilon
        return _inverse(normal, self.floor) @ (self.beams.T[:, None, :] * mixing.T)

    def fit(self, sources, window):
        """A by least squares of window_l X_l = H_l A S_l, channel by channel (C21, Eq. 14).

        `window` (lmax + 1,) makes of the data what `sources` are: 1, or the detail scales.
        """
        gram = harmonic.cross_products(sources, sources)
        n = len(sources)
        normal = (self.beams**2 @ gram.reshape(-1, n * n)).reshape(-1, n, n)
        cross = np.einsum("cl,lcn->cn", self.beams * window, harmonic.cross_products(self.modes, sources))
        return np.einsum("cmn,cn->cm", _inverse(normal, self.floor), cross)

    def of_matrices(self, mixing, strength):
        """epsilon_l = max(0, c - lambda_min(A^T H_l^2 A) / lambda_min(A^T A)), (n_l, 1) (C21, #3)."""
        limit = np.linalg.eigvalsh(mixing.T @ mixing)[0]
        smallest = np.linalg.eigvalsh(self.normal(mixing))[:, 0]
        ratio = smallest / limit if limit > 0 else np.ones(len(smallest))
        return np.maximum(0, strength - ratio)[:, None]

    def of_spectra(self, sources, strength):
        """epsilon_l = c noise / C_l of each source, (n_l, n_sources) (C21, strategy #4)."""
        spectra = np.stack([np.mean(block**2, axis=1) for block in harmonic.blocks(sources)])
        spectra = np.maximum(spectra, np.maximum(_FAINTEST * spectra.max(axis=0), _VANISHED))
        return strength * np.mean(self.noise) / spectra


def _inverse(matrices, floor):
    """Inverses of symmetric matrices (n, m, m), eigenvalues raised to `floor` times the largest."""
    values, vectors = np.linalg.eigh(matrices)
    values = np.maximum(values, np.maximum(floor * values[:, -1:], np.finfo(float).tiny))
    return (vectors / values[:, None, :]) @ np.swapaxes(vectors, -1, -2)
