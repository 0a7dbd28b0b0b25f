"""What a reader does in a browser: plays with figures, enlarges them, reads text and tables in any light."""

import re
from contextlib import suppress

import pytest
import yaml
from conftest import ROOT
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from himap.app.notebook_files import figures, plain_caption
from himap.figures.numbers import quoted

DESK = {"width": 1300, "height": 900}
PHONE = {"width": 390, "height": 800}
LEAST_CONTRAST = 4.5  # of text, WCAG 2 AA
HEAVIEST = 3e6  # bytes of a page with all that it loads
PLAYED = {
    "fig-results-angular": "10_results",
    "fig-results-frequency": "10_results",
    "fig-ns-scan-mse": "11_ns_scan",
    "fig-ns-scan-spectra": "11_ns_scan",
    "fig-post-spectra": "12_post_masking",
    "fig-dimmed-spectra": "13_dimmed_galaxy",
    "fig-readings-curves": "16_readings",
    "fig-transfer-functions": "20_transfer_function",
    "fig-transfer-corrected": "20_transfer_function",
    "fig-transfer-mocks": "20_transfer_function",
}

# {name of a figure: [its text in place of the picture, link to itself, number, how to cite it]}
FIGURES = """Object.fromEntries([...document.querySelectorAll('article figure[id]')].map(one => [one.id, [
    one.querySelector('img')?.alt, one.querySelector('.himap-permalink')?.getAttribute('href'),
    one.querySelector('.caption-number')?.textContent.trim(),
    one.querySelector('.himap-citation')?.textContent,
]]))"""

# {text that is too faint: its contrast}, of what is seen of the article.
FAINT = """least => {
    const luminance = rgb => rgb.map(one => one / 255)
        .map(one => one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4)
        .reduce((sum, one, n) => sum + one * [0.2126, 0.7152, 0.0722][n], 0);
    const parts = text => text.match(/[\\d.]+/g).map(Number);
    const over = (text, under) => {
        const [r, g, b, alpha = 1] = parts(text);
        return [r, g, b].map((one, n) => one * alpha + under[n] * (1 - alpha));
    };
    const grounds = new Map([[null, [255, 255, 255]]]);
    const ground = one => {
        if (!grounds.has(one)) {
            grounds.set(one, over(getComputedStyle(one).backgroundColor, ground(one.parentElement)));
        }
        return grounds.get(one);
    };
    const found = {};
    const walker = document.createTreeWalker(document.querySelector('article'), NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const element = walker.currentNode.parentElement;
        const text = walker.currentNode.textContent.trim();
        if (!text || element.closest('mjx-container, script, style') || !element.checkVisibility()) continue;
        const under = ground(element);
        const both = [over(getComputedStyle(element).color, under), under].map(luminance);
        const contrast = (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05);
        if (contrast < least) found[text.slice(0, 60)] = contrast;
    }
    return found;
}"""
SCROLLING = """[...document.querySelectorAll('article table')].map(one => one.parentElement)
    .filter(one => one.checkVisibility() && one.scrollWidth > one.clientWidth + 1)
    .map(one => [one.clientWidth, one.scrollWidth, one.innerText.slice(0, 80)])"""
STRANGE = r"""[...document.querySelectorAll('dl.py > dt.sig')].flatMap(sig => {
    const names = new Set([...sig.querySelectorAll('em.sig-param span.n')].map(one => one.textContent));
    const known = {Parameters: word => names.has(word), Raises: word => /(Error|Warning)$/.test(word)};
    return [...sig.parentElement.querySelectorAll(':scope > dd > dl.field-list > dt')].flatMap(head => {
        const check = known[head.textContent.replace(':', '')] || (() => true);
        const stated = [...head.nextElementSibling.querySelectorAll('strong')].map(one => one.textContent);
        const words = stated.flatMap(text => text.match(/\w+/g) || [text]);
        return words.filter(word => !check(word)).map(word => [sig.id, word]);
    });
})"""
LOAD_ALL = """for (const one of document.images) one.loading = 'eager';
    for (const one of document.getElementsByTagName('details')) one.open = true;"""
