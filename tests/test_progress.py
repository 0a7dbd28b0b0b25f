"""Bars on a terminal, lines in the log of a command, silence elsewhere."""

import fcntl
import os
import pty
import select
import struct
import termios

import pytest
from conftest import run_python

from himap.core.progress import TERMINAL_VARIABLE, progress


@pytest.fixture
def terminal():
    """A terminal: the path to write to and a function that reads on until a text was written, for 10 s."""
    leader, follower = pty.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))

    def read(text):
        found = ""
        while text not in found and select.select([leader], [], [], 10)[0]:
            found += os.read(leader, 65536).decode()
        return found

    yield os.ttyname(follower), read
    os.close(leader)
    os.close(follower)


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Bars appear at once, not only when work takes its time."""
    monkeypatch.setattr("himap.core.progress._DELAY", 0)


def test_silent_without_a_terminal(capfd, monkeypatch, tmp_path):
    for path in ["", str(tmp_path / "gone"), str(tmp_path / "file")]:
        (tmp_path / "file").touch()
        monkeypatch.setenv(TERMINAL_VARIABLE, path)
        assert list(progress(range(3), "work")) == [0, 1, 2]
    assert capfd.readouterr() == ("", "")
    assert (tmp_path / "file").read_text() == ""


def test_lines_of_a_command_without_a_terminal(capfd, monkeypatch):
    """As in a log: no bar, and no character that goes back."""
    monkeypatch.setattr("himap.core.progress._EVERY", 0)
    monkeypatch.setattr("himap.core.progress.in_lines", True)
    for _ in progress(range(3), "work"):
        list(progress(range(2), "part"))
    said = capfd.readouterr()
    assert said.out == "" and "work: 1 of 3, 00:00 passed" in said.err and "part: 1 of 2" in said.err
    assert "\r" not in said.err and "\x1b" not in said.err and "\n\n" not in said.err
    monkeypatch.setattr("himap.core.progress.in_lines", False)
    assert list(progress(range(3), "work")) == [0, 1, 2]
    assert capfd.readouterr() == ("", "")


def test_a_bar_on_the_terminal_that_is_named(terminal, capfd, monkeypatch):
    """Of things one after the other, and of steps by hand."""
    path, read = terminal
    monkeypatch.setenv(TERMINAL_VARIABLE, path)
    assert list(progress(range(3), "channels")) == [0, 1, 2]
    assert "channels" in read("channels") and capfd.readouterr() == ("", "")
    with progress(description="realisations", total=4) as bar:
        bar.update(2)
        bar.refresh()
    assert "2/4" in read("2/4")


def test_what_is_quick_has_no_bar(terminal, monkeypatch):
    path, read = terminal
    monkeypatch.setenv(TERMINAL_VARIABLE, path)
    monkeypatch.setattr("himap.core.progress._DELAY", 60)
    assert list(progress(range(3), "quick")) == [0, 1, 2]
    with open(path, "w") as screen:
        screen.write("the end")
    assert read("the end") == "the end"


def test_no_thread_looks_after_bars():
    """tqdm's own warns on standard error if bars begin and end while it looks, in notebooks too."""
    code = (
        "import threading; from himap.core.progress import progress; "
        "list(progress(range(3))); print(threading.active_count())"
    )
    assert run_python("-c", code).stdout == "1\n"
