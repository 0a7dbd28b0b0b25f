"""Sources seen through the beams of the channels, X_l = diag(H_l) A S_l + N_l: steps to estimate A and S."""

from dataclasses import dataclass

import numpy as np

from himap.removal.analysis import CubeModes
from himap.removal.covariance import principal_axes
from himap.removal.harmonic import blocks, safe_inverse

_RANK = 1e-13  # directions below this share of the largest are rounding errors
_FAINTEST = 1e-20  # of the largest C_l of a source: smallest divisor in the code of C21
_VANISHED = 1e-100  # mK^2, far below any C_l: divisor for a source without power


@dataclass(frozen=True)
class BlurredMixture:
    """Data of all channels as real modes, and the beams they are seen through (paper, Eq. 21).

    Attributes
    ----------
    modes
        X, real modes (`himap.removal.harmonic`), (n_channels, (lmax + 1)^2); or a list with the modes of
        each l, arrays or `SplitModes`; or `CubeModes` to that l or beyond, whose modes of one l are
        computed when needed, which takes less memory.
    beams
        H_l, (n_channels, lmax + 1).
    noise
        Variance of the noise per mode and channel, (n_channels,); None if unknown.
    floor
        Eigenvalues of regularised normal equations below this share of the largest are raised to it.
    """

    modes: np.ndarray | list | CubeModes
    beams: np.ndarray
    noise: np.ndarray | None = None
    floor: float = 1e-14

    @property
    def lmax(self):
        """Largest multipole."""
        return self.beams.shape[1] - 1

    def _by_degree(self):
        """Yield the modes of each l in turn, (n_channels, 2 l + 1)."""
        if isinstance(self.modes, CubeModes):
            return map(self.modes.at, range(self.lmax + 1))
        return self.modes if isinstance(self.modes, list) else blocks(self.modes)

    def at_one_resolution(self, which="lowest"):
        """Sum over modes of X X^T, X re-convolved to one beam, (n_channels, n_channels).

        At one resolution a source has one map again, and as many eigenvalues stand out as there are spectra.
        `which` is "lowest", the widest beam at every l, or "first", the beam of the first channel. With
        "first", coefficients of m > 0 count once, as in the code of C21 (Carloni Gertosio & Bobin 2021),
        although a sum over m has them twice.
        """
        target = self.beams[0] if which == "first" else self.beams.min(axis=0)
        products = np.zeros((len(self.beams), len(self.beams)))
        for ratio, block in zip((target / self.beams).T, self._by_degree(), strict=True):
            convolved = ratio[:, None] * np.asarray(block)
            if which == "first":
                convolved[:, 1:] /= np.sqrt(2)
            products += convolved @ convolved.T
        return products

    def start(self, n_sources, which="lowest"):
        """A from the principal axes of the data at one resolution, (n_channels, n_sources)."""
        return principal_axes(self.at_one_resolution(which), n_sources)

    def matrices(self, mixing):
        """W_l = diag(H_l) A, (n_l, n_channels, n_sources)."""
        return self.beams.T[:, :, None] * mixing

    def least_squares(self, mixing):
        """P_l with S_l = P_l X_l the least-squares sources for A, (n_l, n_sources, n_channels)."""
        return safe_inverse(self.matrices(mixing))

    def inverses(self, mixing, epsilon):
        """P_l = (A^T H_l^2 A + diag(epsilon_l))^-1 A^T H_l (paper, Eq. 23), (n_l, n_sources, n_channels).

        `epsilon` is (n_l, n_sources), or 0.
        """
        return _inverse(self._normal(mixing, epsilon), self.floor) @ (self.beams.T[:, None, :] * mixing.T)

    def floored(self, mixing, epsilon):
        """Share of the multipoles at which `floor` raises an eigenvalue of these normal equations."""
        values = np.linalg.eigvalsh(self._normal(mixing, epsilon))
        return float(np.mean(values[:, 0] < self.floor * values[:, -1]))

    def _normal(self, mixing, epsilon=0):
        """A^T H_l^2 A + diag(epsilon_l), (n_l, n_sources, n_sources)."""
        n = mixing.shape[1]
        products = (mixing[:, :, None] * mixing[:, None, :]).reshape(len(mixing), -1)
        normal = (self.beams.T**2 @ products).reshape(-1, n, n)
        normal[:, *np.diag_indices(n)] += epsilon
        return normal

    def epsilon_of_matrices(self, mixing, strength):
        """max(0, c - lambda_min(A^T H_l^2 A) / lambda_min(A^T A)) of every l, (n_l, 1) (C21, #3)."""
        limit = np.linalg.eigvalsh(mixing.T @ mixing)[0]
        smallest = np.linalg.eigvalsh(self._normal(mixing))[:, 0]
        ratio = smallest / limit if limit > 0 else np.ones(len(smallest))
        return np.maximum(0, strength - ratio)[:, None]

    def epsilon_of_spectra(self, sources, strength):
        """c noise / C_l of each source, (n_l, n_sources) (C21, strategy #4)."""
        spectra = np.stack([np.mean(block**2, axis=1) for block in blocks(sources)])
        spectra = np.maximum(spectra, np.maximum(_FAINTEST * spectra.max(axis=0), _VANISHED))
        return strength * np.mean(self.noise) / spectra

    def sources(self, inverses):
        """S_l = P_l X_l for every l, real modes (n_sources, (lmax + 1)^2)."""
        sources = np.empty((inverses.shape[-2], (self.lmax + 1) ** 2))
        for inverse, data, out in zip(inverses, self._by_degree(), blocks(sources), strict=True):
            out[:] = inverse @ data
        return sources

    def source_noise(self, inverses):
        """Variance of the noise of these sources per mode, (n_l, n_sources)."""
        return inverses**2 @ self.noise

    def fit(self, sources, window):
        """A by least squares of window_l X_l = H_l A S_l, channel by channel (C21, Eq. 14).

        `window` (lmax + 1,) filters the data as `sources` are filtered: 1, or the detail scales.
        """
        n = len(sources)
        gram = _cross_products(blocks(sources), sources)
        normal = (self.beams**2 @ gram.reshape(-1, n * n)).reshape(-1, n, n)
        cross = np.einsum("cl,lcn->cn", self.beams * window, _cross_products(self._by_degree(), sources))
        return np.einsum("cmn,cn->cm", _inverse(normal, self.floor), cross)

    def residual(self, mixing, sources):
        """X - H A S, real modes (n_channels, (lmax + 1)^2)."""
        residual = np.empty((len(self.beams), (self.lmax + 1) ** 2))
        by_degree = zip(
            self.matrices(mixing), self._by_degree(), *map(blocks, (sources, residual)), strict=True
        )
        for matrix, data, source, out in by_degree:
            np.subtract(np.asarray(data), matrix @ source, out=out)
        return residual

    def corrected(self, mixing, residual, sources, kept):
        """A plus the correction by what `residual`, X - H A S, still holds of thresholded sources `kept`.

        Solves sum_l H (X - H A S) kept^T = 0 by one Newton step. Without noise the true A is a fixed point
        for any thresholds, because the complete sources are subtracted. In a fit to the data with `kept`
        alone, A would describe the removed coefficients, which each channel sees through another beam.
        """
        # Sources of unit length, so that faint ones are not lost in rounding.
        length, kept_length = (
            np.where(norm > 0, norm, 1) for norm in (np.linalg.norm(s, axis=1) for s in (sources, kept))
        )
        cross = np.einsum("cl,lcn->cn", self.beams, _cross_products(blocks(residual), kept)) / kept_length
        gram = _cross_products(blocks(sources), kept) / np.outer(length, kept_length)
        gram = np.einsum("cl,lmn->cmn", self.beams**2, gram)
        return mixing + np.einsum("cn,cnm->cm", cross, np.linalg.pinv(gram, rcond=_RANK)) / length


