"""P(k_perp, k_par) of HEALPix cubes, from patches of the sky that are small enough to be flat."""

from dataclasses import replace

import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.cubes import page
from himap.cubes.views import cylindrical_figure
from himap.maps.patches import patch_centres, patch_pixels
from himap.measures.cylindrical import cell_of, cylindrical_power

_SIDE = np.deg2rad(14)  # of a patch: at its corner an angle is 0.3 % off the plane
_FINER = 2  # cells along a pixel: the sky is sampled without gaps
_LEAST, _MOST = 0.8, 48  # share of a patch that is seen, and patches


def patch_power(cube, maps):
    """The mean `CylindricalPower` over patches of 14 degrees, and how many there are.

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
    n_cells = max(4, round(_FINER * _SIDE / pixel))
    cell, _ = cell_of(cube.freqs, (_SIDE / n_cells, _SIDE / n_cells))
    centres, shares = patch_centres(cube.mask, _SIDE, n_cells, least=_LEAST, most=_MOST)
    if not len(centres):
        raise InputError(
            f"P(k_perp, k_par) needs a patch of {np.rad2deg(_SIDE):.0f} deg of which {_LEAST:.0%} is seen, "
            "and the cube has none."
        )
    full, powers = cube.on_sphere(maps), []
    for centre in progress(centres, "patches"):
        pixels = patch_pixels(cube.nside, centre, _SIDE, n_cells)
        powers.append(cylindrical_power(full[:, pixels], cell, mask=cube.mask[pixels]))
    mean = np.average([one.power for one in powers], axis=0, weights=shares)
    n_modes = len(powers) * powers[0].n_modes
    nyquist = np.pi / (cell[1] * pixel * n_cells / _SIDE)
    return replace(powers[0], power=mean, n_modes=n_modes).upto(nyquist), len(powers)


def patches_part(cleaned, truth=None):
    """HTML of `patch_power` of what is left of a `CleanedCube`, beside the truth, a `Cube`, if known."""
    cube, true = cleaned.cube, None
    try:
        power, n_patches = patch_power(cube, cleaned.residual)
        if truth is not None:
            true, _ = patch_power(cube, cube.seen_of(truth))
    except InputError as error:
        return [page.note(f"There is no P(k_perp, k_par): {error}")]
    text = (
        f"The mean over {n_patches} flat patches of {np.rad2deg(_SIDE):.0f} deg, as far as the Nyquist "
        "wavenumber of the pixels, whose window it has. Scales are comoving, with the cosmology of the "
        "paper. Foreground that is left fills the smallest k_par, and where the beam changes with frequency "
        "a wedge above them."
    )
    picture = cylindrical_figure(power, true)
    return page.section("Across and along the line of sight", picture, "P(k_perp, k_par)", text)
