"""Mistakes in cubes of one's own that were once taken for data, or that once cost data."""

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from click.testing import CliRunner

from himap.app.cli.main import main
from himap.core.errors import InputError
from himap.cubes import beams_of, clean_cube, read_cube, save_cleaned, write_report
from himap.cubes.files import read_truth
from himap.removal.pca import PCA

NSIDE = 8
N_PIX = 12 * NSIDE**2
FREQS = np.linspace(900, 1130, 24)


@pytest.fixture
def maps(rng):
    """Two power laws and noise, mK; (24, 768) float32."""
    amplitudes = 1e3 * np.exp(rng.standard_normal((2, N_PIX)))
    spectra = (FREQS / 1000)[:, None] ** np.array([-2.1, -2.8])
    return (spectra @ amplitudes + rng.standard_normal((24, N_PIX))).astype(np.float32)


@pytest.fixture
def here(maps, tmp_path, monkeypatch):
    """A folder with good.h5, which tells everything, good.npy and its freqs.txt."""
    monkeypatch.chdir(tmp_path)
    write_hdf5("good.h5", maps)
    np.save("good.npy", maps)
    np.savetxt("freqs.txt", FREQS)
    return tmp_path


def write_hdf5(path, maps, name="freqs", freqs=FREQS):
    with h5py.File(path, "w") as file:
        file["maps"], file[name] = maps, freqs
        file.attrs.update(unit="mK", order="RING")


def himap(*words):
    return CliRunner().invoke(main, [str(word) for word in words])


class TestUnits:
    def test_the_unit_of_partial_maps_is_that_of_the_signal(self, maps, here):
        part = np.where(np.arange(N_PIX) < 500, maps, hp.UNSEEN)
        (here / "folder").mkdir()
        for n, pixels in enumerate(part):
            hp.write_map(f"folder/{n}.fits", pixels, partial=True, column_units="mK", dtype=np.float32)
        cube = read_cube("folder", freqs=FREQS)
        assert np.array_equal(cube.maps, maps[:, :500])
        with pytest.raises(InputError, match="the file says mK"):
            read_cube("folder", freqs=FREQS, unit="K")

    def test_bright_kelvins_in_half_precision(self, maps, here):
        half = (maps / 100).astype(np.float16)  # in mK more than float16 can hold
        np.save("half.npy", half)
        cube = read_cube("half.npy", freqs=FREQS, unit="K", order="RING")
        assert cube.maps == pytest.approx(1e3 * half.astype(float), rel=1e-6)


class TestFrequencies:
    def test_files_are_counted_as_people_count(self, maps, here):
        (here / "folder").mkdir()
        for n, pixels in enumerate(maps):
            hp.write_map(f"folder/map_{n}.fits", pixels, column_units="mK", dtype=np.float32)
        assert np.array_equal(read_cube("folder", freqs=FREQS).maps, maps)

    @pytest.mark.parametrize("freqs", [FREQS[::-1], FREQS + 200, FREQS[:5]])
    def test_others_than_the_file_tells(self, freqs, here):
        with pytest.raises(
            InputError, match=r"file says 900, 910, 920, \.\.\., 1130 MHz \(24\), but the list"
        ):
            read_cube("good.h5", freqs=freqs)
        assert read_cube("good.h5", freqs=FREQS.astype(np.float32)).freqs == pytest.approx(FREQS)

    @pytest.mark.parametrize("name", ["tsys", "wavelength_cm", "num_hits"])
    def test_any_other_line_of_numbers_is_no_frequency(self, name, maps, here):
        write_hdf5("a.h5", maps, name=name)
        with pytest.raises(InputError, match="--freqs-name"):
            read_cube("a.h5")
        assert read_cube("a.h5", freqs_name=name).freqs == pytest.approx(FREQS)

    def test_the_name_counts_more_than_others_of_the_same_length(self, maps, here):
        with h5py.File("good.h5", "a") as file:
            file["num_hits"] = np.arange(24)
        assert read_cube("good.h5").freqs == pytest.approx(FREQS)

    def test_uneven_channels_are_told(self, maps, here):
        uneven = np.delete(np.arange(24), 7)
        write_hdf5("a.h5", maps[uneven], freqs=FREQS[uneven])
        assert "10 to 20 MHz apart" in " ".join(read_cube("a.h5").remarks)


