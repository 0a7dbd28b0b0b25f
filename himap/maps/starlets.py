"""Wavelets: starlets (isotropic, undecimated) on the sphere and in the plane, and needlets on the sphere."""

import numpy as np
from scipy import ndimage

from himap.core.errors import InputError
from himap.maps import sphere

_B_SPLINE = np.array([1, 4, 6, 4, 1]) / 16  # the cubic B-spline at integer steps


def starlet_filters(n_scales, lmax):
    """Filters of the isotropic undecimated wavelets on the sphere, (n_scales + 1, lmax + 1).

    `n_scales` detail scales, fine to coarse, then the smooth scale. With low-pass filters
    phi_j(l) = (3/2) b(2^(j + 1) l / lmax), b the cubic B-spline, and phi_0 = 1, detail scale j is
    phi_(j - 1) - phi_j (Starck et al. 2006, Sect. 3), so all filters add up to 1 at every l.
    """
    passes = np.vstack([np.ones(lmax + 1), starlet_low_passes(n_scales, lmax)])
    return np.vstack([passes[:-1] - passes[1:], passes[-1]])


def starlet_low_passes(n_scales, lmax):
    """The phi_j of `starlet_filters`, fine to coarse, (n_scales, lmax + 1)."""
    scale = 2.0 ** np.arange(1, n_scales + 1)[:, None]
    return 1.5 * cubic_b_spline(2 * scale * np.arange(lmax + 1) / lmax)


def bands_of(filters):
    """For each of the filters (n, lmax + 1): indices of coefficients that pass it, and its values there.

    The indices are all coefficients up to some l, so they can be transformed directly. Coarse scales
    end at small l, where transforms are cheap.
    """
    degree = sphere.alm_degree(filters.shape[1] - 1)
    passed = [degree <= np.flatnonzero(values).max(initial=1) for values in filters]
    return [(keep, values[degree[keep]]) for keep, values in zip(passed, filters, strict=True)]


def noise_of_scales(filters, noise):
    """Standard deviation in every scale of noise with a given variance per mode, (n_scales, n).

    `filters` are those of the scales, (n_scales, lmax + 1), and `noise` the variance, (lmax + 1, n).
    """
    n_modes = 2 * np.arange(len(noise)) + 1
    return np.sqrt((filters**2 * n_modes) @ noise / (4 * np.pi))


def starlets(maps, n_scales):
    """Starlet scales of HEALPix maps, (n_scales + 1, ..., n_pix); their sum over the first axis is `maps`.

    The finest scale is the map less the others, so it includes all power beyond lmax = 3 nside - 1.
    """
    nside = sphere.nside_of(maps)
    alms = sphere.analyse(maps)
    scales = np.empty((n_scales + 1, *np.shape(maps)), dtype=alms.real.dtype)
    for band, out in zip(starlet_filters(n_scales, 3 * nside - 1)[1:], scales[1:], strict=True):
        out[:] = sphere.synthesise(sphere.multiply_beam(alms, band), nside)
    scales[0] = maps - scales[1:].sum(axis=0)
    return scales


def cubic_b_spline(x):
    """The cubic B-spline of x >= 0, which is 0 from x = 2."""
    return np.where(x < 1, 2 / 3 - x**2 + x**3 / 2, np.clip(2 - x, 0, None) ** 3 / 6)


def cosine_needlets(peaks, lmax):
    """Windows h_j(l) of cosine needlets, (n_peaks, lmax + 1).

    h_j rises from 0 at the previous peak to 1 at its own and falls to 0 at the next, like quarter periods of
    a sine and a cosine in l, so that sum_j h_j^2 = 1: filtering twice and adding up recovers the field (Basak
    & Delabrouille 2012). The first is 1 below its peak, the last above.

    Parameters
    ----------
    peaks
        l of the peaks, ascending.
    """
    degree = np.arange(lmax + 1)
    place = np.interp(degree, peaks, np.arange(len(peaks)))
    distance = np.abs(place - np.arange(len(peaks))[:, None])
    return np.cos(0.5 * np.pi * np.minimum(distance, 1))


class PlaneStarlets:
    """The starlet transform of images (Starck, Fadili & Murtagh 2007) on observed pixels.

    An image c_0 is smoothed repeatedly, along both axes with the B-spline kernel (1, 4, 6, 4, 1) / 16,
    its taps 2^(j - 1) pixels apart for c_j ("a trous"). Detail scale j is c_(j - 1) - c_j, so the details
    and the last c_j add up to the image.

    The kernel averages observed pixels only: unobserved pixels and the area beyond the border have no weight,
    and the other weights are rescaled to add up to 1 (Knutsson & Westin 1993). Nothing is filled in, a
    constant has no details, and the transform is linear in the pixels.

    Parameters
    ----------
    image
        The observed pixels, (n_y, n_x) bool. Maps hold these, row by row, (n_maps, n_pix).
    n_scales
        Number of detail scales.

    Raises
    ------
    InputError
        If there are too many scales for the image: all but one tap of the kernel would lie outside.
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

    def details(self, maps):
        """Detail scales of maps, fine to coarse, (n_scales, n_maps, n_pix) float64."""
        out = np.empty((len(self._distances), *maps.shape))
        smooth = self._images_of(maps)
        for step, share, scale in zip(self._distances, self._shares, out, strict=True):
            finer, smooth = smooth, share * _summed(smooth, step)
            scale[:] = (finer - smooth)[:, self._image]
        return out

    def details_adjoint(self, scales):
        """The transpose of `details`, (n_scales, n_maps, n_pix) to (n_maps, n_pix)."""
        total = 0.0
        for step, share, scale in zip(self._distances[::-1], self._shares[::-1], scales[::-1], strict=True):
            images = self._images_of(scale)
            total = images + _summed(share * (total - images), step)
        return total[:, self._image]

    def _images_of(self, maps):
        """Maps (n_maps, n_pix) as images (n_maps, n_y, n_x) float64, 0 in unobserved pixels."""
        images = np.zeros((len(maps), *self._image.shape))
        images[:, self._image] = maps
        return images


def _summed(images, step):
    """Convolve images (..., n_y, n_x) with the kernel, taps `step` pixels apart; 0 beyond the border."""
    kernel = np.zeros(4 * step + 1)
    kernel[::step] = _B_SPLINE
    for axis in (-1, -2):
        images = ndimage.correlate1d(images, kernel, axis=axis, output=np.float64, mode="constant")
    return images
