"""From a sky to an observation: beam, noise, and the truth that a perfect cleaning would leave."""

from dataclasses import dataclass

import numpy as np

from himap import sphere
from himap.checks import checked_cube
from himap.errors import InputError

__all__ = ["Observation", "observe"]


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
    provenance
        Names and values of what made it.
    """

    maps: np.ndarray
    truth: np.ndarray
    freqs: np.ndarray
    channel_width: float
    beams: np.ndarray
    provenance: dict


def observe(hi, foregrounds, noise, beam, survey, *, provenance=None):
    """Observe a sky.

    Parameters
    ----------
    hi, foregrounds
        Maps in mK, (n_channels, n_pix), before the beam.
    noise
        Maps in mK, as the receiver adds them; smoothed only by what `beam` does afterwards.
    beam
        A `Beam`.
    survey
        The `Survey` they belong to.
    provenance
        Dictionary kept with the result.

    Raises
    ------
    InputError
        Cubes that are not of the survey's shape.
    """
    expected = (survey.n_channels, survey.n_pix)
    for label, cube in (("hi", hi), ("foregrounds", foregrounds), ("noise", noise)):
        if checked_cube(label, cube).shape != expected:
            raise InputError(
                f"{label} must have shape (n_channels, n_pix) = {expected}, got {np.shape(cube)}."
            )
    if beam.transfer.shape != (survey.n_channels, survey.lmax + 1):
        raise InputError(
            f"the beam must be made for this survey: b_l of shape {(survey.n_channels, survey.lmax + 1)}, "
            f"got {beam.transfer.shape}."
        )
    truth = sphere.convolve(hi, beam.transfer, label="HI")
    truth += noise if beam.after is None else sphere.convolve(noise, beam.after, label="noise")
    maps = sphere.convolve(foregrounds, beam.transfer, label="foregrounds")
    maps += truth
    return Observation(
        maps=maps,
        truth=truth,
        freqs=survey.freqs,
        channel_width=survey.channel_width,
        beams=beam.transfer,
        provenance=dict(provenance or {}) | {"beam": beam.name},
    )
