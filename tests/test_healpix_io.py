"""HEALPix files in FITS: however written, the same maps and words come in; frequencies in names."""

import gzip

import healpy as hp
import numpy as np
import pytest
from astropy.io import fits

from himap.core.errors import InputError
from himap.maps.frames import is_nested
from himap.maps.healpix_io import (
    MILLIKELVIN,
    agreed,
    freq_in_header,
    freqs_in,
    read_maps,
    temperature_unit,
)

NSIDE = 16
N_PIX = 12 * NSIDE**2


@pytest.fixture
def maps(rng):
    return rng.standard_normal((3, N_PIX)).astype(np.float32)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "maps.fits"


def write(path, maps, **options):
    """By healpy, so that nothing here reads only what himap wrote."""
    hp.write_map(path, maps, **{"dtype": np.float32, "overwrite": True} | options)


def write_table(path, arrays, *, form=None, bzero=None, **cards):
    """A table of one map a column, with the cards of a header that healpy does not write."""
    columns = [
        fits.Column(f"C{n}", form or fits.column.NUMPY2FITS[array.dtype.str[1:]], bzero=bzero, array=array)
        for n, array in enumerate(arrays)
    ]
    table = fits.BinTableHDU.from_columns(columns)
    table.header.update({"PIXTYPE": "HEALPIX", "NSIDE": NSIDE, "ORDERING": "RING"} | cards)
    table.writeto(path)


class TestReading:
    def test_words_of_columns(self, maps, path):
        """Of some columns, or of all; what a header does not say is None."""
        units = ["mK", "K_RJ", None]
        write(path, maps, nest=True, coord="G", column_names=["one", "two", "three"], column_units=units)
        file = read_maps(path)
        assert np.array_equal(file.maps, maps) and file.maps.dtype == np.float32
        assert file.names == ("one", "two", "three") and file.units == ("mK", "K_RJ", None)
        assert (file.nested, file.frame, file.partial, file.header["NSIDE"]) == (True, "G", False, NSIDE)
        write_table(path.with_name("b.fits"), maps, ORDERING="")
        file = read_maps(path.with_name("b.fits"), n_maps=1)
        assert np.array_equal(file.maps, maps[:1])
        assert (file.nested, file.frame, file.units) == (None, None, (None,))

    def test_double_precision_and_compressed(self, rng, path):
        pixels = rng.standard_normal(N_PIX)
        write(path, pixels, dtype=np.float64)
        (path.parent / "maps.fits.gz").write_bytes(gzip.compress(path.read_bytes()))
        file = read_maps(path.parent / "maps.fits.gz")
        assert np.array_equal(file.maps, [pixels]) and file.maps.dtype == np.float64

    @pytest.mark.parametrize("stated", [("INDXSCHM",), ("OBJECT",)])
    def test_a_part_of_the_sky(self, stated, maps, path):
        """The first column has the pixels: units and names are those of the next."""
        maps[:, 1000:] = hp.UNSEEN
        write(path, maps, partial=True, column_units="mK", column_names=["a", "b", "c"])
        with fits.open(path, mode="update") as file:
            for key in {"INDXSCHM", "OBJECT"} - set(stated):
                del file[1].header[key]
        file = read_maps(path)
        assert file.partial and file.units == ("mK",) * 3 and file.names == ("a", "b", "c")
        assert np.array_equal(file.maps[:, :1000], maps[:, :1000]) and np.isnan(file.maps[:, 1000:]).all()

    @pytest.mark.parametrize("dtypes", ["ff", "dd", "fd"])
    def test_bad_data(self, dtypes, maps, path):
        """A number that float32 does not hold exactly, UNSEEN and infinity; in columns of two precisions."""
        columns = [row.astype(dtype) for row, dtype in zip(maps, dtypes, strict=False)]
        for column in columns:
            column[:3] = -999.9, hp.UNSEEN, np.inf
        write_table(path, columns, BAD_DATA=-999.9)
        found = read_maps(path).maps
        assert np.isnan(found).sum() == 4 and np.isnan(found[:, :2]).all() and np.isinf(found[:, 2]).all()
        assert np.array_equal(found[:, 3:], maps[:2, 3:])

    @pytest.mark.parametrize("null", [None, -5])
    def test_integers(self, null, path):
        numbers = np.arange(-10, N_PIX - 10, dtype=np.int32) + 2**25 * np.array([[0], [1]], dtype=np.int32)
        write_table(path, numbers, **({"TNULL1": null, "TNULL2": null} if null else {}))
        expected = np.where(numbers == -5, np.nan if null else -5, numbers)
        assert np.array_equal(read_maps(path).maps, expected, equal_nan=True)

    def test_null_is_compared_before_scaling(self, path):
        whole = np.arange(N_PIX, dtype=np.int16)
        write_table(path, [whole], TNULL1=8, TSCAL1=0.5, TZERO1=3.5)
        expected = np.where(whole == 8, np.nan, 0.5 * whole + 3.5)  # which is 8 for another one
        assert np.array_equal(read_maps(path).maps[0], expected, equal_nan=True)

    def test_unseen_is_looked_for_before_scaling(self, maps, path):
        column = maps[0].astype(np.float32)
        column[:3] = hp.UNSEEN
        write_table(path, [column], TSCAL1=1000)
        found = read_maps(path).maps[0]
        assert np.isnan(found[:3]).all() and found[3:] == pytest.approx(1000 * column[3:])

    def test_unsigned_integers_and_many_pixels_a_row(self, maps, path):
        whole = np.arange(N_PIX, dtype=np.uint16) + 40_000
        write_table(path, [whole], form="I", bzero=32768)
        assert np.array_equal(read_maps(path).maps[0], whole)
        write_table(path.with_name("b.fits"), [maps[0].reshape(-1, 64)], form="64E")
        assert np.array_equal(read_maps(path.with_name("b.fits")).maps[0], maps[0])