NOT_LOADED = "[...document.images].filter(one => !(one.complete && one.naturalWidth)).map(one => one.src)"
SILENT = "[...document.images].filter(one => !one.alt.trim()).map(one => one.src)"
BYTES = """[...performance.getEntriesByType('resource'), ...performance.getEntriesByType('navigation')]
    .filter(one => !one.name.includes('/test-fonts/')).reduce((sum, one) => sum + one.encodedBodySize, 0)"""


@pytest.fixture
def played(visit):
    """Opens the page of a figure and presses its button: (page, figure)."""

    def opened(name, **options):
        page = visit(f"notebooks/{PLAYED[name]}.html", **{"viewport": DESK} | options)
        figure = page.locator(f"#{name}")
        figure.locator("button.himap-play").click()
        figure.locator("canvas").first.wait_for()
        return page, figure

    return opened


def numbers(name):
    """{panel: {curve: {x: y}}} of a figure."""
    (figure,) = [one for one in figures(ROOT / "notebooks" / f"{PLAYED[name]}.ipynb") if one.name == name]
    return {panel: {one: dict(xy) for one, xy in many.items()} for panel, many in figure.curves.items()}


def said(figure):
    """{curve: number} that the figure says of the point under its cursor."""
    text = figure.locator(".himap-status").text_content()
    pairs = [part.rpartition(" ") for part in text.partition(": ")[2].split("; ")]
    return {curve: float(value) for curve, _, value in pairs if "·" not in value}


@pytest.mark.parametrize("name", PLAYED)
def test_a_figure_can_be_played_with(played, name):
    page, figure = played(name)
    assert not figure.locator("img").first.is_visible() and figure.locator("canvas").count() in (1, 2)
    charts, curve = figure.locator(".himap-charts"), figure.locator(".himap-legend button").nth(1)
    before = charts.screenshot()
    curve.click()
    assert curve.get_attribute("aria-pressed") == "false" and charts.screenshot() != before
    curve.click()
    all_curves = charts.screenshot()
    figure.get_by_label("Zoom in").click()
    assert charts.screenshot() != all_curves
    charts.focus()
    page.keyboard.press("0")
    page.keyboard.press("ArrowRight")
    assert said(figure)
    for box in figure.locator("select").all():
        box.select_option(index=box.locator("option").count() - 1)
        figure.locator("canvas").first.wait_for()
    page.emulate_media(media="print")
    assert figure.locator("img").first.is_visible() and not charts.is_visible()
    page.emulate_media(media="screen")
    figure.get_by_text("Back to the picture").click()
    assert figure.locator("img").first.is_visible() and not charts.is_visible()
    assert not page.complaints and not page.elsewhere


@pytest.mark.parametrize("name", ["fig-results-angular", "fig-results-frequency"])
def test_ratios_are_those_of_the_numbers(played, name):
    """At the first point, of every curve and beam; of an ensemble that of the median."""
    page, figure = played(name)
    for beam, curves in numbers(name).items():
        figure.locator("select").nth(1).select_option(label=beam)
        figure.locator(".himap-charts").focus()
        page.keyboard.press("Home")
        truth = curves.pop("HI + noise")
        least = min(truth)
        expected = {
            label.removesuffix(": median"): ys[least] / truth[least]
            for label, ys in curves.items()
            if not re.search(r": (\d+ %|restart \d+)$", label)
        }
        found = said(figure)
        assert found == pytest.approx({label: expected[label] for label in found}, rel=6e-3)
        assert set(expected) - set(found) <= {one for one, ratio in expected.items() if ratio > 1e5}


