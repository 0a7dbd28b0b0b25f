"""Power spectra of cleaned cubes: C_l and P(k_nu) of HEALPix maps; P(k_perp, k_par) and P(k_nu) of images."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.cubes.layout import same_freqs
from himap.maps.patches import patch_centres, patch_pixels
from himap.measures.cylindrical import CylindricalPower, cell_of, cylindrical_power
from himap.measures.diagnostics import Comparison
from himap.measures.low_rank_spectra import difference, masked_alms, masked_power, recovered_power
from himap.measures.spectra import FrequencyPower, PowerSpectra, angular_power, frequency_power

PATCH = np.deg2rad(14)
"""Side of a flat patch of the sphere, rad: at its corner an angle is 0.3 % off the plane."""

_FINER = 2  # cells along a pixel: the sky is sampled without gaps
_LEAST, _MOST = 0.8, 48  # share of a patch that is seen, and patches
_ALIKE = 1e-5  # relative: the same maps but for rounding


@dataclass(frozen=True, kw_only=True)
class PlaneSpectra:
    """Power spectra of one cube of images.

    Attributes
    ----------
    frequency
        The `FrequencyPower`.
    cylindrical
        The `CylindricalPower`; None where the cube has none.
    why_not
        Why it has none.
    true
        `PlaneSpectra` of the truth, where it is known.
    """

    frequency: FrequencyPower
    cylindrical: CylindricalPower | None = None
    why_not: str = ""
    true: "PlaneSpectra | None" = None

    @classmethod
    def of(cls, cube, maps):
        """Those of maps (n_channels, n_seen), mK, of the seen pixels of a `Cube` of images."""
        frequency, pixels = frequency_power(maps, cube.channel_width), cube.layout.pixels
        try:
            cell, _ = cell_of(cube.freqs, pixels.pixel_angles())
            images = cube.on_sphere(maps).reshape(-1, *pixels.shape)
            power = cylindrical_power(images, cell, mask=cube.image)
        except InputError as error:
            return cls(frequency=frequency, why_not=str(error))
        return cls(frequency=frequency, cylindrical=power)

    @property
    def comparison(self):
        """P(k_nu) next to the truth, a `Comparison` without C_l; None where the truth is not known."""
        if self.true is None:
            return None
        none = np.empty(0)
        powers = {"frequency": self.frequency.power[1:], "true_frequency": self.true.frequency.power[1:]}
        return Comparison(degrees=none, angular=none, true_angular=none, k=self.frequency.k[1:], **powers)


def spectra_of(cleaned, near=None):
    """The power spectra of a `CleanedCube`.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    near
        Maps on the sphere that differ by a few spectra, and their coefficients, as of `analysed`: only these
        spectra are then analysed.

    Returns
    -------
    PowerSpectra or PlaneSpectra
        Of HEALPix maps C_l, decoupled with a mask, and P(k_nu); of images P(k_perp, k_par) and P(k_nu).
    """
    cube, residual, mask = cleaned.cube, cleaned.residual, cleaned.cube.sky_mask
    if cube.image is not None:
        return PlaneSpectra.of(cube, residual)
    maps = cube.on_sphere(residual)
    if near is None:
        angular = angular_power(maps, mask=mask)
    else:
        others, alms = near
        angular = recovered_power(alms, difference(maps, others, mask=mask), mask=mask)
    return PowerSpectra(angular=angular, frequency=frequency_power(residual, cube.channel_width))


def analysed(cleaned):
    """Maps of the residual of a `CleanedCube` on the sphere, and their coefficients; None of images."""
    maps, mask = cleaned.cube.on_sphere(cleaned.residual), cleaned.cube.sky_mask
    return None if cleaned.cube.image is not None else (maps, masked_alms(maps, mask=mask))


def scales(cube, spectra):
    """The powers (n,) by which two cleanings are compared, a tuple.

    C_l for 2 <= l <= 2 nside, or of images P(k_perp, k_par) where there is one, and P(k) for k > 0.
    """
    if cube.image is None:
        inside = (spectra.angular.degrees >= 2) & (spectra.angular.degrees <= 2 * cube.nside)
        powers = [spectra.angular.mean[inside]]
    else:
        powers = [] if spectra.cylindrical is None else [spectra.cylindrical.power]
    return *(power[np.isfinite(power)] for power in powers), spectra.frequency.power[1:]


def compared(cleaned, truth):
    """The spectra of a `CleanedCube` next to those of the truth.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    truth
        A `Cube` of what a perfect cleaning would leave, with the same channels.

    Returns
    -------
    Comparison or PlaneSpectra

    Raises
    ------
    InputError
        A truth of other pixels, other channels, or that does not see what was cleaned.
    """
    cube, mask = cleaned.cube, cleaned.cube.sky_mask
    check_truth(cube, truth)
    seen = cube.seen_of(truth)
    if cube.image is not None:
        return replace(spectra_of(cleaned), true=PlaneSpectra.of(cube, seen))
    maps = cube.on_sphere(seen)
    alms = masked_alms(maps, mask=mask)
    frequency = frequency_power(seen, cube.channel_width)
    true = PowerSpectra(angular=masked_power(alms, mask), frequency=frequency)
    return Comparison.of(spectra_of(cleaned, (maps, alms)), true, l_top=2 * cube.nside)


def check_truth(cube, truth, label="the truth"):
    """Refuse a truth, a `Cube`, that is not one of `cube`; errors call it `label`.

    Raises
    ------
    InputError
        It has another resolution or other channels, does not see what the cube does, or is the cube itself.
    """
    pixels, others = cube.layout.pixels, truth.layout.pixels
    if not pixels.same(others) or len(truth.freqs) != len(cube.freqs):
        raise InputError(
            f"{label} must have the channels and the {pixels.grid} of the cube, {len(cube.freqs)} and "
            f"{pixels}; got {len(truth.freqs)} and {others}."
        )
    differs = ~same_freqs(truth.freqs, cube.freqs)
    if differs.any():
        channel = int(differs.argmax())
        raise InputError(
            f"{label} must have the frequencies of the cube, got {truth.freqs[channel]:.10g} MHz where "
            f"that has {cube.freqs[channel]:.10g}."
        )
    cube.layout.joined(label, others.frame, truth.layout.spectral_frame)  # refuses others
    if (cube.mask & ~truth.mask).any():
        way_out = (
            "" if cube.missing is None else ", with any number in missing voxels, where it counts nothing"
        )
        raise InputError(f"{label} must see all pixels of the cube{way_out}.")
    seen = cube.mask[truth.mask]
    if all(
        np.allclose(true[seen], pixels, rtol=_ALIKE, atol=0)
        for true, pixels in zip(truth.maps, cube.maps, strict=True)
    ):
        raise InputError(
            f"{label} is the cube itself: give what a perfect cleaning would leave, HI and noise."
        )


def patch_power(cube, maps):
    """The mean `CylindricalPower` over flat patches of 14 degrees of the sphere, and how many there are.

    Parameters
    ----------
    cube
        The `Cube`, of HEALPix maps.
    maps
        (n_channels, n_seen), mK, of its seen pixels.

    Returns
    -------
    (CylindricalPower, int)
        As far as the Nyquist wavenumber of the pixels, whose window it has.

    Raises
    ------
    InputError
        An image, no patch that is seen to four fifths, or as `cell_of`.
    """
    pixel = np.sqrt(4 * np.pi / (12 * cube.nside**2))
    n_cells = max(4, round(_FINER * PATCH / pixel))
    cell, _ = cell_of(cube.freqs, (PATCH / n_cells, PATCH / n_cells))
    centres, shares = patch_centres(cube.mask, PATCH, n_cells, least=_LEAST, most=_MOST)
    if not len(centres):
        raise InputError(
            f"P(k_perp, k_par) needs a patch of {np.rad2deg(PATCH):.0f} deg of which {_LEAST:.0%} is seen, "
            "and the cube has none."
        )
    full, powers = cube.on_sphere(maps), []
    for centre in progress(centres, "patches"):
        pixels = patch_pixels(cube.nside, centre, PATCH, n_cells)
        powers.append(cylindrical_power(full[:, pixels], cell, mask=cube.mask[pixels]))
    mean = np.average([one.power for one in powers], axis=0, weights=shares)
    n_modes = len(powers) * powers[0].n_modes
    nyquist = np.pi / (cell[1] * pixel * n_cells / PATCH)
    return replace(powers[0], power=mean, n_modes=n_modes).upto(nyquist), len(powers)
