"""What users mean is understood: names of methods, endings of outputs, missing voxels; limits come early."""

from dataclasses import replace

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from bad_inputs import FREQS, N_PIX, good_maps, write_hdf5
from cube_files import himap
from image_files import power_law_images, write_image

from himap import removal
from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube, save_cleaned
from himap.cubes.writing import check_columns
from himap.instrument import beams

pytestmark = pytest.mark.usefixtures("no_pages", "here")
PCA = ("--method", "pca", "-p", "n_sources=2")


def run(*words, code=0):
    done = himap(*words)
    assert done.exit_code == code, done.output
    return done.output


class TestOutputs:
    @pytest.mark.parametrize("name", ["c.hdf5", "c.fits.gz", "C.H5"])
    def test_other_endings_are_read_again(self, name, here):
        write_hdf5("a.h5")
        run("clean", "a.h5", *PCA, "-o", name)
        stem = name.partition(".")[0]
        assert (here / f"{stem}.html").exists()
        again = read_cube(name, maps_name=None if "fits" in name else "residual")
        residual = clean_cube(read_cube("a.h5"), "pca", n_sources=2).residual
        assert again.maps == pytest.approx(residual, abs=1e-5) and again.freqs == pytest.approx(FREQS)
        if "fits" in name:
            assert (here / name).read_bytes()[:2] == b"\x1f\x8b"
            assert (here / "c_foreground.fits.gz").exists() and (here / "c_mixing.txt").exists()

    def test_images_packed(self, rng):
        write_image("a.fits", power_law_images(rng))
        run("clean", "a.fits", *PCA, "-o", "c.fits.gz")
        assert fits.getdata("c.fits.gz").shape == (20, 12, 16)

    @pytest.mark.parametrize("n_channels", [999, 1000])
    def test_more_channels_than_a_table_has_columns(self, n_channels, here, rng):
        maps = rng.standard_normal((n_channels, 12 * 16**2)).astype("f4")
        with h5py.File("a.h5", "w") as file:
            file["maps"], file["freqs"] = maps, 400 + 0.3 * np.arange(n_channels)
            file.attrs.update(unit="mK", order="RING")
        words = ["clean", "a.h5", *PCA, "--keep-peaks", "-o", "c.fits"]
        if n_channels > 999:
            said = run(*words, code=2)
            assert "999 columns at most, and c.fits would need 1000: write HDF5, c.h5" in said
            cleaned = clean_cube(read_cube("a.h5"), "pca", peaks=False)
            with pytest.raises(InputError, match="999 columns"):
                save_cleaned(cleaned, "c.fits")
            assert [path.name for path in here.iterdir()] == ["a.h5"]
        else:
            run(*words)
            assert read_cube("c.fits").maps.shape == maps.shape

    def test_pixel_numbers_are_a_column_too(self):
        columns = [fits.Column("PIXEL", "J", array=np.arange(1000, dtype="i4"))]
        columns += [fits.Column(f"{900 + n} MHz", "E", "mK", array=np.ones(1000)) for n in range(24)]
        table = fits.BinTableHDU.from_columns(columns)
        table.header.update(ORDERING="RING", NSIDE=16, INDXSCHM="EXPLICIT", OBJECT="PARTIAL")
        table.writeto("a.fits")
        cube = read_cube("a.fits")
        for n, refused in ((998, False), (999, True)):
            many = replace(cube, layout=replace(cube.layout, freqs=np.arange(1.0, 1 + n)))
            if refused:
                with pytest.raises(InputError, match="would need 1000"):
                    check_columns(many, "c.fits.gz")
            else:
                check_columns(many, "c.fits.gz")


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
            said = run("clean", path, *PCA, *options, "-o", f"c_{path}")
            assert f"{holes.mean():.2%} of the voxels in these pixels are missing" in said
        with h5py.File("c_holes.h5") as one, h5py.File("c_a.h5") as two:
            assert np.array_equal(one["residual"][...], two["residual"][...], equal_nan=True)
            assert np.array_equal(np.isnan(one["residual"][...]), holes)

    def test_others_say_which_do(self, holes):
        some = np.where(holes, np.float32(np.nan), good_maps())
        some[:, 50:] = good_maps()[:, 50:]
        write_hdf5("some.h5", some)
        said = run("clean", "some.h5", "--method", "fastica", "-o", "c.h5")
        assert "masked in all; methods that take weights keep what is seen" in said
        assert "(parametric, pca, polynomial)" in said
        few = np.full_like(some, np.nan)
        few[:12, : N_PIX // 2], few[12:, N_PIX // 2 :] = 1, 1
        write_hdf5("few.h5", few)
        with pytest.raises(InputError, match=r"few.h5: no pixel is seen in every channel.*\(parametric, pca"):
            read_cube("few.h5")

    def test_a_few_pixels_are_masked_as_before(self):
        maps = good_maps()
        maps[3, 5] = np.nan
        write_hdf5("a.h5", maps)
        cube = read_cube("a.h5", scattered=True)
        assert cube.weights is None and cube.mask.sum() == N_PIX - 1
        maps[7] = np.nan  # a blind channel is no hole
        write_hdf5("b.h5", maps)
        assert read_cube("b.h5", scattered=True).weights is None

    def test_floats_of_16_bits_are_remarked_on(self):
        half = (good_maps() / 100).astype(np.float16)
        write_hdf5("a.h5", half, said={"unit": "K", "order": "RING"})
        said = " ".join(read_cube("a.h5").remarks)
        rounding = 1e3 * float(half.max()) / 2048
        assert f"floats of 16 bits, which round its brightest voxels by up to {rounding:.2g} mK" in said
        write_hdf5("b.h5", half.astype("f4"), said={"unit": "K", "order": "RING"})
        assert "16 bits" not in " ".join(read_cube("b.h5").remarks)


class TestNames:
    @pytest.mark.parametrize("name", ["PCA", "FastICA", "SDecGMCA", "beam-subspace", "Gaussian Process"])
    def test_methods_by_any_spelling(self, name):
        plain = "".join(filter(str.isalpha, name)).lower()
        assert removal.create(name).name.replace("_", "") == plain

    def test_others_are_refused(self):
        for name in ("", "__init__", "base", "_", 3):
            with pytest.raises(InputError, match="unknown method"):
                removal.create(name)

    def test_beams_unless_there_is_such_a_file(self):
        assert beams.named("MeerKAT") == beams.named("meerkat")
        assert beams.named("Oscillating:ripple=additive") == beams.named("oscillating:ripple=additive")
        np.savetxt("MeerKAT", np.ones(24))
        assert beams.named("MeerKAT").name == "file"

    def test_the_command_lists_methods_and_their_parameters(self):
        listing = run("methods")
        assert all(name in listing for name in removal.available())
        said = run("methods", "PCA")
        assert "n_sources = 3  number of components to remove" in said and "Uses: weights" in said
        assert "did you mean gmca" in run("methods", "gmc", code=2)


def test_axes_by_the_command(rng):
    images = power_law_images(rng)
    write_image("a.fits", images)
    fits.writeto("turned.fits", images.transpose(2, 1, 0), fits.getheader("a.fits"))
    run("clean", "a.fits", *PCA, "-o", "c.fits")
    run("clean", "turned.fits", *PCA, "--axes", "ra,dec,freq", "-o", "d.fits")
    assert np.array_equal(fits.getdata("c.fits"), fits.getdata("d.fits"))


def test_a_mask_of_numpy_by_the_command():
    write_hdf5("a.h5")
    kept = np.arange(N_PIX) < 100
    np.save("m.npy", kept)
    hp.write_map("m.fits", kept, dtype=bool, column_units=None)
    for name in ("m.npy", "m.fits"):
        assert "52.1% of the sky is kept" in run("clean", "a.h5", *PCA, "--mask", name, "-o", f"{name}.h5")
    with h5py.File("m.npy.h5") as one, h5py.File("m.fits.h5") as two:
        assert np.array_equal(one["residual"][...], two["residual"][...], equal_nan=True)