def test_numbers_change_with_size_and_galaxy(played):
    page, figure = played("fig-results-angular")
    views = figure.locator("select").first
    labels = views.locator("option").all_text_contents()
    assert labels[0] == "quick, synthetic Galaxy" and len([one for one in labels if one[:5] == "paper"]) == 2
    seen = []
    for label in labels:
        views.select_option(label=label)
        figure.locator(".himap-charts").focus()
        page.keyboard.press("Home")
        seen.append(said(figure)["PCA"])
    assert len(set(seen)) == 3


def test_a_slider_goes_through_the_numbers_of_sources(played):
    page, figure = played("fig-ns-scan-mse")
    figure.locator("input[type=range]").focus()
    scan = numbers("fig-ns-scan-mse")["full range"]
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    assert figure.locator("output").text_content() == "5"
    names = [name for name in scan if name == "PCA" or name.endswith(": median")]
    assert len(names) == 2
    expected = {name.removesuffix(": median"): scan[name][5] for name in names}
    assert {name: said(figure)[name] for name in expected} == pytest.approx(expected, rel=6e-3)
    page, figure = played("fig-ns-scan-spectra")
    before = figure.locator(".himap-charts").screenshot()
    figure.locator("input[type=range]").focus()
    page.keyboard.press("ArrowRight")
    first = next(name for panel in numbers("fig-ns-scan-spectra").values() for name in panel if "n_s" in name)
    assert figure.locator("output").text_content() == first.partition("= ")[2].partition(" ")[0]
    assert figure.locator(".himap-charts").screenshot() != before


def test_pictures_stay_where_there_is_no_script(browser, address):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"{address}/notebooks/10_results.html")
    figure = page.locator("#fig-results-angular")
    assert figure.locator("img").is_visible() and not figure.locator("button").is_visible()
    context.close()


def test_the_library_is_loaded_only_where_it_draws(html):
    with_it = {path.stem for path in html.rglob("*.html") if "uPlot.iife" in path.read_text()}
    assert with_it == set(PLAYED.values())
    assert (html / "_static" / "uplot" / "LICENSE").read_text().startswith("The MIT License")


def test_a_click_enlarges_a_figure(visit):
    page = visit("notebooks/04_pca.html", viewport=DESK)
    picture = page.locator("#fig-pca-maps img")
    before = picture.bounding_box()["width"]
    picture.click()
    large = page.locator("dialog[open] img")
    assert large.bounding_box()["width"] > 1.3 * before
    assert large.get_attribute("alt") == picture.get_attribute("alt")
    page.keyboard.press("Escape")
    assert not page.locator("dialog[open]").count()


@pytest.mark.parametrize("part", ["book", "notebooks"])
def test_every_page_loads_reads_well_and_fits(html, visit, part):
    """At a desk, in light and dark, and on a phone; figures have a text, a link and a citation."""
    paths = sorted(html.glob(f"{part}/*.html"))
    assert len(paths) > 8
    for path in paths:
        name = path.relative_to(html).as_posix()
        page = visit(name, viewport=DESK, color_scheme="light")
        check_loaded(page, name)
        check_looks(page, name)
        if part == "notebooks":
            check_figures(page, ROOT / "notebooks" / f"{path.stem}.ipynb")


def check_loaded(page, name):
    page.evaluate(LOAD_ALL)
    with suppress(PlaywrightTimeoutError):  # which images are missing is said below
        page.wait_for_function(f"!{NOT_LOADED}.length")
    assert not page.complaints, f"{name}: {page.complaints}"
    assert not page.elsewhere, f"{name} asks {page.elsewhere}"
    assert not page.evaluate(NOT_LOADED), name
    assert not page.evaluate(SILENT), f"{name} has figures without a text in place of them"
    assert page.evaluate(BYTES) < HEAVIEST, name


