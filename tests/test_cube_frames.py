"""The frame of coordinates, and what else gives numbers meaning: read, compared, said, and written again."""

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from cube_files import FREQ, SKY, run, write_hdf5, write_image

from himap.core.errors import InputError
from himap.cubes import clean_cube, read_cube, save_cleaned
from himap.cubes.files import read_truth
from himap.cubes.spectra import check_truth
from himap.maps import sphere
from himap.maps.frames import equinox_of, frame_of, spectral_frame_of
from himap.maps.healpix_io import read_maps, write_maps

pytestmark = pytest.mark.usefixtures("no_pages", "here")

NSIDE = 8
N_PIX = 12 * NSIDE**2
FREQS = 950 + 1.0 * np.arange(10)
NAMES = [f"{freq:g} MHz" for freq in FREQS]


@pytest.fixture
def maps(rng):
    sky = 1e3 * np.exp(rng.standard_normal(N_PIX))
    return ((FREQS / 950)[:, None] ** -2.7 * sky + rng.standard_normal((10, N_PIX))).astype(np.float32)


def write(name, maps, frame, **options):
    options = {"column_units": "mK", "column_names": NAMES if np.ndim(maps) == 2 else None} | options
    hp.write_map(name, maps, coord=frame, dtype=np.float32, **options)
    return name


@pytest.mark.parametrize(
    ("read", "frame", "spellings"),
    [
        (frame_of, "G", ["G", "galactic", " GAL "]),
        (frame_of, "C", ["C", "Q", "CEL", "Equatorial", "ICRS", "FK5", "J2000"]),
        (frame_of, "E", ["E", "ecliptic"]),
        (frame_of, None, [None, "", "unknown", "NONE"]),
        (frame_of, "FK4", ["fk4"]),
        (spectral_frame_of, "TOPOCENT", ["topocentric", "TOPO", " TOPOCENT"]),
        (spectral_frame_of, "LSRK", ["LSRK", "lsr"]),
        (spectral_frame_of, "GALACTOC", ["Galactocentric", "GALACTO"]),
        (spectral_frame_of, None, [None, ""]),
        (equinox_of, None, [None, float("nan")]),
    ],
)
def test_spellings(read, frame, spellings):
    assert {read(text) for text in spellings} == {frame}


def test_another_equinox_is_another_frame(maps):
    assert frame_of("C", 2000.0) == frame_of("C", float("nan")) == "C" and frame_of("C", 1950) == "C1950"
    write_maps("a.fits", maps, names=NAMES, unit="mK", nested=False, frame="C1950")
    header = fits.getheader("a.fits", 1)
    assert (header["COORDSYS"], header["EQUINOX"]) == ("C", 1950) and read_maps("a.fits").frame == "C1950"


class TestReadAndWritten:
    @pytest.mark.parametrize("on", ["/", "sky", "sky/cube"])
    @pytest.mark.parametrize("name", ["COORDSYS", "coord", "frame"])
    def test_hdf5(self, on, name, maps):
        """Of the dataset, its group or the file."""
        with h5py.File(write_hdf5("a.h5", maps, FREQS), "a") as file:
            file[on].attrs[name] = "Equatorial"
            file[on].attrs["EQUINOX"] = 1950.0
        assert read_cube("a.h5").layout.pixels.frame == "C1950"
        for written in ("b.fits", "b.h5"):
            save_cleaned(clean_cube(read_cube("a.h5"), "pca", n_sources=2), written)
            assert read_cube(written).layout.pixels.frame == "C1950"

    def test_a_card_of_the_file_before_the_table(self, maps):
        write("a.fits", maps, None)
        with fits.open("a.fits", mode="update") as file:
            file[0].header.update(COORDSYS="E", BUNIT="K")
            for n in range(1, 11):
                del file[1].header[f"TUNIT{n}"]
        cube = read_cube("a.fits")
        assert (cube.layout.pixels.frame, cube.layout.unit) == ("E", "K")

    def test_it_can_be_given(self, maps):
        np.save("a.npy", maps)
        given = {"freqs": FREQS, "unit": "mK", "order": "RING"}
        assert read_cube("a.npy", frame="galactic", **given).layout.pixels.frame == "G"
        for name, frame in {"Galactic": "G", "celestial": "C", "frame not stated": None}.items():
            assert name in read_cube(write(f"{name}.fits", maps, frame)).summary

    def test_other_cards_are_kept(self, maps):
        cards = [("SPECSYS", "TOPOCENT"), ("TELESCOP", "MeerKAT"), ("FREQRES", 1.5)]
        cube = read_cube(write("a.fits", maps, "C", extra_header=cards))
        assert "SPECSYS = TOPOCENT" in cube.summary
        assert cube.layout.joined("the truth", None, "topocentric").spectral_frame == "TOPOCENT"
        save_cleaned(clean_cube(cube, "pca", n_sources=1), "c.fits")
        save_cleaned(clean_cube(read_cube("c.fits"), "pca", n_sources=1), "d.h5")
        save_cleaned(clean_cube(read_cube("d.h5"), "polynomial", order=1), "e.fits")
        header = fits.getheader("e.fits", 1)
        assert {key: header[key] for key, _ in cards} == dict(cards) and header["METHOD"] == "polynomial"


