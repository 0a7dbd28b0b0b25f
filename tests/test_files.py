"""Files: written whole or not at all, folders put in order after killed processes, private compiled code."""

import errno
import os
import shutil
import signal
import socket
import stat
import time
from pathlib import Path

import pytest
from conftest import little_room, run_python
from jupyter_client.session import Session

from himap.app.kernels import LocalKernelManager
from himap.core import files
from himap.core.errors import InputError
from himap.core.files import atomic_files, check_free, complete_abandoned, is_abandoned, run_folder


def folder(home, pid, host=None, prefix="himap"):
    path = home / f"{prefix}-{host or socket.gethostname()}-{pid}-0123abcd"
    path.mkdir()
    return path


def test_only_what_ended_here_is_abandoned(tmp_path, ended):
    """Or has a number that another process has now."""
    assert is_abandoned(folder(tmp_path, ended))
    assert not is_abandoned(folder(tmp_path, ended, host="elsewhere"))
    ours = folder(tmp_path, os.getpid())
    assert not is_abandoned(ours)
    os.utime(ours, (time.time() - 10**6,) * 2)
    assert is_abandoned(ours)
    for name in (files.unfinished_name("himap"), "himap-thesis"):
        (tmp_path / name).mkdir()
        assert not is_abandoned(tmp_path / name)


def test_links_and_folders_of_others_are_not_abandoned(tmp_path, ended, monkeypatch):
    (tmp_path / "thesis").mkdir()
    link = tmp_path / f"himap-{socket.gethostname()}-{ended}-89abcdef"
    link.symlink_to(tmp_path / "thesis")
    assert not is_abandoned(link)
    theirs = folder(tmp_path, ended)
    monkeypatch.setattr("os.geteuid", lambda: 12345)
    assert not is_abandoned(theirs)


@pytest.fixture
def fresh(monkeypatch):
    """`run_folder` as in a new process."""
    run_folder.cache_clear()
    yield
    if run_folder.cache_info().currsize:
        shutil.rmtree(run_folder(), ignore_errors=True)  # it may have gone with the test's own folder
    run_folder.cache_clear()


def test_files_of_a_killed_run_go_at_the_next_start(fresh, monkeypatch, tmp_path, ended):
    """Its folder, and the semaphores of the processes that worked for it, and of no others."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(files, "_LONGEST", 10**4)
    (tmp_path / "shm").mkdir()
    monkeypatch.setattr(files, "_SEMAPHORES", tmp_path / "shm")
    left = folder(tmp_path, ended)
    (left / "ipython").mkdir()
    (left / "123456.worker").touch()
    names = [f"sem.loky-{pid}-abc" for pid in (ended, 123456, os.getpid(), f"{ended}0")]
    for name in names:
        (tmp_path / "shm" / name).touch()
    assert run_folder().parent == tmp_path and run_folder().stat().st_mode & 0o777 == 0o700
    assert not left.exists() and sorted(os.listdir(tmp_path / "shm")) == sorted(names[2:])


def test_a_killed_process_is_followed_by_one_that_cleans(tmp_path):
    code = "import os, signal; from himap.core.files import run_folder; print(run_folder()); {}"
    for end, status in (("os.kill(os.getpid(), signal.SIGKILL)", -signal.SIGKILL), ("pass", 0)):
        assert run_python("-c", code.format(end), TMPDIR=str(tmp_path)).returncode == status
        if len(os.fsencode(tmp_path)) < files._LONGEST:
            assert len(os.listdir(tmp_path)) == (status != 0)


def test_a_long_name_of_the_temporary_folder_leaves_room_for_sockets(fresh, monkeypatch, tmp_path):
    """A kernel starts, and all that it needs lies in one folder."""
    long = tmp_path / ("x" * 120)
    long.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(long))
    assert run_folder().parent == Path("/tmp")
    manager = LocalKernelManager(kernel_name="python3", session=Session())
    manager.start_kernel()
    try:
        client = manager.client()
        client.start_channels()
        client.wait_for_ready(timeout=60)
        assert manager.transport == "ipc" and Path(manager.connection_file).parent == run_folder()
        client.stop_channels()
    finally:
        manager.shutdown_kernel(now=True)
    assert not os.listdir(long)


def test_no_temporary_folder(fresh, monkeypatch):
    monkeypatch.setattr("tempfile.gettempdir", lambda: "/dev/null")
    with pytest.raises(InputError, match="name one with the variable TMPDIR"):
        run_folder()


@pytest.fixture
def kept_in(monkeypatch, tmp_path):
    """Function to the folder of compiled code; the user's cache and that of results are in `tmp_path`."""
    monkeypatch.setattr(files, "user_cache", lambda: tmp_path / "user")
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "results"))

    def call():
        monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
        files.keep_compiled_code()
        return Path(os.environ["NUMBA_CACHE_DIR"])

    return call