def _cross_products(by_degree, sources):
    """Sum over m of X_l S_l^T for every l, (n_l, n_channels, n_sources); `by_degree` yields X of each l."""
    return np.stack([data @ source.T for data, source in zip(by_degree, blocks(sources), strict=True)])


def _inverse(matrices, floor):
    """Inverses of symmetric matrices (n, m, m), eigenvalues raised to `floor` times the largest."""
    values, vectors = np.linalg.eigh(matrices)
    values = np.maximum(values, np.maximum(floor * values[:, -1:], np.finfo(float).tiny))
    return (vectors / values[:, None, :]) @ np.swapaxes(vectors, -1, -2)


def noise_per_mode(noise, n_channels, n_pix):
    """Variance per mode and channel, (n_channels,), of noise per pixel, mK, a number or (n_channels,)."""
    return np.broadcast_to(np.square(noise) * 4 * np.pi / n_pix, (n_channels,))


def one_resolution_eigenvalues(modes, beams, lmax):
    """Eigenvalues of the channel covariance at the resolution of the worst channel, (n_channels,), mK^2.

    In descending order. `modes` are `CubeModes`, `beams` b_l, (n_channels, n_l); both are used up to `lmax`.
    """
    mixture = BlurredMixture(modes, beams[:, : lmax + 1])
    return np.linalg.eigvalsh(mixture.at_one_resolution())[::-1] / (4 * np.pi)
