"""Foreground of given spectra seen through beams: an orthogonal projection at every multipole."""

import numpy as np

from himap import sphere
from himap.blocked import mixture, projection
from himap.progress import progress
from himap.removal import harmonic

__all__ = ["through_beams"]

_BRIGHT = 3.0  # times the faintest: a map that holds foreground, not HI and noise alone
_DIGITS = 1e-6  # of a map: beyond, float32 has none
_RANK = 1e-10  # spectra below this share of the largest do not reach the last digit of float32


def through_beams(maps, space, beams):
    """What the spectra `space`, seen through `beams`, hold of `maps`, (n_channels, n_pix) float32.

    At every l the foreground is W_l W_l^+ X_l with W_l = diag(beams_l) space: least squares without
    regularisation. All W_l lie in a space of a few dozen spectra V, so V^T X is all that is transformed. What
    the harmonic transform cannot hold, beyond the last l, is projected as the last l.

    Parameters
    ----------
    maps
        (n_channels, n_pix) float32, mK, RING.
    space
        (n_channels, n_sources); only the space that its columns span matters.
    beams
        b_l, (n_channels, lmax + 1); a common factor of all channels at one l does not matter.
    """
    nside = sphere.nside_of(maps)
    lmax = min(3 * nside, beams.shape[1]) - 1
    bases = _bases(space, beams[:, : lmax + 1])
    spectra, seen = _principal(_common(bases), maps)
    within = np.einsum("cv,lcn->lvn", spectra, bases)
    size = seen.std(axis=1)
    bright = size > _BRIGHT * size.min()
    modes = _analysed(seen, bright, size.min() / size, lmax)
    # P_l of what the transform holds and the last P of the rest: P_l m less P_last m, and P_last of it all.
    last = within[-1]
    beyond = last @ (last.T @ modes)
    for basis, block in zip(within, harmonic.blocks(modes), strict=True):
        block[:] = basis @ (basis.T @ block)
    modes -= beyond
    found = last @ (last.T @ seen)
    for pixels, mode, high in zip(found, modes, bright, strict=True):
        alm = harmonic.from_modes(mode).astype(complex if high else np.complex64)
        pixels += sphere.synthesise(alm, nside)
    return mixture(spectra, found)


def _principal(spectra, maps):
    """The spectra turned so that their maps V^T X are uncorrelated, and these maps, by variance."""
    seen = projection(spectra.T, maps)
    axes = np.linalg.eigh(seen @ seen.T)[1][:, ::-1]
    return spectra @ axes, axes.T @ seen


def _analysed(seen, bright, floors, lmax):
    """Real modes of the maps; of those that stand out from the rest, the foreground, down to the rest."""
    modes = np.empty((len(seen), (lmax + 1) ** 2))
    maps = progress(seen, "sdecgmca: foreground")
    for pixels, high, floor, out in zip(maps, bright, floors, modes, strict=True):
        if high:
            alm = sphere.analyse_closely(pixels, lmax, max(floor, _DIGITS))
        else:
            alm = sphere.analyse(pixels.astype(np.float32), lmax, n_iter=sphere.N_ITER_FLAT)
        out[:] = harmonic.to_modes(alm)
    return modes


def _bases(space, beams):
    """Orthonormal columns that span diag(beams_l) space, (n_l, n_channels, n_sources)."""
    space, _ = np.linalg.qr(space)
    return np.linalg.qr(beams.T[:, :, None] * space)[0]


def _common(bases):
    """Orthonormal spectra that hold all of `bases`, (n_channels, n_spectra)."""
    spectra, values, _ = np.linalg.svd(np.hstack(list(bases)), full_matrices=False)
    return spectra[:, values > _RANK * values[0]]
