"""Maps continued to the whole sphere from the part of it on which they are known.

What is known is analysed by least squares on its pixels alone, so that nothing outside counts. That leaves
open what the fields are outside; of all that fit, one is wanted that goes on smoothly, because a beam at the
edge would mix a step into what is known. The fit therefore starts from a smooth continuation, and leaves the
rest of the sky as it is there but for what the edge asks for.
"""

import numpy as np

from himap.maps import sphere

_WIDEST = 60.0  # deg, FWHM at which the continuation begins
_STEP = 2**-0.5  # from one FWHM to the next
_NARROWEST = 0.75  # pixels
_PASSES = 2  # at each FWHM
_MOST_STEPS = 50  # of the least squares; more move the known pixels by less than HI


def continued(pixels, kept):
    """A map (n_pix,) float64, as it is where `kept` (n_pix,) bool, and continued smoothly elsewhere.

    In turns the map is low-passed and its known pixels are put back (Papoulis 1975; Gerchberg 1974), from
    wide beams b_l to narrow ones. The low pass is 1 - (1 - b_l)^2: what it does not change has no second
    differences of second differences, so that the map goes on with the slope that it has at the edge.
    """
    nside = sphere.nside_of(pixels)
    lmax = 3 * nside - 1
    out = np.where(kept, pixels, 0.0)
    for width in _widths(nside):
        window = 1 - (1 - sphere.gaussian_beam(np.deg2rad(width), lmax)) ** 2
        for _ in range(_PASSES):
            alm = sphere.multiply_beam(sphere.analyse(out, n_iter=0), window)
            out[~kept] = sphere.synthesise(alm, nside)[~kept]
    return out


def _widths(nside):
    """FWHM from wide to narrow, deg."""
    narrowest = _NARROWEST * np.rad2deg(np.sqrt(np.pi / 3) / nside)
    n = int(np.ceil(np.log(narrowest / _WIDEST) / np.log(_STEP))) + 1
    return _WIDEST * _STEP ** np.arange(n)


def continued_alm(pixels, kept, tolerance):
    """Coefficients to l = 3 nside - 1 that reproduce a map where `kept`, (n_alm,) complex128.

    They minimise sum_(p kept) (m(p) - sum_lm a_lm Y_lm(p))^2 by conjugate gradients (CGLS, Bjorck 1996),
    from the coefficients of `continued`, and end at `tolerance` of the rms of the known pixels or after 50
    steps of two transforms. A map with edges is not band limited: an analysis of the whole of it would bring
    waves of l = 3 nside into the known pixels, most near the poles.

    Parameters
    ----------
    pixels
        The map, (n_pix,); where it is not kept it may be anything finite.
    kept
        (n_pix,) bool.
    tolerance
        Relative.
    """
    nside = sphere.nside_of(pixels)
    alm = sphere.analyse(continued(pixels, kept))
    left = np.where(kept, pixels - sphere.synthesise(alm, nside), 0)
    enough = tolerance * np.linalg.norm(pixels[kept])
    slope = sphere.analyse(left, n_iter=0)  # the gradient times 2 pi / n_pix
    direction, size = slope, _product(slope, slope)
    scale = len(pixels) / (4 * np.pi)
    for _ in range(_MOST_STEPS):
        if np.linalg.norm(left) <= enough or size == 0:
            break
        seen = np.where(kept, sphere.synthesise(direction, nside), 0)
        step = scale * size / (seen @ seen)
        alm = alm + step * direction
        left = left - step * seen
        slope = sphere.analyse(left, n_iter=0)
        previous, size = size, _product(slope, slope)
        direction = slope + size / previous * direction
    return alm


def _product(one, other):
    """Scalar product of two real fields given by coefficients (n_alm,)."""
    n_zonal = sphere.lmax_of_size(len(one)) + 1  # those of m = 0 have no twin of negative m
    return 2 * np.vdot(one, other).real - np.vdot(one[:n_zonal], other[:n_zonal]).real
