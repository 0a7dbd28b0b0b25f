"""What files say in the ways of other programs is honoured, and what was read from them is said."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from astropy.io import fits
from bad_inputs import FREQS, N_PIX, NSIDE, SAID, good_maps, write_fits, write_folder, write_hdf5
from conftest import little_room
from cube_files import FREQ, N_CHANNELS, SKY, header_of, power_law_images, run, write_image

from himap.core.errors import InputError
from himap.core.memory import LIMIT_VARIABLE
from himap.cubes import clean_cube, read_cube, save_cleaned
from himap.maps.healpix_io import read_maps

pytestmark = pytest.mark.usefixtures("no_pages", "here")


@pytest.fixture
def maps():
    return good_maps()


class TestHDF5:
    @pytest.mark.parametrize(
        ("options", "scale"),
        [
            *(
                ({"freqs_name": f"index_map/{name}", "more": {"freq_weights": np.ones(24)}}, 1)
                for name in ("freq", "Freqs", "frequency", "frequencies", "nu", "nus", "freq_mhz")
            ),
            ({"freqs_name": "nu_ghz", "freqs": FREQS / 1e3}, 1),
            ({"order_of_fit": 3, "unit_of_weights": "1/K"}, 1),
            ({"said": {"order": "RING"}, "units": np.bytes_("\u00b5K".encode("latin-1"))}, 1e3),
        ],
    )
    def test_names_of_frequencies_and_units(self, options, scale, maps):
        cube = read_cube(write_hdf5("a.h5", scale * maps, **options))
        assert cube.maps == pytest.approx(maps, rel=1e-6) and cube.freqs == pytest.approx(FREQS)
        assert cube.layout.freqs_from == f"the dataset {options.get('freqs_name', 'freqs')}"

    def test_frequencies_that_stand_there_twice(self):
        write_hdf5("a.h5", more={"sky/nu": FREQS})
        assert np.array_equal(read_cube("a.h5").freqs, FREQS)
        with h5py.File("a.h5", "a") as file:
            file["sky/nu"][0] += 1
        assert read_cube("a.h5", freqs_name="sky/nu").freqs[0] == FREQS[0] + 1

    @pytest.mark.parametrize(
        ("value", "said"),
        [
            *((value, {"_FillValue": value}) for value in (-999.9, 1e20, 0.0)),
            *((value, {"missing_value": [value, -1.0]}) for value in (-999.9, 1e20, 0.0)),
            *((value, {"valid_range": [-500.0, 1e19]}) for value in (-999.9, 1e20)),
            (-999.9, {"valid_min": -500.0}),
            (1e20, {"valid_max": 1e19}),
        ],
    )
    def test_missing_values(self, value, said, maps):
        maps[:, :7] = value
        cube = read_cube(write_hdf5("a.h5", maps, **said))
        assert not cube.mask[:7].any() and cube.mask[7:].all() and np.array_equal(cube.maps, maps[:, 7:])

    def test_packed_integers(self, maps):
        """As netCDF packs: the missing value is compared before the scale is applied."""
        packed = np.round((maps - 5000) / 0.5).astype(np.int16)
        packed[:, 3] = -32768
        attributes = {"scale_factor": np.array([0.5]), "add_offset": 5000.0, "_FillValue": np.int16(-32768)}
        cube = read_cube(write_hdf5("a.h5", packed, **attributes))
        assert cube.maps == pytest.approx(np.delete(maps, 3, axis=1), abs=0.26) and not cube.mask[3]

    @pytest.mark.parametrize("key", ["_FillValue", "missing_value", "valid_range"])
    @pytest.mark.parametrize(("stored", "low", "last"), [
        ("i1", 0, 255), (">i2", 0, 65535), ("u1", -50, -128), ("<u2", -50, -32768),
    ])  # fmt: skip
    def test_integers_with_another_sign(self, stored, low, last, key, rng):
        """In netCDF what marks missing pixels is stored as these are: 255 without a sign as -1."""
        expected = rng.integers(low, low + 150, (24, N_PIX))
        marks = np.array([low, low + 149] if key == "valid_range" else last).astype(stored)
        expected[:, :3] = last
        sign = {"_Unsigned": "false" if low else "true"}
        cube = read_cube(write_hdf5("a.h5", expected.astype(stored), **sign, **{key: marks}))
        assert not cube.mask[:3].any() and np.array_equal(cube.maps, expected[:, 3:])

    def test_a_dataset_of_a_type_that_numpy_does_not_have(self, maps):
        write_hdf5("a.h5")
        with h5py.File("a.h5", "a") as file:
            h5py.h5d.create(file.id, b"when", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((24,)))
        assert np.array_equal(read_cube("a.h5").maps, maps)

    @pytest.mark.skipif(np.longdouble == np.float64, reason="no longer floats here")
    def test_longer_floats(self, maps):
        write_hdf5("a.h5", maps.astype(np.longdouble))
        np.save("a.npy", maps.astype(np.longdouble))
        for cube in (read_cube("a.h5"), read_cube("a.npy", freqs=FREQS, unit="mK", order="RING")):
            assert np.array_equal(cube.maps, maps) and cube.maps.dtype == np.float32


def test_another_table_of_fits_that_holds_no_map(maps):
    write_fits("a.fits", maps[:2], column_names=["900 MHz", "910 MHz"])
    beam = fits.BinTableHDU.from_columns([fits.Column("BL", "D", array=np.ones(50))])
    fits.append("a.fits", beam.data, beam.header)
    assert np.array_equal(read_cube("a.fits").maps, maps[:2])


class TestSaid:
    def test_what_was_taken(self):
        write_folder("folder", ["bw20MHz_900MHz", "bw20MHz_910MHz"])
        done = run("clean", "folder", "--method", "pca", "-p", "n_sources=1", "--keep-peaks", "-o", "c.h5")
        said = "2 channels from 900 to 910 MHz, given by the names of its files; maps of nside 4 in mK, "
        assert said + "RING, frame not stated." in done.output

    def test_remarks_on_truth_and_mocks(self, maps):
        write_hdf5("a.h5")
        np.save("t.npy", maps / 100)
        reading = ["--freqs", "nu.txt", "--unit", "mK", "--truth", "t.npy", "--mocks", "t.npy"]
        np.savetxt("nu.txt", FREQS)
        done = run("clean", "a.h5", *reading, "--method", "pca", "-p", "n_sources=2", "-o", "c.h5")
        for name in ("The truth", "t.npy"):
            assert f"{name}: the file does not state the pixel order: assumed to be RING" in done.output
        assert "the truth is not HI and noise alone" in done.output  # it has the foreground
        assert "times the power of the residual (median of bands)" in done.output

    @pytest.mark.parametrize(("unit", "said"), [("mK", False), ("K", True)])
    def test_a_sky_too_bright_for_its_unit(self, unit, said):
        cube = read_cube(write_hdf5("a.h5", said={"unit": unit, "order": "RING"}))
        assert any(f"is {unit} their unit?" in one for one in cube.remarks) == said

    def test_names_that_are_no_text(self):
        """Bytes that are no UTF-8: the cube is read and written, and its name shown in a way that can be."""
        write_hdf5("a.h5")
        name = os.fsdecode(b"c\xff\x1b.h5")
        done = run("clean", "a.h5", "--method", "pca", "-p", "n_sources=2", "-o", name)
        assert "c\\udcff\\x1b.h5" in done.output
        assert os.path.exists(name) and read_cube(name, maps_name="residual").freqs[0] == 950


class TestBright:
    """A sky of 2e5 K, as at 60 MHz: float32 rounds it by 4 mK."""

    @pytest.fixture
    def bright(self, rng):
        freqs = np.linspace(50, 70, 24)
        amplitudes = 1e8 * np.exp(0.5 * rng.standard_normal((2, N_PIX))) * [[1], [0.3]]
        sky = (freqs[:, None] / 60) ** np.array([-2.5, -2.1]) @ amplitudes
        return freqs, sky + rng.standard_normal((24, N_PIX))

    def read(self, freqs, maps, name="a.h5"):
        write_hdf5(name, maps, freqs=freqs)
        return read_cube(name)

    @pytest.mark.parametrize(("method", "peaks"), [("pca", False), ("pca", True), ("polynomial", False)])
    def test_nothing_is_rounded_away(self, bright, method, peaks):
        """Against singular values of the maps, or least squares of Legendre polynomials, in float64."""
        freqs, maps = bright
        cube, options = self.read(freqs, maps), {"n_sources": 2} if method == "pca" else {"order": 6}
        cleaned = clean_cube(cube, method, peaks=peaks, **options)
        lines, basis = maps, np.polynomial.legendre.legvander(np.linspace(-1, 1, len(freqs)), 6)
        if method == "pca":
            lines = maps - maps.mean(axis=1, keepdims=True)
            basis = np.linalg.svd(lines, full_matrices=False)[0][:, :2]
        assert cube.maps.dtype == np.float64
        assert cleaned.residual == pytest.approx(lines - basis @ np.linalg.lstsq(basis, lines)[0], abs=1e-4)

    @pytest.mark.parametrize("method", ["fastica", "gmca", "beam_subspace"])
    def test_by_other_methods(self, bright, method):
        """What is left is HI but for what two sources of 24 channels take; in float32 it is 4 mK off."""
        freqs, maps = bright
        cube = self.read(freqs, maps)
        left = clean_cube(cube, method, beams=np.ones((24, 3 * NSIDE)), n_sources=2).residual
        assert 0.8 < left.std() < 1.05

    @pytest.mark.parametrize("ending", ["h5", "NPY", "fits"])
    def test_what_is_written_adds_up(self, bright, ending):
        freqs, maps = bright
        cleaned = clean_cube(self.read(freqs, maps), "pca", n_sources=2)
        written = save_cleaned(cleaned, f"c.{ending}")
        if ending == "h5":
            with h5py.File("c.h5") as file:
                residual, foreground = file["residual"][...], file["foreground"][...]
        else:
            load = np.load if ending == "NPY" else lambda path: read_maps(path).maps
            residual, foreground = (load(path) for path in written[:2])
        assert residual.dtype == np.float32 and foreground.dtype == np.float64
        assert residual + foreground == pytest.approx(maps, abs=1e-6)

    def test_memory_is_not_doubled_where_it_is_not_needed(self, bright):
        freqs, maps = bright
        assert self.read(freqs, maps / 1e4).maps.dtype == np.float32
        assert self.read(freqs, maps.astype(np.float32)).maps.dtype == np.float32

    def test_equations_that_cannot_be_solved(self, bright, monkeypatch):
        from himap.removal.pca import PCA

        def fail(*_, **__):
            raise np.linalg.LinAlgError("Matrix is not positive definite")

        monkeypatch.setattr(PCA, "_separate", fail)
        with pytest.raises(InputError, match="pca cannot solve its equations for these maps"):
            clean_cube(self.read(*bright), "pca")


@pytest.mark.parametrize("name", ["a.h5", "a.npy", "a.fits", "folder"])
def test_cubes_that_do_not_fit(name, maps, monkeypatch):
    """Known before they are read: by shape, whatever they hold."""
    write_hdf5("a.h5")
    np.save("a.npy", maps)
    write_fits("a.fits", maps, column_names=[f"{freq:g} MHz" for freq in FREQS])
    write_folder("folder", ["900MHz", "910MHz"])
    reading = {"freqs": FREQS, "unit": "mK"} if name == "a.npy" else {}
    assert read_cube(name, **reading).nside == NSIDE
    monkeypatch.setenv(LIMIT_VARIABLE, "20 kB")
    with pytest.raises(InputError, match=rf"{name}.* needs about .* GB, and 2e-05 GB may be used"):
        read_cube(name, **reading)
    assert LIMIT_VARIABLE in run("suggest", name, *(["--unit", "mK"] if reading else []), code=2).output


@pytest.fixture
def locked(here):
    """A file and a folder that may not be read; root, who may read all, is another for a while."""
    write_hdf5("a.h5")
    write_folder("folder", ["900MHz"])
    for path in (here / "a.h5", here / "folder"):
        path.chmod(0)
    user = os.geteuid()
    if not user:
        os.seteuid(65534)
    yield
    os.seteuid(user)
    for path in (here / "a.h5", here / "folder"):
        path.chmod(0o700)


@pytest.mark.parametrize("name", ["a.h5", "folder"])
def test_files_and_folders_that_may_not_be_read(name, locked):
    with pytest.raises(InputError, match=rf"the (file|folder) {name} cannot be read \(Permission denied\)"):
        read_cube(name)


@pytest.mark.parametrize("name", ["c.h5", "c.npy", "c.fits"])
def test_where_the_room_for_a_file_ends_there_is_no_output(name, here):
    """And the one that did not fit is named."""
    write_hdf5("a.h5", np.tile(good_maps(), (1, 64)))
    before = sorted(here.iterdir())
    with little_room(100_000):
        done = run("clean", "a.h5", "--method", "pca", "-p", "n_sources=2", "-o", name, code=2)
    said = " ".join(done.output.split())
    assert f"{name} cannot be written" in said and "give another place" in said
    assert sorted(here.iterdir()) == before


def test_messages_are_short_and_plain():
    said = str(InputError("\x1b[2J" + "x" * 100_000 + " give another."))
    assert len(said) < 4100 and said.startswith("\\x1b[2J") and said.endswith("give another.")
    assert str(InputError("one\ntwo")) == "one two"


class TestValues:
    @pytest.mark.parametrize(("kind", "offset", "blank"), [("i2", 2**15, 32767), ("i4", 2**31, -(2**31))])
    def test_blank_of_unsigned_images(self, kind, offset, blank, rng):
        stored = rng.integers(7, 50, (N_CHANNELS, 12, 16)).astype(kind)
        stored[:, 0, :5] = blank
        fits.PrimaryHDU(stored, header_of((*SKY["SIN"], FREQ), BUNIT="mK")).writeto("k.fits")
        with fits.open("k.fits", mode="update", do_not_scale_image_data=True, uint=False) as file:
            file[0].header.update(BSCALE=1, BZERO=offset, BLANK=blank)
        cube = read_cube("k.fits")
        assert not cube.mask[:5].any() and cube.mask[5:].all()
        assert np.array_equal(cube.maps, stored.reshape(N_CHANNELS, -1)[:, 5:] + float(offset))

    def test_chunks_that_were_never_written_are_missing(self):
        with h5py.File("h.h5", "w") as file:
            maps = file.create_dataset("maps", (24, N_PIX), "f4", fillvalue=-999, chunks=(1, N_PIX // 2))
            maps[:, : N_PIX // 2] = good_maps()[:, : N_PIX // 2]
            file["freqs"] = FREQS
            file.attrs.update(SAID)
        assert np.array_equal(read_cube("h.h5").mask, np.arange(N_PIX) < N_PIX // 2)

    def test_other_stokes_parameters_are_said(self, rng):
        images = power_law_images(rng)[None]
        for value, said in ((1.0, False), (2.0, True)):
            axes = (*SKY["SIN"], FREQ, ("STOKES", value, 1.0, 1.0, ""))
            path = write_image(f"{value}.fits", images, axes=axes)
            assert ("has STOKES = 2; the intensity I is 1" in " ".join(read_cube(path).said)) == said

    def test_axes_of_images_in_hdf5_are_theirs(self, rng):
        write_image("i.fits", power_law_images(rng))
        save_cleaned(clean_cube(read_cube("i.fits"), "pca", n_sources=2, peaks=False), "i.h5")
        with pytest.raises(InputError, match="omit --axes and --freqs-name"):
            read_cube("i.h5", axes="ra,dec,freq")


@pytest.mark.parametrize("text", ["O'Brien", "12:34:56.7", "NaN"])
def test_cards_that_are_not_of_the_standard(text, rng):
    write_image("i.fits", power_law_images(rng), OBSERVER="abc")
    data = Path("i.fits").read_bytes()
    place = data.rindex(b"OBSERVER=")
    card = f"OBSERVER= {text}".encode().ljust(80)
    Path("i.fits").write_bytes(data[:place] + card + data[place + 80 :])
    save_cleaned(clean_cube(read_cube("i.fits"), "pca", n_sources=2, peaks=False), "o.fits")
    assert read_cube("o.fits").maps.shape[0] == N_CHANNELS


def test_a_text_with_a_null():
    write_hdf5("a.h5")
    with h5py.File("a.h5", "a") as file:
        file.attrs["note"] = np.bytes_(b"ab\0cd")
    save_cleaned(clean_cube(read_cube("a.h5"), "pca", n_sources=2, peaks=False), "o.h5")
    assert h5py.File("o.h5").attrs["method"] == "pca"
