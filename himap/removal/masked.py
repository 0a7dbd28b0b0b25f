"""A part of the sky for methods that transform whole maps: what is outside follows from what is inside."""

from dataclasses import replace

import numpy as np

from himap.checks import real_array
from himap.errors import InputError
from himap.maps import sphere
from himap.maps.modes import MapModes
from himap.removal import harmonic

__all__ = [
    "checked_kept",
    "completed",
    "inner_alm",
    "inner_weights",
    "lines_of",
    "lines_on_sphere",
    "on_sphere",
]


def checked_kept(mask, n_pix):
    """A mask as (n_pix,) bool, True where kept.

    Raises
    ------
    InputError
        Another shape, other values than True and False (or 1 and 0), or nothing kept.
    """
    kept = np.asarray(mask)
    if kept.dtype != bool:
        kept = real_array("the mask", mask)
    if kept.shape != (n_pix,):
        raise InputError(f"the mask must have shape (n_pix,) = ({n_pix},), got {kept.shape}.")
    if not np.isin(kept, (0, 1)).all():
        raise InputError(
            "the mask of a separation must be True where kept and False elsewhere (or 1 and 0), got values "
            "between; weights are for power spectra: give mask > 0.5 or the like."
        )
    if not kept.any():
        raise InputError("the mask keeps no pixel; True (or 1) means kept.")
    return kept.astype(bool)


def lines_on_sphere(lines, kept):
    """Lines of sight (n, n_kept) among all pixels, (n, n_pix), 0 elsewhere."""
    out = np.zeros((len(lines), len(kept)), dtype=lines.dtype)
    out[:, kept] = lines
    return out


def on_sphere(separation, kept):
    """A `Separation` of the lines of sight in `kept` as one of all pixels, 0 elsewhere."""
    return _moved(separation, lambda lines: lines_on_sphere(lines, kept))


def lines_of(separation, kept):
    """A `Separation` of all pixels as one of the lines of sight in `kept`, the other way round."""
    return _moved(separation, lambda lines: lines[:, kept])


def _moved(separation, move):
    taken, flagged = separation.taken, separation.flagged
    return replace(
        separation,
        sources=move(separation.sources),
        taken=None if taken is None else MapModes(spectra=taken.spectra, maps=move(taken.maps)),
        flagged=None if flagged is None else move(flagged[None])[0],
    )


def completed(lines, kept, modes):
    """Maps (n_channels, n_pix) float32 of the whole sphere: lines of sight where kept, modes elsewhere.

    Parameters
    ----------
    lines
        (n_channels, n_kept) float32, mK.
    kept
        (n_pix,) bool.
    modes
        Their `CubeModes` (`himap.removal.analysis.analysed` with `kept`): what is bright goes on outside.
    """
    maps, nside = lines_on_sphere(lines, kept), sphere.nside_of(kept)
    bright = np.array([sphere.synthesise(harmonic.from_modes(one), nside)[~kept] for one in modes.bright])
    for spectrum, out in zip(modes.spectra, maps, strict=True):
        out[~kept] = spectrum @ bright
    return maps


def inner_alm(kept, beam, lmax):
    """Coefficients to `lmax` of a mask (n_pix,) seen twice through a beam b_l."""
    return sphere.multiply_beam(
        sphere.analyse(kept.astype(np.float64), lmax), (beam[: lmax + 1] / beam[0]) ** 2
    )


def inner_weights(field):
    """Of the field of `inner_alm`: 0 outside of the mask and at its edge, 1 beyond reach of the beam."""
    return np.clip(2 * field - 1, 0, 1)
