"""Image cubes with world coordinates: whatever their axes, the same maps come in, and go back as given."""

from functools import partial

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from cube_files import FREQ, N_CHANNELS, N_X, N_Y, SKY, STOKES, run, write_image

from himap.core.errors import InputError
from himap.cubes import clean_cube, measure_transfer, read_cube, save_cleaned
from himap.cubes.spectra import patch_power, spectra_of
from himap.measures.cylindrical import cell_of

MHZ = 980 + 2.0 * np.arange(N_CHANNELS)
DOWN = ("FREQ", 1018e6, 1.0, -2e6, "Hz")
PCA = ("--method", "pca", "-p", "n_sources=2")
LOSSLESS = partial(fits.CompImageHDU, quantize_level=0, compression_type="GZIP_2")


class TestReading:
    @pytest.mark.parametrize("projection", SKY)
    def test_frequencies_and_sky_are_those_of_astropy(self, images, projection, tmp_path):
        path = write_image(tmp_path / "a.fits", images, axes=(*SKY[projection], FREQ))
        cube = read_cube(path)
        wcs = WCS(fits.getheader(path))
        freqs = wcs.all_pix2world(0, 0, np.arange(N_CHANNELS), 0)[2] / 1e6
        assert np.allclose(cube.freqs, freqs, rtol=1e-12)
        x, y = np.meshgrid(np.arange(N_X), np.arange(N_Y))
        expected = wcs.all_pix2world(x, y, 0, 0)[:2]
        assert np.allclose(cube.layout.pixels.celestial.all_pix2world(x, y, 0), expected)

    def test_blank_pixels_are_masked_in_all_channels(self, images, tmp_path):
        images[3, 2, 5], images[7] = np.nan, np.nan
        cube = read_cube(write_image(tmp_path / "a.fits", images))
        assert len(cube.freqs) == N_CHANNELS - 1 and cube.mask.sum() == N_Y * N_X - 1
        assert not cube.mask[2 * N_X + 5] and not cube.whole_sky
        assert "1 of 20 channels have no data" in cube.remarks[0]
        assert cube.remarks[1].endswith("(99.5% of the image) are seen in every channel; the rest is masked.")


@pytest.mark.usefixtures("no_pages")
class TestCleaning:
    @pytest.mark.parametrize("kind", [fits.PrimaryHDU, fits.ImageHDU, LOSSLESS])
    def test_the_command_gives_the_header_back_and_the_residual_of_the_library(self, images, kind, tmp_path):
        """Descending frequencies, kelvin, Stokes, blank pixels, axes in another order."""
        given = (images[::-1] / 1e3).transpose(1, 0, 2)[None]
        given[0, 3, :, 4] = np.nan
        axes = (SKY["ZEA"][0], DOWN, SKY["ZEA"][1], STOKES)
        cards = {"BUNIT": "K", "OBJECT": "a field", "RADESYS": "FK5", "EQUINOX": 2000.0, "LONPOLE": 180.0}
        write_image(tmp_path / "a.fits", given, axes=axes, kind=kind, **cards)
        run("clean", tmp_path / "a.fits", *PCA, "-o", tmp_path / "c.fits")
        cleaned = clean_cube(read_cube(tmp_path / "a.fits"), "pca", n_sources=2)
        index = 0 if kind is fits.PrimaryHDU else 1
        before, after = fits.getheader(tmp_path / "a.fits", index), fits.getheader(tmp_path / "c.fits")
        structure = {"SIMPLE", "EXTEND", "XTENSION", "PCOUNT", "GCOUNT", "EXTNAME"}
        for key in set(before) - structure:
            assert after[key] == before[key], key
        more = set(after) - set(before) - structure
        assert more == {"METHOD", "HIMAP", "HISTORY"} and after["METHOD"] == "pca"
        found = fits.getdata(tmp_path / "c.fits")
        assert found.shape == given.shape and found.dtype == np.dtype(">f4")
        assert np.array_equal(np.isnan(found), np.isnan(given))
        lines = found[0].transpose(1, 0, 2)[::-1].reshape(N_CHANNELS, -1)
        lines = 1e3 * lines[:, ~np.isnan(lines[0])]
        assert lines == pytest.approx(cleaned.residual, rel=1e-6, abs=1e-9)
        foreground = fits.getdata(tmp_path / "c_foreground.fits")
        assert np.nan_to_num(found + foreground) == pytest.approx(np.nan_to_num(given), rel=1e-6)
        mixing = np.loadtxt(tmp_path / "c_mixing.txt")
        assert np.allclose(mixing[:, 0], MHZ)
        assert np.allclose(mixing[:, 1:], cleaned.separation.mixing)

    def test_mocks_are_of_the_sphere(self, images, tmp_path):
        with pytest.raises(InputError, match="is an image in the plane"):
            measure_transfer(clean_cube(read_cube(write_image(tmp_path / "a.fits", images)), "pca"), [])

    def test_a_mask(self, images, rng, tmp_path):
        path = write_image(tmp_path / "a.fits", images)
        kept = rng.random((N_Y, N_X)) > 0.3
        write_image(tmp_path / "m.fits", kept.astype("f4"), axes=SKY["SIN"], BUNIT="JY/BEAM")
        done = run("clean", path, *PCA, "--mask", tmp_path / "m.fits", "-o", tmp_path / "c.fits")
        assert f"{kept.mean():.1%} of the image is kept by the mask" in done.output
        found = fits.getdata(tmp_path / "c.fits")
        assert np.isnan(found[:, ~kept]).all()
        expected = clean_cube(read_cube(path).within(kept.ravel()), "pca", n_sources=2)
        assert np.array_equal(found[:, kept], expected.residual)
        np.save(tmp_path / "m.npy", kept)
        assert np.array_equal(read_cube(path).masked(tmp_path / "m.npy").mask, kept.ravel())

    def test_outputs_in_the_unit_that_is_told(self, images, tmp_path):
        path = write_image(tmp_path / "a.fits", images / 1e3, BUNIT="")
        cleaned = clean_cube(read_cube(path, unit="K"), "pca", n_sources=2)
        save_cleaned(cleaned, tmp_path / "c.fits")
        assert fits.getheader(tmp_path / "c.fits")["BUNIT"] == "K"
        written = [path.name for path in save_cleaned(cleaned, tmp_path / "d.npy")]
        assert written == ["d.npy", "d_foreground.npy", "d_mixing.txt"]
        for found in (fits.getdata(tmp_path / "c.fits"), np.load(tmp_path / "d.npy")):
            assert np.allclose(1e3 * found, cleaned.residual.reshape(images.shape))
        assert [path.name for path in save_cleaned(cleaned, tmp_path / "c.h5")] == ["c.h5"]


