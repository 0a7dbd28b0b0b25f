"""Print the rendered book as one PDF, through headless Chromium.

    python book/print_pdf.py _build/html _build/himap.pdf

puts all pages in their order on one, with links between chapters that work in the PDF, an outline and page
numbers. Pictures stand where a page has figures to play with; folded code stays folded.
"""

import functools
import html
import re
import shutil
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import click
from playwright.sync_api import sync_playwright

CHROMIUMS = ("chromium", "chromium-browser", "google-chrome")
MINUTES = 5  # for all equations
PAGES = "[...document.querySelectorAll('nav.bd-links a.internal')].map(one => one.href.split('#')[0])"
TEXT = Path(__file__).with_name("print_page.js").read_text()

HEAD = """[...document.head.querySelectorAll('link[rel=stylesheet]')].map(one => one.href)"""
MATHJAX = """[...document.scripts].filter(one => /mathjax/i.test(one.src) || /window.MathJax/.test(one.text))
  .map(one => one.src ? `<script defer src="${one.src}"></script>` : one.outerHTML).join('')"""

STYLE = """
html { font-size: 13px !important; }
body { background: white; display: block; }
.bd-main, .bd-main .bd-content { display: block !important; height: auto; margin: 0 !important; }
.bd-main .bd-content .bd-article { break-before: page; padding: 0 !important; }
.bd-main .bd-content .bd-article h1:first-of-type { display: block; margin-top: 0; }
.title { margin-top: 30%; text-align: center; }
.contents { break-before: page; }
.contents li { break-inside: avoid; }
img { break-inside: avoid; }
h1, h2, h3 { break-after: avoid; }
p { orphans: 3; widows: 3; }
div.highlight pre { font-size: 0.72em; }
figure, .himap-table { font-size: 0.9em; }
figure img { max-height: 14cm; }
"""

FOOTER = """<div style="font: 8px sans-serif; width: 100%; text-align: center; color: #555">
<span class="pageNumber"></span> / <span class="totalPages"></span></div>"""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *args):
        pass


class _Server(ThreadingHTTPServer):
    def handle_error(self, *args):
        """The browser goes on to the next page before it has all of this one; nothing is wrong."""


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False))
@click.argument("target", type=click.Path(dir_okay=False))
def main(folder, target):
    """Print the book rendered in FOLDER as TARGET."""
    chromium = next(filter(None, map(shutil.which, CHROMIUMS)), None)
    if chromium is None:
        raise click.ClickException(f"a PDF needs Chromium; none of {', '.join(CHROMIUMS)} is installed.")
    server = _Server(("127.0.0.1", 0), functools.partial(_Quiet, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            _print(browser, f"http://127.0.0.1:{server.server_port}", Path(target))
            browser.close()
    finally:
        server.shutdown()
        server.server_close()


def _print(browser, address, target):
    page = browser.new_page()
    page.set_default_timeout(MINUTES * 60_000)
    whole = _whole(page, address)
    page.route(f"{address}/whole.html", lambda route: route.fulfill(body=whole, content_type="text/html"))
    page.goto(f"{address}/whole.html", wait_until="networkidle")
    page.evaluate("() => MathJax.startup.promise")
    page.emulate_media(media="print", color_scheme="light")
    margins = {"top": "16mm", "bottom": "18mm", "left": "18mm", "right": "18mm"}
    options = {"header_template": "<span></span>", "footer_template": FOOTER, "display_header_footer": True}
    options |= {"outline": True, "tagged": True, "print_background": True}
    page.pdf(path=target, format="A4", margin=margins, **options)
    page.close()


def _whole(page, address):
    """The HTML of all pages as one."""
    page.goto(f"{address}/index.html", wait_until="networkidle")
    first = page.url
    pages = list(dict.fromkeys([first, *page.evaluate(PAGES)]))
    title = page.title().split(" — ")[-1]
    styles = "".join(f'<link rel="stylesheet" href="{one}">' for one in page.evaluate(HEAD))
    page.route("**/*.js*", lambda route: route.abort())  # equations are typeset once, in the whole
    chapters, mathjax = [], ""
    for one in pages:
        page.goto(one, wait_until="load")
        mathjax = mathjax or page.evaluate(MATHJAX)
        chapters.append(page.evaluate(TEXT, pages))
    page.unroute("**/*.js*")
    contents = "".join(f'<li><a href="#{one["id"]}">{html.escape(one["title"])}</a></li>' for one in chapters)
    text = "".join(one["text"] for one in chapters)
    return (
        '<!doctype html><html lang="en" data-theme="light"><head><meta charset="utf-8">'
        f"<title>{html.escape(title)}</title>"
        f"{styles}<style>{STYLE}</style>{re.sub('async', 'defer', mathjax)}</head><body>"
        f'<div class="title"><h1>{html.escape(title)}</h1></div>'
        f'<div class="contents"><h2>Contents</h2><ul>{contents}</ul></div>'
        f'<main class="bd-main"><div class="bd-content">{text}</div></main></body></html>'
    )


if __name__ == "__main__":
    main()
