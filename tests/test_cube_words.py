"""Words and numbers of headers, files and options: known in any case, or refused by their name."""

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from bad_inputs import FREQS, N_PIX, NSIDE, good_maps, write_hdf5
from cube_files import himap
from image_files import FREQ, N_CHANNELS, SKY, power_law_images, write_image

from himap.core.errors import InputError
from himap.core.reading import read_numbers
from himap.cubes import read_cube
from himap.cubes.files import read_freqs, read_truth
from himap.cubes.names import check_names
from himap.instrument import beams
from himap.maps.frames import equinox_of, spectral_frame_of
from himap.removal import create

SAID = {"unit": "mK", "order": "RING"}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def images(rng):
    return power_law_images(rng)


def write_fits(**cards):
    names = [f"{freq:g} MHz" for freq in FREQS]
    hp.write_map("a.fits", good_maps(), column_units="mK", column_names=names, dtype=np.float32)
    with fits.open("a.fits", mode="update") as file:
        file[1].header.update(cards)
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

    @pytest.mark.parametrize("cards", [{"RADESYS": 3}, {"RADESYS": "SKY"}, {"SPECSYS": 7}, {"BUNIT": 3}])
    def test_of_images(self, cards, images):
        write_image("a.fits", images, **cards)
        ((key, value),) = cards.items()
        with pytest.raises(InputError, match=rf"a.fits.*{'unit' if key == 'BUNIT' else key}.*{value}"):
            read_cube("a.fits")

    def test_a_step_of_frequencies_that_is_missing(self, images):
        """1 Hz by the standard, which no cube has."""
        write_image("a.fits", images, axes=(*SKY["SIN"], (*FREQ[:3], 1.0, "Hz")))
        with pytest.raises(InputError, match=r"a.fits: two channels .*CDELT"):
            read_cube("a.fits")

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
        with h5py.File("a.h5", "w") as file:
            file["maps"], file["freqs"] = good_maps() if maps is None else maps, freqs
            file["maps"].attrs.update({"unit": "mK"} | attributes)
        return "a.h5"

    @pytest.mark.parametrize(
        ("attributes", "said"),
        [
            ({"coordsys": 3}, "frame of coordinates.*a.h5.* '3'"),
            ({"frame": "sky"}, "frame of coordinates.*a.h5.* 'sky'"),
            ({"specsys": 5}, "a.h5: SPECSYS.* '5'"),
            ({"order": 1}, "RING or NESTED, got '1'"),
            ({"order": "RING", "nest": True}, "says two orders of pixels, RING and True"),
            ({"nested": "perhaps"}, "RING or NESTED, got 'perhaps'"),
            ({"nside": 2 * NSIDE}, f"a.h5 says nside {2 * NSIDE}, and maps has {NSIDE}"),
            ({"unit": 3}, "got unit '3'"),
            ({"BUNIT": "K"}, "say different things: BUNIT = 'K', unit = 'mK'"),
        ],
    )
    def test_refused(self, attributes, said):
        with pytest.raises(InputError, match=said):
            read_cube(self.write(**attributes))

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
    @pytest.mark.parametrize(
        "text",
        [
            "950,5\n951,0\n951,5\n",
            "950\n950,5\n951\n",
            "MHz\n950,5\n951,5",
            "1;950,5\n2;951,5",
            "950,5 0,1\n951,5 0,2",
            "950,975\n951,975",
            "1,50\n1,49",
        ],
    )
    def test_are_named(self, text):
        with open("f.txt", "w") as file:
            file.write(text)
        with pytest.raises(InputError, match=r"f.txt has numbers with decimal commas, such as \d+,\d+"):
            read_numbers("f.txt")

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
def test_every_order_of_axes_is_advised(place, swapped, images):
    """Which axis is frequency is known by its smoothness; which of the others is RA is not: both are said."""
    sky = ["ra", "dec"] if swapped else ["dec", "ra"]
    names = ",".join([*sky[:place], "freq", *sky[place:]])
    turned = np.moveaxis(images.transpose(0, 2, 1) if swapped else images, 0, place)
    write_image("a.fits", turned)
    said = " ".join(read_cube("a.fits").remarks)
    other = ",".join([*sky[::-1][:place], "freq", *sky[::-1][place:]])
    assert all((f"{one}" in said) == (place > 0) for one in (names, other))
    cube = read_cube("a.fits", axes=names)
    assert np.array_equal(cube.maps, images.reshape(N_CHANNELS, -1)) and not cube.remarks


def test_two_numbers_in_names_that_say_two_orders():
    names = [f"day{20 + n:02d}_ch{11 - n:02d}.fits" for n in range(12)]
    with pytest.raises(InputError, match="says another order"):
        check_names(names, 950 + np.arange(12.0))