@pytest.mark.usefixtures("no_pages")
class TestSeveralFiles:
    def ranges(self, folder, images, gap=0):
        high = ("FREQ", 1e6 * (MHZ[12] + gap), 1.0, 2e6, "Hz")
        down = ("FREQ", 1e6 * MHZ[11], 1.0, -2e6, "Hz")
        folder.mkdir()
        write_image(folder / "high.fits", images[12:, None], axes=(*SKY["SIN"], STOKES, high), OBJECT="high")
        return write_image(folder / "low.fits", images[11::-1], axes=(*SKY["SIN"], down), OBJECT="low")

    def test_ranges_are_one_cube_and_go_back_each_with_its_header(self, images, tmp_path):
        self.ranges(tmp_path / "in", images)
        run("clean", tmp_path / "in", *PCA, "-o", tmp_path / "c.fits")
        whole = write_image(tmp_path / "a.fits", images)
        expected = clean_cube(read_cube(whole), "pca", n_sources=2).residual.reshape(images.shape)
        with fits.open(tmp_path / "c.fits") as file:
            assert [hdu.header.get("OBJECT") for hdu in file] == [None, "high", "low"]
            assert np.array_equal(file[1].data, expected[12:, None])
            assert np.array_equal(file[2].data, expected[11::-1])
        assert np.allclose(read_cube(tmp_path / "c.fits").freqs, MHZ)

    def test_a_gap_is_said_and_costs_the_cylindrical_spectrum(self, images, tmp_path):
        self.ranges(tmp_path / "in", images, gap=50)
        cube = read_cube(tmp_path / "in")
        assert "channels are 2 to 52 MHz apart" in cube.remarks[0]
        with pytest.raises(InputError, match="evenly spaced"):
            patch_power(cube, cube.maps)


class TestPages:
    @pytest.mark.parametrize("projection", SKY)
    def test_maps_and_spectra(self, images, projection, tmp_path):
        axes = (*SKY[projection], FREQ)
        images[:, 0, 0] = np.nan
        path = write_image(tmp_path / "a.fits", images, axes=axes)
        smooth = np.linspace(0.99, 1.01, N_CHANNELS)[:, None, None] * images.mean(axis=0)
        truth = write_image(tmp_path / "t.fits", images - smooth, axes=axes)
        run("clean", path, *PCA, "--truth", truth, "-o", tmp_path / "c.fits")
        page = (tmp_path / "c.html").read_text()
        assert page.count("<img alt=") == 4 and "P(k_perp, k_par)" in page and "P/P0" in page

    def test_the_cell_is_that_of_astropy(self, images, tmp_path):
        cube = read_cube(write_image(tmp_path / "a.fits", images, axes=(*SKY["ZEA"], FREQ)))
        rows, columns = cube.layout.pixels.pixel_angles()
        sky = cube.layout.pixels.celestial.pixel_to_world([7, 8], [5.5, 5.5])
        assert columns == pytest.approx(sky[0].separation(sky[1]).rad, rel=1e-9)
        assert np.rad2deg(rows) == pytest.approx(0.5, rel=1e-3)
        (along, *_), z = cell_of(cube.freqs, (rows, columns))
        assert z == pytest.approx(1420.405751768 / 999 - 1)
        hubble = 100 * np.sqrt(0.3 * (1 + z) ** 3 + 0.7)  # (km/s) / (Mpc/h)
        assert along == pytest.approx(299792.458 * 2 * (1 + z) ** 2 / (1420.4058 * hubble), rel=1e-4)
        assert not len(spectra_of(clean_cube(cube, "pca")).angular.degrees)
