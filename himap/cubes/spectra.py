"""Power spectra of cleaned cubes: P(k_nu), C_l of HEALPix maps, P(k_perp, k_par) of images and patches."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.cubes.layout import same_freqs
from himap.maps.patches import patch_centres, patch_pixels
from himap.measures.cylindrical import cell_of, cylindrical_power
from himap.measures.diagnostics import Comparison, band_means
from himap.measures.low_rank_spectra import difference, masked_alms, recovered_power
from himap.measures.spectra import AngularPower, PowerSpectra, angular_power, frequency_power

PATCH = np.deg2rad(14)
"""Side of a flat patch of the sphere, rad: at its corners angles deviate from the plane by 0.3 %."""

_FINER = 2  # cells per pixel along one side, so that all pixels are sampled
_LEAST, _MOST = 0.8, 48  # observed share of a patch, and number of patches
_ALIKE = 1e-5  # relative: equal maps within rounding
_LOST = 0.02  # power of a residual over the truth, far below that of a usual signal loss


def spectra_of(cleaned, near=None):
    """The `PowerSpectra` of a `CleanedCube`: C_l (not of images), decoupled if masked, and P(k_nu).

    With `near` (`analysed`) of maps that differ by a few spectra, only the differences are analysed.
    """
    return power_spectra(cleaned.cube, cleaned.residual, near)


def power_spectra(cube, maps, near=None):
    """The `PowerSpectra` of maps (n_channels, n_seen), mK, in the pixels of a `Cube`."""
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
    """Maps (n_channels, n_seen) of a `Cube` on the sphere, and their coefficients; None for images."""
    full = cube.on_sphere(maps)
    return None if cube.image is not None else (full, masked_alms(full, mask=cube.sky_mask))


def scales(cleaned, near=None):
    """Powers (n,) for the comparison of two cleanings, a tuple; parameters as in `spectra_of`.

    C_l for 2 <= l <= 2 nside, or for images P(k_perp, k_par) if available, and P(k) for k > 0.
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
    """The `Comparison` of the spectra of a `CleanedCube` with those of the truth; no C_l of images.

    The truth is a `Cube` of the residual of a perfect cleaning; errors as in `check_truth`.
    """
    cube = cleaned.cube
    check_truth(cube, truth)
    seen = cube.seen_of(truth)
    near, l_top = analysed(cube, seen), 0 if cube.image is not None else 2 * cube.nside
    return Comparison.of(spectra_of(cleaned, near), power_spectra(cube, seen, near), l_top=l_top)


def remarks_on_truth(comparison):
    """A remark if a `Comparison` with the truth suggests that it has another unit or foreground; a list."""
    means = band_means(comparison.ratios, comparison.degrees, comparison.k)
    typical = float(np.median([*means.values()]))
    if not typical <= _LOST:
        return []
    return [
        f"The residual has about {typical:.2g} times the power of the truth. Unless most signal is lost, the "
        "unit of one of the two is wrong, or the truth is not HI and noise alone."
    ]


def check_truth(cube, truth, label="the truth"):
    """Refuse a truth, a `Cube` called `label` in errors, that does not match `cube`.

    It may have other pixels, channels or frames, lack pixels of the cube, or be the cube itself.
    """
    pixels, others = cube.layout.pixels, truth.layout.pixels
    if not pixels.same(others) or len(truth.freqs) != len(cube.freqs):
        raise InputError(
            f"{label} must have the channels and the {pixels.grid} of the cube, {len(cube.freqs)} and "
            f"{pixels}; got {len(truth.freqs)} and {others.grid} {others}."
        )
    for one, other in zip(truth.freqs, cube.freqs, strict=True):
        if not same_freqs(one, other):
            raise InputError(
                f"{label} must have the frequencies of the cube, "
                f"got {one:.10g} MHz where that has {other:.10g}."
            )
    cube.layout.joined(label, others.frame, truth.layout.spectral_frame)  # refuses other frames
    if (cube.mask & ~truth.mask).any():
        gaps = "" if cube.missing is None else ", with any values in missing voxels, which are ignored"
        raise InputError(f"{label} must cover all pixels of the cube{gaps}.")
    seen, pairs = cube.mask[truth.mask], zip(truth.maps, cube.maps, strict=True)
    if all(np.allclose(true[seen], pixels, rtol=_ALIKE, atol=0) for true, pixels in pairs):
        raise InputError(
            f"{label} is the cube itself: give the residual of a perfect cleaning, HI and noise."
        )


def patch_power(cube, maps):
    """The `CylindricalPower` of an image, or its mean over flat patches of 14 degrees of the sphere.

    Parameters
    ----------
    cube, maps
        A `Cube`, and maps of its observed pixels, (n_channels, n_seen), mK.

    Returns
    -------
    (CylindricalPower, int)
        Also the number of patches, 1 for an image. For patches up to the Nyquist wavenumber of the pixels,
        including the pixel window.

    Raises
    ------
    InputError
        No patch with sufficient coverage (four fifths), or errors of `cell_of`.
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
            f"P(k_perp, k_par) needs a patch of {np.rad2deg(PATCH):.0f} deg with {_LEAST:.0%} coverage, "
            "and the cube has none."
        )
    nyquist = np.pi / (cell[1] * pixel * n_cells / PATCH)
    for centre in progress(centres, "patches"):
        pixels = patch_pixels(cube.nside, centre, PATCH, n_cells)
        powers.append(cylindrical_power(full[:, pixels], cell, mask=cube.mask[pixels], most=nyquist))
    mean = np.average([one.power for one in powers], axis=0, weights=shares)
    return replace(powers[0], power=mean, n_modes=len(powers) * powers[0].n_modes), len(powers)
