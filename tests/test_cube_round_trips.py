"""What is written of a cleaned cube is read again by himap, astropy, h5py and healpy, and means the same."""

import functools
import tempfile
import warnings
from pathlib import Path

import click
import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from astropy.utils.exceptions import AstropyWarning
from astropy.wcs import WCS
from click.testing import CliRunner
from cube_files import SKY, STOKES, header_of, write_hdf5, write_image
from hypothesis import example, given, settings
from hypothesis import strategies as st

from himap.app.cli.main import main
from himap.cubes import clean_cube, read_cube, save_cleaned
from himap.maps.frames import frame_of
from himap.maps.healpix_io import MILLIKELVIN, write_maps

NSIDE, N_CHANNELS, SHAPE = 4, 9, (5, 6)
N_PIX = 12 * NSIDE**2
FREQS = 950.1234567891 + 1.25 * np.arange(N_CHANNELS)
DOWN = FREQS[::-1]


def sky(n_pix, seed=5):
    """A power law and noise, mK, (9, n_pix) float32."""
    rng = np.random.default_rng(seed)
    amplitudes = 1e3 * np.exp(0.3 * rng.standard_normal(n_pix))
    maps = (FREQS / 950)[:, None] ** -2.7 * amplitudes + rng.standard_normal((N_CHANNELS, n_pix))
    return maps.astype(np.float32)


def write_images(path, *, first=0, n=N_CHANNELS, axes=SKY["SIN"], stokes=False, **cards):
    """`n` channels from the `first` on; of one channel the axis of frequency is of the header alone."""
    freq = ("FREQ", (950.1234567891 + 1.25 * first) * 1e6, 1.0, 1.25e6, "Hz")
    axes = (*axes, STOKES, freq) if stokes else (*axes, freq)
    maps = sky(30)[first : first + n].reshape(n, *SHAPE)
    maps = maps[0] if n == 1 else maps[:, None] if stokes else maps
    write_image(path, maps, axes=axes, WCSAXES=len(axes), **cards)


def write_turned(path):
    """HDF5 of (pixels, channels)."""
    with h5py.File(path, "w") as file:
        file["maps"] = sky(N_PIX).T / 1e3
        file["maps"].attrs.update(units="K", coordsys="C", ordering="NEST")
        file.create_dataset("nu", data=FREQS / 1e3).attrs["units"] = "GHz"


def write_folder(path):
    path.mkdir()
    for freq, row in zip(FREQS, sky(N_PIX), strict=True):
        hp.write_map(path / f"{freq:.10f}MHz.fits", row, column_units="mK", coord="C", dtype=np.float32)


def write_image_folder(path):
    path.mkdir()
    for n in range(N_CHANNELS):
        write_images(path / f"{n:02}.fits", first=n, n=1, SPECSYS="BARYCENT")


def write_with_beams(path):
    """A table of the beam of each channel, as of CASA."""
    write_images(path, CASAMBM=True)
    beams = fits.BinTableHDU.from_columns([fits.Column("BMAJ", "E", array=np.ones(9))], name="BEAMS")
    fits.append(path, beams.data, beams.header)


def write_packed(path):
    """Integers with BSCALE, BZERO and BLANK."""
    hdu = fits.ImageHDU(np.round(sky(30)).astype(np.int16).reshape(-1, *SHAPE))
    hdu.header.update(header_of((*SKY["CAR"], ("FREQ", DOWN[0] * 1e6, 1.0, -1.25e6, "Hz")), BUNIT="K"))
    hdu.data[:, 0, 0] = -99
    hdu.header["BLANK"] = -99
    hdu.writeto(path)
    with fits.open(path, mode="update", do_not_scale_image_data=True) as file:
        file[1].header.update(BSCALE=0.5, BZERO=100.0)


def write_blind(path):
    """A part of the sky, from which healpy takes the pixels of the first map alone; that sees none."""
    maps = sky(N_PIX).astype("f8")
    maps[0], maps[:, :90] = np.nan, np.nan
    names = [f"{freq!r} MHz" for freq in FREQS.tolist()]
    write_maps(path, maps, names=names, unit="mK", nested=False, partial=True)


