"""What is written of a cleaned cube is read again by himap, astropy, h5py and healpy, and means the same."""

import warnings
from pathlib import Path

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from astropy.utils.exceptions import AstropyWarning
from astropy.wcs import WCS
from image_files import SKY, STOKES, header_of

from himap.cubes import clean_cube, read_cube, save_cleaned

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


def write_images(path, *, first=0, n=N_CHANNELS, step=1.25, axes=SKY["SIN"], stokes=False, **cards):
    """`n` channels from the `first` on; of one channel the axis of frequency is of the header alone."""
    freq = ("FREQ", (950.1234567891 + 1.25 * first) * 1e6, 1.0, step * 1e6, "Hz")
    if step < 0:
        freq = ("FREQ", FREQS[-1] * 1e6, 1.0, step * 1e6, "Hz")
    maps = sky(30)[:: -1 if step < 0 else 1][first : first + n].reshape(n, *SHAPE)
    maps = maps[0] if n == 1 else maps[:, None] if stokes else maps
    axes = (*axes, STOKES, freq) if stokes else (*axes, freq)
    header = header_of(axes, BUNIT="mK", **cards)
    if n == 1:
        header["WCSAXES"] = 3
    fits.PrimaryHDU(maps, header).writeto(path)


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("maps", data=sky(N_PIX).T / 1e3).attrs.update(
            units="K", coordsys="C", ordering="NEST"
        )
        file.create_dataset("nu", data=FREQS / 1e3).attrs["units"] = "GHz"


def write_table(path, **options):
    names = [f"T {freq:.10f} MHz" for freq in DOWN]
    options = {"column_names": names, "column_units": "uK", "coord": "G", "dtype": np.float64} | options
    hp.write_map(path, 1e3 * sky(N_PIX)[::-1].astype(float), **options)


def write_partial(path):
    maps = sky(N_PIX)
    maps[:, :7] = hp.UNSEEN
    names = [f"T {freq:.10f} MHz" for freq in FREQS]
    cards = [("SPECSYS", "LSRK")]
    options = {"column_names": names, "column_units": "mK", "coord": "E", "extra_header": cards}
    hp.write_map(path, maps, nest=True, partial=True, dtype=np.float32, **options)


def write_folder(path):
    path.mkdir()
    for freq, row in zip(FREQS, sky(N_PIX), strict=True):
        hp.write_map(path / f"{freq:.10f}MHz.fits", row, column_units="mK", coord="C", dtype=np.float32)


def write_image_folder(path):
    path.mkdir()
    for n in range(N_CHANNELS):
        write_images(path / f"{n:02}.fits", first=n, n=1)


def write_ranges(path):
    path.mkdir()
    write_images(path / "b.fits", n=4, SPECSYS="BARYCENT")
    write_images(path / "a.fits", first=4, n=5, SPECSYS="BARYCENT")


def write_tabulated(path):
    """Uneven channels, whose frequencies are in a table (-TAB), and the table of their beams, as of CASA."""
    freqs = 1e6 * (FREQS + 0.1 * np.arange(N_CHANNELS) ** 2)
    header = header_of((*SKY["SIN"], ("FREQ-TAB", 1.0, 1.0, 1.0, "Hz")), BUNIT="mK", CASAMBM=True)
    header.update(PS3_0="WCS-TABLE", PS3_1="COORDS", PV3_1=1, PV3_2=1, PV3_3=1)
    values = fits.Column("COORDS", f"{N_CHANNELS}D", dim=f"(1,{N_CHANNELS})", array=freqs.reshape(1, -1, 1))
    table = fits.BinTableHDU.from_columns([values], name="WCS-TABLE")
    beams = fits.BinTableHDU.from_columns([fits.Column("BMAJ", "E", array=np.ones(9))], name="BEAMS")
    fits.HDUList([fits.PrimaryHDU(sky(30).reshape(-1, *SHAPE), header), table, beams]).writeto(path)


def write_packed(path):
    """Integers with BSCALE, BZERO and BLANK, compressed by tiles."""
    hdu = fits.ImageHDU(np.round(sky(30)).astype(np.int16).reshape(-1, *SHAPE))
    hdu.header.update(header_of((*SKY["CAR"], ("FREQ", DOWN[0] * 1e6, 1.0, -1.25e6, "Hz")), BUNIT="K"))
    hdu.data[:, 0, 0] = -99
    hdu.header.update(BSCALE=0.5, BZERO=100.0, BLANK=-99)
    hdu.writeto(path)


KINDS = {
    "a.h5": write_hdf5,
    "table.fits": write_table,
    "partial.fits": write_partial,
    "folder": write_folder,
    "images.fits": write_images,
    "down.fits": lambda path: write_images(path, step=-1.25, SPECSYS="TOPOCENT", RADESYS="FK5"),
    "stokes.fits": lambda path: write_images(path, stokes=True, axes=SKY["ZEA"]),
    "image_folder": write_image_folder,
    "ranges": write_ranges,
    "tabulated.fits": write_tabulated,
    "packed.fits": write_packed,
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
        return np.where(maps == hp.UNSEEN, np.nan, maps)
    parts = []
    with fits.open(path) as file, warnings.catch_warnings(action="ignore", category=AstropyWarning):
        for hdu in (hdu for hdu in file if hdu.is_image and hdu.shape):
            wcs = WCS(hdu.header, fobj=file)
            wcs.pixel_shape = None
            line = wcs.sub([wcs.wcs.spec + 1])
            n = 1 if wcs.naxis > len(hdu.shape) else hdu.shape[wcs.naxis - 1 - wcs.wcs.spec]
            freqs = line.wcs_pix2world(np.arange(n), 0)[0]
            parts.append((freqs / 1e6, hdu.data.reshape(n, -1)))
    freqs, maps = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    assert freqs == pytest.approx(layout.freqs, rel=1e-12)
    return maps


def check_written(path, cube, cleaned, target):
    """`target`, written of a cube in `path`, says to everyone what the cube does."""
    again, layout = read_cube(target), cube.layout
    assert meaning(again) == meaning(cube)
    assert again.freqs == pytest.approx(cube.freqs, rel=1e-12)
    assert again.layout.freqs == pytest.approx(layout.freqs, rel=1e-12)
    assert np.array_equal(again.mask, cube.mask)
    close = {"rel": 1e-6, "abs": 1e-5}
    assert again.maps == pytest.approx(cleaned.residual, **close)
    places = layout.as_given(cleaned.residual, cube.mask).reshape(len(layout.freqs), -1)
    assert by_other_readers(Path(target), layout) == pytest.approx(places, nan_ok=True, **close)


@pytest.mark.parametrize("ending", ["fits", "h5"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_was_written_is_read_again(kind, ending, tmp_path):
    path, target = tmp_path / kind, tmp_path / f"c.{ending}"
    KINDS[kind](path)
    cube = read_cube(path)
    cleaned = clean_cube(cube, "pca", n_sources=1)
    save_cleaned(cleaned, target)
    check_written(path, cube, cleaned, target)
    if kind == "tabulated.fits" and ending == "h5":  # uneven channels, that no axis of FITS states
        return
    second = clean_cube(read_cube(target), "polynomial", order=1)
    save_cleaned(second, tmp_path / "d.fits")
    check_written(target, read_cube(target), second, tmp_path / "d.fits")
    assert meaning(read_cube(tmp_path / "d.fits")) == meaning(cube)
