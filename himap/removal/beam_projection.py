"""Foreground of given spectra seen through beams: an orthogonal projection at every multipole."""

import numpy as np

from himap.maps import sphere
from himap.maps.blocked import projection
from himap.maps.modes import HarmonicModes, MapModes
from himap.progress import progress
from himap.removal import harmonic
from himap.removal.covariance import common_axes

__all__ = ["on_sky", "seen_through", "through_beams"]


def through_beams(maps, space, beams, modes):
    """What the spectra `space`, seen through `beams`, hold of `maps`, a `MapModes`.

    At every l the foreground is W_l W_l^+ X_l with W_l = diag(beams_l) space: least squares without
    regularisation. All W_l lie in a space of a few dozen spectra V, so V^T X is all that is projected and
    transformed back. What the harmonic transform cannot hold, beyond the last l, is projected as the last l.

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
    nside = sphere.nside_of(maps)
    lmax = min(3 * nside, beams.shape[1]) - 1
    bases = _bases(space, beams[:, : lmax + 1])
    spectra = common_axes(bases)
    within = np.einsum("cv,lcn->lvn", spectra, bases)
    projected = modes.along(spectra.T, lmax)
    # P_l of what the transform holds and the last P of the rest: P_l m less P_last m, and P_last of it all.
    last_basis = within[-1]
    beyond = last_basis @ (last_basis.T @ projected)
    for basis, block in zip(within, harmonic.blocks(projected), strict=True):
        block[:] = basis @ (basis.T @ block)
    projected -= beyond
    foreground = last_basis @ (last_basis.T @ projection(spectra.T, maps))
    for pixels, mode in zip(progress(foreground, "foreground"), projected, strict=True):
        pixels += sphere.synthesise(harmonic.from_modes(mode), nside)
    return MapModes(spectra=spectra, maps=foreground)


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


def _bases(space, beams):
    """Orthonormal columns that span diag(beams_l) space, (n_l, n_channels, n_sources)."""
    space, _ = np.linalg.qr(space)
    return np.linalg.qr(beams.T[:, :, None] * space)[0]
