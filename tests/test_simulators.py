"""Cubes as the simulators of the field write them, read as the page on them says.

The files are made here, in formats that the public codes and their notes describe; the page links to them.
"""

import os
import shlex

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from book_examples import blocks
from conftest import ROOT
from cube_files import FREQS, N_PIX, NSIDE, run, write_container

from himap.cubes import clean_cube, read_cube
from himap.sky.cosmology import redshift

pytestmark = pytest.mark.usefixtures("here")
EDGES = np.linspace(900, 1020, 25)
CENTRES = (EDGES[1:] + EDGES[:-1]) / 2


PAGE = (ROOT / "book" / "simulators.md").read_text()


def check_read(path, maps, *said, freqs=CENTRES, exact=False, given_freqs=None, **given):
    """The cube has these maps, mK, and frequencies, and tells these sentences."""
    cube = read_cube(path, freqs=given_freqs, **given)
    told = " ".join([cube.summary, *cube.remarks])
    assert all(sentence in told for sentence in said), told
    assert cube.freqs == pytest.approx(freqs)
    assert np.array_equal(cube.maps, maps) if exact else cube.maps == pytest.approx(maps, rel=1e-6)
    return cube


def columns_of(maps, names, unit, **cards):
    """A table with a pixel a row, as cfitsio writes it for both codes of D. Alonso."""
    columns = [fits.Column(name, "1E", unit, array=m) for name, m in zip(names, maps, strict=True)]
    table = fits.BinTableHDU.from_columns(columns, name="BINTABLE")
    table.header.update(PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE, COORDSYS="G", **cards)
    return table


def write_crime(maps, names=("T",)):
    os.mkdir("crime")
    for number, row in enumerate(maps, 1):
        polarised = [row] + [np.full(N_PIX, 1e6)] * (len(names) - 1)
        columns_of(polarised, names, "mK").writeto(f"crime/test_{number:03d}.fits")


def write_crime_table(path, columns=5):
    lower, upper = EDGES[:-1], EDGES[1:]
    table = np.array([np.arange(1, 25), lower, upper, redshift(upper), redshift(lower)]).T
    np.savetxt(path, table[:, :columns], fmt=["%d", *["%f"] * (columns - 1)])


def write_colore(maps):
    os.mkdir("colore")
    for number, row in enumerate(maps):
        columns_of([1e3 * row], ["map 1"], "uK").writeto(f"colore/out_imap_s1_nu{number:03d}.fits")
    np.savetxt("nus.txt", np.array([EDGES[:-1], EDGES[1:]]).T)


def write_pysm(maps, names):
    os.mkdir("pysm")
    for freq, row in zip(CENTRES, maps, strict=True):
        stokes = np.stack([1e3 * row, np.full(N_PIX, 7e4), np.full(N_PIX, -7e4)])
        written = {"column_units": "uK_RJ", "dtype": np.float32, "column_names": names}
        hp.write_map(f"pysm/sky_{freq:.1f}MHz.fits", stokes, **written)


def write_cora(maps, **given):
    write_container("map.h5", maps[::-1], CENTRES[::-1], **given)


@pytest.mark.parametrize("columns", [3, 5])
@pytest.mark.parametrize("names", [("T",), ("T", "Q", "U")])
def test_crime(columns, names, maps):
    write_crime(maps, names)
    write_crime_table("test_nuTable.dat", columns)
    said = ["24 channels from 902.5 to 1017.5 MHz, given by the edges of"]
    said += ["Stokes Q and U in 24 of its files are ignored."] * (len(names) - 1)
    check_read("crime", maps, *said, given_freqs="test_nuTable.dat", exact=True)


def test_colore(maps):
    write_colore(maps)
    check_read("colore", maps, "maps of nside 16 in uK, RING", given_freqs="nus.txt")


@pytest.mark.parametrize("names", [None, ["I_STOKES", "Q_STOKES", "U_STOKES"]])
def test_pysm(names, maps):
    write_pysm(maps, names)
    check_read("pysm", maps, "given by the names of its files", "Stokes Q and U")


