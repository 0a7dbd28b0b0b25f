"""Files that are written whole or not at all, also when the process is killed between two of them."""

import errno
import os
import signal
import socket
from pathlib import Path

import pytest
from conftest import little_room, run_python

from himap.core.errors import InputError
from himap.core.files import atomic_files, check_free, complete_abandoned

NAMES = ("a.txt", "b.txt", "c.txt")

KILLED = """
import os, signal
from himap.core import files

calls = []

def replace(source, target):
    calls.append(source)
    if len(calls) > {after}:
        os.kill(os.getpid(), signal.SIGKILL)
    rename(source, target)

rename, os.replace = os.replace, replace
with files.atomic_files(*{names}) as files:
    for file in files:
        file.write_text("new")
"""


def killed(after):
    """A process that writes `NAMES` here and is killed after so many renames, the list of them included."""
    done = run_python("-c", KILLED.format(after=after, names=NAMES))
    assert done.returncode == (-signal.SIGKILL if after < 4 else 0)


def held():
    return {name: Path(name).read_text() for name in os.listdir() if Path(name).is_file()}


@pytest.mark.parametrize("after", range(5))
@pytest.mark.parametrize("before", [{}, dict.fromkeys(NAMES, "old")], ids=["new", "over old"])
def test_a_set_is_there_or_not_wherever_it_is_killed(tmp_path, monkeypatch, before, after):
    """And what was killed does not stand in the way of the rerun."""
    monkeypatch.chdir(tmp_path)
    paths = [Path(name) for name in NAMES]
    for name, text in before.items():
        Path(name).write_text(text)
    killed(after)
    assert len(os.listdir()) > len(held()) or after == 4
    if after < 4 and not (before and not after):
        check_free(paths, overwrite=False)
    complete_abandoned(Path())
    assert held() == (dict.fromkeys(NAMES, "new") if after else before)
    assert set(os.listdir()) == set(held())
    with atomic_files(*NAMES) as files:
        for file in files:
            file.write_text("again")
    assert held() == dict.fromkeys(NAMES, "again") and len(os.listdir()) == 3
    with pytest.raises(InputError, match="a.txt exists"):
        check_free(paths, overwrite=False)


def test_what_is_being_written_is_left_alone(tmp_path):
    with atomic_files(tmp_path / "a") as (first,):
        first.write_text("1")
        with atomic_files(tmp_path / "b") as (second,):
            second.write_text("2")
        assert complete_abandoned(tmp_path) == set()
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]


def test_a_list_renames_nothing_elsewhere(tmp_path, ended):
    """A folder that somebody laid there, with paths that lead out of it."""
    (tmp_path / "victim").write_text("mine")
    left = tmp_path / "home" / f".himap-{socket.gethostname()}-{ended}-0123abcd"
    left.mkdir(parents=True)
    (left / "victim").write_text("theirs")
    (left / ".whole").write_text('["../victim"]')
    complete_abandoned(tmp_path / "home")
    assert (tmp_path / "victim").read_text() == "mine" and not left.exists()


def test_an_error_leaves_nothing(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_files(tmp_path / "c"):  # of another file, and no fault of c
        (tmp_path / "gone").read_text()
    with pytest.raises(KeyError), atomic_files(tmp_path / "a", tmp_path / "b") as (first, _):
        first.write_text("1")
        raise KeyError
    assert os.listdir(tmp_path) == []


def test_the_file_that_cannot_be_written_is_named(tmp_path):
    """Here the second."""
    files = [tmp_path / name for name in NAMES]
    message = f"b.txt cannot be written .{os.strerror(errno.EFBIG)}"
    with pytest.raises(InputError, match=message), atomic_files(*files) as temporary:
        temporary[0].write_text("small")
        with little_room(1000):
            temporary[1].write_text("x" * 10**6)
    assert os.listdir(tmp_path) == []
