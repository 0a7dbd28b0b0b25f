"""Numbers with a tolerance: what a notebook shows, and what a test takes for the same. And the one table."""

import math
import re
from itertools import product
from types import SimpleNamespace

import click
import pytest
from book_examples import cells

from himap.core.errors import InputError
from himap.figures import numbers
from himap.figures.numbers import agree, of_restarts, one_run, quote, quoted, show, show_table
from himap.figures.tables import HTML, Table

SPACE = "\N{NO-BREAK SPACE}"


@pytest.mark.parametrize(
    "entry, shown, prose",
    [
        ((0.98712, 0.01), "0.987 ± 0.010", "0.99"),
        ((0.98712, 0.0999), "0.99 ± 0.10", "1.0"),
        ((0.9573, 0.005), "0.9573 ± 0.0050", "0.957"),
        ((-0.0004, 0.01), "-0.000 ± 0.010", "0.00"),
        ((-3.14159, 0.02, "mK"), "-3.142 ± 0.020 mK", "-3.14 mK"),
        ((142.3, 14), "142 ± 14", "140"),
        ((123456, 500, "K"), "123456 ± 500 K", "123,500 K"),
        ((9999.6, 1), "9999.6 ± 1.0", "10,000"),
        ((1.814e8, 2e7), "1.81e+08 ± 2.0e+07", "1.8 × 10⁸"),
        ((1.23456e-7, 1.2e-9), "1.235e-07 ± 1.2e-09", "1.23 × 10⁻⁷"),
        ((9.996e-7, 1e-8), "1.00e-06 ± 1.0e-08", "1.00 × 10⁻⁶"),
        ((0, 1e-9), "0.0e+00 ± 1.0e-09", "0.00000"),
        ((math.nan, 0.1), "nan ± 1.0e-01", "nan"),
        (125, "125", "125"),
        ("in part (2 of 3)", "in part (2 of 3)", "in part (2 of 3)"),
    ],
)
def test_the_digits_follow_the_tolerance(entry, shown, prose):
    """In a table, in prose, and of one run, which says so."""
    assert repr(show({"x": entry})) == f"x: {shown}"
    assert quoted(entry).replace(SPACE, " ") == prose
    assert quoted(one_run(entry)) == quoted(entry)
    number, unit = quoted(entry), ""
    if isinstance(entry, tuple) and len(entry) == 3:
        number, unit = number.rsplit(SPACE, 1)
    line = f"x: {number.replace(' ', SPACE)}† {unit}".rstrip()
    assert repr(show({"x": one_run(entry)})).splitlines() == [line, numbers.NOT_COMPARED]
    assert one_run({"x": {"y": entry}}) == {"x": {"y": one_run(entry)}}


@pytest.mark.parametrize("entry", [(1.0, 0), (1.0, -1), (1.0, math.nan), (1.0,), (1, 2, 3, 4), ("a", 1)])
def test_a_number_needs_a_tolerance(entry):
    for one in (entry, one_run(one_run(entry))):
        with pytest.raises(InputError, match="PCA, x: "):
            show_table({"PCA": {"x": one}})


@pytest.mark.parametrize(
    "text, reference, same",
    [
        ("a 0.987 ± 0.010 b", "a 0.987 ± 0.010 b", True),
        ("a 0.997 ± 0.010 b", "a 0.987 ± 0.010 b", True),
        ("a 0.998 ± 0.010 b", "a 0.987 ± 0.010 b", False),
        ("a 0.987 ± 0.020 b", "a 0.987 ± 0.010 b", False),
        ("0.00956 ± 0.00096", "0.00955 ± 0.00095", True),  # a tenth of the value
        ("b 0.987 ± 0.010 b", "a 0.987 ± 0.010 b", False),
        ("1.00e-07 ± 2.0e-09", "9.99e-08 ± 2.0e-09", True),
        ("-0.001 ± 0.010", "0.001 ± 0.010", True),
        ("1 ± 1, n = 4", "1 ± 1, n = 5", False),
        ("1 ± 1, 2 ± 1", "1 ± 1", False),
        ("<td>1.0 ± 0.5</td><td>3</td>", "<td>1.3 ± 0.5</td><td>3</td>", True),
        ("nan ± 1.0e-01", "0.10 ± 0.10", False),
        ("C: yes†", f"C: does{SPACE}not{SPACE}apply†", True),
        (f"n_s: 4{SPACE}and{SPACE}5†", "n_s: 8†", True),
        (f"n_s: 4,{SPACE}5{SPACE}and{SPACE}12†", f"n_s: 5{SPACE}and{SPACE}6†", True),
        (f"MHz: 906,{SPACE}1,394†", "MHz: –†", True),
        (f"rank: 1{SPACE}of{SPACE}4†", f"rank: 3{SPACE}of{SPACE}12†", True),
        (f"n_s: 4{SPACE}and{SPACE}5†", "n_s: none†", False),
        ("C: 0.9†", "P: 0.9†", False),
        ("C: 0.9†", "C: 0.90 ± 0.10", False),
        ("C: 0.9†", "C: yes†", False),
        ("C: 0.9†", "C:", False),
        (f"C: 0.98{SPACE}(0.97–1.04)†", "C: rubbish†", False),
        (f"C: 0.98{SPACE}(0.97–1.04)†", f"C: 0.98{SPACE}(unknown)†", False),
        (f"C: 0.98{SPACE}(0.97–1.04)†", f"C: 0.0{SPACE}(-0.1{SPACE}to{SPACE}0.1)†", True),
        (f"C: 0.98{SPACE}(0.97–1.04)†", "C: –†", True),
        ("C: nan†", "C: 0.9†", False),
        ("C: nan†", "C: nan†", True),
        ("C: 0.9†\nP: 3.0 ± 0.1", "C: 1.1†\nP: 3.2 ± 0.1", False),
        ("C: 0.9†\nP: 3.0 ± 0.1", "C: 1.1†\nP: 3.1 ± 0.1", True),
        ("<td>0.9†</td><td>3</td>", "<td>1,000†</td><td>4</td>", False),
        ("P  3", "P 3", False),  # without a number of one run nothing is loosened
    ],
)
def test_texts_agree_within_the_stated_tolerance_and_of_one_run_in_form(text, reference, same):
    assert agree(text, reference) is same and agree(reference, text) is same


