"""Shared fixtures."""

import functools
import os
import resource
import shutil
import subprocess
import sys
import threading
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from click.testing import CliRunner
from filelock import FileLock
from hypothesis import settings

import himap
from himap.app.cli.main import main

# The same examples everywhere, however slow a machine is.
settings.register_profile("fixed", deadline=None, derandomize=True, database=None)
settings.load_profile("fixed")

ROOT = Path(__file__).resolve().parents[1]
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FONTS = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
FACES = {
    ("Test Sans", 400): "DejaVuSans",
    ("Test Sans", 700): "DejaVuSans-Bold",
    ("Test Mono", 400): "DejaVuSansMono",
}
SET_FONTS = """faces => {
    document.documentElement.style.setProperty('--pst-font-family-base', '"Test Sans"');
    document.documentElement.style.setProperty('--pst-font-family-heading', '"Test Sans"');
    document.documentElement.style.setProperty('--pst-font-family-monospace', '"Test Mono"');
    return Promise.all(faces.map(async ([family, weight, file]) => {
        const face = new FontFace(family, `url(/test-fonts/${file}.ttf)`, {weight: `${weight}`});
        document.fonts.add(await face.load());
    }));
}"""
"""Sets a page in fonts that come with matplotlib, so that no width depends on what is installed."""
SCREEN = {"width": 1280, "height": 720}
SHARED_SKY = ROOT.parent / "shared" / "sky"

LONGEST = [
    "test_book_browser",
    "11_ns_scan",
    "15_claims",
    "09_sdecgmca",
    "26_a_survey",
    "test_sdecgmca_ensemble",
]


def pytest_collection_modifyitems(items):
    """What takes longest comes first; the first also renders the book, before other files wait for that."""
    place = {name: n for n, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


@pytest.fixture(autouse=True, scope="module")
def private_cache(tmp_path_factory):
    """No test, and no fixture of a module, reads or fills the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HIMAP_CACHE", str(tmp_path_factory.getbasetemp() / "himap-cache"))
        yield


def run_python(*arguments, **variables):
    """A finished process of this Python, of this himap, with more variables in its environment."""
    environment = os.environ | {"PYTHONPATH": str(Path(himap.__file__).parents[1])} | variables
    return subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True)


@contextmanager
def little_room(n_bytes):
    """A limit on the size of files, in place of a full disk."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


@pytest.fixture
def ended():
    """The number of a process that is no more."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


@pytest.fixture
def rng():
    return np.random.default_rng(12345)


@pytest.fixture
def problem(rng):
    """Maps without noise, A and S of `sparse_problem.make_problem`."""
    from sparse_problem import make_problem  # it imports the transforms, which most tests do without

    return make_problem(rng)[:3]


@pytest.fixture
def maps(rng):
    """`cube_files.power_law_maps`; a module whose maps are others has a fixture of its own."""
    from cube_files import power_law_maps  # as above

    return power_law_maps(rng)


@pytest.fixture
def images(rng):
    """`cube_files.power_law_images`."""
    from cube_files import power_law_images  # as above

    return power_law_images(rng)


@pytest.fixture(scope="session")
def real_sky():
    """Folder of the real Galaxy templates (nside 64), which the project cannot ship."""
    if not SHARED_SKY.is_dir():
        pytest.skip("the real Galaxy templates (../shared/sky) are not on this machine")
    return SHARED_SKY


@pytest.fixture
def lab(tmp_path, monkeypatch, request):
    """A module of its own with products; says what it `computed`, and can `start` code on it elsewhere."""
    name = "lab_" + request.node.name.partition("[")[0]
    shutil.copy(Path(__file__).with_name("product_lab.py"), tmp_path / f"{name}.py")
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NOTES", str(tmp_path / "notes"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(Path(himap.__file__).parents[1])]))
    monkeypatch.syspath_prepend(str(tmp_path))
    module = __import__(name)
    (tmp_path / "notes").touch()
    module.computed = lambda: (tmp_path / "notes").read_text().split()
    module.start = lambda code: subprocess.Popen([sys.executable, "-c", f"import {name} as lab\n{code}"])
    yield module
    del sys.modules[name]


@pytest.fixture
def himap_command(tmp_path, monkeypatch):
    """Call the command in an empty folder; gives exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments, **options):
        result = CliRunner().invoke(main, arguments, **options)
        return result.exit_code, result.stdout, result.stderr

    return call


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder that is empty, and the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def no_pages(monkeypatch):
    """Commands on cubes write empty pages: to draw them takes longer than all the rest."""
    monkeypatch.setattr("himap.cubes.report.write_report", lambda cleaned, path, **_: Path(path).touch())
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)


@pytest.fixture(scope="session")
def html(tmp_path_factory):
    """The folder of the book, rendered once for all workers from what is committed; a warning is an error."""
    several = "PYTEST_XDIST_WORKER" in os.environ
    shared = tmp_path_factory.getbasetemp().parent if several else tmp_path_factory.mktemp("shared")
    folder, sources = shared / "book", shared / "sources"
    with FileLock(shared / "book.lock"):
        if not folder.exists():
            shutil.rmtree(sources, ignore_errors=True)
            shutil.copytree(ROOT / "notebooks", sources / "notebooks")
            for name in ("_config.yml", "_toc.yml"):
                shutil.copy(ROOT / name, sources)
            render_book(sources, "-W", "--keep-going").rename(folder)
            shutil.rmtree(sources)
    return folder


def render_book(folder, *options):
    """The folder of the pages of the book, rendered in a folder with its notebooks and configuration."""
    for name in ("CHANGELOG.md", "CITATION.cff"):
        shutil.copy(ROOT / name, folder)
    shutil.copytree(ROOT / "book", folder / "book")
    build = ["from jupyter_book.cli.main import main; main()", "build", str(folder), *options]
    outcome = subprocess.run([sys.executable, "-c", *build], capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stdout[-3000:] + outcome.stderr[-3000:]
    return folder / "_build" / "html"


class Quiet(SimpleHTTPRequestHandler):
    """Of the book, and the fonts that tests set it in."""

    def log_message(self, *args):
        pass

    def translate_path(self, path):
        font = path.startswith("/test-fonts/")
        return str(FONTS / Path(path).name) if font else super().translate_path(path)


@pytest.fixture(scope="session")
def address(html):
    """Where a server of the book listens."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=html))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")  # its event loop gets in the way of other tests
def browser():
    """A Chromium without window."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    from playwright.sync_api import sync_playwright  # most tests do without

    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def tabs():
    """{options: page}, for `visit`: a page that is opened anew costs as much as what it shows."""
    return {}


@pytest.fixture
def visit(browser, tabs, address):
    """Shows a page in place of the one before; `complaints` are its errors, `elsewhere` other hosts asked."""

    def shown(path, viewport=SCREEN, **options):
        key = repr(options)
        if key in tabs:
            tabs[key].evaluate("localStorage.clear()")
        else:
            tabs[key] = watched(browser.new_page(**options), address)
        page = tabs[key]
        page.set_viewport_size(viewport)
        page.complaints, page.elsewhere = [], []
        page.goto(f"{address}/{path}", wait_until="load")
        page.evaluate(SET_FONTS, [[*face, file] for face, file in FACES.items()])
        page.evaluate("window.MathJax?.startup?.promise")
        return page

    return shown


def watched(page, address):
    """A page that keeps its `complaints`, and what it asks `elsewhere`."""

    def ask(request):
        if not request.url.startswith((address, "data:", "blob:")):
            page.elsewhere.append(request.url)

    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("console", lambda said: page.complaints.append(said.text) if said.type == "error" else None)
    page.on("request", ask)
    return page