class TestContainers:
    @pytest.mark.parametrize("words", ["S5", h5py.string_dtype()])
    def test_map(self, words, maps):
        write_cora(maps, words=words)
        said = ("24 channels from 902.5 to 1017.5 MHz, given by index_map/freq", "polarisations Q, U, V are")
        check_read("map.h5", maps, *said, unit="K")

    @pytest.mark.parametrize("pols", [["Q", "I"], ["I"]])
    def test_intensity_by_its_name_alone(self, pols, maps):
        write_cora(maps, pols=pols)
        cube = check_read("map.h5", maps, unit="K")
        assert any("ignored" in remark for remark in cube.remarks) == (len(pols) > 1)

    def test_plain_frequencies_and_other_maps(self, maps):
        """Which of several is meant can be said."""
        write_cora(maps, index_map__freq=CENTRES[::-1])
        check_read("map.h5", maps, unit="K")
        write_cora(maps, others=maps)
        check_read("map.h5", maps, unit="K", maps_name="map")

    def test_missing_values_of_its_maps(self, maps):
        write_cora(maps)
        with h5py.File("map.h5", "a") as file:
            file["map"].attrs["_FillValue"] = float(maps[3, 7] / 1e3)
        assert not read_cube("map.h5", unit="K", order="RING").mask[7]


@pytest.mark.parametrize("shape", [(1, 24), (24, 1)])
def test_one_row_or_column_is_a_list(shape, maps):
    np.save("a.npy", maps)
    np.save("nu.npy", FREQS.reshape(shape))
    check_read("a.npy", maps, given_freqs="nu.npy", freqs=FREQS, unit="mK", order="RING", exact=True)


def meer21cm(rng):
    """(wcs, maps in K, frequencies): an array (RA, Dec, channel), and world coordinates of the sky alone."""
    wcs = WCS(naxis=2)
    wcs.wcs.ctype, wcs.wcs.crval = ["RA---ZEA", "DEC--ZEA"], [150.0, -2.0]
    wcs.wcs.crpix, wcs.wcs.cdelt = [1.0, 1.0], [0.3, 0.3]
    freqs = 971 + 0.209 * np.arange(20)
    spectra = (freqs / 1000)[:, None] ** np.array([-2.1, -2.8])
    maps = np.exp(rng.standard_normal((30, 16, 2))) @ spectra.T
    return wcs, maps + 1e-3 * rng.standard_normal(maps.shape), freqs


def test_arrays_of_meer21cm(rng):
    """What the page has for them in Python is the cube that its options make of the array as it is."""
    wcs, maps, freqs = meer21cm(rng)
    code = next(code for code in blocks(PAGE, "python") if "transposed.fits" in code)
    exec(code, {"wcs": wcs, "maps": maps, "freqs": freqs})
    cube = read_cube("transposed.fits")
    assert cube.freqs == pytest.approx(freqs)
    assert cube.maps == pytest.approx(1e3 * maps.transpose(2, 1, 0).reshape(20, -1), rel=1e-6)
    hdu = wcs.to_fits()[0]
    fits.writeto("cube.fits", maps, hdu.header)
    other = read_cube("cube.fits", axes="ra,dec,freq", freqs=freqs, unit="K")
    assert np.array_equal(other.maps, cube.maps)


@pytest.mark.usefixtures("no_pages")
def test_the_commands_on_the_page_run_in_order(maps, rng):
    """As they stand, with files as the codes write them; each output is there, and can be read again."""
    for name in ("folder", "joint", "cosmo"):
        os.mkdir(name)
        for number, row in enumerate(1e-3 * maps if name == "cosmo" else maps, 1):
            columns_of([row], ["T"], "mK").writeto(f"{name}/test_{number:03d}.fits")
    for name in ("prefix_nuTable.dat", "joint_nuTable.dat"):
        write_crime_table(name)
    write_pysm(maps, None)
    os.rename("pysm", "pysm_maps")
    write_cora(maps)
    wcs, array, freqs = meer21cm(rng)
    fits.writeto("cube.fits", array, wcs.to_fits()[0].header)
    np.savetxt("nu.txt", freqs)
    lines = [
        line for block in blocks(PAGE, "bash") for line in block.splitlines() if line.startswith("himap")
    ]
    assert len(lines) >= 6
    for line in lines:
        run(*shlex.split(line, comments=True)[1:])
    again = read_cube("images.fits")
    given = {"axes": "ra,dec,freq", "freqs": freqs, "unit": "K"}
    residual = clean_cube(read_cube("cube.fits", **given), "pca", n_sources=4).residual
    assert again.maps == pytest.approx(residual, rel=1e-5, abs=1e-9) and again.freqs == pytest.approx(freqs)
