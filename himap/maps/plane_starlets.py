"""Starlets in the plane: isotropic undecimated wavelets of images of which not all pixels need be seen."""

import numpy as np

from himap.core.errors import InputError

_B_SPLINE = 6 / 16, 4 / 16, 1 / 16  # the cubic B-spline at 0, 1 and 2 steps from its middle


class PlaneStarlets:
    """The starlet transform of images (Starck, Fadili & Murtagh 2007) on the pixels that are seen.

    An image c_0 is smoothed again and again, along both axes with the B-spline kernel (1, 4, 6, 4, 1) / 16,
    its taps 2^(j - 1) pixels apart for c_j ("a trous"). Detail scale j is c_(j - 1) - c_j, so that details
    and the last c_j add up to the image.

    The kernel takes means over the seen pixels alone: those that are not seen, and what lies beyond the
    border, have no weight, and the weights of the others are scaled up to add up to 1 (Knutsson & Westin
    1993). Nothing is filled in, a constant has no details, and all is linear in the pixels.

    Parameters
    ----------
    image
        The seen pixels, (n_y, n_x) bool. Maps have those, row by row, (n_maps, n_pix).
    n_scales
        Number of detail scales.

    Raises
    ------
    InputError
        More scales than the image has room for: the taps of the kernel would lie outside, all but one.
    """

    def __init__(self, image, n_scales):
        most = (max(image.shape) - 1).bit_length()
        if n_scales > most:
            raise InputError(
                f"n_scales must be at most {most} for an image of {image.shape} pixels, got {n_scales}: "
                "coarser scales would be empty."
            )
        self._image = image
        self._distances = [2**scale for scale in range(n_scales)]
        self._shares = [image / np.where(image, _summed(image, step), 1) for step in self._distances]

    def scales(self, maps):
        """Scales of maps, fine to coarse, the smooth rest last: (n_scales + 1, n_maps, n_pix) float64."""
        out = np.empty((len(self._distances) + 1, *maps.shape))
        smooth = self._images_of(maps)
        for step, share, scale in zip(self._distances, self._shares, out[:-1], strict=True):
            finer, smooth = smooth, share * _summed(smooth, step)
            scale[:] = (finer - smooth)[:, self._image]
        out[-1] = smooth[:, self._image]
        return out

    def details(self, maps):
        """`scales` without the smooth rest, (n_scales, n_maps, n_pix)."""
        return self.scales(maps)[:-1]

    def details_adjoint(self, scales):
        """The transpose of `details`, (n_scales, n_maps, n_pix) to (n_maps, n_pix)."""
        total = 0.0
        for step, share, scale in zip(self._distances[::-1], self._shares[::-1], scales[::-1], strict=True):
            images = self._images_of(scale)
            total = images + _summed(share * (total - images), step)
        return total[:, self._image]

    def _images_of(self, maps):
        """Maps (n_maps, n_pix) as images (n_maps, n_y, n_x) float64, 0 where nothing is seen."""
        images = np.zeros((len(maps), *self._image.shape))
        images[:, self._image] = maps
        return images


def _summed(images, step):
    """Images (..., n_y, n_x) under the kernel with taps `step` pixels apart; 0 lies beyond the border."""
    for axis in (-1, -2):
        lines = np.moveaxis(images, axis, 0)
        total = _B_SPLINE[0] * lines
        for shift, weight in zip((step, 2 * step), _B_SPLINE[1:], strict=True):
            total[shift:] += weight * lines[:-shift]
            total[:-shift] += weight * lines[shift:]
        images = np.moveaxis(total, 0, axis)
    return images
