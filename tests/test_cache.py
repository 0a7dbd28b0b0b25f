"""The folder of results: each complete or not there, computed by one process, listed and cleared."""

import json
import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
import zlib
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.core.survey import PRESETS
from himap.store import cache

SURVEY = PRESETS["ci"]
_FILES = ["0.npy", "note.json", "value.json"]


@pytest.fixture
def kept(lab):
    """The folder of a result of `lab.base`."""
    lab.base(SURVEY)
    (file,) = cache.cache_folder().rglob("0.npy")
    return file.parent


def _unfinished():
    return [path for path in cache.cache_folder().glob("*/unfinished*") if path.is_dir()]


def _refuse(*error):
    def refuse(*args, **options):
        raise OSError(*error)

    return refuse


def _alter(folder):
    content = bytearray((folder / "0.npy").read_bytes())
    content[len(content) // 2] ^= 1
    (folder / "0.npy").write_bytes(content)


def _tree(tree):
    """Another tree of the value, with its checksum."""

    def write(folder):
        (folder / "value.json").write_text(tree)
        note = json.loads((folder / "note.json").read_text())
        note["files"]["value.json"] = [len(tree), zlib.crc32(tree.encode())]
        (folder / "note.json").write_text(json.dumps(note))

    return write


@pytest.mark.parametrize(
    ("harm", "why"),
    [
        (lambda folder: os.truncate(folder / "0.npy", 100), "0.npy has another checksum"),
        (_alter, "0.npy has another checksum"),
        (lambda folder: (folder / "0.npy").unlink(), "No such file"),
        (lambda folder: (folder / "note.json").write_text("{"), ""),
        (_tree('{"array": "/etc/passwd"}'), "no array of this folder"),
        (_tree('{"class": ["antigravity", "fly"], "fields": {}}'), "there is no class"),
        (_tree('{"class": ["os", "system"], "fields": {}}'), "there is no class"),
        (_tree('{"class": ["himap.core.errors", "InputError"], "fields": {}}'), "there is no class"),
        # The rest of a deletion that was killed, say: there is no result.
        (lambda folder: (folder / "note.json").unlink(), None),
        (lambda folder: [file.unlink() for file in folder.iterdir()], None),
        (lambda folder: (shutil.rmtree(folder), folder.touch()), None),
    ],
)
def test_a_damaged_result_is_computed_again_with_a_warning(lab, kept, harm, why):
    """Reading runs and imports nothing; where there is no result there is no warning."""
    harm(kept)
    message = f"cached base is damaged and is computed again .*{why}"
    with pytest.warns(UserWarning, match=message) if why is not None else nullcontext():
        np.testing.assert_array_equal(lab.base(SURVEY), 2 * np.arange(100))
    lab.base(SURVEY)
    assert lab.computed() == ["base", "base"] and sorted(os.listdir(kept)) == _FILES
    assert not _unfinished() and "antigravity" not in sys.modules


@pytest.mark.parametrize("error", [(24, "too many open files"), (13, "Permission denied")])
def test_what_the_machine_refuses_is_no_damage(lab, kept, monkeypatch, error):
    with monkeypatch.context() as patched:
        patched.setattr("numpy.load", _refuse(*error))
        with pytest.raises(InputError, match=f"base cannot be read .*{error[1]}"):
            lab.base(SURVEY)
    lab.base(SURVEY)
    assert lab.computed() == ["base"]


_AT_WORK = """
import time
from himap.store.cache import workplace
with workplace("base", "a", 10) as folder:
    (folder / "part").write_text("half")
    {then}
"""


@pytest.mark.parametrize("how", ["killed", "interrupted", "failed"])
def test_work_in_files_that_is_interrupted_goes_on(lab, how):
    """Another process waits, and what is made for another result is another folder."""
    then = {"killed": "time.sleep(60)", "interrupted": "raise KeyboardInterrupt", "failed": "raise OSError"}
    command = [sys.executable, "-c", _AT_WORK.format(then=then[how])]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    if how == "killed":
        lab.wait_for(lambda: [path for path in _unfinished() if (path / "part").exists()])
        with cache.workplace("base", "b", 10) as folder:
            assert not (folder / "part").exists()
        threading.Timer(0.3, process.kill).start()
    else:
        process.wait()
    with cache.workplace("base", "a", 10) as folder:
        assert process.wait() and (folder / "part").exists() == (how != "failed")
    assert not _unfinished()


def test_writers_at_work_go_on(lab, kept):
    hosts = (socket.gethostname(), "elsewhere")
    names = {f"unfinished-{host}-{os.getpid()}-0123abcd" for host in hosts}
    for name in names:
        (kept.parent / name).mkdir()
    lab.base(SURVEY, scale=2.0)
    assert {path.name for path in _unfinished()} == names
    unfinished = [entry for entry in cache.cache_info() if entry.product == "unfinished"]
    assert cache.clear_cache(unfinished) == 0 and not _unfinished()


@pytest.mark.parametrize("is_killed", [False, True])
def test_two_processes_compute_a_result_once(lab, tmp_path, is_killed):
    """The second waits for the first, and takes over where that is killed."""
    gate = str(tmp_path / "gate")
    check = f"assert lab.slow(1000, gate={gate!r}).sum() == 1000"
    processes = [lab.start(check)]
    lab.wait_for(lambda: lab.computed() == ["slow"])
    processes.append(lab.start(f"lab.note('asks')\n{check}"))
    lab.wait_for(lambda: len(lab.computed()) == 2)
    time.sleep(0.3)
    assert lab.computed() == ["slow", "asks"]
    if is_killed:
        processes[0].kill()
        lab.wait_for(lambda: len(lab.computed()) == 3)
    Path(gate).touch()
    assert [process.wait() for process in processes] == [-signal.SIGKILL * is_killed, 0]
    assert lab.slow(1000, gate=gate).sum() == 1000
    assert lab.computed().count("slow") == 1 + is_killed and not list(cache.cache_folder().rglob("*.lock"))


def test_without_locks_two_at_once_keep_one_result(lab, monkeypatch):
    """As on a file system that has none."""
    monkeypatch.setattr("filelock.FileLock.acquire", _refuse(95, "not supported"))
    note = lab.note

    def other_computes_first(name):
        monkeypatch.setattr(lab, "note", note)
        lab.base(SURVEY)
        note(name)

    monkeypatch.setattr(lab, "note", other_computes_first)
    np.testing.assert_array_equal(lab.base(SURVEY), 2 * np.arange(100))
    assert lab.computed() == ["base", "base"] and len(cache.cache_info()) == 1 and not _unfinished()


def test_a_folder_that_can_only_be_read_is_read(lab, kept, monkeypatch):
    monkeypatch.setattr(Path, "touch", _refuse(30, "Read-only file system"))
    assert lab.base(SURVEY).size == 100
    with pytest.raises(InputError, match="base cannot be kept .*Read-only"):
        lab.base(SURVEY, scale=2.0)
    monkeypatch.setenv("HIMAP_CACHE", str(kept / "0.npy" / "cache"))  # below a file
    with pytest.raises(InputError, match="HIMAP_CACHE"):
        lab.base(SURVEY, scale=2.0)
    assert lab.computed() == ["base"]  # said before the work


def test_a_disk_that_is_full_is_one_clear_error(lab):
    """A limit on the size of files stands for the end of the disk."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (10**6,) * 2)"
    code = f"{limit}; import {lab.__name__} as lab; lab.slow(10**6)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    error = done.stderr.strip().splitlines()[-1]
    assert "slow cannot be kept in" in error and "GB are free. Free space with `himap cache clear`" in error
    assert not _unfinished() and not cache.cache_info()


@pytest.mark.parametrize("text", ["[]", "3", "{", '{"seconds": "x", "product": null}', "\0"])
def test_a_note_of_any_text_is_listed(kept, text):
    (kept / "note.json").write_text(text)
    assert len(cache.cache_info()) == 1
    cache.clear_cache()
    assert not kept.exists()


def test_what_himap_did_not_make_is_neither_listed_nor_cleared(kept, tmp_path):
    """HIMAP_CACHE may name a folder that holds other things too, and links: of a product or of a result."""
    project, elsewhere = cache.cache_folder() / "project", tmp_path / "elsewhere"
    names = ("data/thesis.txt", "unfinished-draft/note.json", "models/value.pkl")
    others = [project / name for name in names]
    for path in others:
        path.parent.mkdir(parents=True)
        path.write_text("{}")
    shutil.copytree(kept.parent, elsewhere)
    (cache.cache_folder() / "link").symlink_to(elsewhere)
    (kept.parent / ("0" * 32)).symlink_to(next(elsewhere.iterdir()))
    assert len(cache.cache_info()) == 1
    cache.clear_cache()
    assert all(path.exists() for path in others) and not cache.cache_info()
    assert sorted(path.name for path in elsewhere.glob("*/*")) == _FILES


def test_what_cannot_be_deleted_is_an_error(kept, monkeypatch):
    monkeypatch.setattr(Path, "rename", _refuse(13, "Permission denied"))
    with pytest.raises(InputError, match="1 of 1 results could not be deleted"):
        cache.clear_cache()


def test_a_result_that_is_deleted_meanwhile_is_no_damage(lab, monkeypatch):
    """As soon as it is kept, or while it is read, by another process; warnings are errors here."""
    save, read = cache.save, cache.read_value
    expected = 2 * np.arange(100)
    with monkeypatch.context() as patched:
        patched.setattr(cache, "save", lambda *args, **given: save(*args, **given) or cache.remove(*args[:2]))
        np.testing.assert_array_equal(lab.base(SURVEY), expected)
    lab.base(SURVEY)
    with monkeypatch.context() as patched:
        patched.setattr(cache, "read_value", lambda folder: lab.base.forget(SURVEY) or read(folder))
        np.testing.assert_array_equal(lab.base(SURVEY), expected)
    assert lab.computed() == ["base"] * 3


def test_a_deletion_that_is_killed_leaves_no_half_result(lab, kept):
    kill = "import os, shutil, signal; shutil.rmtree = lambda *a, **b: os.kill(os.getpid(), signal.SIGKILL)"
    process = lab.start(f"{kill}\nfrom himap.store import cache\ncache.clear_cache()")
    assert process.wait() == -signal.SIGKILL
    assert [entry.product for entry in cache.cache_info()] == ["unfinished"]
    lab.base(SURVEY)
    assert not _unfinished()


def test_the_folder_is_for_its_owner_alone(lab, request):
    before = os.umask(0)
    try:
        folder = request.getfixturevalue("kept")
    finally:
        os.umask(before)
    assert {stat.S_IMODE(path.stat().st_mode) for path in (folder, *folder.parents[:2])} == {0o700}


USES = [lambda lab: lab.base(SURVEY), lambda lab: cache.cache_info(), lambda lab: cache.clear_cache()]


@pytest.mark.parametrize("use", USES)
def test_a_folder_of_others_or_that_they_can_write_to_is_refused(lab, kept, monkeypatch, use):
    for mode in (0o777, 0o770, 0o722):
        cache.cache_folder().chmod(mode)
        with pytest.raises(InputError, match="other users can write .* `chmod go-w .*HIMAP_CACHE"):
            use(lab)
    cache.cache_folder().chmod(0o755)
    with (
        monkeypatch.context() as patched,
        pytest.raises(InputError, match="belongs to the user with number .*HIMAP_CACHE"),
    ):
        patched.setattr("os.geteuid", lambda: 12345)
        use(lab)
    use(lab)
