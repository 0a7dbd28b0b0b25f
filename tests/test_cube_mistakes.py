"""Mistakes in cubes of one's own that were once taken for data, or that once cost data."""

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from bad_inputs import FREQS, N_PIX, NSIDE, good_maps, write_fits, write_folder, write_hdf5
from cube_files import himap

from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube, save_cleaned, write_report
from himap.cubes.files import read_truth
from himap.removal.pca import PCA

pytestmark = pytest.mark.usefixtures("no_pages")


@pytest.fixture
def maps():
    return good_maps()


@pytest.fixture(autouse=True)
def good(here):
    write_hdf5("good.h5")


class TestReading:
    def test_the_unit_of_partial_maps_is_that_of_the_signal(self, maps, here):
        (here / "folder").mkdir()
        for n, pixels in enumerate(np.where(np.arange(N_PIX) < 150, maps, hp.UNSEEN)):
            write_fits(f"folder/{n}.fits", pixels, partial=True)
        assert np.array_equal(read_cube("folder", freqs=FREQS).maps, maps[:, :150])
        with pytest.raises(InputError, match="the file says mK"):
            read_cube("folder", freqs=FREQS, unit="K")

    def test_bright_kelvins_in_half_precision(self, maps):
        half = (maps / 100).astype(np.float16)  # in mK more than float16 can hold
        np.save("half.npy", half)
        cube = read_cube("half.npy", freqs=FREQS, unit="K", order="RING")
        assert cube.maps == pytest.approx(1e3 * half.astype(float), rel=1e-6)

    def test_files_are_counted_as_people_count(self, maps):
        write_folder("folder", [f"map_{n}" for n in range(24)])
        assert np.array_equal(read_cube("folder", freqs=FREQS).maps, maps)

    def test_frequencies_that_are_those_of_the_file(self):
        assert read_cube("good.h5", freqs=FREQS.astype(np.float32)).freqs == pytest.approx(FREQS)
        said = r"file says 950, 955, 960, \.\.\., 1065 MHz \(24\), but the list"
        with pytest.raises(InputError, match=said):
            read_cube("good.h5", freqs=FREQS[::-1])

    def test_a_dataset_of_frequencies_by_its_name(self):
        write_hdf5("a.h5", freqs_name="tsys")
        assert read_cube("a.h5", freqs_name="tsys").freqs == pytest.approx(FREQS)

    def test_integers_that_mean_nothing(self, maps):
        numbers = np.round(maps).clip(-1000, 30000).astype(np.int16)
        numbers[:, :100] = -32768
        columns = [
            fits.Column(f"{freq:g} MHz", "I", "mK", -32768, array=pixels)
            for freq, pixels in zip(FREQS, numbers, strict=True)
        ]
        table = fits.BinTableHDU.from_columns(columns)
        table.header.update(PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE, INDXSCHM="IMPLICIT")
        table.writeto("i.fits")
        cube = read_cube("i.fits")
        assert cube.mask.sum() == N_PIX - 100 and not cube.mask[:100].any()

    def test_oddities_are_told(self, maps):
        """Uneven channels, dead ones, and zeros."""
        maps[:, : N_PIX // 2] = 0
        others = np.arange(24) != 7
        write_hdf5("a.h5", maps[others], freqs=FREQS[others])
        remarks = " ".join(read_cube("a.h5").remarks)
        assert "5 to 10 MHz apart" in remarks and "50.0% of the pixels are 0" in remarks
        maps[3] = 7
        write_hdf5("b.h5", maps)
        remarks = " ".join(read_cube("b.h5").remarks)
        assert "1 channels have one value everywhere" in remarks and "965 MHz" in remarks

    @pytest.mark.parametrize("name", ["c.fits", "c.h5"])
    def test_blind_channels_come_back_with_their_frequency(self, name, maps):
        maps[[4, 9]] = np.nan
        write_hdf5("a.h5", maps)
        save_cleaned(clean_cube(read_cube("a.h5"), "pca", n_sources=2), name)
        again = read_cube(name, maps_name="residual" if name == "c.h5" else None)
        assert again.freqs == pytest.approx(np.delete(FREQS, [4, 9]), rel=1e-9)
        assert "2 of 24 channels see nothing" in " ".join(again.remarks)


class TestBeams:
    def test_the_command_says_how_wide_they_are(self):
        method = ["--method", "sdecgmca", "-p", "noise=0.1", "-p", "beyond=cut", "--restarts", 1]
        done = himap("clean", "good.h5", *method, "--beam", "evolving", "--dish", 2, "-o", "c.h5")
        assert done.exit_code == 0 and "FWHM of 8.06 to 9.04 deg" in done.output, done.output
        assert "sdecgmca finds nothing beyond l = 8: the residual ends there" in done.output


class TestOutputs:
    def test_a_page_from_python(self, here):
        write_report(clean_cube(read_cube("good.h5"), PCA(n_sources=2)), "page.html")
        assert "<h2>Spectra</h2>" in (here / "page.html").read_text()

    def test_python_does_not_write_over_files_unasked(self):
        cleaned = clean_cube(read_cube("good.h5"), PCA(n_sources=2))
        with pytest.raises(InputError, match="good.h5 exists"):
            save_cleaned(cleaned, "good.h5")
        with pytest.raises(InputError, match=".fits.gz or .npy file"):
            save_cleaned(cleaned, "c.hdf")
        save_cleaned(cleaned, "good.h5", overwrite=True)
        with h5py.File("good.h5") as file:
            assert "residual" in file


class TestTruth:
    def test_its_own_frequencies_count(self, maps, rng):
        """Options are for what a file does not say: the cube is shuffled, the truth is not."""
        order = rng.permutation(24)
        np.save("shuffled.npy", maps[order])
        np.savetxt("nu.txt", FREQS[order])
        truth = read_truth("good.h5", freqs="nu.txt", unit="K", maps_name="another")
        assert np.array_equal(truth.maps, maps) and truth.freqs == pytest.approx(FREQS)
        assert np.array_equal(read_truth("shuffled.npy", freqs="nu.txt", unit="mK").maps, maps)

    def test_another_frequency_is_named(self, maps):
        write_hdf5("t.h5", maps / 1000, freqs=FREQS + 1e-9)
        write_hdf5("u.h5", maps, freqs=FREQS + 3)
        words = ["clean", "good.h5", "--method", "pca", "-o", "c.h5", "--truth"]
        done = himap(*words, "u.h5")
        assert done.exit_code == 2 and "got 953 MHz where that has 950" in done.output
        assert himap(*words, "t.h5").exit_code == 0


class TestMethods:
    def test_few_channels(self, maps):
        write_hdf5("a.h5", maps[:6], freqs=FREQS[:6])
        for command, more in (("clean", ["-o", "c.h5"]), ("suggest", ["--to", "3"])):
            done = himap(command, "a.h5", "--method", "pca", *more)
            assert done.exit_code == 2 and "needs 8 channels, got 6" in done.output
            assert himap(command, "a.h5", "--method", "pca", *more, "--keep-peaks").exit_code == 0

    def test_parameters_beside_a_method_that_has_its_own(self):
        cube = read_cube("good.h5")
        with pytest.raises(InputError, match="n_sources: give parameters to PCA"):
            clean_cube(cube, PCA(n_sources=2), n_sources=9)
        with pytest.raises(InputError, match="a method, such as PCA"):
            clean_cube(cube, PCA)
