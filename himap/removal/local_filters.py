"""Filters of the channels that change over the sky, with the covariance of the region around each place."""

import numpy as np

from himap.core.progress import progress
from himap.maps import sphere

_NOTHING = 1e-3  # of the largest weight: pixels below it do not feel a region


def local_difference(maps, find, whole, width):
    """What filters of regions take more than the one of the whole sky does, (n_channels, n_pix) float32.

    A region has the weight exp(-d^2 / (2 width^2)) at an angle d from its centre. Centres are HEALPix pixels
    no further apart than `width`; between them the results of their filters are averaged with the squares of
    those weights. A covariance is that of cells of half that size, each with its weight.

    Parameters
    ----------
    maps
        (n_channels, n_pix) float64.
    find
        Function of a covariance, (n_channels, n_channels), to a filter as (spectra, rows).
    whole
        (spectra, rows) of the whole sky.
    width
        rad.
    """
    nside = sphere.nside_of(maps)
    coarse = 2 ** max(0, int(np.ceil(np.log2(np.sqrt(np.pi / 3) / width))))
    products = _cell_products(maps, min(2 * coarse, nside))
    cells = sphere.pixel_vectors(sphere.nside_of(products.T), nest=True)
    places, centres = sphere.pixel_vectors(nside), sphere.pixel_vectors(min(coarse, nside))
    total = sum(_weight(places, centre, width) ** 2 for centre in centres)
    more = np.zeros(maps.shape, dtype=np.float32)
    for centre in progress(centres, "regions"):
        weight = _weight(cells, centre, width)
        spectra, rows = find(np.tensordot(weight, products, 1) / (weight.sum() * maps.shape[1] / len(cells)))
        share = _weight(places, centre, width) ** 2 / total
        near = share > _NOTHING * share.max()
        # Differences alone: a share that is left out of them is one of HI, and not of the foreground.
        both = np.hstack([spectra, -whole[0]]), np.vstack([rows, whole[1]])
        more[:, near] += share[near] * (both[0] @ (both[1] @ maps[:, near]))
    return more


def _weight(vectors, centre, width):
    """exp(-d^2 / (2 width^2)) at the angles d between unit vectors (n, 3) and one of them."""
    angle = np.arccos(np.clip(vectors @ centre, -1, 1))
    return np.exp(-0.5 * (angle / width) ** 2)


def _cell_products(maps, nside):
    """Sums of x x^T over the pixels of each NESTED cell, (n_cells, n_channels, n_channels)."""
    order = sphere.nest_to_ring(sphere.nside_of(maps)).reshape(12 * nside**2, -1)
    return np.array([maps[:, cell] @ maps[:, cell].T for cell in order])