@pytest.mark.parametrize("way", [repr, Table.html], ids=["text", "html"])
def test_what_is_shown_agrees_with_what_is_shown_elsewhere(way):
    """Within the tolerance, whatever the width; of one run whatever the number, or if there is none."""
    mine, other, off = (way(show({"C": (value, 0.5), "P": (1.0, 0.5)})) for value in (9.9, 10.1, 10.7))
    assert mine != other and agree(mine, other) and not agree(mine, off)
    runs = [(0.978, 0.01), (9e5, 0.01), (-3e-9, 1e-10), (2.5e8, 1e7), 12, "–"]
    texts = [
        way(show_table({"PCA": {"C": (0.5, 0.1), "n": 4}, "SDecGMCA": {"C": one_run(run), "n": 4}}))
        for run in runs
    ]
    assert all(agree(mine, other) for mine, other in product(texts, texts))


def test_a_table_has_a_column_for_each_quantity():
    assert show_table({"PCA": {"C": 1}}, head="bands").header == ["bands", "C"]
    rows = {"PCA": {"C": (0.987, 0.01), "n": 3}, "<b>": {"P": (1.5, 0.1, "mK"), "C": (1, 0.01)}}
    table = show_table(rows)
    expected = [
        ["", "C", "n", "P"],
        ["PCA", "0.987 ± 0.010", "3", ""],
        ["<b>", "1.000 ± 0.010", "", "1.50 ± 0.10 mK"],
    ]
    assert [line.split() for line in repr(table).splitlines()] == [" ".join(row).split() for row in expected]
    escaped = [[cell.replace("<b>", "&lt;b&gt;") for cell in row] for row in expected]
    assert cells(table.html()) == escaped
    assert numbers.NOT_COMPARED not in f"{table!r}{table.html()}{table.markdown()}"
    assert cells(show({"10 < l": (1.0, 0.1, "mK"), "n": 3}).html())[0] == ["10 &lt; l", "1.00 ± 0.10", "mK"]


def test_restarts_have_a_median_and_a_band_and_are_not_compared():
    pairs = [(0.9, "no"), (1.0, "yes"), (1.2, "no"), (30.0, "no")], 4 * [(0.8, "no")]
    runs = ([{"C": (value, 0.01, "mK"), "settled": text} for value, text in several] for several in pairs)
    table, other = (show_table({"SD": of_restarts(several)}) for several in runs)
    row, note = (line.replace(SPACE, " ") for line in repr(table).splitlines()[1:])
    assert row.split("  ")[-2:] == ["1.10 (0.95–16.2)† mK", "3 no, 1 yes†"] and note == numbers.OF_RESTARTS
    assert agree(repr(table), repr(other)) and agree(table.html(), other.html())
    assert of_restarts([(value, 0.01) for value in (0.9, 1.1, 1.0)])[0] == 1.0
    assert of_restarts([(0.9, 0.01)]) == one_run((0.9, 0.01))
    for values in ((0.9, 1.2), (-3e8, 2.5e8), (-0.2, 0.1), (1.5e4, 9e5)):
        band = repr(show({"C": of_restarts([(value, abs(value) / 10) for value in values])}))
        number, text = (f"C: {other}†\n{numbers.OF_RESTARTS}" for other in ("0.9", "no"))
        assert "(" in band and agree(band, number) and not agree(band, text)
    # Ends have as many digits as the median, and two where that has fewer.
    for values, shown in (((1.5, 2.0, 300), "2.00 (1.66–205)"), ((0, 0.001, 0.5), "0.00 (0.00–0.34)")):
        assert quoted(of_restarts([(value, 0.01) for value in values])) == shown
    below = of_restarts([(-0.2, 0.1), (0.2, 0.1)])
    assert quoted(below).replace(SPACE, " ") == "0.0 (-0.1 to 0.1)"