def test_words_for_the_order_of_pixels():
    words = {"RING": False, " ring": False, "NESTED": True, "nest": True, None: None}
    assert {text: is_nested(text) for text in words} == words


class TestUnits:
    @pytest.mark.parametrize(
        ("name", "factor", "spellings"),
        [
            ("K", 1e3, ["K", "k", "Kelvin", "K_RJ", "K_{RJ}", "K (RJ)", "KRJ", "K (Tmb)", "K_Tb"]),
            ("mK", 1, ["mK", "MK", " mk ", "millikelvin", "mK_RJ", "mK RJ", "mK Tmb"]),
            ("uK", 1e-3, ["uK", "\u00b5K", "\u03bcK", "microKelvin", "uK_RJ", "\u03bcK_RJ"]),
        ],
    )
    def test_spellings(self, name, factor, spellings):
        assert {temperature_unit(text) for text in spellings} == {name}
        assert MILLIKELVIN[name] == factor


@pytest.mark.parametrize(
    ("names", "freqs"),
    [
        (["map_950.5MHz.fits"], [950.5]),
        (["950MHz.fits", "T_0.95GHz_nside64.fits", "map-950-mhz.fits", "map_950_MHz"], [950]),
        (["bw20MHz_900MHz.fits", "ch003_900MHz.fits", "nside64_900MHz_v2.fits"], [900]),
        (["residual 1020.25 MHz"], [1020.25]),
        (["1420.40575MHz"], [1420.40575]),
        (["f950MHz", "T_freq950.0MHz.fits", "nu0.95GHz"], [950]),
        (["bw_20MHz_900MHz", "900 MHz of 20 MHz"], {20, 900}),
        (["900MHz-910MHz"], [900, 910]),
        (["map_971p137MHz.fits", "map_.9GHz", "1.4e3MHz", "1,20.5 MHz", "900,5MHz"], []),  # other decimals
        (["900-910MHz.fits", "900 - 910 MHz", "900.0_910.0MHz"], []),  # a range
        (["map900-910MHz.fits", "T900 - 910 MHz"], []),
        (["map_900_11MHz.fits", "003_900MHz.fits"], []),  # 3.900?
        (["900MHzish", "900MHz5", "900kHz", "900 Hz", "MHz", "map_950"], []),
    ],
)
def test_frequencies_in_names(names, freqs):
    for name in names:
        assert sorted(stated.freq for stated in freqs_in(name)) == pytest.approx(sorted(freqs), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "header", "freq"),
    [
        ("950MHz", None, 950),
        ("950MHz", 950.0, 950),
        ("950.5MHz", 950.49, 950.49),  # the header has more digits
        ("950MHz", 9.504e8, 950.4),
        ("30GHz", 30.0, 30_000),
        ("0.95GHz", 948.0, 948),
        ("950MHz", 951.0, "contradict"),
        ("950.5MHz", 950.0, "contradict"),
        ("30GHz", 31.0, "contradict"),
    ],
)
def test_names_and_headers_agree_to_the_digits_of_the_name(name, header, freq):
    if freq == "contradict":
        with pytest.raises(InputError, match=r"the name of a.fits says .* MHz, and FREQ"):
            agreed(freqs_in(name)[0], header, "a.fits")
    else:
        assert agreed(freqs_in(name)[0], header, "a.fits") == pytest.approx(freq, rel=1e-12)


def test_a_frequency_in_a_header():
    assert freq_in_header({}, "a.fits") is None and freq_in_header({"FREQ": 950}, "a.fits") == 950
