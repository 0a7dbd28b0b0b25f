"""Cubes as the simulators of the field write them: read by the commands of the page on them.

The files are made here, in formats that the public codes and their notes describe; the page links to them.
"""

import os

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from cube_files import FREQS, N_PIX, NSIDE, himap, power_law_maps, write_hdf5

from himap.cubes import read_cube
from himap.sky.cosmology import redshift

PCA = ["--method", "pca", "-p", "n_sources=2", "-o", "out.h5"]
EDGES = np.linspace(900, 1020, 25)
CENTRES = (EDGES[1:] + EDGES[:-1]) / 2
STOKES = np.array(["I", "Q", "U", "V"])


@pytest.fixture
def maps(rng):
    return power_law_maps(rng)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def expected(maps):
    """What cleaning leaves of the maps, mK."""
    write_hdf5("plain.h5", maps, unit="mK", order="RING")
    done = himap("clean", "plain.h5", *PCA[:-1], "expected.h5")
    assert done.exit_code == 0, done.output
    return residual("expected.h5")


def near(expected, maps):
    """`expected` to the rounding of the brightest pixel in float32, in the file and in the cube."""
    return pytest.approx(expected, rel=0, abs=float(2 * np.spacing(maps.max())))


def residual(path):
    with h5py.File(path) as file:
        return file["residual"][...]


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


def write_cora(maps, pols=STOKES, told="S"):
    words = h5py.string_dtype() if told == "O" else "S5"
    cube = np.full((len(maps), len(pols), maps.shape[1]), 1e6)
    cube[:, list(pols).index("I")] = maps / 1e3
    table = np.zeros(len(maps), dtype=[("centre", np.float64), ("width", np.float64)])
    table["centre"], table["width"] = CENTRES[::-1], 5.0
    with h5py.File("map.h5", "w") as file:
        file.attrs["__memh5_distributed_file"] = True
        dataset = file.create_dataset("map", data=cube[::-1])
        dataset.attrs["axis"] = np.array(("freq", "pol", "pixel")).astype(words)
        dataset.attrs["__memh5_distributed_dset"] = True
        file["index_map/freq"] = table
        file["index_map/pol"] = np.array(pols).astype(words)
        file["index_map/pixel"] = np.arange(maps.shape[1])


def cleaned(words, *said):
    """What cleaning leaves, in the unit of the file, and that the command says these sentences."""
    done = himap("clean", *words, *PCA)
    assert done.exit_code == 0, done.output
    for sentence in said:
        assert sentence in done.output, done.output
    return residual("out.h5")


class TestCRIME:
    @pytest.mark.parametrize("columns", [3, 5])
    def test_maps_and_table(self, columns, maps, expected):
        write_crime(maps)
        write_crime_table("test_nuTable.dat", columns)
        words = ["crime", "--freqs", "test_nuTable.dat"]
        found = cleaned(words, "24 channels from 902.5 to 1017.5 MHz, told by the edges of")
        assert np.array_equal(found, expected)

    def test_polarised_maps(self, maps, expected):
        write_crime(maps, names=("T", "Q", "U"))
        write_crime_table("nuTable.txt")
        words = ["crime", "--freqs", "nuTable.txt"]
        found = cleaned(words, "Stokes Q and U in 24 of its files are left out.")
        assert np.array_equal(found, expected)


class TestCoLoRe:
    def test_maps_and_edges(self, maps, expected):
        write_colore(maps)
        found = cleaned(["colore", "--freqs", "nus.txt"], "maps of nside 16 in uK, RING")
        assert found / 1e3 == near(expected, maps)


class TestPySM:
    @pytest.mark.parametrize("names", [None, ["I_STOKES", "Q_STOKES", "U_STOKES"]])
    def test_maps_of_three_stokes_parameters(self, names, maps, expected):
        write_pysm(maps, names)
        found = cleaned(["pysm"], "told by the names of its files", "Stokes Q and U")
        assert found / 1e3 == near(expected, maps)


class TestContainers:
    @pytest.mark.parametrize("told", ["S", "O"])
    def test_map(self, told, maps, expected):
        write_cora(maps, told=told)
        said = ("24 channels from 902.5 to 1017.5 MHz, told by index_map/freq", "polarisations Q, U, V are")
        found = cleaned(["map.h5", "--unit", "K"], *said)
        assert 1e3 * found[::-1] == near(expected, maps)

    def test_intensity_by_its_name_alone(self, maps):
        write_cora(maps, pols=["Q", "I"])
        cube = read_cube("map.h5", unit="K")
        assert cube.maps == pytest.approx(maps, rel=1e-6)
        write_cora(maps, pols=["I"])
        cube = read_cube("map.h5", unit="K")
        assert cube.maps == pytest.approx(maps, rel=1e-6) and not any("left out" in r for r in cube.remarks)

    def test_plain_frequencies(self, maps):
        write_cora(maps)
        with h5py.File("map.h5", "a") as file:
            del file["index_map/freq"]
            file["index_map/freq"] = CENTRES[::-1]
        assert np.array_equal(read_cube("map.h5", unit="K").freqs, CENTRES)

    def test_missing_values_of_its_maps(self, maps):
        write_cora(maps)
        with h5py.File("map.h5", "a") as file:
            file["map"].attrs["_FillValue"] = float(maps[3, 7] / 1e3)
        assert not read_cube("map.h5", unit="K", order="RING").mask[7]

    def test_beside_other_maps_it_can_be_named(self, maps):
        write_cora(maps)
        with h5py.File("map.h5", "a") as file:
            file["others"] = maps
        assert read_cube("map.h5", unit="K", maps_name="map").maps == pytest.approx(maps, rel=1e-6)


class TestTablesOfFrequencies:
    def test_channels_that_descend(self, maps):
        np.save("a.npy", maps)
        np.savetxt("nu.txt", np.array([EDGES[:-1], EDGES[1:]]).T[::-1])
        cube = read_cube("a.npy", freqs="nu.txt", unit="mK", order="RING")
        assert np.array_equal(cube.freqs, CENTRES) and np.array_equal(cube.maps, maps[::-1])

    def test_one_row_or_column_is_a_list(self, maps):
        np.save("a.npy", maps)
        for shape in ((1, 24), (24, 1)):
            np.save("nu.npy", FREQS.reshape(shape))
            cube = read_cube("a.npy", freqs="nu.npy", unit="mK", order="RING")
            assert np.array_equal(cube.freqs, FREQS)
