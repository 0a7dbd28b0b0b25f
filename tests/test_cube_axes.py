"""Which axis, file and format is which: said by the files, by the caller, or refused, and never guessed."""

import fcntl
import os
from contextlib import nullcontext
from dataclasses import replace

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from bad_inputs import FREQS, N_PIX, good_maps, write_folder, write_hdf5
from cube_files import FREQ, N_CHANNELS, N_X, N_Y, SKY, STOKES, write_image

from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube, save_cleaned
from himap.cubes.axes import check_names
from himap.cubes.files import read_truth
from himap.cubes.weights import read_mask

pytestmark = pytest.mark.usefixtures("here")

MHZ = 980 + 2.0 * np.arange(N_CHANNELS)
KEPT = np.arange(N_PIX) % 3 > 0


class TestAxes:
    """Arrays (RA, Dec, channel) of numpy, written as they are under a header of the sky."""

    def write(self, images, axes=SKY["ZEA"], name="turned.fits", **cards):
        write_image(name, images.transpose(2, 1, 0), axes=axes, **cards)

    @pytest.mark.parametrize(
        "axes", [SKY["ZEA"], (*SKY["ZEA"], FREQ), (FREQ, *SKY["ZEA"]), (*SKY["ZEA"], STOKES, FREQ)]
    )
    def test_named_axes_and_the_way_back(self, images, axes):
        """The residual is that of the transposed cube, in the order of FITS, and can be read again."""
        self.write(images, axes, WCSAXES=len(axes))
        given = {} if FREQ in axes else {"freqs": MHZ}
        cube = read_cube("turned.fits", axes="RA, Dec, channel", **given)
        assert np.array_equal(cube.maps.reshape(images.shape), images) and np.allclose(cube.freqs, MHZ)
        cleaned = clean_cube(cube, "pca", n_sources=2)
        save_cleaned(cleaned, "c.fits")
        again = read_cube("c.fits")
        assert np.array_equal(again.maps, cleaned.residual) and np.allclose(again.freqs, MHZ)
        world, (n_y, n_x) = WCS(fits.getheader("c.fits")), (N_Y, N_X)
        assert world.celestial.array_shape == (n_y, n_x)
        if len(axes) == 2:  # where the file itself says too little of its axes
            truth = read_truth("turned.fits", axes="ra,dec,freq", freqs=MHZ)
            assert np.array_equal(truth.maps, cube.maps)

    def test_axes_hold_for_the_truth_or_its_header_does(self, images, rng):
        """That does where the axes are of an array whose header has two, with frequencies from elsewhere.

        With as many channels as columns, so that no shape tells them apart.
        """
        images, axes = images[:N_X], (*SKY["SIN"], FREQ)
        truth = rng.standard_normal(images.shape).astype(np.float32)
        self.write(images, axes)
        self.write(truth, axes, "t.fits")
        write_image("own.fits", truth, axes=axes)
        cube = read_cube("turned.fits", axes="ra,dec,freq")
        assert np.array_equal(cube.maps.reshape(images.shape), images)
        other = replace(cube, layout=replace(cube.layout, freqs_from="freqs.txt"))
        for name, of in (("t.fits", cube), ("own.fits", other)):
            found = read_truth(name, cube=of, axes="ra,dec,freq")
            assert np.array_equal(found.maps, truth.reshape(N_X, -1))
        self.write(np.zeros_like(images), axes, "f.fits", BUNIT="")
        message = r"is transposed \(--axes\).*give it as .npy of the shape .n_channels, 12"
        with pytest.raises(InputError, match=message):
            read_cube("turned.fits", axes="ra,dec,freq", flags="f.fits")

    @pytest.mark.parametrize("gain", [0, 0.05])
    def test_a_header_that_fits_the_array_turned_round_is_doubted(self, gain, rng):
        """Of a sky whose lines a few modes would hold; neither growing gaps, dead channels nor gains are."""
        y, x = np.mgrid[:N_Y, :N_X]
        sky, spectrum = 4 + np.sin(x / 3) + np.cos(y / 3), (MHZ / 1e3) ** -2.7
        spectrum = spectrum * (1 + gain * rng.standard_normal(N_CHANNELS))
        images = 1e3 * spectrum[:, None, None] * sky + 0.3 * rng.standard_normal((N_CHANNELS, N_Y, N_X))
        self.write(images, (*SKY["ZEA"], FREQ))
        assert "--axes ra,dec,freq" in " ".join(read_cube("turned.fits").remarks)
        images[5] = 1e4  # a dead channel, as bright as the others
        for n, image in enumerate(images):
            image[:, : 1 + (N_CHANNELS - n) // 4] = np.nan
        assert "--axes" not in " ".join(read_cube(write_image("right.fits", images)).remarks)

    @pytest.mark.parametrize("kind", ["", "LINEAR"])
    def test_channels_without_a_type_have_the_frequencies_that_are_given(self, images, kind):
        write_image("a.fits", images, axes=(*SKY["SIN"], (kind, 0.0, 1.0, 1.0, "")))
        with pytest.raises(InputError, match="a.fits does not state its frequencies"):
            read_cube("a.fits")
        uneven = read_cube("a.fits", freqs=MHZ + (np.arange(N_CHANNELS) == 3))
        assert "which an image axis cannot state" in " ".join(uneven.remarks)
        cube = read_cube("a.fits", freqs=MHZ[::-1])
        assert "which an image axis cannot state" not in " ".join(cube.remarks)
        assert np.array_equal(cube.maps.reshape(images.shape), images[::-1])
        with pytest.raises(InputError, match="a.fits.*20 channels, got 16.*--axes"):
            read_cube("a.fits", freqs=MHZ[:16])

    def test_a_folder_of_images_without_any(self, images):
        for freq, image in zip(MHZ, images, strict=True):
            write_image(f"{freq:g}.fits", image, axes=SKY["SIN"])
        assert np.array_equal(read_cube(".", freqs=MHZ).maps, images.reshape(N_CHANNELS, -1))
        with pytest.raises(InputError, match=r"980.fits would have 1018 MHz"):
            read_cube(".", freqs=MHZ[::-1])

    def test_maps_of_which_both_axes_could_be_pixels(self, rng):
        square = rng.standard_normal((192, 192)).astype("f4")
        write_hdf5("a.h5", square, freqs=900 + np.arange(192.0))
        cube = read_cube("a.h5")
        assert np.array_equal(cube.maps, square) and "both axes, 192 and 192" in cube.remarks[0]
        assert np.array_equal(read_cube("a.h5", axes="pixel,freq").maps, square.T)
        np.save("a.npy", square[:48])
        given = {"freqs": 900 + np.arange(192.0), "unit": "mK"}
        with pytest.raises(InputError, match="48 channels, got 192.*pixel,freq"):
            read_cube("a.npy", **given)
        assert np.array_equal(read_cube("a.npy", axes="pixel,freq", **given).maps, square[:48].T)

    @pytest.mark.parametrize("name", ["freq", "Frequency", "FREQ-LSR"])
    def test_names_of_the_axis_of_frequencies(self, images, name):
        write_image("a.fits", images, axes=(*SKY["SIN"], (name, *FREQ[1:])))
        assert np.allclose(read_cube("a.fits").freqs, MHZ)
        save_cleaned(clean_cube(read_cube("a.fits"), "pca", n_sources=2), "c.fits")
        assert fits.getheader("c.fits")["CTYPE3"] == name


class TestOrderOfFiles:
    def test_decimals_are_decimals(self):
        names = [f"map_{950 + n / 4}" for n in range(24)]
        write_folder("folder", names)
        cube = read_cube("folder", freqs=950 + np.arange(24) / 4)
        assert np.array_equal(cube.maps, good_maps())
        assert "map_950.0.fits (950 MHz), the last map_955.75.fits (955.75 MHz)" in cube.remarks[0]

    @pytest.mark.parametrize("form", ["{:.1f}", "{:g}GHz", "nside4_{:g}_a", "{:g}"])
    def test_names_are_checked_against_the_frequencies(self, form):
        freqs = 950 + 0.5 * np.arange(12)
        names = [form.format(freq / (1000 if "GHz" in form else 1)).replace(".", "p") for freq in freqs]
        check_names(names, freqs)
        swapped = np.r_[freqs[1], freqs[0], freqs[2:]]
        for wrong in (swapped, freqs[::-1]):
            with pytest.raises(InputError, match="would have"):
                check_names(names, wrong)
        with pytest.raises(InputError, match="would have 955.5 MHz"):
            check_names([*names[:-1], form.format(0.957 if "GHz" in form else 957)], freqs)

    numbers = range(12)
    right = (
        [f"map_{949.5 + n}" for n in numbers],  # edges
        [f"map_{n}" for n in numbers],
        [f"map_z{1420.406 / (950 + n) - 1:.3f}" for n in numbers],  # redshifts
        sorted(f"2024{1 + n // 4:02d}01_ch{n:02d}" for n in numbers),
        [f"run_1.{n:02}" for n in numbers],
    )
    wrong = (
        sorted(f"map_z{1420.406 / (950 + n) - 1:.3f}" for n in numbers),
        sorted(f"2024{1 + n % 9:02d}01_ch{n:02d}" for n in numbers),  # a date that several share comes first
        [f"day{20 + n:02d}_ch{11 - n:02d}" for n in numbers],
        sorted((f"run_1.{n}" for n in range(1, 13)), key=lambda name: float(name[4:])),  # decimals or not
    )

    @pytest.mark.parametrize("names", right + wrong)
    def test_what_numbers_in_names_may_be(self, names):
        refused = pytest.raises(InputError, match="rename the files")
        with refused if names in self.wrong else nullcontext():
            check_names(names, 950 + np.arange(12.0))

    def test_what_is_left_out_is_listed(self, here):
        write_folder("folder", [f"map_{n}" for n in range(23)] + ["mean"])
        (here / "folder" / "notes.txt").write_text("...")
        (here / "folder" / "._map_1.fits").write_bytes(b"\0\5\26\7")
        (here / "folder" / "map_3.fits").rename(here / "folder" / "map_3.dat")  # FITS by its first bytes
        cube = read_cube("folder", freqs=FREQS)
        assert np.array_equal(cube.maps, good_maps())  # counted as people count
        said = " ".join(cube.remarks)
        assert "notes.txt" in said and "._map_1.fits" in said and "the last mean.fits (1065 MHz)" in said
        with pytest.raises(InputError, match="one frequency for each of the 24 channels, got 23"):
            read_cube("folder", freqs=FREQS[:23])


class TestFormats:
    @pytest.mark.parametrize("name", ["a.hd5", "a.nc", "a", "a.fits"])
    def test_hdf5_by_its_first_bytes(self, name):
        with h5py.File(name, "w", userblock_size=512) as file:
            file["maps"], file["freqs"] = good_maps(), FREQS
            file.attrs.update(unit="mK", order="RING")
        assert np.array_equal(read_cube(name).maps, good_maps())

    def test_fits_and_npy_by_theirs(self, images):
        write_image("a.fits", images)
        fits.writeto("b.fits.gz", images, fits.getheader("a.fits"))
        os.rename("b.fits.gz", "b.cube")
        np.save("c.npy", good_maps())
        os.rename("c.npy", "c.dat")
        assert np.array_equal(read_cube("b.cube").maps, images.reshape(N_CHANNELS, -1))
        assert np.array_equal(read_cube("c.dat", freqs=FREQS, unit="mK").maps, good_maps())

    def test_a_filter_that_is_not_installed_is_named(self):
        maps = good_maps()
        with h5py.File("a.h5", "w") as file:
            how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            how.set_chunk(maps.shape)
            how.set_filter(32015, h5py.h5z.FLAG_OPTIONAL, (3,))
            space = h5py.h5s.create_simple(maps.shape)
            item = h5py.h5d.create(file.id, b"maps", h5py.h5t.NATIVE_FLOAT, space, how)
            item.write_direct_chunk((0, 0), maps.tobytes(), 0)
            file["freqs"] = FREQS
            file.attrs.update(unit="mK", order="RING")
        with pytest.raises(InputError, match="a.h5 cannot be read .* filter that is not installed here"):
            read_cube("a.h5")

    def test_a_file_that_another_program_has_locked(self):
        write_hdf5("a.h5")
        with open("a.h5", "r+") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            message = "a.h5 cannot be locked: it is open for .* HDF5_USE_FILE_LOCKING=FALSE"
            with pytest.raises(InputError, match=message):
                read_cube("a.h5")
        assert np.array_equal(read_cube("a.h5").maps, good_maps())


@pytest.mark.parametrize("nest", [False, True])
def test_logical_masks_and_flags(nest):
    """FITS has its own order; arrays have that of the cube, here the other one."""
    ordered = {False: KEPT, True: hp.reorder(KEPT.astype("f4"), r2n=True) > 0}
    write_hdf5("a.h5", said={"unit": "mK", "order": "RING" if nest else "NESTED"})
    layout = read_cube("a.h5").layout
    hp.write_map("m.fits", ordered[nest], nest=nest, dtype=bool, column_units=None)
    assert fits.getheader("m.fits", 1)["TFORM1"].endswith("L")
    assert np.array_equal(read_mask("m.fits", layout)[0], KEPT)
    for dtype in (bool, np.uint8, float):
        np.save("m.npy", ordered[not nest].astype(dtype))
        assert np.array_equal(read_mask("m.npy", layout)[0], KEPT)
    hp.write_map("bad.fits", ~ordered[nest], nest=nest, dtype=bool, column_units=None)
    assert np.array_equal(read_cube("a.h5", flags="bad.fits").mask, KEPT)
