"""Foreground of given spectra seen through beams: an orthogonal projection at every multipole."""

import numpy as np

from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.modes import HarmonicModes, MapModes
from himap.removal import harmonic
from himap.removal.covariance import common_axes
from himap.removal.spectral_filter import filtered


def through_beams(maps, space, beams, modes):
    """What the spectra `space`, seen through `beams`, hold of `maps`, a `MapModes`.

    At every l the foreground is W_l W_l^+ X_l with W_l = diag(beams_l) space: least squares without
    regularisation (`filtered`).

    Parameters
    ----------
    maps
        (n_channels, n_pix) float32, mK, RING.
    space
        (n_channels, n_sources); only the space that its columns span matters.
    beams
        b_l, (n_channels, lmax + 1); a common factor of all channels at one l does not matter.
    modes
        The `CubeModes` of the maps.
    """
    n_degrees = min(3 * sphere.nside_of(maps), beams.shape[1])
    space, _ = np.linalg.qr(space)
    bases = np.linalg.qr(beams.T[:n_degrees, :, None] * space)[0]
    return filtered(bases, np.swapaxes(bases, 1, 2), maps, modes)


def seen_through(sources, mixing, beams):
    """Sources mixed and seen through beams, diag(beams_l) A S_l, in few spectra: a `HarmonicModes`, mK.

    Parameters
    ----------
    sources
        Real modes, (n_sources, (lmax + 1)^2).
    mixing
        A, (n_channels, n_sources).
    beams
        b_l, (n_channels, lmax + 1).
    """
    matrices = beams.T[:, :, None] * mixing
    blocks = harmonic.blocks(sources)
    sizes = (np.linalg.qr(block.T, mode="r").T for block in blocks)
    spectra = common_axes([matrix @ size for matrix, size in zip(matrices, sizes, strict=True)])
    seen = np.empty((spectra.shape[1], sources.shape[1]))
    for matrix, source, out in zip(spectra.T @ matrices, blocks, harmonic.blocks(seen), strict=True):
        np.matmul(matrix, source, out=out)
    return HarmonicModes(spectra=spectra, alms=harmonic.from_modes(seen))


def on_sky(modes, nside, lmax=None):
    """The `MapModes` of a `HarmonicModes`, up to `lmax` or as far as it goes."""
    maps = np.empty((len(modes.alms), 12 * nside**2))
    for alm, pixels in zip(progress(modes.alms, "foreground"), maps, strict=True):
        pixels[:] = sphere.synthesise(alm if lmax is None else sphere.alms_upto(alm, lmax), nside)
    return MapModes(spectra=modes.spectra, maps=maps)
