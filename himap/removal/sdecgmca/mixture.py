"""The mixture with the step for A of C21."""

from himap.removal import blurred_mixture
from himap.removal.harmonic import degrees

__all__ = ["BlurredMixture"]


class BlurredMixture(blurred_mixture.BlurredMixture):
    """`himap.removal.blurred_mixture.BlurredMixture` with A from least squares on thresholded sources."""

    def fit(self, sources, window):
        """A by least squares of window_l X_l = H_l A S_l, channel by channel (C21, Eq. 14).

        `window` (lmax + 1,) makes of the data what `sources` are: 1, or the detail scales.
        """
        return self._solve(window[degrees(self.lmax)] * self.modes, sources, sources)
