"""Image cubes in FITS with world coordinates, made for tests."""

import numpy as np
from astropy.io import fits
from cube_files import power_laws

N_CHANNELS, N_Y, N_X = 20, 12, 16
FREQ = ("FREQ", 980e6, 1.0, 2e6, "Hz")
SKY = {
    "SIN": (("RA---SIN", 163.0, 8.0, -0.25, "deg"), ("DEC--SIN", 2.0, 6.0, 0.25, "deg")),
    "CAR": (("GLON-CAR", 30.0, 8.0, -0.25, "deg"), ("GLAT-CAR", 0.0, 6.0, 0.25, "deg")),
    "ZEA": (("RA---ZEA", 45.0, 8.0, -0.5, "deg"), ("DEC--ZEA", -30.0, 6.0, 0.5, "deg")),
}
STOKES = ("STOKES", 1.0, 1.0, 1.0, "")


def header_of(axes, **more):
    """A header with axes of (CTYPE, CRVAL, CRPIX, CDELT, CUNIT), in the order of FITS, and more cards."""
    header = fits.Header()
    for n, values in enumerate(axes, start=1):
        for key, value in zip(("CTYPE", "CRVAL", "CRPIX", "CDELT", "CUNIT"), values, strict=True):
            header[f"{key}{n}"] = value
    header.update(more)
    return header


def power_law_images(rng):
    """`power_laws` from 980 MHz in steps of 2, (20, 12, 16)."""
    return power_laws(rng, 980 + 2 * np.arange(N_CHANNELS), N_Y, N_X)


def write_image(path, maps, *, axes=(*SKY["SIN"], FREQ), kind=fits.PrimaryHDU, **more):
    """An image cube as (..., n_y, n_x) in one HDU; cards as of `header_of`."""
    hdu = kind(maps, header_of(axes, **({"BUNIT": "mK"} | more)))
    hdus = [hdu] if kind is fits.PrimaryHDU else [fits.PrimaryHDU(), hdu]
    fits.HDUList(hdus).writeto(path)
    return path
