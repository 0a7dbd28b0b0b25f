"""A cube of one's own, in HDF5 or as images in FITS with world coordinates, and the commands on it."""

import h5py
import numpy as np
from astropy.io import fits
from click.testing import CliRunner

from himap.app.cli.main import main

NSIDE = 16
N_PIX = 12 * NSIDE**2
FREQS = np.linspace(950, 1050, 24)
WIDE = 1000 + 16.0 * np.arange(24)
"""Channels whose box of mocks has few cells."""
POLS = ("I", "Q", "U", "V")


def power_laws(rng, freqs, *shape):
    """Two power laws and noise, mK, (n_channels, *shape) float32."""
    amplitudes = 1e3 * np.exp(rng.standard_normal((2, *shape)))
    maps = np.tensordot((freqs / 1000)[:, None] ** np.array([-2.1, -2.8]), amplitudes, axes=1)
    return (maps + rng.standard_normal(maps.shape)).astype(np.float32)


def power_law_maps(rng):
    """`power_laws` of the whole sky, RING, (24, 3072)."""
    return power_laws(rng, FREQS, N_PIX)


def write_hdf5(path, maps, freqs=FREQS, **attributes):
    """A cube in HDF5, in mK and RING unless it has other attributes."""
    with h5py.File(path, "w") as file:
        file.create_dataset("sky/cube", data=maps)
        file.create_dataset("sky/freq", data=freqs)
        file.attrs.update(attributes or {"unit": "mK", "order": "RING"})
    return path


def write_container(path, maps, freqs, *, pols=POLS, axis=("freq", "pol", "pixel"), words="S5", **datasets):
    """A container of cora with maps (n_channels, n_pix), mK, as kelvin; Q, U and V have other numbers.

    `datasets`, with __ for /, are in place of its own, None for none.
    """
    cube = np.full((len(maps), len(pols), maps.shape[1]), 1e6)
    cube[:, [pol == "I" for pol in pols]] = maps[:, None] / 1e3
    table = np.zeros(len(maps), dtype=[("centre", np.float64), ("width", np.float64)])
    table["centre"], table["width"] = freqs, 5.0
    items = {"index_map/freq": table, "index_map/pol": np.array(pols).astype(words)}
    items |= {"index_map/pixel": np.arange(maps.shape[1])}
    items |= {name.replace("__", "/"): values for name, values in datasets.items()}
    with h5py.File(path, "w") as file:
        file.attrs["__memh5_distributed_file"] = True
        dataset = file.create_dataset("map", data=cube)
        dataset.attrs.update({"axis": np.array(axis).astype(words), "__memh5_distributed_dset": True})
        for name in (name for name, values in items.items() if values is not None):
            file[name] = items[name]


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


def run(*words, code=0):
    """The outcome of a command that ends with this exit code."""
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert done.exit_code == code, (words, done.output)
    return done