def check_looks(page, name):
    assert page.locator("article").bounding_box()["width"] < 770
    page.add_style_tag(content="* { transition: none !important; }")  # colours as they come to be
    assert not page.evaluate(SCROLLING), name
    for theme in ("light", "dark"):
        page.evaluate(f"document.documentElement.dataset.theme = {theme!r}")
        assert not page.evaluate(FAINT, LEAST_CONTRAST), f"{name}, {theme}"
    page.set_viewport_size(PHONE)
    assert not page.evaluate(SCROLLING), f"{name} on a phone"
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"], f"{name} on a phone"


def check_figures(page, notebook):
    shown = page.evaluate(FIGURES)
    for one in figures(notebook):
        alternative, link, number, text = shown[one.name]
        assert alternative == plain_caption(one.caption) and link == f"#{one.name}"
        assert f"{number}, in: himap" in text and text.endswith(f"{notebook.stem}.html#{one.name}")


def test_docstrings_name_parameters_and_errors_that_are(visit):
    """Prose after a list of parameters would be set as more of them."""
    page = visit("book/api.html")
    assert page.locator("dl.py > dt.sig").count() > 50
    assert not page.evaluate(STRANGE)


def test_answers_are_on_paper(visit):
    page = visit("notebooks/04_pca.html")
    folded = "document.querySelectorAll('details.himap-answer:not([open])').length"
    answers = page.evaluate(folded)
    assert answers
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert not page.evaluate(folded)
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(folded) == answers


def test_paper_has_no_heading_of_a_gallery_that_is_folded(visit):
    page = visit("book/figures.html")
    printed = page.evaluate((ROOT / "book" / "print_page.js").read_text(), [page.url])
    assert "Figures" in printed["text"] and "All figures, chapter by chapter" not in printed["text"]


def test_pages_show_no_tolerance_and_few_digits(html, visit):
    page = visit("notebooks/10_results.html")
    assert "±" not in "".join(page.locator(".himap-table").all_inner_texts())
    cells = page.locator(".himap-table td span[title]").all()
    assert len(cells) > 50
    for cell in cells[::3]:
        value, tolerance = map(float, cell.get_attribute("title").split(", to within "))
        assert cell.inner_text() == quoted((value, tolerance))
        assert cell.evaluate("one => getComputedStyle(one.parentElement).textAlign") == "right"
    assert not [path for path in html.rglob("*.html") if re.search(r"<td[^>]*>[^<]*±", path.read_text())]


def test_search_finds_a_method_and_says_where(visit):
    """The icon is next to the words."""
    page = visit("search.html?q=SDecGMCA", viewport=DESK)
    page.wait_for_selector("#search-results p.context")
    assert page.locator("#search-results li a", has_text="SDecGMCA").count() >= 1
    snippets = page.locator("#search-results p.context").all_text_contents()
    assert all("sdecgmca" in one.lower() for one in snippets[:3])
    assert not any(".pdf" in one for one in snippets)
    icon = page.locator(".bd-search-container .fa-magnifying-glass").bounding_box()
    box = page.locator(".bd-search-container input")
    padding = float(box.evaluate("one => parseFloat(getComputedStyle(one).paddingLeft)"))
    assert icon["x"] + icon["width"] <= box.bounding_box()["x"] + padding


def test_references_lead_out(html):
    page = (html / "book" / "bibliography.html").read_text()
    entries = re.findall(r'<div class="citation" id="[^"]*".*?</div>', page, re.S)
    without = [one for one in entries if not re.search(r'href="https?://', one)]
    assert len(entries) > 30
    assert all("Draine" in one or "Minka" in one for one in without)  # a book, and proceedings without a DOI
    assert "arxiv.org/abs/2511.13328" in page
    assert "2511.13328" in str(yaml.safe_load((ROOT / "CITATION.cff").read_text())["references"])


def test_equations_are_typeset(visit):
    page = visit("notebooks/13_dimmed_galaxy.html")
    page.wait_for_selector("mjx-container")
    count = {name: page.locator(name).count() for name in (".math", "mjx-container", "mjx-merror")}
    assert count[".math"] == count["mjx-container"] > 5 and count["mjx-merror"] == 0