def expected(kind):
    """The maps of a kind of file, mK, by ascending frequency; pixels that it has not are of no account."""
    if kind == "packed.fits":
        return 1e3 * (0.5 * np.round(sky(30)[::-1]) + 100)
    if kind == "a.h5":
        return hp.reorder(sky(N_PIX), n2r=True)
    if kind == "blind.fits":
        return sky(N_PIX)[1:]
    return sky(N_PIX if kind == "folder" else 30)


KINDS = {
    "a.h5": write_turned,
    "folder": write_folder,
    "stokes.fits": lambda path: write_images(path, stokes=True, axes=SKY["ZEA"]),
    "image_folder": write_image_folder,
    "beams.fits": write_with_beams,
    "packed.fits": write_packed,
    "blind.fits": write_blind,
}


def meaning(cube):
    """What gives the numbers of a `Cube` meaning."""
    pixels, layout = cube.layout.pixels, cube.layout
    order = pixels.order if pixels.whole_sky else pixels.celestial.to_header_string()
    return (str(pixels), order, pixels.frame, layout.unit, layout.spectral_frame)


def by_other_readers(path, layout):
    """The maps in a written file as astropy, h5py or healpy read them, (n_in_file, n_pix), in its unit."""
    if path.suffix == ".h5":
        with h5py.File(path) as file:
            assert file["residual"].attrs["unit"] == layout.unit
            assert file["freqs"][...] == pytest.approx(layout.freqs, rel=1e-12)
            return file["residual"][...].reshape(len(layout.freqs), -1)
    if layout.pixels.whole_sky:
        maps = hp.read_map(path, field=None, nest=None, dtype=None, partial=False)
        if layout.pixels.partial:
            header, (seen,) = fits.getheader(path, 1), np.nonzero((maps != hp.UNSEEN).any(axis=0))
            assert (header["INDXSCHM"], header["OBJECT"]) == ("EXPLICIT", "PARTIAL")
            assert np.array_equal(fits.getdata(path)["PIXEL"], seen)
            assert header["ORDERING"] == layout.pixels.order
        return np.where(maps == hp.UNSEEN, np.nan, maps)
    parts = []
    with fits.open(path) as file, warnings.catch_warnings(action="ignore", category=AstropyWarning):
        for hdu in (hdu for hdu in file if hdu.is_image and hdu.shape):
            wcs = WCS(hdu.header, fobj=file)
            wcs.pixel_shape = None
            line = wcs.sub([wcs.wcs.spec + 1])
            n = 1 if wcs.naxis > len(hdu.shape) else hdu.shape[wcs.naxis - 1 - wcs.wcs.spec]
            freqs = line.wcs_pix2world(np.arange(n), 0)[0]
            axis = wcs.naxis - 1 - wcs.wcs.spec
            data = np.moveaxis(hdu.data, axis, 0) if wcs.naxis == hdu.data.ndim else hdu.data
            parts.append((freqs / 1e6, data.reshape(n, -1)))
    freqs, maps = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    assert freqs == pytest.approx(layout.freqs, rel=1e-12)
    return maps


def check_written(cleaned, target):
    """What is written of a `CleanedCube` says to everyone what its cube does; gives the `Cube` in it."""
    save_cleaned(cleaned, target)
    again, cube, layout = read_cube(target), cleaned.cube, cleaned.cube.layout
    assert meaning(again) == meaning(cube)
    assert again.freqs == pytest.approx(cube.freqs, rel=1e-12)
    assert again.layout.freqs == pytest.approx(layout.freqs, rel=1e-12)
    assert np.array_equal(again.mask, cube.mask)
    close = {"rel": 1e-6, "abs": 1e-5}
    assert again.maps == pytest.approx(cleaned.residual, **close)
    places = layout.as_given(cleaned.residual, cube.mask).reshape(len(layout.freqs), -1)
    assert by_other_readers(target, layout) == pytest.approx(places, nan_ok=True, **close)
    return again


