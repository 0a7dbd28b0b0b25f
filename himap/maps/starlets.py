"""Starlets on the sphere: isotropic undecimated wavelets, one scale for each range of multipoles."""

import numpy as np

from himap.maps import sphere


def starlet_filters(n_scales, lmax):
    """Filters of the isotropic undecimated wavelets on the sphere, (n_scales + 1, lmax + 1).

    `n_scales` detail scales, fine to coarse, then the smooth rest. With low passes
    phi_j(l) = (3/2) b(2^(j + 1) l / lmax), b the cubic B-spline, and phi_0 = 1, detail scale j is
    phi_(j - 1) - phi_j (Starck et al. 2006, Sect. 3), so that all add up to 1 at every l.
    """
    passes = np.vstack([np.ones(lmax + 1), starlet_low_passes(n_scales, lmax)])
    return np.vstack([passes[:-1] - passes[1:], passes[-1]])


def starlet_low_passes(n_scales, lmax):
    """The phi_j of `starlet_filters`, fine to coarse, (n_scales, lmax + 1)."""
    scale = 2.0 ** np.arange(1, n_scales + 1)[:, None]
    return 1.5 * cubic_b_spline(2 * scale * np.arange(lmax + 1) / lmax)


def starlet_bands(n_scales, lmax):
    """For every scale, fine to coarse: which coefficients to `lmax` it keeps, and its filter on those.

    The kept ones are all coefficients up to some l, so they can be transformed as they are. Coarse scales
    end at small l, where transforms are cheap.
    """
    degree = sphere.alm_degree(lmax)
    bands = []
    for values in starlet_filters(n_scales, lmax):
        keep = degree <= np.flatnonzero(values).max(initial=1)
        bands.append((keep, values[degree[keep]]))
    return bands


def noise_of_scales(filters, noise):
    """Standard deviation in every scale of noise of some variance per mode, (n_scales, n).

    `filters` (n_scales, lmax + 1) are those of the scales, `noise` (lmax + 1, n) is the variance.
    """
    n_modes = 2 * np.arange(len(noise)) + 1
    return np.sqrt((filters**2 * n_modes) @ noise / (4 * np.pi))


def starlets(maps, n_scales):
    """Starlet scales of HEALPix maps, (n_scales + 1, ..., n_pix); their sum over the first axis is `maps`.

    The finest scale is what the others leave, so that nothing is lost beyond lmax = 3 nside - 1.
    """
    nside = sphere.nside_of(maps)
    alms = sphere.analyse(maps)
    scales = np.empty((n_scales + 1, *np.shape(maps)), dtype=alms.real.dtype)
    for band, out in zip(starlet_filters(n_scales, 3 * nside - 1)[1:], scales[1:], strict=True):
        out[:] = sphere.synthesise(
            alms * band.astype(alms.real.dtype)[sphere.alm_degree(3 * nside - 1)], nside
        )
    scales[0] = maps - scales[1:].sum(axis=0)
    return scales


def cubic_b_spline(x):
    """The cubic B-spline of x >= 0, which ends at x = 2."""
    return np.where(x < 1, 2 / 3 - x**2 + x**3 / 2, np.clip(2 - x, 0, None) ** 3 / 6)
