"""The problem that SDecGMCA solves in turns for A and for S: X_l = diag(H_l) A S_l + N_l."""

import numpy as np

from himap.removal.harmonic import blocks, cross_products

__all__ = ["Channels"]

_RANK = 1e-13  # directions below this share of the largest are rounding


class Channels:
    """Data modes of all channels, and their beams.

    Parameters
    ----------
    modes
        X, real modes, (n_channels, (lmax + 1)^2).
    beams
        H_l relative to the resolution of the sources, (n_channels, lmax + 1).
    noise
        Variance of the noise per mode and channel, (n_channels,).
    """

    def __init__(self, modes, beams, noise):
        self.modes, self.beams, self.noise = modes, beams, noise
        self.lmax = beams.shape[1] - 1

    def matrices(self, mixing):
        """W_l = diag(H_l) A, (n_l, n_channels, n_sources)."""
        return self.beams.T[:, :, None] * mixing

    def noise_of(self, inverses):
        """Variance of the noise of the sources P_l X_l, (n_l, n_sources)."""
        return inverses**2 @ self.noise

    def fit(self, sources, window):
        """A by least squares of window_l X_l = H_l A S_l, channel by channel (C21, Eq. 14).

        `window` (lmax + 1,) makes of the data what `sources` are: 1, or the detail scales.
        """
        return self._solve(self.modes, sources, sources, window, np.ones_like(window))

    def corrected(self, mixing, sources, kept):
        """A plus what the residual X - H A S still holds of the thresholded sources `kept`.

        Solves sum_l H (X - H A S) kept^T = 0 by one Newton step. Without noise the true A is a fixed point
        whatever the thresholds take away, for the whole sources are subtracted. In `fit` what is cut from
        the sources stays in the data, through another beam in each channel, and A goes to fit that.
        """
        left = np.empty_like(self.modes)
        parts = zip(self.matrices(mixing), *map(blocks, (sources, self.modes, left)), strict=True)
        for matrix, source, seen, out in parts:
            np.subtract(seen, matrix @ source, out=out)
        ones = np.ones(len(self.beams[0]))
        return mixing + self._solve(left, sources, kept, ones, ones)

    def misfit(self, mixing, sources):
        """Sum of (X - H A S)^2."""
        parts = zip(self.matrices(mixing), blocks(sources), blocks(self.modes), strict=True)
        return sum(float(np.sum((seen - matrix @ source) ** 2)) for matrix, source, seen in parts)

    def _solve(self, data, sources, kept, window, weights):
        """B of sum_l H_l (window_l data - weights_l H_l B sources) kept^T = 0 by channel; never singular."""
        length, kept_length = _lengths(sources), _lengths(kept)
        cross = np.einsum("l,cl,lcn->cn", window, self.beams, cross_products(data, kept)) / kept_length
        gram = cross_products(sources, kept) / np.outer(length, kept_length)
        gram = np.einsum("l,cl,lmn->cmn", weights, self.beams**2, gram)
        return np.einsum("cn,cnm->cm", cross, np.linalg.pinv(gram, rcond=_RANK)) / length


def _lengths(sources):
    """Norm of every source, 1 where it is zero, so that faint sources do not drown in rounding."""
    length = np.linalg.norm(sources, axis=1)
    return np.where(length > 0, length, 1)
