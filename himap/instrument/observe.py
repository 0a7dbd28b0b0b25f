"""From a sky to an observation: beam, noise, and the truth, the residual of a perfect cleaning."""

from dataclasses import dataclass

import numpy as np

from himap.core.checks import checked_cube
from himap.core.errors import InputError
from himap.maps import sphere


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Channel maps and what is known about them.

    Attributes
    ----------
    maps
        Sky through the beam plus noise, mK, (n_channels, n_pix) float32, RING.
    truth
        HI through the beam plus the same noise, mK, same shape: what the paper compares with.
    freqs
        Channel centres, MHz, ascending.
    channel_width
        MHz.
    beams
        b_l from the sky to `maps`, (n_channels, lmax + 1).
    """

    maps: np.ndarray
    truth: np.ndarray
    freqs: np.ndarray
    channel_width: float
    beams: np.ndarray


def observe(hi, foregrounds, noise, windows, survey, *, noise_alms=None):
    """Observe a sky.

    Harmonic coefficients (complex, to 3 nside - 1, from `sphere.analyse`) are accepted in place of maps, so
    that several beams can share the analysis of a sky.

    Parameters
    ----------
    hi
        In mK before the beam: maps (n_channels, n_pix), or their coefficients (n_channels, n_alm).
    foregrounds
        The same as maps, or as a pair (spectra, coefficients), (n_channels, n_modes) and (n_modes, n_alm),
        whose product is the cube.
    noise
        Maps in mK, as the receiver adds them; smoothed only by what is done to the maps afterwards.
    windows
        The `Windows` of a beam (`himap.instrument.beams.base`).
    survey
        The `Survey` they belong to.
    noise_alms
        Coefficients of `noise`, (n_channels, n_alm), if known.

    Raises
    ------
    InputError
        Cubes that are not of the survey's shape.
    """
    expected = (survey.n_channels, survey.lmax + 1)
    if windows.total.shape != expected:
        raise InputError(
            f"the beam must be made for this survey: b_l of shape {expected}, got {windows.total.shape}."
        )
    noise = _checked("noise", noise, survey)
    signal = _seen("hi", hi, windows.total, survey)
    bright = _seen("foregrounds", foregrounds, windows.total, survey)
    if windows.resmoothing is not None:
        added = _seen("noise", noise if noise_alms is None else noise_alms, windows.resmoothing, survey)
        signal = (hi_alm + noise_alm for hi_alm, noise_alm in zip(signal, added, strict=True))
    size = {"nside": survey.nside, "n_channels": survey.n_channels}
    truth = sphere.synthesise_cube(signal, **size, label="beam on HI and noise")
    if windows.resmoothing is None:
        truth += noise
    maps = sphere.synthesise_cube(bright, **size, label="beam on foregrounds")
    maps += truth
    return Observation(
        maps=maps,
        truth=truth,
        freqs=survey.freqs,
        channel_width=survey.channel_width,
        beams=windows.total,
    )


def _seen(label, cube, beams, survey):
    """Coefficients of each channel of a cube in turn, through its beam."""
    pairs = zip(_alms(label, cube, survey), beams, strict=True)
    return (sphere.multiply_beam(alm, beam) for alm, beam in pairs)


def _alms(label, cube, survey):
    """Coefficients of each channel in turn: as given, of maps (analysed in float64), or of modes."""
    if isinstance(cube, tuple):
        spectra, alms = cube
        expected = (survey.n_channels, len(alms)), (len(alms), sphere.alm_size(survey.lmax))
        if (np.shape(spectra), np.shape(alms)) != expected:
            raise InputError(
                f"{label} must have shapes (n_channels, n_modes) and (n_modes, n_alm) = {expected[0]} and "
                f"{expected[1]}, got {np.shape(spectra)} and {np.shape(alms)}."
            )
        return (row @ alms for row in spectra)
    cube = _checked(label, cube, survey)
    return (
        cube
        if np.iscomplexobj(cube)
        else (sphere.analyse(np.asarray(channel, dtype=np.float64), survey.lmax) for channel in cube)
    )


def _checked(label, cube, survey):
    """A cube of maps or of coefficients, of the survey's shape."""
    alms = np.iscomplexobj(cube)
    expected = (survey.n_channels, sphere.alm_size(survey.lmax) if alms else survey.n_pix)
    cube = cube if alms else checked_cube(label, cube)
    if np.shape(cube) != expected:
        kind = "n_alm" if alms else "n_pix"
        raise InputError(f"{label} must have shape (n_channels, {kind}) = {expected}, got {np.shape(cube)}.")
    return cube
