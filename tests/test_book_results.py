"""The pages of what was measured once say what the files in book/results say."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from himap.paper.claims import CLAIMS
from himap.paper.ledger import read_ledger

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "book" / "results"
PAPER = {*"1234567", "A.1", "A.2", "B.1", "B.2", "B.3"}  # its figures
SIGNS = {"reproduced": "✓", "reproduced with a difference": "≈", "not reproduced": "✗"}


def stored(name):
    return json.loads((RESULTS / f"{name}.json").read_text())


def tables(page):
    """[[[text of a cell]]] of a rendered page."""
    return [
        [
            [re.sub(r"<[^>]+>", "", cell).strip() for cell in re.findall(r"<t[dh].*?</t[dh]>", row, re.S)]
            for row in re.findall(r"<tr.*?</tr>", text, re.S)
        ]
        for text in re.findall(r"<table.*?</table>", page, re.S)
    ]


def number(cell):
    """The number that a cell begins with; no number is written with an exponent."""
    return float(re.match(r"[\d.,]+(?=\s|$)", cell)[0].replace(",", ""))


@pytest.fixture(scope="module")
def html(tmp_path_factory):
    """A book of these two pages only; test_book.py renders them all, and knows warnings and broken links."""
    folder = tmp_path_factory.mktemp("book")
    shutil.copy(ROOT / "_config.yml", folder)
    for name in ("book", "notebooks"):
        shutil.copytree(ROOT / name, folder / name)
    toc = "format: jb-book\nroot: book/scale\nchapters:\n  - file: book/paper_size\n"
    (folder / "_toc.yml").write_text(toc)
    jupyter_book = [sys.executable, "-c", "from jupyter_book.cli.main import main; main()"]
    outcome = subprocess.run([*jupyter_book, "build", str(folder)], capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stdout[-3000:] + outcome.stderr[-3000:]
    return folder / "_build" / "html"


@pytest.fixture(scope="module")
def scale(html):
    """The tables of the page on scale."""
    return tables((html / "book" / "scale.html").read_text())


@pytest.fixture(scope="module")
def paper_size(html):
    return (html / "book" / "paper_size.html").read_text()


@pytest.mark.parametrize(("n", "name"), [(0, "steps_paper"), (2, "steps_laptop")])
def test_every_step_has_a_row(scale, n, name):
    head, *rows = scale[n]
    steps = stored(name)["steps"]
    assert len(rows) == len(steps) == 10
    assert ("Goal" in head) == (name == "steps_paper")
    for row, step in zip(rows, steps, strict=True):
        # Of two goals, the first, that of time, is kept.
        cells = dict(zip(reversed(head), reversed(row), strict=True))
        assert row[0] == step["step"]
        assert number(cells["Time"]) == pytest.approx(step["seconds"], rel=0.006)
        assert number(cells["Memory"]) == pytest.approx(step["memory_gb"], abs=0.05)
        assert number(cells["Floor"]) == pytest.approx(step["floor_seconds"], rel=0.06)
        assert number(cells["Over it"]) == pytest.approx(step["seconds"] / step["floor_seconds"], rel=0.06)
        assert bool(cells["Beside it"]) == ("alternative" in step)
        if "alternative" in step:
            times = step["alternative"]["seconds"] / step["seconds"]
            assert number(cells["Beside it"]) == pytest.approx(times, rel=0.06)
        if "Goal" in cells:
            assert number(cells["Goal"]) == step["goal_seconds"]


def test_the_whole_is_the_sum_of_its_parts(scale):
    head, *rows, total = scale[1]
    assert head == ["Part", "Time", "Goal"] and len(rows) == 8
    once = {row["execution"]["seconds"] for row in stored("paper_synthetic/figures")["figures"]}
    seconds = stored("steps_paper")["steps"][0]["seconds"] + sum(once)
    seconds += stored("claims_paper_synthetic")["about"]["seconds"]
    assert number(total[1]) == pytest.approx(seconds / 60, abs=0.5)
    assert sum(number(row[1]) for row in rows) == pytest.approx(seconds / 60, rel=0.02)
    assert number(total[2]) == 90
    figures = [word for row in rows for word in re.findall(r"[AB]\.\d|\b\d(?=,|$)", row[0])]
    assert set(figures) == PAPER and len(figures) == len(PAPER)


def test_what_misses_its_goal_is_bold(html):
    (page,) = re.findall(r"<table.*?</table>", (html / "book" / "scale.html").read_text(), re.S)[:1]
    missed = [
        round(step[have])
        for step in stored("steps_paper")["steps"]
        for have, goal in (("seconds", "goal_seconds"), ("memory_gb", "goal_gb"))
        if step[have] > step[goal]
    ]
    bold = [round(number(text)) for text in re.findall(r"<strong>(.*?)</strong>", page)]
    assert bold == missed


def test_exponents_are_those_of_the_figure(scale):
    _, *rows = scale[3]
    found = stored("scaling")["found"]
    assert len(rows) == 10
    for name, *exponents in rows:
        assert exponents == [f"{found[way][name]['exponent']:.2f}" for way in ("nside", "n_channels")]


def test_a_larger_survey_costs_what_the_exponents_say(scale):
    """nside 512, 2000 channels: once more what lay between laptop and paper, then twice the channels."""
    _, *rows, (_, _, _, total, _) = scale[4]
    found, hours = stored("scaling")["found"], 0
    both = zip(rows, *(stored(f"steps_{name}")["steps"] for name in ("laptop", "paper")), strict=True)
    for row, laptop, paper in both:
        once = paper["seconds"] ** 2 / laptop["seconds"] * 2 ** found["n_channels"][row[0]]["exponent"]
        hours += 2 * 100 * int(row[2]) * once / 3600
        assert number(row[1]) == pytest.approx(once / 60, rel=0.06)
        assert number(row[4]) > 50  # GB: a cube has 25
    times = {row[0]: int(row[2]) for row in rows}
    assert times.pop("HI light cone") == times.pop("observations, three beams") == 1
    assert times.pop("both spectra") == 18 and set(times.values()) == {3}
    assert number(total) == pytest.approx(hours, abs=1)


def arguments(directive):
    """What the page at the paper's size shows with `directive`, in its order."""
    page = (ROOT / "book" / "paper_size.md").read_text()
    return re.search(rf"^```\{{{directive}\}} (.+)$", page, re.M)[1].split()


