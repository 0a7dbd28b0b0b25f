"""Masks for cubes of one's own, from HEALPix files."""

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import regular_file
from himap.maps import sphere
from himap.maps.healpix_files import ENDINGS, read_maps, to_ring


def read_mask(path, nside):
    """The mask in a FITS file, (n_pix,) bool, RING, True where kept.

    Parameters
    ----------
    path
        A HEALPix map of 1 (kept) and 0; UNSEEN, NaN and pixels that a partial file leaves out are not kept.
    nside
        That of the maps it is for.

    Raises
    ------
    InputError
        No such file, no order of pixels, another nside, values between 0 and 1, or nothing kept.
    """
    if not regular_file(path, "mask").name.lower().endswith(ENDINGS):
        raise InputError(
            f"the mask {path} must be a FITS file ({', '.join(ENDINGS)}); healpy.write_map writes one."
        )
    file = read_maps(path, n_maps=1)
    if file.nested is None:
        raise InputError(
            f"the mask {path} must say ORDERING = RING or NESTED in its header; write it again with "
            "healpy.write_map."
        )
    values = np.nan_to_num(file.maps[0], nan=0.0)
    if sphere.nside_of(values) != nside:
        raise InputError(
            f"the mask {path} has nside {sphere.nside_of(values)}, and the cube {nside}; write it again at "
            "that nside, as healpy.ud_grade(mask, nside) > 0.5 does."
        )
    if not np.isin(values, (0, 1)).all():
        raise InputError(
            f"the mask {path} must be 1 where kept and 0 elsewhere, got values from {values.min():g} to "
            f"{values.max():g}; write mask > 0.5, or the like."
        )
    if not values.any():
        raise InputError(f"the mask {path} keeps no pixel; 1 means kept.")
    kept = values > 0
    return to_ring(kept) if file.nested else kept
