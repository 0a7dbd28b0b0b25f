"""Weights and flags of cubes that are images: of one image for all channels, or of one for each."""

import numpy as np
import pytest
from astropy.io import fits
from cube_files import himap
from image_files import N_CHANNELS, N_X, N_Y, SKY, power_law_images, write_image

from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube
from himap.removal.pca import PCA

DOWN = ("FREQ", 1018e6, 1.0, -2e6, "Hz")


@pytest.fixture(autouse=True)
def maps(rng, here):
    maps = power_law_images(rng)
    write_image("cube.fits", maps)
    return maps


@pytest.fixture
def hits(rng):
    hits = rng.integers(1, 50, (N_Y, N_X)).astype(np.float32)
    hits[:2] = 0
    return hits


@pytest.fixture
def flags(rng):
    return rng.random((N_CHANNELS, N_Y, N_X)) < 0.05


def write_hits(name, hits, sky="SIN", **more):
    return write_image(name, hits, axes=SKY[sky], BUNIT="", **more)


def test_one_image_for_all_channels(maps, hits):
    cube = read_cube("cube.fits", weights=write_hits("hits.fits", hits))
    seen = hits.ravel() > 0
    assert np.array_equal(cube.mask, seen) and np.array_equal(cube.weights, hits.ravel()[seen])
    lines = maps.reshape(N_CHANNELS, -1)[:, seen]
    expected = PCA(n_sources=2).clean(lines, freqs=cube.freqs, weights=hits.ravel()[seen]).residual
    assert clean_cube(cube, "pca", n_sources=2, peaks=False).residual == pytest.approx(expected, abs=1e-4)


def test_as_arrays_and_npy(hits, flags):
    np.save("hits.npy", hits)
    np.save("flags.npy", flags.astype("u1"))
    cubes = [
        read_cube("cube.fits", weights=weights, flags=bad)
        for weights, bad in ((hits, flags), ("hits.npy", "flags.npy"))
    ]
    expected = np.where(flags, 0, hits).reshape(N_CHANNELS, -1)[:, cubes[0].mask]
    assert all(np.array_equal(cube.weights, expected) for cube in cubes)


def test_one_for_each_channel_by_its_own_header(flags):
    """In a file whose frequencies descend as those of the cube; NaN is bad."""
    write_image("down.fits", power_law_images(np.random.default_rng(1)), axes=(*SKY["SIN"], DOWN))
    bad = flags.astype(np.float32)
    bad[bad == 1] = np.nan
    write_image("flags.fits", bad, axes=(*SKY["SIN"], DOWN))
    cube = read_cube("down.fits", flags="flags.fits")
    assert np.array_equal(cube.missing, flags[::-1].reshape(N_CHANNELS, -1))
    with pytest.raises(InputError, match="must have the channels of the cube in the order of its own file"):
        read_cube("cube.fits", flags="flags.fits")


def test_from_the_shell(hits, flags):
    """The header comes back, and NaN where nothing is known."""
    write_hits("hits.fits", hits)
    write_image("flags.fits", flags.astype("u1"))
    options = ["--weights", "hits.fits", "--flags", "flags.fits", "--keep-peaks", "-o", "c.fits"]
    done = himap("clean", "cube.fits", "--method", "pca", "-p", "n_sources=2", *options)
    assert done.exit_code == 0, done.output
    with fits.open("c.fits") as file:
        assert file[0].header["CTYPE1"] == "RA---SIN"
        assert np.array_equal(np.isnan(file[0].data), flags | (hits == 0))
    done = himap("clean", "cube.fits", "--method", "fastica", *options, "--overwrite")
    assert done.exit_code == 2 and "takes no weights" in done.output