def ledgers():
    return arguments("ledgers")


def test_all_that_is_stored_is_shown():
    assert set(ledgers()) == {path.stem for path in RESULTS.glob("claims_*.json")}
    assert set(folders()) == {path.parent.name for path in RESULTS.glob("*/figures.json")}


def test_ledgers_stand_side_by_side(paper_size):
    (head, *rows, last) = tables(paper_size)[0]
    columns = [read_ledger(RESULTS / f"{name}.json") for name in ledgers()]
    assert head[3:] == [f"{about['preset']}, {about['galaxy']}" for _, about in columns]
    assert [row[0] for row in rows] == list(CLAIMS)
    for n, (entries, _) in enumerate(columns):
        for row, entry in zip(rows, entries, strict=True):
            assert row[3 + n].startswith(f"{SIGNS[entry.verdict]} {entry.values[0]:.3g}")
        verdicts = [entry.verdict for entry in entries]
        assert last[3 + n] == " · ".join(f"{SIGNS[one]} {verdicts.count(one)}" for one in SIGNS)


def folders():
    return arguments("beside")


def test_figures_stand_beside_those_of_the_book(html, paper_size):
    shown = re.findall(r'<a href="([^"]+)"><img src="([^"]+)"', paper_size)
    for full, small in shown:
        with Image.open(html / "book" / full) as large, Image.open(html / "book" / small) as picture:
            assert picture.width <= large.width and picture.width >= 600, full
    for folder in folders():
        rows = stored(f"{folder}/figures")["figures"]
        assert {row["paper"] for row in rows} == PAPER
        for row in rows:
            assert row["parameters"]["preset"] == "paper" and not row["execution"]["dirty"]
            picture = f"_static/sizes/{folder}/{row['name']}.png"
            original = html / "_static" / "sizes" / folder / f"{row['name']}.png"
            assert f"../{picture}" in dict(shown)
            assert original.read_bytes() == (RESULTS / folder / f"{row['name']}.png").read_bytes()
