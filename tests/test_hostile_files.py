"""Malformed input: each is one clear error with exit code 2, in time, and nothing is written."""

import os
import re
import shutil
import signal
import warnings
from collections import Counter
from contextlib import contextmanager

import numpy as np
import pytest
from click.testing import CliRunner
from hostile_files import BY_HAND, write_good
from mutations import KINDS, SOURCES, mutated

from himap.cli.main import main
from himap.cubes import cleaning

COMMANDS = ("clean", "suggest", "sensitivity", "transfer", "claims", "readings")
LONGEST = 5000  # characters of what is said
SECONDS = 20
EACH = 8  # mutations of each kind and file


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder, before = tmp_path_factory.mktemp("good"), os.getcwd()
    os.chdir(folder)
    write_good()
    os.chdir(before)
    return folder


@pytest.fixture
def here(good, tmp_path, monkeypatch):
    """A folder with a good file of each kind."""
    monkeypatch.chdir(shutil.copytree(good, tmp_path / "here"))
    return tmp_path / "here"


@contextmanager
def in_time():
    def too_late(*_):
        raise TimeoutError(f"it took more than {SECONDS} s")

    before = signal.signal(signal.SIGALRM, too_late)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def himap(words):
    """The outcome of a command line, with what it needs in any case."""
    words = [str(word) for word in words]
    words = words if words[0] in COMMANDS else ["clean", *words]
    defaults = {"clean": {"--method": "pca", "-o": "out.h5"}}.get(words[0], {})
    for option, value in defaults.items():
        words += [] if option in words else [option, value]
    with in_time(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # in a shell they are none that end a command
        return CliRunner().invoke(main, words)


def contents(folder):
    """What there is, and when it was written."""
    return {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}


def check_refused(done, message=""):
    """One paragraph of text that can be read, and exit code 2."""
    assert done.exit_code == 2, (done.output, done.exception)
    error = re.search(r"^Error: (.*)\n\Z", done.output, re.M)
    assert error and message.lower() in error[1].lower(), done.output
    assert len(done.output) < LONGEST and done.output.replace("\n", "").isprintable()


@pytest.mark.parametrize("name", BY_HAND)
def test_by_hand(name, here):
    words, message = BY_HAND[name]()
    before = contents(here)
    check_refused(himap(words), message)
    assert contents(here) == before


class _Read(Exception):
    """Instead of the work: the files could be read."""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("source", SOURCES)
def test_mutations(source, kind, good, here, monkeypatch):
    """What is damaged is refused, or read: the damage may have met a comment, or a digit."""

    def instead(*_, **__):
        raise _Read

    monkeypatch.setattr(cleaning, "clean_cube", instead)
    rng = np.random.default_rng([2025, len(kind), len(source)])
    outcomes = Counter()
    for _ in range(EACH):
        (here / source).write_bytes(mutated(source, kind, rng))
        before = contents(here)
        done = himap(SOURCES[source][0])
        read = isinstance(done.exception, _Read)
        outcomes[read] += 1
        if not read:
            check_refused(done)
        assert contents(here) == before
        shutil.copy(good / source, here)
    if kind in ("cut", "of another file") and not source.endswith(".txt"):
        assert outcomes[True] == 0
