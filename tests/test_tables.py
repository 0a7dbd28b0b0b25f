"""The one table: on a terminal, in a notebook, in a page of the book."""

import re

import click
from pages import cells

from himap.figures.tables import HTML, Table

HEADER, ROWS = ["method", "n", "why"], [["PCA", 4, "a < b"], ["SDecGMCA", 5.50, "x | y"]]


def test_text_is_aligned_without_blanks_at_the_end():
    assert repr(Table(HEADER, ROWS)).splitlines() == [
        "method    n    why",
        "PCA       4    a < b",
        "SDecGMCA  5.5  x | y",
    ]
    assert repr(Table(HEADER, ROWS, align="rr")).splitlines()[1] == "     PCA    4  a < b"
    assert repr(Table([], ROWS)).splitlines()[0] == "PCA       4    a < b"


def test_texts_that_look_like_numbers_stay_as_they_are():
    texts = ["1e3", "0.50", "1,000", "nan", "007", "-0", "True"]
    assert repr(Table([], [texts])).split() == texts
    assert cells(Table([], [texts]).html()) == [texts]


def test_colours_take_no_room():
    coloured = [
        [name, click.style(verdict, fg="green"), "x"] for name, verdict in (("D1", "ok"), ("D2", "not"))
    ]
    plain = Table(["", "verdict", ""], [["D1", "ok", "x"], ["D2", "not", "x"]])
    assert click.unstyle(repr(Table(["", "verdict", ""], coloured))) == repr(plain)


def test_html_escapes_what_does_not_say_that_it_is_html():
    page = Table(["<i>", HTML("<b>n</b>")], [["a & b", HTML("<a href='x'>y</a>")]]).html()
    assert cells(page) == [["&lt;i&gt;", "<b>n</b>"], ["a &amp; b", "<a href='x'>y</a>"]]


def test_html_heads_columns_and_rows_and_scrolls():
    page = Table(HEADER, ROWS, align="lr").html()
    assert page.startswith('<div class="himap-table"><table>') and page.endswith("</table></div>")
    (head,) = re.findall("<thead>(.*?)</thead>", page)
    assert head.count('<th scope="col"') == 3 and "<td" not in head
    assert page.count('<th scope="row"') == 2 and page.count("<td") == 4
    assert re.findall("text-align:(\\w+)", head) == ["left", "right", "left"]
    assert page.count("nowrap") == 2  # the numbers, that is, what stands at the right
    assert "thead" not in Table([], ROWS).html()


def test_a_bar_does_not_end_a_cell_of_markdown():
    lines = Table(HEADER, ROWS, align="lr").markdown()
    assert len(lines) == 4 and re.fullmatch(r"\|:-+\|-+:\|:-+\|", lines[1])
    assert lines[3].endswith(r"| x \| y |")


def test_a_table_may_be_empty():
    assert repr(Table([], [])) == ""
    assert repr(Table(HEADER, [], align="lr")) == "method  n  why"
    assert cells(Table(HEADER, [], align="lr").html()) == [HEADER]
