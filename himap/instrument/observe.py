"""From a sky to an observation: beam, noise, and the truth, which is the residual of a perfect cleaning."""

from dataclasses import dataclass

import numpy as np

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.low_rank import precision


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Channel maps and their metadata.

    Attributes
    ----------
    maps, truth
        Sky through the beam plus noise, mK, (n_channels, n_pix) float32, RING; and HI through the beam plus
        the same noise, the reference of the paper.
    freqs, channel_width
        Channel centres, ascending, and their spacing, MHz.
    beams
        b_l from the sky to `maps`, (n_channels, lmax + 1).
    """

    maps: np.ndarray
    truth: np.ndarray
    freqs: np.ndarray
    channel_width: float
    beams: np.ndarray


def observe(hi, foregrounds, noise, windows, survey):
    """The `Observation` of a sky given by its coefficients, so that several beams share one analysis of it.

    Parameters
    ----------
    hi, foregrounds
        Before the beam, mK: coefficients (n_channels, n_alm) to 3 nside - 1, and `HarmonicModes`.
    noise
        As added by the receiver, mK: maps (n_channels, n_pix), or its coefficients if `windows` smooth it
        later.
    windows, survey
        The `Windows` of a beam (`himap.instrument.beams.base`), and the `Survey`.

    Raises
    ------
    InputError
        If an input does not have the shape of the survey.
    """
    beams, resmoothing, n_channels = windows.total, windows.resmoothing, survey.n_channels
    n_alm, n_modes = sphere.alm_size(survey.lmax), len(foregrounds.alms)
    for label, values, shape in (
        ("b_l of the beam", beams, (n_channels, survey.lmax + 1)),
        ("coefficients of hi", hi, (n_channels, n_alm)),
        ("spectra of the foregrounds", foregrounds.spectra, (n_channels, n_modes)),
        ("coefficients of the foregrounds", foregrounds.alms, (n_modes, n_alm)),
        ("the noise", noise, (n_channels, survey.n_pix if resmoothing is None else n_alm)),
    ):
        if np.shape(values) != shape:
            raise InputError(f"{label} must have the shape for this survey, {shape}, got {np.shape(values)}.")
    signal = map(sphere.multiply_beam, hi, beams)
    if resmoothing is not None:
        signal = map(np.add, signal, map(sphere.multiply_beam, noise, resmoothing))
    truth = sphere.synthesise_cube(signal, survey.nside, n_channels=n_channels, label="beam on HI and noise")
    if resmoothing is None:
        truth += noise
    bright = map(sphere.multiply_beam, (row @ foregrounds.alms for row in foregrounds.spectra), beams)
    # The mean square of a map, without its mean, in the lowest channel, where synchrotron is brightest.
    power = sphere.power_spectrum(sphere.multiply_beam(foregrounds.spectra[0] @ foregrounds.alms, beams[0]))
    rms = np.sqrt(np.sum((2 * np.arange(len(power)) + 1)[1:] * power[1:]) / (4 * np.pi))
    maps = sphere.synthesise_cube(
        bright, survey.nside, n_channels=n_channels, label="beam on foregrounds", floats=precision(rms)
    )
    maps += truth
    return Observation(
        maps=maps, truth=truth, freqs=survey.freqs, channel_width=survey.channel_width, beams=beams
    )
