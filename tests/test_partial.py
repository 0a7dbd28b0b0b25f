"""HEALPix files of a part of the sky, with the numbers of their pixels, there and back."""

import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from cube_files import FREQS, N_PIX, himap, power_law_maps

from himap.cubes import clean_cube, read_cube, save_cleaned
from himap.maps.healpix_io import write_maps

PCA = ("--method", "pca", "-p", "n_sources=2")


@pytest.mark.parametrize("nest", [False, True])
def test_partial_healpix_there_and_back(nest, rng, tmp_path):
    """As healpy writes a part of the sky."""
    maps, seen = power_law_maps(rng), np.sort(rng.permutation(N_PIX)[:500])
    part = np.full_like(maps, hp.UNSEEN)
    part[:, seen] = maps[:, seen]
    options = {"nest": nest, "partial": True, "column_units": "mK", "dtype": np.float32}
    hp.write_map(tmp_path / "a.fits", part, **options)
    np.savetxt(tmp_path / "nu.txt", FREQS)
    words = ["--freqs", tmp_path / "nu.txt", *PCA, "-o", tmp_path / "c.fits"]
    done = himap("clean", tmp_path / "a.fits", *words)
    assert done.exit_code == 0, done.output
    with fits.open(tmp_path / "c.fits") as file:
        assert file[1].header["INDXSCHM"] == "EXPLICIT" and file[1].header["OBJECT"] == "PARTIAL"
        assert np.array_equal(file[1].data["PIXEL"], seen)
    found = np.array(hp.read_map(tmp_path / "c.fits", field=None, nest=nest, dtype=None))
    cleaned = clean_cube(read_cube(tmp_path / "a.fits", freqs=FREQS), "pca", n_sources=2)
    expected = cleaned.cube.layout.as_given(cleaned.residual, cleaned.cube.mask)
    assert np.array_equal(found[:, seen], expected[:, seen])
    assert (np.delete(found, seen, axis=1) == hp.UNSEEN).all()
    assert np.array_equal(read_cube(tmp_path / "c.fits").maps, cleaned.residual)


def test_partial_healpix_whose_first_channel_sees_nothing(rng, tmp_path):
    """healpy takes the pixels from the first map alone."""
    maps, seen = power_law_maps(rng).astype("f8"), rng.permutation(N_PIX)[:500]
    maps[0], maps[:, np.setdiff1d(np.arange(N_PIX), seen)] = np.nan, np.nan
    names = [f"{freq:.6f} MHz" for freq in FREQS]
    write_maps(tmp_path / "a.fits", maps.copy(), names=names, unit="mK", nested=False, partial=True)
    cube = read_cube(tmp_path / "a.fits")
    assert len(cube.freqs) == len(FREQS) - 1 and cube.mask.sum() == 500
    save_cleaned(clean_cube(cube, "pca", n_sources=2), tmp_path / "c.fits")
    assert len(fits.getdata(tmp_path / "c.fits")) == 500
    assert np.allclose(read_cube(tmp_path / "c.fits").freqs, FREQS[1:])
