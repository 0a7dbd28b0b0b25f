"""Starlet detail scales as GMCA looks at them: on the sphere and in the plane, forward and transposed."""

import numpy as np

from himap.maps import sphere
from himap.maps.plane_starlets import PlaneStarlets
from himap.maps.starlets import starlet_bands


def details_of(maps, n_scales, image=None):
    """What takes maps (n_maps, n_pix) to their detail scales, a `SphereDetails` or a `PlaneStarlets`.

    Of an image where `image`, (n_y, n_x) bool, tells which of its pixels they are, otherwise of a
    HEALPix sphere. Both are linear, and the same for every map.

    Raises
    ------
    InputError
        No whole HEALPix sphere, or too small an image for so many scales.
    """
    if image is None:
        return SphereDetails(n_scales, sphere.nside_of(maps))
    return PlaneStarlets(image, n_scales)


class SphereDetails:
    """Starlet detail scales of HEALPix maps.

    As `himap.maps.starlets.starlets`, but with plain quadrature, which is less exact (by 1 % of white
    noise on HEALPix) and easy to transpose; being linear it leaves a mixture X = A S as it is.
    """

    def __init__(self, n_scales, nside):
        self._n_scales, self._nside = n_scales, nside
        bands = starlet_bands(n_scales, 3 * nside - 1)[1:]
        widest = bands[0][0]  # every scale but the finest, among the coefficients of the widest of them
        self._bands = [(keep[widest], band) for keep, band in bands]
        self._n_alm = len(self._bands[0][0])

    def details(self, maps):
        """Phi: detail scales of maps (n_maps, n_pix), fine to coarse, (n_scales, n_maps, n_pix) float64."""
        scales = np.empty((self._n_scales, *maps.shape))
        scales[0] = maps
        alms = sphere.analyse(maps, sphere.lmax_of_size(self._n_alm), n_iter=0)
        for scale, (keep, band) in enumerate(self._bands, start=1):
            smooth = sphere.synthesise(alms[:, keep] * band, self._nside)
            scales[0] -= smooth
            if scale < self._n_scales:
                scales[scale] = smooth
        return scales

    def details_adjoint(self, scales):
        """Phi^T: the transpose of `details`, (n_scales, n_maps, n_pix) to (n_maps, n_pix)."""
        alms = np.zeros((scales.shape[1], self._n_alm), dtype=complex)
        for scale, (keep, band) in enumerate(self._bands, start=1):
            difference = scales[scale] - scales[0] if scale < len(scales) else -scales[0]
            alms[:, keep] += sphere.analyse(difference, sphere.lmax_of_size(len(band)), n_iter=0) * band
        return scales[0] + sphere.synthesise(alms, self._nside)
