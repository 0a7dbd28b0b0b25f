"""HEALPix files in FITS: however written, the same maps and words come in; frequencies in names."""

import gzip

import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from hypothesis import given, settings
from hypothesis import strategies as st

from himap.core.errors import InputError
from himap.maps import healpix_io
from himap.maps.frames import is_nested
from himap.maps.healpix_io import (
    MILLIKELVIN,
    agreed,
    freq_in_header,
    freqs_in,
    read_maps,
    temperature_unit,
    write_maps,
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


def write_table(path, arrays, *, null=None, **cards):
    """A table of one map a column, with the cards of a header that healpy does not write."""
    columns = [
        fits.Column(f"C{n}", fits.column.NUMPY2FITS[array.dtype.str[1:]], null=null, array=array)
        for n, array in enumerate(arrays)
    ]
    table = fits.BinTableHDU.from_columns(columns)
    table.header.update({"PIXTYPE": "HEALPIX", "NSIDE": NSIDE, "ORDERING": "RING"} | cards)
    table.writeto(path)


class TestReading:
    @pytest.mark.parametrize("nest", [False, True])
    def test_many_columns(self, nest, maps, path):
        units, names = ["mK", "K_RJ", None], ["one", "two", "three"]
        write(path, maps, nest=nest, coord="G", column_names=names, column_units=units)
        file = read_maps(path)
        assert np.array_equal(file.maps, maps) and file.maps.dtype == np.float32
        assert file.names == ("one", "two", "three") and file.units == ("mK", "K_RJ", None)
        assert (file.nested, file.frame, file.partial) == (nest, "G", False)
        assert file.header["NSIDE"] == NSIDE

    def test_one_column_of_many(self, maps, path):
        write(path, maps, column_units=["K", "mK", "mK"])
        file = read_maps(path, n_maps=1)
        assert np.array_equal(file.maps, maps[:1]) and file.units == ("K",)

    def test_double_precision_and_compressed(self, rng, path):
        pixels = rng.standard_normal(N_PIX)
        write(path, pixels, dtype=np.float64)
        (path.parent / "maps.fits.gz").write_bytes(gzip.compress(path.read_bytes()))
        file = read_maps(path.parent / "maps.fits.gz")
        assert np.array_equal(file.maps, [pixels]) and file.maps.dtype == np.float64

    def test_what_is_not_told_is_none(self, maps, path):
        write(path, maps)
        with fits.open(path, mode="update") as file:
            del file[1].header["ORDERING"]
        file = read_maps(path)
        assert file.nested is None and file.frame is None
        assert file.units == (None, None, None)

    @pytest.mark.parametrize("told", [("INDXSCHM", "OBJECT"), ("INDXSCHM",), ("OBJECT",)])
    def test_a_part_of_the_sky(self, told, maps, path):
        """The first column has the pixels: units and names are those of the next."""
        maps[:, 1000:] = hp.UNSEEN
        write(path, maps, partial=True, column_units="mK", column_names=["a", "b", "c"])
        with fits.open(path, mode="update") as file:
            for key in {"INDXSCHM", "OBJECT"} - set(told):
                del file[1].header[key]
        file = read_maps(path)
        assert file.partial and file.units == ("mK",) * 3 and file.names == ("a", "b", "c")
        assert np.array_equal(file.maps[:, :1000], maps[:, :1000]) and np.isnan(file.maps[:, 1000:]).all()

    @pytest.mark.parametrize("dtype", [np.float32, np.float64])
    def test_bad_data(self, dtype, maps, path):
        """A number that float32 does not hold exactly, beside UNSEEN and infinity."""
        pixels = maps.astype(dtype)
        pixels[0, :3] = -999.9, hp.UNSEEN, np.inf
        write_table(path, pixels, BAD_DATA=-999.9)
        found = read_maps(path).maps
        assert np.isnan(found).sum() == 2 and np.isnan(found[0, :2]).all() and np.isinf(found[0, 2])
        assert np.array_equal(found[:, 3:], pixels[:, 3:])

    @pytest.mark.parametrize("null", [None, -5])
    def test_integers(self, null, path):
        whole = np.arange(-10, N_PIX - 10, dtype=np.int32) + 2**25 * np.array([[0], [1]], dtype=np.int32)
        write_table(path, whole, null=null)
        expected = np.where(whole == -5, np.nan if null else -5, whole)
        assert np.array_equal(read_maps(path).maps, expected, equal_nan=True)

    @pytest.mark.parametrize("size", [0, 3000, 9000])
    def test_a_damaged_file(self, size, maps, path):
        write(path, maps)
        path.write_bytes(path.read_bytes()[:size])
        with pytest.raises(InputError, match=r"maps.fits(: there is no table| cannot be read as HEALPix)"):
            read_maps(path)

    def test_an_order_or_a_number_of_pixels_that_is_none(self, maps, path):
        write_table(path, maps, ORDERING="SPIRAL")
        with pytest.raises(InputError, match=r"ORDERING in .*maps.fits must be RING or NESTED, got 'SPIRAL'"):
            read_maps(path)
        write(path, np.ones(12 * 6**2))
        with pytest.raises(InputError, match="nside a power of two; got 432 pixels"):
            read_maps(path)


class TestWriting:
    @pytest.mark.parametrize("nested", [False, True])
    def test_it_comes_back(self, nested, maps, path):
        maps[1, 5:7] = np.nan, np.inf
        names = ["residual 950 MHz", "residual 960.5 MHz", "c"]
        write_maps(path, maps.copy(), names=names, unit="uK", nested=nested, cards=[("METHOD", "pca")])
        file = read_maps(path)
        maps[1, 6] = np.nan
        assert np.array_equal(file.maps, maps, equal_nan=True)
        assert file.names == tuple(names) and file.units == ("uK",) * 3
        assert file.nested == nested and file.header["METHOD"] == "pca"
        assert (hp.read_map(path, field=1, nest=None, dtype=None)[5:7] == np.float32(hp.UNSEEN)).all()


class TestOrder:
    def test_words(self):
        words = {"RING": False, " ring": False, "NESTED": True, "nest": True, None: None}
        assert {text: is_nested(text) for text in words} == words
        for text in ("", "SPIRAL", "NESTLE"):
            with pytest.raises(InputError, match="the order of pixels must be RING or NESTED"):
                is_nested(text)

    def test_to_ring(self, rng):
        ring = rng.standard_normal(N_PIX)
        assert np.array_equal(healpix_io.to_ring(hp.reorder(ring, r2n=True)), ring)


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

    @pytest.mark.parametrize("text", ["K_CMB", "Jy", "MJy/sr", "nK", "RJ", "K K", "mK_RJ_RJ", None, "", " "])
    def test_others_are_refused(self, text):
        said = f"got TUNIT1 {text!r}" if text and text.strip() else "got no TUNIT1"
        with pytest.raises(InputError, match=f"brightness temperatures .*{said}"):
            temperature_unit(text, "TUNIT1")


@pytest.mark.parametrize(
    ("name", "freq"),
    [
        ("map_950.5MHz.fits", 950.5),
        ("950MHz.fits", 950),
        ("residual 1020.25 MHz", 1020.25),
        ("T_0.95GHz_nside64.fits", 950),
        ("map-950-mhz.fits", 950),
        ("map_950_MHz", 950),
        ("bw20MHz_900MHz.fits", 900),  # 20 does not stand by itself
        ("ch003_900MHz.fits", 900),
        ("nside64_900MHz_v2.fits", 900),
        ("1420.40575MHz", 1420.40575),
    ],
)
def test_one_number_by_itself(name, freq):
    (stated,) = freqs_in(name)
    assert stated.freq == pytest.approx(freq, rel=1e-12)


QUICK = settings(deadline=None, derandomize=True, database=None)
WORDS = st.sampled_from(["map", "nside64", "T", "residual", "v2", ""])


@QUICK
@given(st.decimals(1, 99_999, places=3), WORDS, WORDS, st.sampled_from("_-. "))
def test_any_decimal_between_separators(number, before, after, separator):
    separator = "_" if separator == "." and not before else separator
    parts = [part for part in (before, f"{number}MHz", after) if part]
    expected = [float(number)] if separator != "." or not before else []  # T.950MHz may be 0.950
    assert [stated.freq for stated in freqs_in(separator.join(parts))] == pytest.approx(expected)


@QUICK
@given(st.text(max_size=40), st.text(max_size=40))
def test_any_text_is_read(before, after):
    assert all(stated.freq >= 0 for stated in freqs_in(f"{before}950MHz{after}"))


@pytest.mark.parametrize(
    "name",
    [
        "map_971p137MHz.fits",
        "map_900_11MHz.fits",
        "900-910MHz.fits",
        "900 - 910 MHz",
        "900.0_910.0MHz",
        "1,20.5 MHz",
        "900,5MHz",
        "map_.9GHz",
        "1.4e3MHz",
        "900MHzish",
        "900MHz5",
        "900kHz",
        "900 Hz",
        "003_900MHz.fits",  # 3.900?
        "MHz",
        "map_950",
    ],
)
def test_no_number_by_itself(name):
    assert freqs_in(name) == []


def test_two_numbers_are_two():
    for name in ("bw_20MHz_900MHz", "900MHz-910MHz", "900MHz_0.9GHz", "900 MHz of 20 MHz"):
        assert len(freqs_in(name)) == 2


class TestHeaders:
    @pytest.mark.parametrize(
        ("name", "header", "freq"),
        [
            ("950MHz", None, 950),
            ("950MHz", 950.0, 950),
            ("950.5MHz", 950.49, 950.49),  # the header has more digits
            ("950MHz", 9.504e8, 950.4),
            ("30GHz", 30.0, 30_000),
            ("0.95GHz", 948.0, 948),
        ],
    )
    def test_they_agree_to_the_digits_of_the_name(self, name, header, freq):
        assert agreed(freqs_in(name)[0], header, "a.fits") == pytest.approx(freq, rel=1e-12)

    @pytest.mark.parametrize(("name", "header"), [("950MHz", 951.0), ("950.5MHz", 950.0), ("30GHz", 31.0)])
    def test_they_contradict_each_other(self, name, header):
        with pytest.raises(InputError, match=r"the name of a.fits says .* MHz, and FREQ"):
            agreed(freqs_in(name)[0], header, "a.fits")

    def test_what_is_no_number(self):
        assert freq_in_header({}, "a.fits") is None and freq_in_header({"FREQ": 950}, "a.fits") == 950
        for value in ("950 MHz", True, float("inf")):
            with pytest.raises(InputError, match="must be a number of MHz, got .* in a.fits"):
                freq_in_header({"FREQ": value}, "a.fits")