def test_what_is_quoted_is_glued_and_not_seen(monkeypatch, capsys):
    quote(pca_loss=(0.95, 0.001))  # without a notebook there is nobody to keep it
    published = []

    def publish(data, metadata):
        published.append((data, metadata["scrapbook"]))

    shell = SimpleNamespace(display_pub=SimpleNamespace(publish=publish))
    monkeypatch.setattr("IPython.get_ipython", lambda: shell)
    quote(pca_loss=(0.95, 0.001), sky="synthetic", run=one_run((95.2, 1, "%")), settled=one_run("yes"))
    text, with_tolerance = numbers.QUOTED
    assert [data for data, _ in published] == [
        {text: "'0.950'", with_tolerance: "0.9500 ± 0.0010"},
        {text: "'synthetic'"},
        {text: "'95\\xa0%'", with_tolerance: "95† %"},
        {text: "'yes'", with_tolerance: "yes†"},
    ]
    about = published[0][1]
    assert about["name"] == "pca_loss" and all(
        kind.startswith(about["mime_prefix"]) for kind in numbers.QUOTED
    )
    with pytest.raises(InputError, match="pca_peak: the tolerance"):
        quote(pca_loss=(1, 0.1), pca_peak=(1, 0))
    assert len(published) == 4 and capsys.readouterr() == ("", "")


class TestTable:
    """On a terminal, in a notebook, in a page of the book."""

    HEADER, ROWS = ["method", "n", "why"], [["PCA", 4, "a < b"], ["SDecGMCA", 5.50, "x | y"]]

    def test_text_is_aligned_without_blanks_at_the_end(self):
        lines = ["method    n    why", "PCA       4    a < b", "SDecGMCA  5.5  x | y"]
        assert repr(Table(self.HEADER, self.ROWS)).splitlines() == lines
        assert repr(Table(self.HEADER, self.ROWS, align="rr")).splitlines()[1] == "     PCA    4  a < b"
        assert repr(Table([], self.ROWS)).splitlines() == lines[1:]

    def test_texts_that_look_like_numbers_stay_as_they_are(self):
        texts = ["1e3", "0.50", "1,000", "nan", "007", "-0", "True"]
        assert repr(Table([], [texts])).split() == texts
        assert cells(Table([], [texts]).html()) == [texts]

    def test_colours_take_no_room(self):
        rows = [["D1", "ok", "x"], ["D2", "not", "x"]]
        coloured = [[name, click.style(verdict, fg="green"), x] for name, verdict, x in rows]
        assert click.unstyle(repr(Table([], coloured))) == repr(Table([], rows))

    def test_html_escapes_what_does_not_say_that_it_is_html(self):
        page = Table(["<i>", HTML("<b>n</b>")], [["a & b", HTML("<a href='x'>y</a>")]]).html()
        assert cells(page) == [["&lt;i&gt;", "<b>n</b>"], ["a &amp; b", "<a href='x'>y</a>"]]

    def test_html_heads_columns_and_rows_and_scrolls(self):
        page = Table(self.HEADER, self.ROWS, align="lr").html()
        assert page.startswith('<div class="himap-table"><table>') and page.endswith("</table></div>")
        (head,) = re.findall("<thead>(.*?)</thead>", page)
        assert head.count('<th scope="col"') == 3 and "<td" not in head
        assert page.count('<th scope="row"') == 2 and page.count("<td") == 4
        assert re.findall("text-align:(\\w+)", head) == ["left", "right", "left"]
        assert page.count("nowrap") == 2  # the numbers, that is, what is at the right
        assert "thead" not in Table([], self.ROWS).html()

    def test_a_bar_does_not_end_a_cell_of_markdown(self):
        lines = Table(self.HEADER, self.ROWS, align="lr").markdown()
        assert len(lines) == 4 and re.fullmatch(r"\|:-+\|-+:\|:-+\|", lines[1])
        assert lines[3].endswith(r"| x \| y |")

    def test_it_may_be_empty(self):
        assert repr(Table([], [])) == ""
        assert repr(Table(self.HEADER, [], align="lr")) == "method  n  why"
        assert cells(Table(self.HEADER, [], align="lr").html()) == [self.HEADER]
