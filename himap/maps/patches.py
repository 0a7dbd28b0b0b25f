"""Square patches of the sphere, small enough to be flat: cells of equal area, each one HEALPix pixel."""

import numpy as np

from himap.maps import sphere

_CANDIDATES = 8  # nside of the candidate centres


def patch_pixels(nside, centre, side, n_cells):
    """RING index of the pixel at each cell of a patch, (n_cells, n_cells).

    Cells are those of Lambert's azimuthal projection about the centre, of equal area (ZEA in FITS).

    Parameters
    ----------
    nside
        Resolution of the pixels.
    centre
        Unit vector, (3,).
    side
        Side of the patch, rad.
    n_cells
        Number of cells along each side.
    """
    offsets = side * ((np.arange(n_cells) + 0.5) / n_cells - 0.5)
    x, y = np.meshgrid(offsets, offsets)
    pole = np.eye(3)[np.argmin(np.abs(centre))]
    east = np.cross(pole, centre)
    east /= np.linalg.norm(east)
    north = np.cross(centre, east)
    squared = x**2 + y**2  # (2 sin(theta / 2))^2
    along, across = 1 - squared / 2, np.sqrt(1 - squared / 4)
    vectors = along[..., None] * centre + across[..., None] * (x[..., None] * east + y[..., None] * north)
    lon, lat = np.arctan2(vectors[..., 1], vectors[..., 0]), np.arcsin(np.clip(vectors[..., 2], -1, 1))
    return sphere.pixel_at(nside, np.rad2deg(lon), np.rad2deg(lat))


def patch_centres(mask, side, n_cells, *, least, most):
    """Centres of patches that do not overlap, (n, 3), and the observed share of each, (n,).

    Best observed patches come first, with at least `least` observed; at most `most` patches.
    """
    nside = sphere.nside_of(mask)
    places = sphere.pixel_vectors(_CANDIDATES)
    shares = np.array([mask[patch_pixels(nside, place, side, n_cells)].mean() for place in places])
    chosen, apart = [], np.cos(np.sqrt(2) * side)
    for n in np.argsort(-shares, kind="stable"):
        if shares[n] < least or len(chosen) == most:
            break
        if all(places[n] @ places[other] < apart for other in chosen):
            chosen.append(n)
    return places[chosen], shares[chosen]