class TestDiffer:
    """Of a cube in C and others in G: refused, or rotated."""

    @pytest.fixture
    def cube(self, maps):
        return write("cube.fits", maps, "C")

    @pytest.fixture
    def latitudes(self):
        """Those of the pixels in their own frame, and Galactic ones of those of the cube, by the angles."""
        lon, lat = hp.pix2ang(NSIDE, np.arange(N_PIX), lonlat=True)
        return np.abs(lat), np.abs(hp.Rotator(coord=["C", "G"])(lon, lat, lonlat=True)[1])

    @pytest.fixture
    def files(self, maps, latitudes):
        given = latitudes[0] > 20
        write("mask.fits", given.astype("f4"), "G")
        write("weights.fits", hp.reorder(latitudes[0], r2n=True), "G", nest=True)
        with h5py.File("flags.h5", "w") as file:
            file["sky/flags"] = (~given).astype("u1")
            file.attrs.update(order="RING", coordsys="G")
        write("truth.fits", maps, "G")

    @pytest.mark.parametrize("name", ["mask", "weights", "flags", "truth", "mocks"])
    def test_refused(self, name, cube, files):
        file = {"flags": "flags.h5", "mocks": "truth.fits"}.get(name, f"{name}.fits")
        common = ["--method", "pca", "-p", "n_sources=1", "--keep-peaks", "-o", "c.fits"]
        output = run("clean", cube, f"--{name}", file, *common, code=2).output
        said = f"{file} is Galactic (COORDSYS = G), that of the cube celestial"
        assert said in output and "--rotate" in output

    @pytest.mark.parametrize("nest", [False, True])
    def test_masks_weights_and_flags_are_rotated(self, nest, maps, latitudes, files):
        """The kept pixels are those of |b| > 20 deg, but for a pixel at the edge, of 7 deg."""
        given = np.array([hp.reorder(row, r2n=True) for row in maps]) if nest else maps
        write("n.fits", given, "C", nest=nest)
        cube = read_cube("n.fits", weights="weights.fits", flags="flags.h5", rotate=True)
        masked, galactic = read_cube("n.fits").masked("mask.fits", rotate=True), latitudes[1]
        sure = np.abs(galactic - 20) > 6
        assert sure.mean() > 0.7 and np.array_equal(masked.mask[sure], galactic[sure] > 20)
        assert "rotated from Galactic to celestial" in " ".join(masked.remarks)
        assert np.array_equal(cube.mask, masked.mask)
        assert np.abs(cube.weights - galactic[masked.mask]).max() < 6
        assert sum("rotated from Galactic to celestial" in remark for remark in cube.remarks) == 2

    def test_a_truth_is_rotated(self, cube, rng):
        """Maps of multipoles up to 2 nside, which healpy rotates as coefficients."""
        alms = [sphere.gaussian_alm(np.ones(2 * NSIDE + 1), rng) for _ in FREQS]
        write("t.fits", [hp.alm2map(alm, NSIDE) for alm in alms], "G")
        rotator = hp.Rotator(coord=["G", "C"])
        expected = [hp.alm2map(rotator.rotate_alm(alm), NSIDE) for alm in alms]
        truth = read_truth("t.fits", cube=read_cube(cube), rotate=True)
        assert np.std(truth.maps - expected) < 0.03 * np.std(expected)
        check_truth(read_cube(cube), truth)
        with pytest.raises(InputError, match="of the truth is Galactic"):
            check_truth(read_cube(cube), read_truth("t.fits"))

    def test_a_truth_of_a_part_of_the_sky(self, cube, maps):
        maps[:, :9] = hp.UNSEEN
        with pytest.raises(InputError, match="a part of the sky cannot be rotated"):
            read_truth(write("t.fits", maps, "G"), cube=read_cube(cube), rotate=True)

    def test_what_no_rotation_is_known_for(self, cube):
        write("m.fits", np.ones(N_PIX), "FK4")
        with pytest.raises(InputError, match="only G, C, E can be rotated"):
            read_cube(cube).masked("m.fits", rotate=True)

    def test_unknown_ones_are_said(self, cube, maps):
        """That of the cube counts for a mask that states none, and that of a mask for such a cube."""
        write("m.fits", np.ones(N_PIX), None)
        remarks = " ".join(read_cube(cube).masked("m.fits").remarks)
        assert "m.fits does not state its frame: assumed to be that of the cube, celestial" in remarks
        write("g.fits", np.ones(N_PIX), "G")
        masked = read_cube(write("none.fits", maps, None)).masked("g.fits")
        assert "the cube does not state its frame" in masked.remarks[0] and masked.layout.pixels.frame == "G"
        with pytest.raises(InputError, match="is celestial .* of the cube Galactic"):
            masked.masked(write("c.fits", np.ones(N_PIX), "C"))


