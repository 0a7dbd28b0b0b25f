"""No number that was measured is typed in prose: it comes from a notebook, or from a stored result.

Every other number is a definition (a parameter, a number of an instrument or of the paper, a preset) and is
listed here, page by page.
"""

import ast
import re
from collections import Counter

import pytest
from conftest import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("[0-9]*.py"))
PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in [ROOT / "README.md", *sorted((ROOT / "book").glob("*.md")), *NOTEBOOKS]
}

DEFINED = {
    "README.md": "ten thousand times",
    "book/conventions.md": (
        "10 %, 1400 MHz, 5 MHz, 4 MHz, 2 MHz, 1 MHz, 0.1, 0.1 arcmin, 0.5 arcmin, 0.14 %, 0.7 %, 10 MHz, "
        "84 %, 15°, 1.4 GHz, 0.01, 2 Mpc"
    ),
    "book/glossary.md": "10 %, 84 %",
    "book/intro.md": "2511.13328",
    "notebooks/00_the_answer.py": "10 %, 5 %, 84 %, 95 %, 1.1",
    "notebooks/01_simulations.py": (
        "1420.4 MHz, 1400 MHz, ten thousand times, 408 MHz, 30 GHz, 1.4 GHz, 0.2, 4 MHz, 1300 MHz, 1.66°, "
        "6 %, 2 Mpc"
    ),
    "notebooks/02_beams_and_noise.py": "0.14 %, 0.1, 0.5 arcmin, 0.5 MHz, 1 MHz, 13.5, 20 MHz, 20,000 h",
    "notebooks/03_peak_masking.py": "10°, 60°, four times",
    "notebooks/04_pca.py": "96 %, 99 %, 10 %",
    "notebooks/05_fastica.py": "96 %, 99 %, 10 %",
    "notebooks/06_gmca.py": "96 %, 99 %, 10 %, 1.48 times",
    "notebooks/07_polynomial.py": "96 %, 99 %, 10 %, 10 K",
    "notebooks/08_parametric.py": "96 %, 99 %, 10 %, 1 %",
    "notebooks/09_sdecgmca.py": "96 %, 99 %, 10 %, 84 %, 0.1 %, three times",
    "notebooks/10_results.py": "10 %, 84 %",
    "notebooks/11_ns_scan.py": "10 %, 84 %",
    "notebooks/12_post_masking.py": "84 %, 99.9 %, 15°, 95 %, 25 %, 10 %, 180°",
    "notebooks/13_dimmed_galaxy.py": "10 %, 2 %, 30°",
    "notebooks/14_diagnostics.py": "1000 MHz",
    "notebooks/15_claims.py": "84 %, 16 %, 95 %, 10 %, 20 %, 1 %, 1.5 times, factor of 2, 1.001, 1.01",
    "notebooks/16_readings.py": "0.31, 84 %",
    "notebooks/17_your_own_cube.py": "100 MHz, 10 %, 1 %",
    "notebooks/18_paper_size.py": "1 MHz, four times, 84 %",
    "notebooks/19_scale.py": "1 MHz, 0.93, 0.85, factor of 8.4, factor of 9.2, 215 s, 18 s",
    "notebooks/20_transfer_function.py": "3°, 10 %, 30 %, 3 %, 1 %, 68 %, 95 %",
    "notebooks/21_beam_errors.py": "10 K, 0.1 mK, 0.14 %, 0.7 %, 1 %, 0.1 %",
    "notebooks/22_how_many.py": "10 %, 3 %, factor of 3, ten times",
    "notebooks/23_thresholds.py": "10 %, 1 %",
    "notebooks/24_masks.py": "40 %",
    "notebooks/25_side_by_side.py": "10 %, 1 %",
    "notebooks/26_a_survey.py": "100 %, 10 %",
    "notebooks/27_restarts.py": "10 %, 5 %, three times, ten thousand times",
}
"""{page: numbers that it may type}: of axes and colours, of the instrument, of presets, of the paper."""