def test_compiled_code_is_kept_for_the_owner_alone(kept_in, tmp_path, monkeypatch):
    assert kept_in() == tmp_path / "user" / "numba" and stat.S_IMODE(kept_in().stat().st_mode) == 0o700
    monkeypatch.setenv("NUMBA_CACHE_DIR", "chosen")
    files.keep_compiled_code()
    assert os.environ["NUMBA_CACHE_DIR"] == "chosen"


def test_where_others_could_put_code_none_is_read(kept_in, tmp_path, fresh, monkeypatch):
    (tmp_path / "shared").mkdir(mode=0o700)
    (tmp_path / "shared").chmod(0o777)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "shared"))
    with pytest.warns(UserWarning, match="not kept in NUMBA_CACHE_DIR: other users can write"):
        files.keep_compiled_code()
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "user" / "numba")
    kept_in().chmod(0o777)
    assert kept_in() == tmp_path / "results" / "numba"
    shutil.rmtree(tmp_path / "results")
    (tmp_path / "results").touch()
    assert kept_in() == run_folder() / "numba"


def test_numba_follows(tmp_path, monkeypatch):
    code = "from himap.removal.sdecgmca import scales; import numba; print(numba.config.CACHE_DIR)"
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    done = run_python("-c", code, XDG_CACHE_HOME=str(tmp_path))
    assert done.stdout.strip() == str(tmp_path / "himap" / "numba")


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
    with atomic_files(*NAMES) as again:
        for file in again:
            file.write_text("again")
    assert held() == dict.fromkeys(NAMES, "again") and len(os.listdir()) == 3
    with pytest.raises(InputError, match="a.txt exists"):
        check_free(paths, overwrite=False)


def test_a_set_that_two_processes_complete_at_once_is_not_lost(tmp_path, ended, monkeypatch):
    left = folder(tmp_path, ended, prefix=".himap")
    for name in "ab":
        (left / name).write_text(name)
    (left / ".whole").write_text('["a", "b"]')
    rename = os.replace

    def rename_after_the_other(file, target):
        if file.name == "a":
            rename(file, target)
        rename(file, target)

    monkeypatch.setattr(os, "replace", rename_after_the_other)
    assert complete_abandoned(tmp_path) == {tmp_path / "a", tmp_path / "b"}
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]


def test_complete_files_are_kept_if_something_is_in_their_place(tmp_path, ended):
    left = folder(tmp_path, ended, prefix=".himap")
    (left / "a").write_text("mine")
    (left / ".whole").write_text('["a"]')
    (tmp_path / "a").mkdir()
    assert complete_abandoned(tmp_path) == set() and (left / "a").read_text() == "mine"
    (tmp_path / "a").rmdir()
    assert complete_abandoned(tmp_path) == {tmp_path / "a"} and (tmp_path / "a").read_text() == "mine"
    assert not left.exists()


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
    (tmp_path / "home").mkdir()
    left = folder(tmp_path / "home", ended, prefix=".himap")
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
    paths = [tmp_path / name for name in NAMES]
    message = f"b.txt cannot be written .{os.strerror(errno.EFBIG)}"
    with pytest.raises(InputError, match=message), atomic_files(*paths) as temporary:
        temporary[0].write_text("small")
        with little_room(1000):
            temporary[1].write_text("x" * 10**6)
    assert os.listdir(tmp_path) == []
