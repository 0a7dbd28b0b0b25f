"""Words and numbers of headers, files and options: known in any case, or refused by their name."""

import bad_inputs
import h5py
import numpy as np
import pytest
from bad_inputs import FREQS, N_PIX, NSIDE, good_maps, write_hdf5
from cube_files import himap
from image_files import N_CHANNELS, power_law_images, write_image

from himap.core.errors import InputError
from himap.cubes import read_cube
from himap.cubes.files import read_freqs, read_truth
from himap.instrument import beams
from himap.maps.frames import equinox_of, spectral_frame_of
from himap.removal import create

pytestmark = pytest.mark.usefixtures("here")

SAID = {"unit": "mK", "order": "RING"}


@pytest.fixture
def images(rng):
    return power_law_images(rng)


def write_fits(**cards):
    names = [f"{freq:g} MHz" for freq in FREQS]
    bad_inputs.write_fits("a.fits", good_maps(), column_names=names, extra_header=list(cards.items()))
    return "a.fits"


class TestCards:
    @pytest.mark.parametrize(
        ("key", "value"),
        [
            *(("COORDSYS", value) for value in (3, "3", True, "SKY")),
            *(("SPECSYS", value) for value in (5, "SKY")),
            *(("ORDERING", value) for value in (0, False, "NUNIQ")),
            *(("NSIDE", value) for value in ("16", 0, 2.5)),
        ],
    )
    def test_of_maps(self, key, value):
        with pytest.raises(InputError, match=rf"{key}.*{value}") as error:
            read_cube(write_fits(**{key: value}))
        assert "a.fits" in str(error.value)

    @pytest.mark.parametrize("equinox", ["soon", True])
    def test_of_an_equinox(self, equinox):
        with pytest.raises(InputError, match=rf"EQUINOX beside COORDSYS in a.fits .*{equinox}"):
            read_cube(write_fits(COORDSYS="C", EQUINOX=equinox))

    @pytest.mark.parametrize(("equinox", "frame"), [("B1950", "C1950"), ("1950.0", "C1950"), ("J2000", "C")])
    def test_an_equinox_as_text(self, equinox, frame, images):
        assert read_cube(write_fits(COORDSYS="C", EQUINOX=equinox)).layout.pixels.frame == frame
        write_image("b.fits", images, RADESYS="FK5", EQUINOX=equinox)
        assert read_cube("b.fits").layout.pixels.frame == frame

    def test_spectral_frames_as_programs_spell_them(self):
        for frame, texts in {
            "TOPOCENT": ("topocentric", "TOPO", " TOPOCENT"),
            "LSRK": ("LSRK", "lsr"),
            "GALACTOC": ("Galactocentric", "GALACTO"),
            None: (None, ""),
        }.items():
            assert {spectral_frame_of(text) for text in texts} == {frame}
        assert equinox_of(None) is equinox_of(float("nan")) is None
        truth = read_truth(write_fits(SPECSYS="TOPO"))
        assert truth.layout.joined("the truth", None, "topocentric").spectral_frame == "TOPOCENT"


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
        with pytest.raises(InputError, match="a.h5 has pixels in an order of its own, pix"):
            read_cube("a.h5")

    @pytest.mark.parametrize("turned", [False, True])
    def test_frequencies_say_which_axis_is_theirs(self, turned, rng):
        """Where both could be the pixels of a sphere."""
        maps = rng.standard_normal((192, 48)).astype("f4")
        cube = read_cube(self.write(maps.T if turned else maps, 900 + np.arange(192.0), order="RING"))
        assert np.array_equal(cube.maps, maps) and not cube.remarks


class TestOptions:
    def test_in_any_case(self):
        assert create("fastica", contrast="EXP").contrast == "exp"
        assert create("SDecGMCA", reading="Letter").reading == "letter"
        assert beams.named("MeerKAT:Band=uhf") == beams.named("meerkat:band=UHF")
        write_hdf5("a.h5", said={})
        words = ["--method", "PCA", "-p", "N_SOURCES=2", "--unit", "MK", "--order", "Ring", "--frame", "g"]
        done = himap("clean", "a.h5", *words, "--keep-peaks", "-o", "o.h5")
        assert done.exit_code == 0 and "Galactic" in done.output and "unless" not in done.output
        assert himap("list", "04_PCA").output == himap("list", "04_pca").output
        done = himap("run", "04", "--preset", "CI", "-o", "o.txt")
        assert "preset" not in done.output and "ipynb" in done.output

    def test_given_twice(self):
        twice = ["-p", "n_sources=2", "-p", "N_SOURCES=3"]
        done = himap("clean", "a.h5", "--method", "pca", *twice, "-o", "o.h5")
        assert done.exit_code == 2 and "n_sources is given twice" in done.output
        with pytest.raises(InputError, match="given twice"):
            beams.named("meerkat:band=L,Band=UHF")

    def test_others_of_a_truth(self):
        with pytest.raises(TypeError, match="uint"):
            read_truth("a.h5", uint="K")


class TestDecimalCommas:
    def test_columns_are_none(self):
        for text, freqs in {
            "950,951\n951,952\n": [950.5, 951.5],
            "951,952\n950,951\n": [951.5, 950.5],
            "1,950,951\n2,951,952": [950.5, 951.5],
            "950, 951\n951, 952": [950.5, 951.5],
            "950,951,952": [950, 951, 952],
        }.items():
            with open("f.txt", "w") as file:
                file.write(text)
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
