"""No number that was measured is typed in prose: it comes from a notebook, or from a stored result.

Every other number is a definition (a parameter, one of an instrument or of the paper, a preset) and is listed
here, page by page.
"""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("[0-9]*.py"))
PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in [ROOT / "README.md", *sorted((ROOT / "book").glob("*.md")), *NOTEBOOKS]
}

DEFINED = {
    "README.md": {
        "ten thousand times": "how much brighter the Galaxy is, as everybody says",
        "100 MHz": "bands where the sky is bright",
    },
    "book/intro.md": {
        "2511.13328": "the paper's number at arXiv",
        "0.1 %": "how much lower and higher the noise level is",
    },
    "book/conventions.md": {
        "1400 MHz": "end of the band",
        "5 MHz": "channels of a preset",
        "4 MHz": "channels of a preset",
        "2 MHz": "channels of a preset",
        "1 MHz": "channels of a preset",
        "0.1": "amplitude of the ripple, and weight of the plane, in the paper",
        "0.1 arcmin": "amplitude of the ripple in the paper",
        "0.5 arcmin": "amplitude of the stronger ripple",
        "0.14 %": "the ripple over the width of the beam, both by definition",
        "0.7 %": "the stronger ripple over the width of the beam",
        "10 MHz": "half the period of the ripple",
        "15°": "where dimming ends, in the paper",
        "1.4 GHz": "frequency of the counts of sources",
        "0.01": "faintest source that is put on the sky, Jy",
    },
    "notebooks/01_simulations.py": {
        "1420.4 MHz": "the 21 cm line",
        "1400 MHz": "end of the band",
        "ten thousand times": "how much brighter the Galaxy is, as everybody says",
        "408 MHz": "where synchrotron emission is given",
        "30 GHz": "where free-free emission is given",
        "1.4 GHz": "frequency of the counts of sources",
        "0.2": "width of the distribution of spectral indices",
    },
    "notebooks/02_beams_and_noise.py": {
        "0.14 %": "the ripple over the width of the beam, both by definition",
        "0.1": "amplitude of the ripple in the paper, arcmin",
        "0.5 arcmin": "amplitude of the stronger ripple",
        "0.5 MHz": "spacing of a figure",
        "1 MHz": "channels of the paper",
        "20 MHz": "period of the ripple",
    },
    "notebooks/03_peak_masking.py": {
        "10°": "edge of the lines of sight near the plane",
        "60°": "edge of those near the poles",
        "four times": "nside of the paper and of the preset",
    },
    "notebooks/04_pca.py": {
        "5 %": "what the axis of ratios shows",
        "96 %": "what colours span",
        "99 %": "what colours span",
        "10 %": "the grey band",
        "20 MHz": "period of the ripple",
    },
    "notebooks/05_fastica.py": {
        "-2.1": "spectral index of free-free emission",
        "96 %": "what colours span",
        "99 %": "what colours span",
        "10 %": "the grey band",
    },
    "notebooks/06_gmca.py": {
        "96 %": "span of the colours",
        "99 %": "span of the colours",
        "10 %": "the grey band",
        "1.48 times": "standard deviation over median absolute value, of a Gaussian",
    },
    "notebooks/07_polynomial.py": {
        "96 %": "span of the colours",
        "99 %": "span of the colours",
        "10 %": "the grey band",
        "10 K": "foreground of a figure",
        "0.03": "edge of a band",
        "0.1 MHz": "edge of a band, in 1/MHz",
    },
    "notebooks/08_parametric.py": {
        "96 %": "span of the colours",
        "99 %": "span of the colours",
        "10 %": "the grey band",
        "1 %": "share of the lines of sight that counts as the worst",
    },
    "notebooks/09_sdecgmca.py": {
        "96 %": "span of the colours",
        "99 %": "span of the colours",
        "10 %": "the grey band",
        "0.1 %": "change of the noise level that is tried",
        "three times": "lowest threshold, in units of the noise, in C21",
        "0.4": "lower end of the axis of a figure",
        "1.6": "upper end of the axis of a figure",
    },
    "notebooks/10_results.py": {
        "10 %": "the grey band",
    },
    "notebooks/11_ns_scan.py": {
        "10 %": "a band that is drawn",
    },
    "notebooks/12_post_masking.py": {
        "99.9 %": "percentiles of what is drawn",
        "15°": "what counts as in the plane, claim M1, and a cut",
        "95 %": "a percentile that is drawn",
        "20 MHz": "period of the ripple",
        "180°": "half a turn",
    },
    "notebooks/13_dimmed_galaxy.py": {
        "10 %": "what counts as right, claim G3, and a band that is drawn",
        "2 %": "what the paper has of the peak",
        "30°": "a wider edge that is tried",
    },
    "notebooks/14_diagnostics.py": {
        "20 MHz": "period of the ripple",
        "1000 MHz": "where the lower end of the band is divided from the rest",
    },
    "notebooks/15_claims.py": {
        "0.1 %": "how much lower and higher the noise level is",
        "1.001": "a mark that claim B1 once had",
    },
    "notebooks/16_readings.py": {
        "0.1 %": "change of the noise level that is tried",
        "0.31": "where the ripple shows, 1/MHz",
    },
    "notebooks/17_your_own_cube.py": {
        "10 %": "a grey band, and what counts as hardly moving",
    },
    "notebooks/18_paper_size.py": {
        "1 MHz": "channels of the paper",
        "four times": "pixels of the two presets",
    },
    "notebooks/19_scale.py": {
        "1 MHz": "channels of the paper",
    },
    "notebooks/20_transfer_function.py": {
        "10 %": "a grey band",
        "30 %": "how much higher the bias of a mock is",
        "3 %": "ends of an axis",
        "20 %": "ends of an axis",
        "1 %": "lines that are drawn",
        "68 %": "share within one standard deviation of a Gaussian",
    },
    "notebooks/21_beam_errors.py": {
        "10 K": "a foreground, in an exercise",
        "0.1 mK": "HI, in an exercise",
        "0.14 %": "the paper's ripple",
        "1 %": "a line that is drawn, and what is tolerated",
        "0.1 %": "end of an axis",
    },
    "notebooks/24_masks.py": {
        "40 %": "ends of an axis",
    },
    "notebooks/23_thresholds.py": {
        "10 %": "a grey band",
        "1 %": "the goal, set beforehand",
    },
    "notebooks/00_the_answer.py": {
        "10 %": "a grey band",
        "5 %": "what the paper has",
    },
    "notebooks/25_side_by_side.py": {
        "5 %": "what the axis of ratios shows",
        "10 %": "a grey band",
        "1 %": "the error of the beam that is looked up",
    },
    "notebooks/26_a_survey.py": {
        "100 %": "what is lost altogether",
    },
    "notebooks/22_how_many.py": {
        "10 %": "what counts as stable",
        "3 %": "what counts as settled",
        "factor of 3": "what counts as above the line",
        "ten times": "the noise that is tried",
    },
}
"""{page: {number: what it is}}."""

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


