"""Numbers with a tolerance: what a notebook shows, and what a test takes for the same."""

import math

import pytest
from pages import cells

from himap.core.errors import InputError
from himap.figures.numbers import NOT_COMPARED, QUOTED, agree, one_run, quote, quoted, show, show_table


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


@pytest.mark.parametrize(
    "entry, text",
    [
        ((0.98712, 0.01), "x: 0.99†"),
        ((123456, 500, "K"), "x: 123,500† K"),
        ((1.8e9, 1e8), "x: 1.8\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10⁹†"),
        ((math.nan, 0.1), "x: nan†"),
        (7, "x: 7†"),
        (
            "in part (2 of 3)",
            "x: in\N{NO-BREAK SPACE}part\N{NO-BREAK SPACE}(2\N{NO-BREAK SPACE}of\N{NO-BREAK SPACE}3)†",
        ),
    ],
)
def test_what_is_of_one_run_says_so(entry, text):
    assert repr(show({"x": one_run(entry)})).splitlines() == [text, NOT_COMPARED]
    assert quoted(one_run(entry)) == quoted(entry)
    assert one_run({"x": {"y": entry}}) == {"x": {"y": one_run(entry)}}


def test_only_what_is_of_one_run_is_marked():
    table = show_table({"PCA": {"C": (0.987, 0.01)}, "SDecGMCA": one_run({"C": (0.987, 0.01)})})
    assert cells(table.html()) == [["", "C"], ["PCA", "0.987 ± 0.010"], ["SDecGMCA", "0.99†"]]
    assert f"<small>{NOT_COMPARED}</small>" in table.html() and repr(table).endswith(f"\n{NOT_COMPARED}")
    assert table.markdown()[-1] == NOT_COMPARED
    plain = show_table({"PCA": {"C": (0.987, 0.01)}})
    assert NOT_COMPARED not in f"{plain!r}{plain.html()}{plain.markdown()}"


@pytest.mark.parametrize("entry", [(1.0, 0), (1.0,), (1, 2, 3, 4), ("a", 1)])
def test_a_number_of_one_run_needs_a_tolerance_too(entry):
    with pytest.raises(InputError, match="x: "):
        show({"x": one_run(one_run(entry))})


RUNS = [(0.978, 0.01), (9e5, 0.01), (-3e-9, 1e-10), (2.5e8, 1e7), 12, "–"]
"""All have the form of a number, or say that there is none."""


@pytest.mark.parametrize("way", [lambda table: repr(table), lambda table: table.html()])
@pytest.mark.parametrize("mine", RUNS)
@pytest.mark.parametrize("theirs", RUNS)
def test_of_one_run_the_form_is_compared_and_not_the_number(way, mine, theirs):
    first, second = (
        way(show_table({"PCA": {"C": (0.5, 0.1), "n": 4}, "SDecGMCA": {"C": one_run(one), "n": 4}}))
        for one in (mine, theirs)
    )
    assert agree(first, second)


@pytest.mark.parametrize(
    "text, reference, same",
    [
        ("C: yes†", "C: does\N{NO-BREAK SPACE}not\N{NO-BREAK SPACE}apply†", True),
        ("C: 0.9†", "P: 0.9†", False),
        ("C: 0.9† mK", "C: 0.9† K", False),
        ("C: 0.9†", "C: 0.9", False),
        ("C: 0.9†", "C: 0.90 ± 0.10", False),
        ("C: 0.9†", "C: yes†", False),
        ("C: 0.9†", "C:", False),
        ("C: nan†", "C: 0.9†", False),
        ("C: inf†", "C: -inf†", False),
        ("C: nan†", "C: nan†", True),
        ("C: nan†", "C: yes†", False),
        ("C: 0.9†\nP: 3", "C: 1.1†\nP: 4", False),
        ("C: 0.9†\nP: 3.0 ± 0.1", "C: 1.1†\nP: 3.2 ± 0.1", False),
        ("C: 0.9†\nP: 3.0 ± 0.1", "C: 1.1†\nP: 3.1 ± 0.1", True),
        ("<td>0.9†</td><td>3</td>", "<td>1,000†</td><td>3</td>", True),
        ("<td>0.9†</td><td>3</td>", "<td>1,000†</td><td>4</td>", False),
        ("P  3", "P 3", False),  # without a number of one run nothing is loosened
    ],
)
def test_nothing_beside_a_number_of_one_run_is_loosened(text, reference, same):
    assert agree(text, reference) is same and agree(reference, text) is same


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
    quote(pca_run=one_run((95.2, 1, "%")), pca_settled=one_run("yes"))
    assert [data for data, _ in published[2:]] == [
        {text: "'95\\xa0%'", whole: "95† %"},
        {text: "'yes'", whole: "yes†"},
    ]


def test_numbers_for_prose_need_no_notebook(capsys):
    quote(pca_loss=(0.95, 0.001))
    assert capsys.readouterr() == ("", "")
