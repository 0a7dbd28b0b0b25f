"""Sources seen through the beams of the channels, X_l = diag(H_l) A S_l + N_l: A and S in turns."""

from dataclasses import dataclass

import numpy as np

from himap.removal.covariance import principal_axes
from himap.removal.harmonic import at_one_resolution, blocks, cross_products, project, safe_inverse

_RANK = 1e-13  # directions below this share of the largest are rounding


@dataclass(frozen=True)
class BlurredMixture:
    """Data modes of all channels, and what they are seen through.

    Attributes
    ----------
    modes
        X, real modes (`himap.removal.harmonic`), (n_channels, (lmax + 1)^2).
    beams
        H_l, (n_channels, lmax + 1).
    noise
        Variance of the noise per mode and channel, (n_channels,); None where it is not known.
    """

    modes: np.ndarray
    beams: np.ndarray
    noise: np.ndarray | None = None

    @property
    def lmax(self):
        """Largest multipole."""
        return self.beams.shape[1] - 1

    def at_one_resolution(self, which="lowest"):
        """Sum over modes of X X^T, X re-convolved to one beam, (n_channels, n_channels).

        `which` is "lowest", that of the widest beam at every l, or "first", that of the first channel, in
        which the code of Carloni Gertosio & Bobin (2021) counts coefficients of m > 0 once where the sum over
        m has them twice.
        """
        seen = self.beams[0] if which == "first" else self.beams.min(axis=0)
        return at_one_resolution(self.modes, seen / self.beams, halve=which == "first")

    def start(self, n_sources, which="lowest"):
        """A from the principal axes of the data at one resolution, (n_channels, n_sources)."""
        return principal_axes(self.at_one_resolution(which), n_sources)

    def matrices(self, mixing):
        """W_l = diag(H_l) A, (n_l, n_channels, n_sources)."""
        return self.beams.T[:, :, None] * mixing

    def least_squares(self, mixing):
        """P_l with S_l = P_l X_l by least squares of A, (n_l, n_sources, n_channels)."""
        return safe_inverse(self.matrices(mixing))

    def sources(self, inverses):
        """S_l = P_l X_l of every l, real modes (n_sources, (lmax + 1)^2)."""
        return project(inverses, self.modes)

    def source_noise(self, inverses):
        """Variance of the noise of those sources per mode, (n_l, n_sources)."""
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
        length, kept_length = _lengths(sources), _lengths(kept)
        cross = np.einsum("cl,lcn->cn", self.beams, cross_products(residual, kept)) / kept_length
        gram = cross_products(sources, kept) / np.outer(length, kept_length)
        gram = np.einsum("cl,lmn->cmn", self.beams**2, gram)
        return mixing + np.einsum("cn,cnm->cm", cross, np.linalg.pinv(gram, rcond=_RANK)) / length

    def residual_noise(self, mixing, sources):
        """Variance per mode and channel of X - H A S over the finer half of the multipoles, (n_channels,)."""
        fine = ((self.lmax + 1) // 2) ** 2
        return np.mean(self.residual(mixing, sources)[:, fine:] ** 2, axis=1)


def _lengths(sources):
    """Norm of every source, 1 where it is zero, so that faint sources do not drown in rounding."""
    length = np.linalg.norm(sources, axis=1)
    return np.where(length > 0, length, 1)


def noise_per_mode(noise, n_channels, n_pix):
    """Variance per mode and channel, (n_channels,), of noise per pixel, mK, a number or (n_channels,)."""
    return np.broadcast_to(np.square(noise) * 4 * np.pi / n_pix, (n_channels,))


def one_resolution_eigenvalues(modes, beams, lmax):
    """Of the channel covariance at the resolution of the worst channel, (n_channels,) descending, mK^2.

    `modes` are `CubeModes`, `beams` b_l, (n_channels, n_l), and both count to `lmax`.
    """
    mixture = BlurredMixture(modes.upto(lmax), beams[:, : lmax + 1])
    return np.linalg.eigvalsh(mixture.at_one_resolution())[::-1] / (4 * np.pi)
