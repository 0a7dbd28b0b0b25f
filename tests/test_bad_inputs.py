"""Malformed input: each is one clear error with exit code 2, in time, and nothing is written."""

import os
import re
import shutil
import signal
import warnings
from contextlib import contextmanager
from unittest import mock

import pytest
from bad_inputs import BAD, READING, write_good
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from himap.app.cli.main import main
from himap.cubes import cleaning

COMMANDS = ("clean", "suggest", "sensitivity", "transfer", "measure", "run")
LONGEST = 5000  # characters of what is said
SECONDS = 20
SOURCES = {  # by the part that says what the rest is: (words of the command, its length in bytes)
    "good.h5": (["good.h5"], 2400),
    "good.fits": (["good.fits"], 2880 * 4),
    "part.fits": (["part.fits"], 2880 * 4),
    "image.fits": (["image.fits"], 2880),
    "good.npy": (["good.npy", *READING], 128),
    "nu.npy": (["good.npy", "--freqs", "nu.npy", "--unit", "mK"], 128),
    "bl.npy": (["good.h5", "--beam", "bl.npy"], 128),
    "widths.txt": (["good.h5", "--beam", "widths.txt"], 600),
    "mask.fits": (["good.h5", "--mask", "mask.fits"], 2880 * 2),
}


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
    words = words if words[0] in COMMANDS else ["clean", *words]
    defaults = {"clean": {"--method": "pca", "-o": "out.h5"}}.get(words[0], {})
    if words[0] in ("sensitivity", "transfer"):
        defaults = {"--method": "pca", "-o": "out.html"}
    for option, value in defaults.items():
        words = words if option in words else [*words, option, value]
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


@pytest.mark.parametrize(
    ("words", "message", "write"), BAD, ids=[" ".join([*one[0], one[1]])[:80] for one in BAD]
)
def test_by_hand(words, message, write, here):
    if write is not None:
        write()
    before = contents(here)
    check_refused(himap(words), message)
    assert contents(here) == before


@settings(max_examples=60)
@given(st.text(max_size=300), st.sampled_from(["", "--freqs", "--mask", "--weights", "--truth", "--maps"]))
def test_names_that_nobody_has(name, option):
    """Whatever is in them: of the cube, of other files, of datasets."""
    words = ["nothing.h5", option, name] if option else [name + "?"]
    check_refused(himap(words))


@st.composite
def damage(draw, head):
    """A function of the bytes of a file: a part cut off, zeroed, put in, changed, or of another."""
    kind = draw(st.sampled_from(["cut", "zeroed", "put in", "changed", "of another file"]))
    place, other = draw(st.integers(0, head - 81)), draw(st.integers(0, head - 81))
    some = draw(st.binary(min_size=1, max_size=16))

    def damaged(data):
        if kind == "of another file":
            source = "nu.txt" if data.startswith(b"\x89HDF") else "good.h5"
            with open(source, "rb") as file:
                return file.read(64 + other % 500) + data[head:]
        ways = {"cut": (b"", len(data)), "zeroed": (bytes(80), 80), "put in": (some, 0)}
        more, gone = ways.get(kind, (some, len(some)))
        return data[:place] + more + data[place + gone :]

    return kind, damaged


class _Read(Exception):
    """Instead of the work: the files could be read."""


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # astropy leaves files open
@pytest.mark.parametrize("source", SOURCES)
def test_damaged_files(source, good, here):
    """What is damaged is refused, or read: the damage may have met a comment, or a digit."""
    words, head = SOURCES[source]
    data = (good / source).read_bytes()

    @settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
    @given(damage(min(head, len(data))))
    def refused_or_read(found):
        kind, damaged = found
        (here / source).write_bytes(damaged(data))
        before = contents(here)
        done = himap(words)
        if not isinstance(done.exception, _Read):
            check_refused(done)
        elif kind in ("cut", "of another file"):
            assert source.endswith(".txt")
        assert contents(here) == before

    with mock.patch.object(cleaning, "clean_cube", side_effect=_Read):
        refused_or_read()
