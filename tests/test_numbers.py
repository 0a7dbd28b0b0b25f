"""Numbers with a tolerance: what a notebook shows, and what a test takes for the same."""

import math

import pytest
from pages import cells

from himap.errors import InputError
from himap.figures.numbers import QUOTED, agree, quote, quoted, show, show_table


@pytest.mark.parametrize(
    "entry, text",
    [
        ((0.98712, 0.01), "x: 0.987 ± 0.010"),
        ((0.98712, 0.0999), "x: 0.99 ± 0.10"),
        ((-31.24, 5), "x: -31.2 ± 5.0"),
        ((123456, 500, "K"), "x: 123456 ± 500 K"),
        ((1.23456e-7, 1.2e-9), "x: 1.235e-07 ± 1.2e-09"),
        ((0, 1e-9), "x: 0.0e+00 ± 1.0e-09"),
        ((math.nan, 0.1), "x: nan ± 1.0e-01"),
        (125, "x: 125"),
        ("synthetic", "x: synthetic"),
    ],
)
def test_the_digits_follow_the_tolerance(entry, text):
    assert repr(show({"x": entry})) == text


def test_the_table_is_html():
    table = show({"10 < l": (1.0, 0.1, "mK"), "n": 3})._repr_html_()
    assert cells(table) == [["10 &lt; l", "1.00 ± 0.10", "mK"], ["n", "3", ""]]


@pytest.mark.parametrize("entry", [(1.0, 0), (1.0, -1), (1.0, math.nan), (1.0,), (1, 2, 3, 4), ("a", 1)])
def test_a_number_needs_a_tolerance(entry):
    with pytest.raises(InputError, match="x: "):
        show({"x": entry})


@pytest.mark.parametrize(
    "text, reference, same",
    [
        ("a 0.987 ± 0.010 b", "a 0.987 ± 0.010 b", True),
        ("a 0.997 ± 0.010 b", "a 0.987 ± 0.010 b", True),
        ("a 0.998 ± 0.010 b", "a 0.987 ± 0.010 b", False),
        ("a 0.987 ± 0.020 b", "a 0.987 ± 0.010 b", False),
        ("0.00956 ± 0.00096", "0.00955 ± 0.00095", True),  # a tenth of the value
        ("0.987 ± 0.012", "0.987 ± 0.010", False),
        ("b 0.987 ± 0.010 b", "a 0.987 ± 0.010 b", False),
        ("1.00e-07 ± 2.0e-09", "9.99e-08 ± 2.0e-09", True),
        ("-0.001 ± 0.010", "0.001 ± 0.010", True),
        ("1 ± 1, n = 4", "1 ± 1, n = 5", False),
        ("4", "5", False),
        ("1 ± 1, 2 ± 1", "1 ± 1", False),
        ("<td>1.0 ± 0.5</td><td>3</td>", "<td>1.3 ± 0.5</td><td>3</td>", True),
        ("nan ± 1.0e-01", "0.10 ± 0.10", False),
    ],
)
def test_texts_agree_within_the_stated_tolerance(text, reference, same):
    assert agree(text, reference) is same


def test_what_is_shown_agrees_with_what_is_shown_elsewhere():
    mine, theirs, off = (repr(show({"ratio": (value, 3e-4)})) for value in (0.99971, 0.99999, 1.00061))
    assert agree(mine, theirs) and not agree(mine, off)


def test_a_number_of_another_width_leaves_the_rest_of_the_html():
    mine, theirs = (
        show_table({"PCA": {"C": (value, 0.5)}, "GMCA": {"C": (1.0, 0.5)}}).html() for value in (9.9, 10.1)
    )
    assert mine != theirs and agree(mine, theirs)


def test_a_table_has_a_column_for_each_quantity():
    assert show_table({"PCA": {"C": 1}}, head="bands").header == ["bands", "C"]
    table = show_table({"PCA": {"C": (0.987, 0.01), "n": 3}, "<b>": {"P": (1.5, 0.1, "mK"), "C": (1, 0.01)}})
    lines = repr(table).splitlines()
    assert lines[0].split() == ["C", "n", "P"]
    assert lines[1].split("  ")[0] == "PCA" and "0.987 ± 0.010" in lines[1]
    assert lines[2].endswith("1.50 ± 0.10 mK") and len(lines) == 3
    head, *rows = cells(table._repr_html_())
    assert head == ["", "C", "n", "P"]
    assert rows == [["PCA", "0.987 ± 0.010", "3", ""], ["&lt;b&gt;", "1.000 ± 0.010", "", "1.50 ± 0.10 mK"]]
    with pytest.raises(InputError, match="PCA, C: the tolerance"):
        show_table({"PCA": {"C": (1, 0)}})


@pytest.mark.parametrize(
    "entry, text",
    [
        ((0.9573, 0.005), "0.957"),
        ((0.95, 0.001), "0.950"),
        ((95.2, 1, "%"), "95 %"),
        ((-0.0004, 0.01), "0.00"),
        ((-3.14159, 0.02, "mK"), "-3.14 mK"),
        ((142.3, 14), "140"),
        ((12345.6, 1), "12,346"),
        ((9999.6, 1), "10,000"),
        ((1.814e8, 2e7), "1.8 × 10⁸"),
        ((9.97e-7, 1e-9), "9.97 × 10⁻⁷"),
        ((9.996e-7, 1e-8), "1.00 × 10⁻⁶"),
        ((0, 1e-9), "0.00000"),
        ((math.inf, 1), "inf"),
        (27, "27"),
        ("PCA", "PCA"),
    ],
)
def test_prose_reads_the_digits_that_the_tolerance_is_sure_of(entry, text):
    assert quoted(entry).replace("\N{NO-BREAK SPACE}", " ") == text


def test_what_is_quoted_is_glued_and_not_seen(monkeypatch):
    published = []

    class Publisher:
        def publish(self, data, metadata):
            published.append((data, metadata["scrapbook"]))

    class Shell:
        display_pub = Publisher()

    monkeypatch.setattr("IPython.get_ipython", Shell)
    assert quote(pca_loss=(0.95, 0.001), pca_sky="synthetic") is None
    (number, about), (word, _) = published
    text, whole = QUOTED
    assert number == {text: "'0.950'", whole: "0.9500 ± 0.0010"} and word == {text: "'synthetic'"}
    assert about["name"] == "pca_loss" and all(kind.startswith(about["mime_prefix"]) for kind in QUOTED)
    with pytest.raises(InputError, match="pca_peak: the tolerance"):
        quote(pca_loss=(1, 0.1), pca_peak=(1, 0))
    assert len(published) == 2


def test_numbers_for_prose_need_no_notebook(capsys):
    quote(pca_loss=(0.95, 0.001))
    assert capsys.readouterr() == ("", "")