def check_round_trips(cube, target):
    """A `Cube` that is written, and one that is written of what was written, say the same."""
    again = check_written(clean_cube(cube, "pca", n_sources=1), target)
    last = check_written(clean_cube(again, "polynomial", order=1), target.with_name("d.fits"))
    assert meaning(last) == meaning(cube)


@pytest.mark.parametrize("ending", ["fits", "h5"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_was_written_is_read_again(kind, ending, tmp_path):
    path, target = tmp_path / kind, tmp_path / f"c.{ending}"
    KINDS[kind](path)
    cube = read_cube(path)
    assert cube.maps == pytest.approx(expected(kind)[:, cube.mask], rel=1e-6)
    check_round_trips(cube, target)
    if kind == "blind.fits":
        assert "1 of 9 channels have no data" in " ".join(read_cube(target).remarks)
    if kind == "beams.fits":
        assert "also contains BEAMS, which is copied but not used" in cube.remarks[0]
        assert ending == "h5" or fits.getdata(target, "BEAMS")["BMAJ"].tolist() == [1] * 9


FEW = settings(max_examples=8)
UNITS, ENDINGS = st.sampled_from([*MILLIKELVIN]), st.sampled_from(["fits", "h5"])
FRAMES = st.sampled_from(["G", "galactic", "C", "ICRS", "E", "FK4", None])
SPECTRAL = st.sampled_from([None, "TOPOCENT", "LSRK", "BARYCENT"])


def check_file(write, ending, expected, maps):
    """A file says what it was given, `expected` of `meaning`, with `maps` in mK; so does what is written."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.fits"
        write(path)
        cube = read_cube(path)
        assert meaning(cube)[2:] == expected
        assert cube.freqs == pytest.approx(FREQS, rel=1e-12) and cube.maps == pytest.approx(maps, rel=1e-6)
        check_round_trips(cube, path.with_name(f"c.{ending}"))


@FEW
@given(FRAMES, UNITS, SPECTRAL, ENDINGS, st.booleans(), st.booleans(), st.permutations(range(N_CHANNELS)))
@example("E", "mK", "LSRK", "fits", True, True, [*range(N_CHANNELS)])
@example("E", "mK", "LSRK", "h5", True, True, [*range(N_CHANNELS)])
def test_any_table_of_maps(frame, unit, spectral, ending, nest, partial, order):
    maps = sky(N_PIX)
    seen = np.arange(N_PIX) >= 9 * partial
    columns = np.where(seen, maps / MILLIKELVIN[unit], hp.UNSEEN)[order]
    columns = hp.reorder(columns, r2n=True) if nest else columns
    write = functools.partial(
        hp.write_map,
        m=columns,
        nest=nest,
        partial=partial,
        dtype=np.float64,
        column_units=unit,
        column_names=[f"{float(FREQS[n])!r} MHz" for n in order],
        coord=frame,
        extra_header=[("SPECSYS", spectral)] if spectral else [],
    )
    check_file(write, ending, (frame_of(frame), unit, spectral), maps[:, seen])


@FEW
@given(
    st.sampled_from([*SKY]),
    st.permutations(range(3)),
    st.integers(-5, 12),
    st.sampled_from([("Hz", 1e6), ("kHz", 1e3), ("MHz", 1.0), ("GHz", 1e-3)]),
    st.sampled_from([1, -1]),
    st.sampled_from(["f4", "f8", ">f4"]),
    UNITS,
    SPECTRAL,
    st.sampled_from(["ICRS", "FK5", "FK4"]),
    ENDINGS,
)
def test_any_image(projection, order, place, spelled, sign, dtype, unit, spectral, radesys, ending):
    (name, scale), step = spelled, 1.25 * sign
    first = FREQS[0] if sign > 0 else FREQS[-1]
    freq = ("FREQ", (first + step * (place - 1)) * scale, float(place), step * scale, name)
    axes = [(*SKY[projection], freq)[n] for n in order]  # in the order of FITS
    cube = sky(30)[::sign].reshape(-1, *SHAPE) / MILLIKELVIN[unit]
    array = cube.transpose([[2, 1, 0][n] for n in order[::-1]]).astype(dtype)
    more = {"BUNIT": unit, "RADESYS": radesys} | ({"SPECSYS": spectral} if spectral else {})
    frame = "G" if projection == "CAR" else frame_of(radesys)
    rows = order.index(0) > order.index(1)  # the sky comes transposed
    maps = sky(30).reshape(-1, *SHAPE)
    maps = (maps.transpose(0, 2, 1) if rows else maps).reshape(N_CHANNELS, -1)
    write = functools.partial(write_image, maps=array, axes=axes, **more)
    check_file(write, ending, (frame, unit, spectral), maps)


def test_as_many_channels_as_a_sphere_has_pixels(tmp_path, rng):
    """12 of them: the mixing matrix could be maps too, and is not read as these."""
    path = write_hdf5(tmp_path / "a.h5", 1e3 + rng.standard_normal((12, N_PIX)), 950 + np.arange(12.0))
    cleaned = clean_cube(read_cube(path), "pca", n_sources=1)
    save_cleaned(cleaned, tmp_path / "c.h5")
    assert np.allclose(read_cube(tmp_path / "c.h5").maps, cleaned.residual, atol=1e-6)


def test_rows_of_the_mixing_matrix_have_their_frequencies(tmp_path):
    """Of a file from the highest channel down whose third is dead, and so has no numbers."""
    maps = sky(N_PIX)
    maps[2] = 0
    cube = read_cube(write_hdf5(tmp_path / "a.h5", maps, freqs=DOWN, unit="mK", order="RING"))
    save_cleaned(clean_cube(cube, "pca", n_sources=1, peaks=False), tmp_path / "b.h5")
    with h5py.File(tmp_path / "b.h5") as file:
        assert np.array_equal(file["freqs"], DOWN) and np.isnan(file["mixing"][2])
        rows = np.delete(file["mixing"][:, 0], 2)[::-1]  # of a spectrum that falls with frequency
    cleaned = clean_cube(cube, "pca", n_sources=1, peaks=False)
    assert rows == pytest.approx(cleaned.separation.mixing[:, 0])


@pytest.mark.parametrize("card", [("ORDER", 3), ("NEST", "F"), ("FRAME", "LSRK"), ("FRAME", "C")])
def test_cards_that_say_something_else_elsewhere_are_no_attributes(tmp_path, card):
    """Of a HEALPix table in FITS, which does not state its frame, cleaned to HDF5."""
    path = tmp_path / "a.fits"
    hp.write_map(path, sky(N_PIX), column_units="mK", dtype=np.float32, extra_header=[card])
    cube = read_cube(path, freqs=FREQS)
    save_cleaned(clean_cube(cube, "pca", n_sources=1, peaks=False), tmp_path / "b.h5")
    again = read_cube(tmp_path / "b.h5", maps_name="residual")
    assert again.layout.pixels.frame is None and again.layout.pixels.nested is False


def test_what_is_done_is_kept_where_nobody_reads_what_is_printed(tmp_path, monkeypatch):
    for name, factor in (("a", 1), ("m", 1e-3)):
        write_hdf5(tmp_path / f"{name}.h5", factor * sky(N_PIX), freqs=FREQS, unit="mK", order="RING")
    echo = click.echo

    def gone(message=None, err=False, **more):
        if not err:
            raise BrokenPipeError
        echo(message, err=err, **more)

    monkeypatch.setattr(click, "echo", gone)
    words = ["--method", "pca", "-p", "n_sources=1", "--keep-peaks", "--mocks", tmp_path / "m.h5"]
    words = ["clean", tmp_path / "a.h5", *words, "-o", tmp_path / "b.h5"]
    assert CliRunner().invoke(main, [*map(str, words)]).exit_code
    assert (tmp_path / "b.h5").exists() and (tmp_path / "b.csv").exists()
