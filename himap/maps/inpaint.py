"""Inpainting: continue maps from the known part of the sphere to the full sphere.

The known pixels are fitted by least squares, so nothing outside counts. That does not determine the field
outside; it should continue smoothly, because a beam would mix a step at the edge into the known pixels. The
fit therefore starts from a smooth continuation and changes it only where the edge requires it.
"""

import numpy as np

from himap.maps import sphere

_WIDEST = 60.0  # deg, first FWHM of the continuation
_STEP = 2**-0.5  # from one FWHM to the next
_NARROWEST = 0.75  # pixels
_PASSES = 2  # at each FWHM
_MOST_STEPS = 50  # of least squares; further steps change the known pixels by less than HI


def inpaint(pixels, kept):
    """Continue a map (n_pix,) smoothly outside `kept` (n_pix,) bool, where it is unchanged; float64.

    The map is low-passed and its known pixels are restored, alternately (Papoulis 1975; Gerchberg 1974), with
    beams b_l from wide to narrow. The low pass is 1 - (1 - b_l)^2: a field that it does not change has no
    fourth differences, so the map continues with its slope at the edge.
    """
    nside = sphere.nside_of(pixels)
    lmax = 3 * nside - 1
    out = np.where(kept, pixels, 0.0)
    narrowest = _NARROWEST * np.rad2deg(np.sqrt(np.pi / 3) / nside)
    n_widths = int(np.ceil(np.log(narrowest / _WIDEST) / np.log(_STEP))) + 1
    for width in _WIDEST * _STEP ** np.arange(n_widths):
        window = 1 - (1 - sphere.gaussian_beam(np.deg2rad(width), lmax)) ** 2
        for _ in range(_PASSES):
            alm = sphere.multiply_beam(sphere.analyse(out, n_iter=0), window)
            out[~kept] = sphere.synthesise(alm, nside)[~kept]
    return out


def inpaint_alm(pixels, kept, tolerance):
    """Coefficients to l = 3 nside - 1 that reproduce a map in the `kept` pixels, (n_alm,) complex128.

    They minimise sum_(p kept) (m(p) - sum_lm a_lm Y_lm(p))^2 by conjugate gradients (CGLS, Bjorck 1996),
    starting from the coefficients of `inpaint`, until the residual is `tolerance` times the rms of the known
    pixels or after 50 steps of two transforms. A map with edges is not band limited: analysing it directly
    would add waves of l = 3 nside to the known pixels, mostly near the poles.

    Parameters
    ----------
    pixels
        The map, (n_pix,), finite everywhere.
    kept
        (n_pix,) bool.
    tolerance
        Relative.
    """
    nside = sphere.nside_of(pixels)
    alm = sphere.analyse(inpaint(pixels, kept))
    residual = np.where(kept, pixels - sphere.synthesise(alm, nside), 0)
    enough = tolerance * np.linalg.norm(pixels[kept])
    slope = sphere.analyse(residual, n_iter=0)  # the gradient times 2 pi / n_pix
    direction, size = slope, _square(slope)
    scale = len(pixels) / (4 * np.pi)
    for _ in range(_MOST_STEPS):
        if np.linalg.norm(residual) <= enough or size == 0:
            break
        seen = np.where(kept, sphere.synthesise(direction, nside), 0)
        step = scale * size / (seen @ seen)
        alm = alm + step * direction
        residual = residual - step * seen
        slope = sphere.analyse(residual, n_iter=0)
        previous, size = size, _square(slope)
        direction = slope + size / previous * direction
    return alm


def _square(alm):
    """Squared norm of a real field given by coefficients (n_alm,)."""
    zonal = alm[: sphere.lmax_of_size(len(alm)) + 1]  # m = 0 has no counterpart of negative m
    return 2 * np.vdot(alm, alm).real - np.vdot(zonal, zonal).real
