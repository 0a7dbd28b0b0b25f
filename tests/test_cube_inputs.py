"""What users mean, and what they get wrong: files, headers, options and outputs, understood or refused."""

from dataclasses import replace

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy import units as u
from bad_inputs import FREQS, N_PIX, NSIDE, good_maps, write_cards, write_fits, write_hdf5
from cube_files import N_CHANNELS, run, write_image

from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube, save_cleaned
from himap.cubes.files import read_freqs, read_truth
from himap.cubes.writing import check_columns, check_output
from himap.instrument import beams
from himap.removal import available, create
from himap.removal.pca import PCA

pytestmark = pytest.mark.usefixtures("no_pages", "here")
ON_PCA = ("--method", "pca", "-p", "n_sources=2")


@pytest.fixture
def maps():
    return good_maps()


@pytest.fixture(autouse=True)
def good(here):
    write_hdf5("good.h5")


class TestReading:
    def test_frequencies_that_are_those_of_the_file(self):
        assert read_cube("good.h5", freqs=FREQS.astype(np.float32)).freqs == pytest.approx(FREQS)
        with pytest.raises(InputError, match=r"file states \[ 950.  955. .*, but the list"):
            read_cube("good.h5", freqs=FREQS[::-1])

    def test_oddities_are_said(self, maps):
        """Uneven channels, dead ones, and zeros."""
        maps[:, : N_PIX // 2] = 0
        others = np.arange(24) != 7
        remarks = " ".join(read_cube(write_hdf5("a.h5", maps[others], freqs=FREQS[others])).remarks)
        assert "5 to 10 MHz apart" in remarks and "50.0% of the pixels are 0" in remarks
        maps[3] = 7
        cube = read_cube(write_hdf5("b.h5", maps))
        remarks = " ".join(cube.remarks)
        assert "1 of 24 channels have no data" in remarks
        assert "1 of the channels are dead, with one value everywhere: 965 MHz" in remarks
        assert cube.freqs == pytest.approx(np.delete(FREQS, 3))  # and is not cleaned with the others

    def test_attributes_that_have_a_meaning_in_fits(self, maps):
        """They are not those of the table that is written, whose maps they would change."""
        attributes = {"NAXIS1": 4, "TSCAL1": 2.0, "TZERO3": 1.0, "BITPIX": -32, "XTENSION": "IMAGE"}
        attributes |= {"OBJECT": "PARTIAL", "INDXSCHM": "EXPLICIT", "END": "x"}
        attributes |= {"epoch": np.nan, "telescope": "one"}
        cleaned = clean_cube(read_cube(write_hdf5("a.h5", maps, **attributes)), "pca", n_sources=2)
        save_cleaned(cleaned, "c.fits")
        assert read_cube("c.fits").maps == pytest.approx(cleaned.residual, rel=1e-6)

    def test_frequencies_with_a_unit(self):
        write_hdf5("a.h5", freqs_name=None)
        assert read_cube("a.h5", freqs=FREQS / 1e3 * u.GHz).freqs == pytest.approx(FREQS)
        with pytest.raises(InputError, match="freqs must have a unit that is one of MHz"):
            read_cube("a.h5", freqs=u.Quantity(FREQS, "m"))


def test_the_command_says_how_wide_beams_are():
    method = ["--method", "sdecgmca", "-p", "noise=0.1", "-p", "beyond=cut", "--restarts", 1]
    done = run("clean", "good.h5", *method, "--beam", "evolving", "--dish", 2, "-o", "c.h5")
    assert "FWHM of 9.04 deg at 950 MHz and 8.06 at 1065 MHz" in done.output
    assert "sdecgmca estimates nothing beyond l = 8: the residual ends there" in done.output


ENDS = "The beams end at l = 8, the maps at l = 11"
NARROW = "pixels are 14.7 deg wide, so check that widths are in degrees"


@pytest.mark.parametrize(
    ("method", "beam", "said", "is_said"),
    [
        ("beam_subspace", np.ones((24, 12)), "FWHM of 0 deg at 950 MHz and 0 at", True),  # smooths nothing
        ("beam_subspace", np.ones((24, 9)), ENDS, True),  # foreground beyond is not seen through them
        ("beam_subspace", np.ones((24, 12)), "The beams end", False),
        ("pca", np.full(24, 0.1), NARROW, True),  # as of widths in rad
        ("pca", np.full(24, 9.9), NARROW, False),
    ],
)
def test_beams_that_are_remarked_on(method, beam, said, is_said):
    np.save("beam.npy", beam)
    done = run("clean", "good.h5", "--method", method, "--beam", "beam.npy", "-o", "c.h5")
    assert (said in done.output) == is_said


def test_python_does_not_write_over_files_unasked():
    cleaned = clean_cube(read_cube("good.h5"), PCA(n_sources=2))
    with pytest.raises(InputError, match="good.h5 exists"):
        save_cleaned(cleaned, "good.h5")
    save_cleaned(cleaned, "good.h5", overwrite=True)
    with h5py.File("good.h5") as file:
        assert "residual" in file


def test_frequencies_of_a_truth_are_its_own(maps, rng):
    """Options are for what a file does not say: the cube is shuffled, the truth is not."""
    order = rng.permutation(24)
    np.save("shuffled.npy", maps[order])
    np.savetxt("nu.txt", FREQS[order])
    truth = read_truth("good.h5", freqs="nu.txt", unit="K", maps_name="another")
    assert np.array_equal(truth.maps, maps) and truth.freqs == pytest.approx(FREQS)
    assert np.array_equal(read_truth("shuffled.npy", freqs="nu.txt", unit="mK").maps, maps)


def test_frequencies_of_a_truth_may_be_rounded(maps):
    write_hdf5("t.h5", maps / 1000, freqs=FREQS + 1e-9)
    run("clean", "good.h5", "--method", "pca", "-o", "c.h5", "--truth", "t.h5")


def test_few_channels(maps):
    write_hdf5("a.h5", maps[:6], freqs=FREQS[:6])
    for command, more in (("clean", ["-o", "c.h5"]), ("suggest", ["--to", "3"])):
        assert "needs 8 channels, got 6" in run(command, "a.h5", "--method", "pca", *more, code=2).output
        run(command, "a.h5", "--method", "pca", *more, "--keep-peaks")


class TestEndings:
    @pytest.mark.parametrize("name", ["c.hdf5", "c.fits.gz", "c.FITS.GZ", "C.H5"])
    def test_other_endings_are_read_again(self, name, here):
        run("clean", "good.h5", *ON_PCA, "-o", name)
        stem = name.partition(".")[0]
        assert (here / f"{stem}.html").exists()
        is_fits = ".fits" in name.lower()
        again = read_cube(name, maps_name=None if is_fits else "residual")
        residual = clean_cube(read_cube("good.h5"), "pca", n_sources=2).residual
        assert again.maps == pytest.approx(residual, abs=1e-5) and again.freqs == pytest.approx(FREQS)
        if is_fits:
            assert (here / name).read_bytes()[:2] == b"\x1f\x8b"
            assert (here / "c_foreground.fits.gz").exists() and (here / "c_mixing.txt").exists()

    def test_pages_in_capital_letters(self, here):
        paths = check_output("P.HTML", overwrite=False, page=True, endings=(".csv",))
        assert [path.name for path in paths] == ["P.HTML", "P.csv"]

    def test_more_channels_than_a_table_has_columns(self, here, rng):
        maps = rng.standard_normal((1000, 12 * 16**2)).astype("f4")
        write_hdf5("good.h5", maps, freqs=400 + 0.3 * np.arange(1000))
        said = run("clean", "good.h5", *ON_PCA, "--keep-peaks", "-o", "c.fits", code=2).output
        assert "a FITS table has at most 999 columns, and c.fits would need 1000: write HDF5, c.h5" in said
        with pytest.raises(InputError, match="999 columns"):
            save_cleaned(clean_cube(read_cube("good.h5"), "pca", peaks=False), "c.fits")
        assert [path.name for path in here.iterdir()] == ["good.h5"]

    def test_pixel_numbers_are_a_column_too(self):
        part = np.where(np.arange(N_PIX) < 150, good_maps(), hp.UNSEEN)
        write_fits("a.fits", part, partial=True)
        cube = read_cube("a.fits", freqs=FREQS)
        most, more = (replace(cube.layout, freqs=np.arange(1.0, 1 + n)) for n in (998, 999))
        check_columns(replace(cube, layout=most), "c.fits.gz")
        with pytest.raises(InputError, match="would need 1000"):
            check_columns(replace(cube, layout=more), "c.fits.gz")


class TestMissingVoxels:
    @pytest.fixture
    def holes(self, rng):
        """Of a cube, one voxel in ten."""
        maps, bad = good_maps(), rng.random((24, N_PIX)) < 0.1
        maps[bad] = np.nan
        write_hdf5("holes.h5", maps)
        write_hdf5("a.h5", more={"flags": bad})
        return bad

    def test_methods_that_take_weights_go_on_as_with_flags(self, holes):
        for path, options in (("holes.h5", ()), ("a.h5", ("--flags", "a.h5"))):
            said = run("clean", path, *ON_PCA, *options, "-o", f"c_{path}").output
            assert f"{holes.mean():.2%} of the voxels in these pixels are missing" in said
        with h5py.File("c_holes.h5") as one, h5py.File("c_a.h5") as two:
            assert np.array_equal(one["residual"][...], two["residual"][...], equal_nan=True)
            assert np.array_equal(np.isnan(one["residual"][...]), holes)

    def test_others_say_which_do(self, holes):
        some = np.where(holes, np.float32(np.nan), good_maps())
        some[:, 50:] = good_maps()[:, 50:]
        write_hdf5("some.h5", some)
        said = run("clean", "some.h5", "--method", "fastica", "-o", "c.h5").output
        assert "masked in all; methods with weights use their remaining voxels" in said
        assert "(parametric, pca, polynomial)" in said

    def test_floats_of_16_bits_are_remarked_on(self):
        half = (good_maps() / 100).astype(np.float16)
        cube = read_cube(write_hdf5("a.h5", half, said={"unit": "K", "order": "RING"}))
        assert cube.maps == pytest.approx(1e3 * half.astype(float), rel=1e-6)  # more than float16 can hold
        said = " ".join(cube.remarks)
        rounding = 1e3 * float(half.max()) / 2048
        assert f"16-bit floats, which round the brightest voxels by up to {rounding:.2g} mK" in said
        write_hdf5("b.h5", half.astype("f4"), said={"unit": "K", "order": "RING"})
        assert "16-bit" not in " ".join(read_cube("b.h5").remarks)


def test_a_file_with_the_name_of_a_beam():
    """Beams by any spelling are in `test_names_and_options_in_any_case`."""
    np.savetxt("MeerKAT", np.ones(24))
    assert beams.named("MeerKAT").name == "file"


def test_the_command_lists_methods_and_their_parameters():
    listing = run("methods").output
    assert all(name in listing for name in available())
    said = run("methods", "PCA").output
    assert "n_sources = 3  number of components to remove" in said and "Uses: weights" in said
    assert "did you mean gmca" in run("methods", "gmc", code=2).output


@pytest.mark.parametrize(("equinox", "frame"), [("B1950", "C1950"), ("1950.0", "C1950"), ("J2000", "C")])
def test_an_equinox_as_text(equinox, frame, images):
    assert read_cube(write_cards(COORDSYS="C", EQUINOX=equinox)).layout.pixels.frame == frame
    write_image("b.fits", images, RADESYS="FK5", EQUINOX=equinox)
    assert read_cube("b.fits").layout.pixels.frame == frame


class TestAttributes:
    """Of HDF5 and netCDF."""

    def write(self, maps=None, freqs=FREQS, **attributes):
        write_hdf5("a.h5", maps, freqs=freqs, said={}, **{"unit": "mK"} | attributes)
        return "a.h5"

    @pytest.mark.parametrize("attributes", [{"nest": True}, {"nested": 1}, {"healpix_order": "nest"}])
    def test_nested(self, attributes):
        assert read_cube(self.write(nside=NSIDE, **attributes)).layout.pixels.nested

    def test_arrays_of_one_text(self):
        said = {"unit": np.array([b"uK"]), "coordsys": np.array(["G"], dtype=object)}
        layout = read_cube(self.write(**said)).layout
        assert (layout.unit, layout.pixels.frame) == ("uK", "G")

    def test_a_grid_mapping(self):
        with h5py.File(self.write(grid_mapping="crs"), "a") as file:
            file["crs"] = 0
            file["crs"].attrs.update(healpix_nside=NSIDE, healpix_order="nested")
        assert read_cube("a.h5").layout.pixels.nested

    def test_pixels_in_an_order_of_their_own(self):
        for numbers in (np.arange(N_PIX), np.arange(N_PIX)[::-1]):
            with h5py.File(self.write(order="RING"), "a") as file:
                file["pix"] = numbers
            if numbers[0] == 0:
                assert np.array_equal(read_cube("a.h5").maps, good_maps())
        with pytest.raises(InputError, match="a.h5 has its own pixel order, pix"):
            read_cube("a.h5")

    @pytest.mark.parametrize("name", [None, "mine"])
    @pytest.mark.parametrize("turned", [False, True])
    def test_frequencies_say_which_axis_is_theirs(self, turned, name, rng):
        """Where both could be the pixels of a sphere; those that are named as well."""
        maps = rng.standard_normal((192, 48)).astype("f4")
        path = self.write(maps.T if turned else maps, 900 + np.arange(192.0), order="RING")
        if name is not None:
            with h5py.File(path, "a") as file:
                file.move("freqs", name)
        cube = read_cube(path, freqs_name=name)
        assert np.array_equal(cube.maps, maps) and not cube.remarks


def test_names_and_options_in_any_case():
    for name in ("PCA", "FastICA", "beam-subspace", "Gaussian Process"):
        plain = "".join(filter(str.isalpha, name)).lower()
        assert create(name).name.replace("_", "") == plain
    assert create("fastica", contrast="EXP").contrast == "exp"
    assert create("SDecGMCA", reading="Letter").reading == "letter"
    assert beams.named("MeerKAT:Band=uhf") == beams.named("meerkat:band=UHF")
    write_hdf5("a.h5", said={})
    words = ["--method", "PCA", "-p", "N_SOURCES=2", "--unit", "MK", "--order", "Ring", "--frame", "g"]
    done = run("clean", "a.h5", *words, "--keep-peaks", "-o", "o.h5")
    assert "Galactic" in done.output and "by default" not in done.output
    assert run("list", "04_PCA").output == run("list", "04_pca").output
    done = run("run", "04", "--preset", "CI", "-o", "o.txt", code=2)
    assert "preset" not in done.output and "ipynb" in done.output


def test_an_unknown_option_of_a_truth():
    with pytest.raises(TypeError, match="uint"):
        read_truth("good.h5", uint="K")


@pytest.mark.parametrize(
    ("text", "freqs"),
    [
        ("950,951\n951,952\n", [950.5, 951.5]),
        ("951,952\n950,951\n", [951.5, 950.5]),
        ("1,950,951\n2,951,952", [950.5, 951.5]),
        ("950, 951\n951, 952", [950.5, 951.5]),
        ("950,951,952", [950, 951, 952]),
        ("\ufeff950\n951", [950, 951]),  # a mark at its beginning
    ],
)
def test_texts_of_frequencies(text, freqs, here):
    (here / "f.txt").write_text(text)
    assert read_freqs("f.txt")[0].tolist() == freqs


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("swapped", [False, True])
def test_every_order_of_axes_is_advised(place, swapped, images, rng):
    """Which axis is frequency is known by its smoothness; which other is RA is not, so that both are said."""
    sky = ["ra", "dec"] if swapped else ["dec", "ra"]
    names = ",".join([*sky[:place], "freq", *sky[place:]])
    turned = np.moveaxis(images.transpose(0, 2, 1) if swapped else images, 0, place)
    write_image("a.fits", turned)
    said = " ".join(read_cube("a.fits").remarks)
    other = ",".join([*sky[::-1][:place], "freq", *sky[::-1][place:]])
    assert all((f"{one}" in said) == (place > 0) for one in (names, other))
    cube = read_cube("a.fits", axes=names)
    assert np.array_equal(cube.maps, images.reshape(N_CHANNELS, -1)) and not cube.remarks
    write_image("noise.fits", rng.standard_normal(turned.shape).astype("f4"))
    assert "--axes" not in " ".join(read_cube("noise.fits").remarks)
