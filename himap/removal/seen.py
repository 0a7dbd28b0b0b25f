"""What is seen of maps: the pixels that a mask keeps, and the weights of what is in them."""

from dataclasses import dataclass

import numpy as np

from himap.checks import checked_cube
from himap.removal.weights import checked_weights, weighted_means

__all__ = ["Seen", "means_of"]


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What counts of maps (n_channels, n_pix).

    Attributes
    ----------
    kept
        Pixels that are kept, (n_pix,) bool; None for all.
    weights
        (n_pix,) or (n_channels, n_pix), as `checked_weights` gives them; None where all are the same.
    """

    kept: np.ndarray | None = None
    weights: np.ndarray | None = None

    @classmethod
    def of(cls, maps, mask, weights):
        """From a mask and weights as users give them, or None."""
        kept, shape = None, np.shape(maps)
        if mask is not None:
            # Imported here: most calls do without transforms, and to import these takes a second.
            from himap.removal.masked import checked_kept

            kept = checked_kept(mask, shape[-1] if shape else 0)
        if weights is not None:
            kept, weights = checked_weights(weights, shape, kept)
        return cls(kept=kept, weights=weights)

    @property
    def by_voxel(self):
        """Whether channels of one pixel have weights of their own."""
        return np.ndim(self.weights) == 2

    def within(self, label, maps):
        """Checked maps (n_channels, n_pix), 0 where nothing is seen."""
        seen = self.weights > 0 if self.by_voxel else self.kept
        maps = checked_cube(label, maps, min_channels=2, kept=seen)
        return maps if seen is None else np.where(seen, maps, np.zeros((), maps.dtype))

    def lines(self):
        """The weights of the lines of sight that are kept, or None."""
        if self.weights is None or self.kept is None:
            return self.weights
        return self.weights[..., self.kept]

    def finish(self, maps, residual, separation):
        """Put 0 into a residual where nothing is seen, and what was found into missing voxels of the maps.

        Both (n_channels, n_pix) are changed, maps only where voxels have weights: there `within` copies them.
        """
        if self.kept is not None:
            residual[:, ~self.kept] = 0
        if not self.by_voxel:
            return
        foreground, missing = separation.foreground, self.weights == 0
        if self.kept is not None:
            missing &= self.kept
        residual[missing] = 0
        rows = zip(foreground.spectra, separation.means, missing, maps, strict=True)
        for spectrum, mean, gaps, row in rows:
            row[gaps] = spectrum @ foreground.maps[:, gaps] + mean


def means_of(maps, weights):
    """The mean of every channel, (n_channels,) float64."""
    return maps.mean(axis=1, dtype=np.float64) if weights is None else weighted_means(maps, weights)