class TestMissing:
    def test_integers_that_mean_nothing(self, maps, here):
        whole = np.round(maps).clip(-1000, 30000).astype(np.int16)
        whole[:, :100] = -32768
        columns = [
            fits.Column(f"{freq:g} MHz", "I", "mK", -32768, array=pixels)
            for freq, pixels in zip(FREQS, whole, strict=True)
        ]
        table = fits.BinTableHDU.from_columns(columns)
        table.header.update(PIXTYPE="HEALPIX", ORDERING="RING", NSIDE=NSIDE, INDXSCHM="IMPLICIT")
        table.writeto("i.fits")
        cube = read_cube("i.fits")
        assert cube.mask.sum() == N_PIX - 100 and not cube.mask[:100].any()

    def test_zeros_and_dead_channels_are_told(self, maps, here):
        maps[:, : N_PIX // 2] = 0
        maps[3] = 7
        write_hdf5("a.h5", np.where(np.arange(24)[:, None] == 3, 7, maps))
        remarks = " ".join(read_cube("a.h5").remarks)
        assert "1 channels have one value everywhere" in remarks and "930 MHz" in remarks
        write_hdf5("b.h5", maps[np.arange(24) != 3], freqs=FREQS[np.arange(24) != 3])
        assert "50.0% of the pixels are 0" in " ".join(read_cube("b.h5").remarks)
        write_hdf5("c.h5", np.zeros_like(maps))
        with pytest.raises(InputError, match="all maps are zero"):
            read_cube("c.h5")

    @pytest.mark.parametrize("name", ["c.fits", "c.h5"])
    def test_blind_channels_come_back_with_their_frequency(self, name, maps, here):
        maps[[4, 9]] = np.nan
        write_hdf5("a.h5", maps)
        save_cleaned(clean_cube(read_cube("a.h5"), "pca", n_sources=2), name)
        again = read_cube(name, maps_name="residual" if name == "c.h5" else None)
        assert again.freqs == pytest.approx(np.delete(FREQS, [4, 9]), rel=1e-9)
        assert "2 of 24 channels see nothing" in " ".join(again.remarks)


class TestBeamFiles:
    @pytest.mark.parametrize(
        ("numbers", "message"),
        [
            (np.full(24, 0.028), "FWHM in degrees, between"),  # rad
            (np.full(24, 96.0), "FWHM in degrees, between"),  # arcmin
            (np.column_stack([FREQS, np.full(24, 1.6)]), r"for widths give one FWHM \(deg\) a line"),
            (7 * np.ones((24, 24)), "1 at l = 0"),
            (1 + 0.1 * np.arange(24) * np.ones((24, 1)), "nowhere more"),
        ],
    )
    def test_what_cannot_be_a_beam(self, numbers, message, here):
        np.save("beam.npy", numbers)
        with pytest.raises(InputError, match=message):
            beams_of(read_cube("good.h5"), "beam.npy")

    def test_a_dish_in_cm(self, here):
        with pytest.raises(InputError, match="in m, at most 1000"):
            beams_of(read_cube("good.h5"), "evolving", dish=1350)

    def test_the_command_says_how_wide_they_are(self, here):
        method = ["--method", "sdecgmca", "-p", "noise=0.1", "--beam", "evolving", "--dish", 2]
        done = himap("clean", "good.h5", *method, "-o", "c.h5")
        assert done.exit_code == 0 and "FWHM of 7.6 to 9.54 deg" in done.output
        assert "sdecgmca finds nothing beyond l = 16: what is left ends there" in done.output


class TestOutputs:
    def clean(self, *words):
        return himap("clean", *words, "--method", "pca", "-p", "n_sources=2", "--overwrite")

    def test_what_a_cube_is_made_from_is_never_written_over(self, maps, here):
        (here / "freqs.txt").rename("c_mixing.txt")
        np.save("c_foreground.npy", maps)
        before = {path: path.read_bytes() for path in here.iterdir()}
        reading = ["--unit", "mK", "--freqs", "c_mixing.txt"]
        for words in (
            ["good.h5", "-o", "good.h5"],
            ["good.npy", *reading, "-o", "c.npy"],
            ["c_foreground.npy", "--unit", "mK", "--freqs", "c_mixing.txt", "-o", "c.npy"],
            ["good.h5", "--truth", "good.npy", *reading[2:], "-o", "good.npy"],
        ):
            done = self.clean(*words)
            assert done.exit_code == 2 and "made from" in done.output, done.output
        assert {path: path.read_bytes() for path in here.iterdir()} == before

    def test_a_page_from_python(self, here):
        write_report(clean_cube(read_cube("good.h5"), PCA(n_sources=2)), "page.html")
        assert "<h2>Spectra</h2>" in (here / "page.html").read_text()

    def test_python_does_not_write_over_files_unasked(self, here):
        cleaned = clean_cube(read_cube("good.h5"), PCA(n_sources=2))
        with pytest.raises(InputError, match="good.h5 exists"):
            save_cleaned(cleaned, "good.h5")
        with pytest.raises(InputError, match=".h5, .fits or .npy"):
            save_cleaned(cleaned, "c.hdf5")
        save_cleaned(cleaned, "good.h5", overwrite=True)
        with h5py.File("good.h5") as file:
            assert "residual" in file


class TestTruth:
    def test_its_own_frequencies_count(self, maps, here, rng):
        """Options are for what a file does not say: the cube is shuffled, the truth is not."""
        order = rng.permutation(24)
        np.save("shuffled.npy", maps[order])
        np.savetxt("nu.txt", FREQS[order])
        truth = read_truth("good.h5", freqs="nu.txt", unit="K", maps_name="another")
        assert np.array_equal(truth.maps, maps) and truth.freqs == pytest.approx(FREQS)
        assert np.array_equal(read_truth("shuffled.npy", freqs="nu.txt", unit="mK").maps, maps)

    def test_another_frequency_is_named(self, maps, here):
        write_hdf5("t.h5", maps / 1000, freqs=FREQS + 1e-9)
        write_hdf5("u.h5", maps, freqs=FREQS + 3)
        words = ["clean", "good.h5", "--method", "pca", "-o", "c.h5", "--truth"]
        done = himap(*words, "u.h5")
        assert done.exit_code == 2 and "got 903 MHz where that has 900" in done.output
        assert himap(*words, "t.h5").exit_code == 0


class TestParameters:
    def test_few_channels(self, maps, here):
        write_hdf5("a.h5", maps[:6], freqs=FREQS[:6])
        for command, more in (("clean", ["-o", "c.h5"]), ("suggest", ["--to", "3"])):
            done = himap(command, "a.h5", "--method", "pca", *more)
            assert done.exit_code == 2 and "needs 8 channels, got 6" in done.output
            assert himap(command, "a.h5", "--method", "pca", *more, "--keep-peaks").exit_code == 0

    def test_parameters_beside_a_method_that_has_its_own(self, here):
        cube = read_cube("good.h5")
        with pytest.raises(InputError, match="n_sources: give parameters to PCA"):
            clean_cube(cube, PCA(n_sources=2), n_sources=9)
        with pytest.raises(InputError, match="a method, such as PCA"):
            clean_cube(cube, PCA)