_LITERAL = (  # what is not prose: code, math, roles, links, tags
    r"(?ms)^(```+|~~~+).*?^\1\s*$",
    r"(?s)\$\$.*?\$\$",
    r"\$[^$\n]*(?:\n[^$\n]*)?\$",
    r"\{[\w:]+\}`[^`]*`",
    r"`[^`]*`",
    r"\]\([^)]*\)",
    r"<[^>]+>",
    r"https?://\S+",
    r"(?:Sect\.|Figs?\.|App\.|Table|Python|PySM|himap)\s+\d[\d.]*(?:(?: to |, )\d\.[\d.]*)*",
)
_UNIT = (
    r"[%°]|×(?!\s*\d)|Mpc|(?:times|-?fold|per\s?cent|mK|K|[kMG]?Hz|[kMG]B|arcmin|deg|min|minutes|seconds|hours"
    r"|h|s|ms)\b"
)
_DIGITS = r"(?<![\w.,])[-−]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?"
_WORDS = (
    r"\b(?:(?:two|three|four|five|six|seven|eight|nine|ten|twelve|fifteen|twenty|thirty|fifty|hundred|thousand"
    r"|million)\s)+(?:times|fold|per\s?cent)\b"
)
_NUMBERS = re.compile(
    rf"factor of {_DIGITS}|{_DIGITS}(?:\s|-|\N{{NO-BREAK SPACE}})?(?:{_UNIT})"
    rf"|(?<![\w.,])[-−]?\d+(?:,\d{3})*\.\d+(?:e[-+]?\d+)?|{_WORDS}"
)
_ROLE = re.compile(r"\{glue:text\}`(?:([^`]+)::)?(\w+)(?::[^`:]*)?`")


def prose(text, notebook):
    """The prose of a page, as many lines, all else blank: markdown cells and captions of a notebook."""
    if notebook:
        lines, inside = [], False
        for line in text.splitlines():
            if line.startswith("# %%"):
                inside = line.startswith("# %% [markdown]")
                caption = re.search(r'"caption": ("(?:[^"\\]|\\.)*")', line)
                lines.append(ast.literal_eval(caption[1]) if caption else "")
            else:
                lines.append(line[2:] if inside else "")
        text = "\n".join(lines)
    for pattern in _LITERAL:
        text = re.sub(pattern, lambda found: re.sub(r"[^\n]", " ", found[0]), text)
    return text


def numbers(text, notebook):
    """[(line, number)] in the prose of a page."""
    text = prose(text, notebook)
    return [
        (text.count("\n", 0, found.start()) + 1, " ".join(found[0].split()))
        for found in _NUMBERS.finditer(text)
    ]


@pytest.mark.parametrize("page", sorted(PAGES))
def test_no_measured_number_is_typed(page):
    path, known = PAGES[page], set(filter(None, DEFINED.get(page, "").split(", ")))
    found = numbers(path.read_text(), path.suffix == ".py")
    typed = [f"{page}:{line}: {number}" for line, number in found if number not in known]
    assert DEFINED.keys() <= PAGES.keys()
    assert not typed, "typed numbers; quote what was measured, list what is defined:\n" + "\n".join(typed)
    assert known == {number for _, number in found}, "a definition that the page does not have"


def quoted_names(path):
    """The names that a notebook quotes; they are written out, so that they can be found."""
    calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    keywords = [
        keyword.arg for call in calls for keyword in call.keywords if getattr(call.func, "id", "") == "quote"
    ]
    assert None not in keywords, f"{path.name}: write the names of `quote` out"
    return keywords


def test_names_of_quoted_numbers_are_unique():
    count = Counter(name for path in NOTEBOOKS for name in quoted_names(path))
    assert count and set(count.values()) == {1}, [name for name, times in count.items() if times > 1]


def test_prose_and_notebooks_quote_the_same_numbers():
    """No page refers to a number that nobody quotes, and none is quoted for nobody."""
    there = {(path, name) for path in NOTEBOOKS for name in quoted_names(path)}
    wanted = set()
    for path in PAGES.values():
        for place, name in _ROLE.findall(path.read_text()):
            source = (path.parent / place).resolve().with_suffix(".py") if place else path
            wanted.add((source, name))
    assert wanted == there, {f"{path.name}: {name}" for path, name in wanted ^ there}
