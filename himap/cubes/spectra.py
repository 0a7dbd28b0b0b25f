"""Power spectra of cleaned cubes: P(k_nu), C_l of HEALPix maps, P(k_perp, k_par) of images and patches."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.cubes.layout import same_freqs
from himap.maps.patches import patch_centres, patch_pixels
from himap.measures.cylindrical import cell_of, cylindrical_power
from himap.measures.diagnostics import Comparison
from himap.measures.low_rank_spectra import difference, masked_alms, recovered_power
from himap.measures.spectra import AngularPower, PowerSpectra, angular_power, frequency_power

PATCH = np.deg2rad(14)
"""Side of a flat patch of the sphere, rad: at its corner an angle is 0.3 % off the plane."""

_FINER = 2  # cells along a pixel: the sky is sampled without gaps
_LEAST, _MOST = 0.8, 48  # share of a patch that is seen, and patches
_ALIKE = 1e-5  # relative: the same maps but for rounding


def spectra_of(cleaned, near=None):
    """The `PowerSpectra` of a `CleanedCube`: C_l, decoupled with a mask, and P(k_nu); of an image no C_l.

    With `near`, as of `analysed`, of maps that differ by a few spectra, only these are analysed.
    """
    return power_spectra(cleaned.cube, cleaned.residual, near)


def power_spectra(cube, maps, near=None):
    """The same of maps (n_channels, n_seen), mK, of the pixels of a `Cube`."""
    frequency, mask = frequency_power(maps, cube.channel_width), cube.sky_mask
    if cube.image is not None:
        angular = AngularPower(degrees=np.empty(0), cl=np.empty((len(maps), 0)))
    elif near is None:
        angular = angular_power(cube.on_sphere(maps), mask=mask)
    else:
        others, alms = near
        angular = recovered_power(alms, difference(cube.on_sphere(maps), others, mask=mask), mask=mask)
    return PowerSpectra(angular=angular, frequency=frequency)


def analysed(cube, maps):
    """Maps (n_channels, n_seen) of a `Cube` on the sphere, and their coefficients; None of images."""
    full = cube.on_sphere(maps)
    return None if cube.image is not None else (full, masked_alms(full, mask=cube.sky_mask))


def scales(cleaned, near=None):
    """The powers (n,) by which two cleanings are compared, a tuple; parameters as of `spectra_of`.

    C_l for 2 <= l <= 2 nside, or of images P(k_perp, k_par) where there is one, and P(k) for k > 0.
    """
    cube, spectra, powers = cleaned.cube, spectra_of(cleaned, near), []
    if cube.image is None:
        inside = (spectra.angular.degrees >= 2) & (spectra.angular.degrees <= 2 * cube.nside)
        powers.append(spectra.angular.mean[inside])
    else:
        with suppress(InputError):
            powers.append(patch_power(cube, cleaned.residual)[0].power)
    return *(power[np.isfinite(power)] for power in powers), spectra.frequency.power[1:]


def compared(cleaned, truth):
    """The `Comparison` of the spectra of a `CleanedCube` with those of the truth; of an image without C_l.

    The truth is a `Cube` of what a perfect cleaning would leave; errors as of `check_truth`.
    """
    cube = cleaned.cube
    check_truth(cube, truth)
    seen = cube.seen_of(truth)
    near, l_top = analysed(cube, seen), 0 if cube.image is not None else 2 * cube.nside
    return Comparison.of(spectra_of(cleaned, near), power_spectra(cube, seen, near), l_top=l_top)


def check_truth(cube, truth, label="the truth"):
    """Refuse a truth, a `Cube` that errors call `label`, which is none of `cube`.

    It may have other pixels, channels or frames, not see what the cube does, or be the cube itself.
    """
    pixels, others = cube.layout.pixels, truth.layout.pixels
    if not pixels.same(others) or len(truth.freqs) != len(cube.freqs):
        raise InputError(
            f"{label} must have the channels and the {pixels.grid} of the cube, {len(cube.freqs)} and "
            f"{pixels}; got {len(truth.freqs)} and {others}."
        )
    for one, other in zip(truth.freqs, cube.freqs, strict=True):
        if not same_freqs(one, other):
            raise InputError(
                f"{label} must have the frequencies of the cube, "
                f"got {one:.10g} MHz where that has {other:.10g}."
            )
    cube.layout.joined(label, others.frame, truth.layout.spectral_frame)  # refuses others
    if (cube.mask & ~truth.mask).any():
        gaps = "" if cube.missing is None else ", with any number in missing voxels, where it counts nothing"
        raise InputError(f"{label} must see all pixels of the cube{gaps}.")
    seen, pairs = cube.mask[truth.mask], zip(truth.maps, cube.maps, strict=True)
    if all(np.allclose(true[seen], pixels, rtol=_ALIKE, atol=0) for true, pixels in pairs):
        raise InputError(
            f"{label} is the cube itself: give what a perfect cleaning would leave, HI and noise."
        )


def patch_power(cube, maps):
    """The `CylindricalPower` of an image, or its mean over flat patches of 14 degrees of the sphere.

    Parameters
    ----------
    cube, maps
        A `Cube`, and maps of its seen pixels, (n_channels, n_seen), mK.

    Returns
    -------
    (CylindricalPower, int)
        And the number of patches, 1 of an image. Of patches as far as the Nyquist wavenumber of the pixels,
        whose window it has.

    Raises
    ------
    InputError
        No patch that is seen to four fifths, or as `cell_of`.
    """
    full, powers = cube.on_sphere(maps), []
    if cube.image is not None:
        cell, _ = cell_of(cube.freqs, cube.layout.pixels.pixel_angles())
        return cylindrical_power(full.reshape(-1, *cube.image.shape), cell, mask=cube.image), 1
    pixel = np.sqrt(4 * np.pi / (12 * cube.nside**2))
    n_cells = max(4, round(_FINER * PATCH / pixel))
    cell, _ = cell_of(cube.freqs, (PATCH / n_cells, PATCH / n_cells))
    centres, shares = patch_centres(cube.mask, PATCH, n_cells, least=_LEAST, most=_MOST)
    if not len(centres):
        raise InputError(
            f"P(k_perp, k_par) needs a patch of {np.rad2deg(PATCH):.0f} deg of which {_LEAST:.0%} is seen, "
            "and the cube has none."
        )
    nyquist = np.pi / (cell[1] * pixel * n_cells / PATCH)
    for centre in progress(centres, "patches"):
        pixels = patch_pixels(cube.nside, centre, PATCH, n_cells)
        powers.append(cylindrical_power(full[:, pixels], cell, mask=cube.mask[pixels], most=nyquist))
    mean = np.average([one.power for one in powers], axis=0, weights=shares)
    return replace(powers[0], power=mean, n_modes=len(powers) * powers[0].n_modes), len(powers)
