"""The beams of a cube of one's own: by name, by dish, measured ones of MeerKAT, or from a file."""

from pathlib import Path

import numpy as np

from himap.checks import checked_beams
from himap.cubes.files import read_numbers
from himap.errors import InputError
from himap.instrument.beams import BEAM_MODELS, diffraction_fwhm, oscillating_fwhm
from himap.maps import sphere

__all__ = ["BEAM_NAMES", "beams_of", "meerkat_fwhm"]

BEAM_NAMES = (*BEAM_MODELS, "meerkat")
_DISH = 13.5  # m, of MeerKAT, as in the paper
_KATBEAM = {"MKAT-AA-UHF-JIM-2020": (544, 1088), "MKAT-AA-L-JIM-2020": (856, 1712)}  # MHz
_LARGEST_DISH = 1000.0  # m: beyond, it is in cm or mm
_NARROWEST, _WIDEST = 0.04, 10.0  # deg, of a FWHM from a file: less is in rad, more in arcmin
_OFF = 0.01  # by which b_l may miss 1 at l = 0


def beams_of(cube, beam, *, dish=None):
    """b_l of every channel of a `Cube`, (n_channels, 3 nside).

    Parameters
    ----------
    cube
        The `Cube`.
    beam
        "evolving": Gaussian, FWHM = lambda / dish. "degraded": all channels have the resolution of the worst
        of those. "oscillating": as in the paper (Eq. 10). "meerkat": Gaussian with the FWHM of MeerKAT's
        measured beams (package katbeam). Or the path of a file, .npy or text, with one line for each channel
        in the order of the cube's own file: the FWHM in degrees, or b_l from l = 0.
    dish
        Diameter in m, 13.5 unless given; not for measured beams.

    Raises
    ------
    InputError
        An unknown name, a file that does not fit, or frequencies that a beam is not known at.
    """
    lmax = 3 * cube.nside - 1
    if beam not in BEAM_NAMES or beam == "meerkat":
        if dish is not None:
            raise InputError("dish= is for the beams that follow from it: evolving, degraded, oscillating.")
        if beam == "meerkat":
            return sphere.gaussian_beam(meerkat_fwhm(cube.freqs), lmax)
        return _from_file(Path(beam), cube, lmax)
    dish = _DISH if dish is None else dish
    if not 0 < dish <= _LARGEST_DISH:
        raise InputError(f"dish must be a diameter in m, at most {_LARGEST_DISH:g}, got {dish}.")
    if beam == "oscillating":
        return sphere.gaussian_beam(oscillating_fwhm(cube.freqs, dish), lmax)
    fwhm = diffraction_fwhm(cube.freqs, dish)
    return sphere.gaussian_beam(np.full_like(fwhm, fwhm.max()) if beam == "degraded" else fwhm, lmax)


def meerkat_fwhm(freqs):
    """FWHM of MeerKAT's measured beams, rad, (n,): of Stokes I averaged over angles; `freqs` in MHz.

    Raises
    ------
    InputError
        katbeam is not installed, or has no band that holds the frequencies.
    """
    try:
        from katbeam import JimBeam
    except ImportError:
        raise InputError("the beams of MeerKAT are in the package katbeam: pip install katbeam.") from None
    for name, (low, high) in _KATBEAM.items():
        if low <= min(freqs) and max(freqs) <= high:
            return np.array([_half_power(JimBeam(name), freq) for freq in freqs])
    bands = " or ".join(f"{low} to {high}" for low, high in _KATBEAM.values())
    raise InputError(f"katbeam knows {bands} MHz, the channels go from {min(freqs):g} to {max(freqs):g}.")


def _half_power(model, freq):
    """Full width at half maximum of a model of katbeam, rad."""
    radius = np.linspace(0, 3, 601)  # deg
    angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)[:, None]
    power = model.I(radius * np.cos(angle), radius * np.sin(angle), freq).mean(axis=0)
    below = int(np.argmax(power < power[0] / 2))
    inside = slice(below, below - 2, -1)
    return 2 * np.deg2rad(np.interp(power[0] / 2, power[inside], radius[inside]))


def _from_file(path, cube, lmax):
    """b_l from a file, whose lines are in the order of the channels of the cube's own file."""
    if not path.is_file():
        raise InputError(
            f"unknown beam {str(path)!r}: it is neither one of {', '.join(BEAM_NAMES)} nor a file."
        )
    numbers = np.asarray(read_numbers(path), dtype=float)
    if numbers.ndim == 2 and numbers.shape[1] == 1:
        numbers = numbers[:, 0]
    n_channels = len(cube.layout.freqs)
    if numbers.ndim not in (1, 2) or len(numbers) != n_channels:
        raise InputError(
            f"{path} must hold one FWHM (deg) or one line of b_l for each of the {n_channels} "
            f"channels, got {numbers.shape}."
        )
    numbers = numbers[cube.layout.channels]
    if numbers.ndim == 2:
        return _transfer(path, numbers[:, : lmax + 1], cube)
    if not ((numbers >= _NARROWEST) & (numbers <= _WIDEST)).all():
        raise InputError(
            f"{path} must hold FWHM in degrees, between {_NARROWEST:g} and {_WIDEST:g}, got "
            f"{numbers.min():g} to {numbers.max():g}."
        )
    return sphere.gaussian_beam(np.deg2rad(numbers), lmax)


def _transfer(path, numbers, cube):
    """b_l of a file, if that is what the numbers can be."""
    if numbers.shape[1] <= 2 * cube.nside:
        raise InputError(
            f"{path} must hold b_l from l = 0 to 2 nside = {2 * cube.nside} at least, got {numbers.shape[1]} "
            "numbers a line; for widths give one FWHM (deg) a line."
        )
    beams = checked_beams(str(path), numbers, len(cube.freqs))
    if np.abs(beams[:, 0] - 1).max() > _OFF or np.abs(beams).max() > 1 + _OFF:
        raise InputError(
            f"{path} must hold b_l that are 1 at l = 0 and nowhere more, got {beams[:, 0].min():g} to "
            f"{beams[:, 0].max():g} at l = 0 and {np.abs(beams).max():g} at most."
        )
    return beams
