"""From a sky to an observation: beam, noise, and the truth that a perfect cleaning would leave."""

from dataclasses import dataclass

import numpy as np

from himap import sphere
from himap.checks import checked_cube
from himap.errors import InputError
from himap.progress import progress

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


def observe(hi, foregrounds, noise, beam, survey, *, hi_alms=None, provenance=None):
    """Observe a sky.

    Parameters
    ----------
    hi, foregrounds
        Maps in mK, (n_channels, n_pix), before the beam. The foregrounds may also be a pair (spectra, maps),
        (n_channels, n_modes) and (n_modes, n_pix), whose product is the cube.
    noise
        Maps in mK, as the receiver adds them; smoothed only by what `beam` does afterwards.
    beam
        A `Beam`.
    survey
        The `Survey` they belong to.
    hi_alms
        Coefficients of `hi` to 3 nside - 1, (n_channels, n_alm), where they are at hand.
    provenance
        Dictionary kept with the result.

    Raises
    ------
    InputError
        Cubes that are not of the survey's shape.
    """
    expected = (survey.n_channels, survey.n_pix)
    mixture = isinstance(foregrounds, tuple)
    cubes = {"hi": hi, "noise": noise} | ({} if mixture else {"foregrounds": foregrounds})
    shapes = {label: checked_cube(label, cube).shape for label, cube in cubes.items()}
    if mixture:
        spectra, bright = (checked_cube("foregrounds", part) for part in foregrounds)
        shapes["foregrounds"] = (len(spectra), bright.shape[1])
    for label, shape in shapes.items():
        if shape != expected:
            raise InputError(f"{label} must have shape (n_channels, n_pix) = {expected}, got {shape}.")
    if beam.transfer.shape != (survey.n_channels, survey.lmax + 1):
        raise InputError(
            f"the beam must be made for this survey: b_l of shape {(survey.n_channels, survey.lmax + 1)}, "
            f"got {beam.transfer.shape}."
        )
    truth = _smoothed(hi, hi_alms, beam.transfer)
    truth += noise if beam.after is None else sphere.convolve(noise, beam.after, label="noise")
    convolve = sphere.convolve_mixture if mixture else sphere.convolve
    cube = foregrounds if mixture else (foregrounds,)
    maps = convolve(*cube, beam.transfer, label="foregrounds")
    maps += truth
    return Observation(
        maps=maps,
        truth=truth,
        freqs=survey.freqs,
        channel_width=survey.channel_width,
        beams=beam.transfer,
        provenance=dict(provenance or {}) | {"beam": beam.name},
    )


def _smoothed(hi, alms, beams):
    """HI through the beam, float32."""
    if alms is None:
        return sphere.convolve(hi, beams, label="HI")
    out = np.empty(np.shape(hi), dtype=np.float32)
    for alm, beam, row in zip(progress(alms, "beam on HI"), beams, out, strict=True):
        row[:] = sphere.synthesise(sphere.multiply_beam(alm, beam), sphere.nside_of(hi))
    return out
