"""make sets up once, renders what changed, and does nothing twice."""

import os
import re
import shutil
import subprocess
import time

import pytest
from conftest import ROOT

COPIED = ["Makefile", "requirements.txt", "requirements.lock", "pyproject.toml", "_config.yml", "_toc.yml"]
COPIED += ["CHANGELOG.md", "CITATION.cff"]
FAKE_PYTHON = """#!/bin/sh
# In place of python, himap and jupyter-book: notes what it was asked, makes what make looks for.
[ "$1" = -c ] && exit 0
echo "$(basename "$0") $*" >> log
if [ "$2" = venv ]; then
    mkdir -p .venv/bin
    for name in python himap jupyter-book; do cp "$0" .venv/bin/$name; done
fi
[ "$1" = build ] && mkdir -p _build/html
case "$*" in *"$(cat fails 2>/dev/null || echo nothing)"*) exit 1;; esac
exit 0
"""


class Workshop:
    """A copy of the project where make runs a fake python, and the log of what it was asked."""

    def __init__(self, folder):
        self.folder = folder
        for name in COPIED:
            shutil.copy(ROOT / name, folder)
        for name in ("book/intro.md", "notebooks/04_pca.ipynb"):
            (folder / name).parent.mkdir()
            (folder / name).touch()
        (folder / "fake-python").write_text(FAKE_PYTHON)
        (folder / "fake-python").chmod(0o755)

    def make(self, target, *more):
        """Exit code of make, and the programs it ran."""
        (self.folder / "log").write_text("")
        quiet = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
        make = ["make", target, "PYTHON=./fake-python", *more]
        code = subprocess.run(make, cwd=self.folder, env=quiet, capture_output=True).returncode
        lines = (self.folder / "log").read_text().splitlines()
        return code, [re.sub(r" -[qW-].*| \..*| -r.*", "", line) for line in lines]

    def edit(self, name):
        time.sleep(0.02)
        (self.folder / name).touch()


@pytest.fixture
def workshop(tmp_path):
    return Workshop(tmp_path)


SETUP = ["fake-python -m venv", "python -m pip install"]
REFRESH = ["himap run", "python book/readme_figure.py", "python book/metadata.py"]
TESTS = ["python -m pytest -n 2"]


@pytest.mark.parametrize("lock", [[], ["LOCK=1"]])
def test_make_sets_up_once(workshop, lock):
    """Also what the lock names."""
    assert workshop.make("setup", *lock) == (0, [*SETUP, *SETUP[1:] * len(lock)])
    assert workshop.make("setup", *lock) == (0, [])
    workshop.edit("requirements.txt")
    assert workshop.make("setup") == (0, SETUP)


def test_failed_install_is_tried_again(workshop):
    (workshop.folder / "fails").write_text("pip install")
    assert workshop.make("setup")[0] != 0
    (workshop.folder / "fails").unlink()
    assert workshop.make("test") == (0, [*SETUP, *TESTS])


def test_make_book_renders_when_something_changed(workshop):
    assert workshop.make("book") == (0, [*SETUP, *REFRESH, "jupyter-book build"])
    assert workshop.make("book") == (0, REFRESH)
    for name in ("notebooks/04_pca.ipynb", "book/intro.md", "_toc.yml", "CHANGELOG.md"):
        workshop.edit(name)
        assert workshop.make("book") == (0, [*REFRESH, "jupyter-book build"])


def test_book_with_a_warning_is_rendered_again(workshop):
    (workshop.folder / "fails").write_text("build")
    assert workshop.make("book")[0] != 0
    assert workshop.make("book") != (0, REFRESH)
    (workshop.folder / "fails").unlink()
    assert workshop.make("book") == (0, [*REFRESH, "jupyter-book build"])


def test_make_pdf_prints_the_rendered_book(workshop):
    book = [*SETUP, *REFRESH, "jupyter-book build"]
    assert workshop.make("pdf") == (0, [*book, "python book/print_pdf.py _build/html _build/himap.pdf"])
