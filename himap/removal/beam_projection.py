"""Foreground of given spectra seen through beams: an orthogonal projection at every multipole."""

import numpy as np

from himap.maps import sphere
from himap.maps.blocked import mixture, projection
from himap.progress import progress
from himap.removal import harmonic

__all__ = ["seen_through", "through_beams"]

_RANK = 1e-10  # spectra below this share of the largest do not reach the last digit of float32


def through_beams(maps, space, beams, modes):
    """What the spectra `space`, seen through `beams`, hold of `maps`, (n_channels, n_pix) float32.

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
    spectra = _common(bases)
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
    return mixture(spectra, foreground)


def seen_through(sources, mixing, beams, nside):
    """Maps of sources mixed and seen through beams, diag(beams_l) A S_l, (n_channels, n_pix) float32, mK.

    Parameters
    ----------
    sources
        Real modes, (n_sources, (lmax + 1)^2).
    mixing
        A, (n_channels, n_sources).
    beams
        b_l, (n_channels, lmax + 1).
    nside
        Of the maps.
    """
    bases = _bases(mixing, beams)
    spectra = _common(bases)
    within = np.einsum("cv,cl,cn->lvn", spectra, beams, mixing, optimize=True)
    projected = np.empty((spectra.shape[1], sources.shape[1]))
    for matrix, source, block in zip(
        within, harmonic.blocks(sources), harmonic.blocks(projected), strict=True
    ):
        np.matmul(matrix, source, out=block)
    maps = np.empty((len(projected), 12 * nside**2))
    for pixels, mode in zip(progress(maps, "foreground"), projected, strict=True):
        pixels[:] = sphere.synthesise(harmonic.from_modes(mode), nside)
    return mixture(spectra, maps)


def _bases(space, beams):
    """Orthonormal columns that span diag(beams_l) space, (n_l, n_channels, n_sources)."""
    space, _ = np.linalg.qr(space)
    return np.linalg.qr(beams.T[:, :, None] * space)[0]


def _common(bases):
    """Orthonormal spectra that hold all of `bases`, (n_channels, n_spectra)."""
    spectra, values, _ = np.linalg.svd(np.hstack(list(bases)), full_matrices=False)
    return spectra[:, values > _RANK * values[0]]
