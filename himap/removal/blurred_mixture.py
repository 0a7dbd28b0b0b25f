"""Sources seen through the beams of the channels, X_l = diag(H_l) A S_l + N_l: A and S in turns."""

import numpy as np

from himap.removal.covariance import principal_axes
from himap.removal.harmonic import at_one_resolution, blocks, cross_products, project, safe_inverse

__all__ = ["BlurredMixture"]

_RANK = 1e-13  # directions below this share of the largest are rounding


class BlurredMixture:
    """Data modes of all channels, and their beams.

    Parameters
    ----------
    modes
        X, real modes, (n_channels, (lmax + 1)^2).
    beams
        H_l relative to the resolution of the sources, (n_channels, lmax + 1).
    noise
        Variance of the noise per mode and channel, (n_channels,); None where it is not needed.
    """

    def __init__(self, modes, beams, noise=None):
        self.modes, self.beams, self.noise = modes, beams, noise
        self.lmax = beams.shape[1] - 1

    def with_noise(self, noise):
        """The same data with another noise."""
        return type(self)(self.modes, self.beams, noise)

    def at_worst_beam(self):
        """Sum over modes of X X^T, X re-convolved to the worst beam at every l, (n_channels, n_channels)."""
        return at_one_resolution(self.modes, self.beams.min(axis=0) / self.beams)

    def start(self, n_sources):
        """Principal axes of the data re-convolved to the worst beam, (n_channels, n_sources)."""
        return principal_axes(self.at_worst_beam(), n_sources)

    def matrices(self, mixing):
        """W_l = diag(H_l) A, (n_l, n_channels, n_sources)."""
        return self.beams.T[:, :, None] * mixing

    def sources(self, mixing):
        """S of A by least squares at every l, real modes (n_sources, (lmax + 1)^2)."""
        return project(safe_inverse(self.matrices(mixing)), self.modes)

    def noise_of(self, inverses):
        """Variance of the noise of the sources P_l X_l, (n_l, n_sources)."""
        return inverses**2 @ self.noise

    def residual(self, mixing, sources):
        """X - H A S, real modes (n_channels, (lmax + 1)^2)."""
        residual = np.empty_like(self.modes)
        by_degree = zip(self.matrices(mixing), *map(blocks, (sources, self.modes, residual)), strict=True)
        for matrix, source, data, out in by_degree:
            np.subtract(data, matrix @ source, out=out)
        return residual

    def corrected(self, mixing, residual, sources, kept):
        """A plus what `residual`, X - H A S, still holds of the thresholded sources `kept`.

        Solves sum_l H (X - H A S) kept^T = 0 by one Newton step. Without noise the true A is a fixed point
        whatever the thresholds take away, for the whole sources are subtracted. Fitted to the data with
        `kept` alone, A would go to describe what was cut, which each channel sees through another beam.
        """
        return mixing + self._solve(residual, sources, kept)

    def residual_noise(self, mixing, sources):
        """Variance per mode and channel of X - H A S over the finer half of the multipoles, (n_channels,)."""
        fine = ((self.lmax + 1) // 2) ** 2
        return np.mean(self.residual(mixing, sources)[:, fine:] ** 2, axis=1)

    def _solve(self, data, sources, kept):
        """B of sum_l H_l (data - H_l B sources) kept^T = 0 by channel; never singular."""
        length, kept_length = _lengths(sources), _lengths(kept)
        cross = np.einsum("cl,lcn->cn", self.beams, cross_products(data, kept)) / kept_length
        gram = cross_products(sources, kept) / np.outer(length, kept_length)
        gram = np.einsum("cl,lmn->cmn", self.beams**2, gram)
        return np.einsum("cn,cnm->cm", cross, np.linalg.pinv(gram, rcond=_RANK)) / length


def _lengths(sources):
    """Norm of every source, 1 where it is zero, so that faint sources do not drown in rounding."""
    length = np.linalg.norm(sources, axis=1)
    return np.where(length > 0, length, 1)
