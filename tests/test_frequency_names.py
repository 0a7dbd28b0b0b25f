"""Frequencies in names: what stands by itself is taken, and nothing else."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from himap.core.errors import InputError
from himap.maps.healpix_io import agreed, freq_in_header, freqs_in


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


@pytest.mark.parametrize("name", ["bw_20MHz_900MHz", "900MHz-910MHz", "900MHz_0.9GHz", "900 MHz of 20 MHz"])
def test_two_numbers_are_two(name):
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