def numbers(text, notebook=False):
    """[(line, number)] of those that stand in the prose of a page."""
    text = prose(text, notebook)
    return [
        (text.count("\n", 0, found.start()) + 1, " ".join(found[0].split()))
        for found in _NUMBERS.finditer(text)
    ]


@pytest.mark.parametrize("page", sorted(PAGES))
def test_no_measured_number_is_typed(page):
    path, known = PAGES[page], DEFINED.get(page, {})
    found = numbers(path.read_text(), path.suffix == ".py")
    typed = [f"{page}:{line}: {number}" for line, number in found if number not in known]
    assert not typed, "typed numbers; quote what was measured, list what is defined:\n" + "\n".join(typed)
    assert set(known) == {number for _, number in found}, "a definition that the page does not have"


def test_pages_that_are_listed_exist():
    assert DEFINED.keys() <= PAGES.keys()


@pytest.mark.parametrize(
    "text, found",
    [
        ("Of it 0.97 is left,\nand 12 % of that.", ["0.97", "12 %"]),
        (
            "A factor of 33, 5 times, 200-fold, six times.",
            ["factor of 33", "5 times", "200-fold", "six times"],
        ),
        (
            "It has 0.09 mK, 24 GB, 5°, 1,566 hours, ten per cent.",
            ["0.09 mK", "24 GB", "5°", "1,566 hours", "ten per cent"],
        ),
        ("Minus -0.5; a tenth (1e-3 mK).", ["-0.5", "1e-3 mK"]),
        ("a hundred\nthousand times", ["hundred thousand times"]),
        ("Three channels, 500 maps, nside 64, Sect. 3.1.1 and Fig. A.1; Python 3.11 to 3.13.", []),
        ("At $k = 0.3$ and `x = 0.5`, [here](a_0.5.html), {glue:text}`pca_loss:.2f` is left.", []),
        ("```sh\nhimap run 04_pca -p weight=0.01  # 5 times\n```\n", []),
    ],
)
def test_what_counts_as_a_typed_number(text, found):
    assert [number for _, number in numbers(text)] == found


def test_cells_and_captions_of_a_notebook_are_prose_and_code_is_not():
    text = (
        '# %% [markdown]\n# Here 0.1.\n\n# %% mystnb={"figure": {"name": "a", "caption": "With 5 %."}}\n'
        "x = 0.2  # 7 %\n"
    )
    assert numbers(text, notebook=True) == [(2, "0.1"), (4, "5 %")]


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