class TestOfOneAnother:
    """A cube that states no frame has that of its truth or mocks, which may not differ from each other."""

    clean = ("--method", "pca", "-p", "n_sources=1", "--keep-peaks", "-o", "c.fits")

    def run(self, maps, *, truth=(), mocks=(), code=0):
        """``himap clean`` of a cube without a frame, with files of these frames and cards."""
        given = []
        for option, cards in (("--truth", truth), *(("--mocks", each) for each in mocks)):
            if cards:
                name = f"{len(given)}.fits"
                frame, *more = cards
                given += [option, write(name, maps / (2 + len(given)), frame, extra_header=more)]
        return run("clean", write("cube.fits", maps, None), *given, *self.clean, code=code).output

    @pytest.mark.parametrize(
        ("truth", "mocks", "message"),
        [
            ("G", ["C"], "that of 2.fits is celestial (COORDSYS = C), that of the cube Galactic"),
            ("G", ["E"], "that of 2.fits is ecliptic (COORDSYS = E), that of the cube Galactic"),
            ((), ["C", "G"], "that of 2.fits is Galactic"),
            ((), [(None, ("SPECSYS", "LSRK")), (None, ("SPECSYS", "CMB"))], "= LSRK, but has CMBDIPOL"),
        ],
    )
    def test_they_differ(self, truth, mocks, message, maps):
        assert message in self.run(maps, truth=truth, mocks=mocks, code=2)

    def test_the_cube_gets_what_its_truth_states(self, maps):
        output = self.run(maps, truth=("G", ("SPECSYS", "LSRK")))
        assert output.count("the cube does not state its frame: assumed to be that of 0.fits, Galactic.") == 1
        assert "spectral frame: assumed as that of 0.fits, LSRK" in output
        header = fits.getheader("c.fits", 1)
        assert (header["COORDSYS"], header["SPECSYS"]) == ("G", "LSRK")

    def test_what_states_none_is_said_once(self, maps):
        write("c.fits", maps, "G")
        given = [word for n in (1, 2) for word in ("--mocks", write(f"{n}.fits", maps / (2 + n), None))]
        given += ["--truth", write("t.fits", maps / 2, None)]
        output = run("clean", "c.fits", *given, *self.clean[:-1], "a.fits", code=0).output
        for name in ("1.fits", "2.fits", "t.fits"):
            assert output.count(f"{name} does not state its frame: assumed to be that of the cube") == 1

    def test_spectral_frames_of_weights(self, maps):
        write("a.fits", maps, "C", extra_header=[("SPECSYS", "TOPOCENT")])
        write("w.fits", np.ones_like(maps), "C", extra_header=[("SPECSYS", "LSRK")])
        with pytest.raises(InputError, match="w.fits must have the spectral frame .*TOPOCENT, but has LSRK"):
            read_cube("a.fits", weights="w.fits")


def test_pixels_in_another_frame():
    """The values of the pixels that healpy's angles say, for each pair of frames."""
    ids = np.arange(N_PIX)
    for one, other in ("CG", "GC", "EG", "CE"):
        theta, phi = hp.Rotator(coord=[one, other])(*hp.pix2ang(NSIDE, ids))
        assert np.array_equal(sphere.pixels_in_frame(NSIDE, one, other), hp.ang2pix(NSIDE, theta, phi))


@pytest.mark.parametrize(
    ("sky", "cards", "same"),
    [
        *(("SIN", cards, True) for cards in ({"RADESYS": "FK5"}, {"EQUINOX": 2000.0}, {})),
        ("CAR", {}, True),  # Galactic axes have no RADESYS
        ("SIN", {"EQUINOX": 1950.0}, False),
    ],
)
def test_a_mask_of_images_in_the_frame_of_the_cube_and_in_another(sky, cards, same, images):
    """ICRS and J2000 are a milliarcsecond apart."""
    cube = read_cube(write_image("a.fits", images, axes=(*SKY[sky], FREQ), RADESYS="ICRS"))
    write_image("m.fits", np.ones_like(images[0]), axes=SKY[sky], BUNIT="", **cards)
    if same:
        assert cube.masked("m.fits").mask.all()
    else:
        with pytest.raises(InputError, match="reproject"):
            cube.masked("m.fits")
