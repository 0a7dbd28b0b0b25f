"""What is seen of maps: the pixels that a mask keeps, and the weights of what is in them."""

from dataclasses import dataclass

import numpy as np

from himap.checks import checked_cube
from himap.errors import InputError
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
    image
        Which pixels of an image in the plane the maps have, (n_y, n_x) bool; None where they are of none.
    """

    kept: np.ndarray | None = None
    weights: np.ndarray | None = None
    image: np.ndarray | None = None

    @classmethod
    def of(cls, maps, mask, weights, image):
        """From a mask, weights and an image as users give them, or None."""
        kept, shape = None, np.shape(maps)
        if mask is not None:
            # Imported here: most calls do without transforms, and to import these takes a second.
            from himap.removal.masked import checked_kept

            kept = checked_kept(mask, shape[-1] if shape else 0)
        if weights is not None:
            kept, weights = checked_weights(weights, shape, kept)
        if image is not None:
            image = _checked_image(image, shape[-1] if shape else 0)
        return cls(kept=kept, weights=weights, image=image)

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

    def image_of_lines(self):
        """Which pixels of the image the lines of sight have that are kept, (n_y, n_x) bool, or None."""
        if self.image is None or self.kept is None:
            return self.image
        image = self.image.copy()
        image[image] = self.kept
        return image

    def completed(self, lines, modes):
        """Lines of sight that are kept on the whole sphere, going on elsewhere, and their `CubeModes`."""
        # Imported here, and below, as above.
        from himap.removal.analysis import analysed
        from himap.removal.masked import completed, lines_on_sphere

        modes = analysed(lines_on_sphere(lines, self.kept), self.kept) if modes is None else modes
        return completed(lines, self.kept, modes), modes

    def among_all(self, separation):
        """The `Separation` of the lines of sight that are kept as one of all pixels, 0 elsewhere."""
        from himap.removal.masked import on_sphere

        return on_sphere(separation, self.kept)

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


def _checked_image(image, n_pix):
    """Which pixels of an image maps of `n_pix` pixels have, (n_y, n_x) bool."""
    image = np.asarray(image)
    if image.dtype != bool or image.ndim != 2 or np.count_nonzero(image) != n_pix:
        got = f"{image.dtype} {image.shape}, {np.count_nonzero(image)} of them not 0"
        raise InputError(
            f"image must be (n_y, n_x) bool, True at the {n_pix} pixels that the maps have, got {got}."
        )
    return image


def means_of(maps, weights):
    """The mean of every channel, (n_channels,) float64."""
    return maps.mean(axis=1, dtype=np.float64) if weights is None else weighted_means(maps, weights)
