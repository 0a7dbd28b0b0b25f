"""The folder of results: each whole or not at all, listed and cleared."""

import json
import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.core.survey import PRESETS
from himap.store import cache

SURVEY = PRESETS["ci"]


def _value_file():
    (file,) = cache.cache_folder().rglob("0.npy")
    return file


def _cut(file):
    file.write_bytes(file.read_bytes()[:-8])


def _alter(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize(
    ("harm", "why"),
    [(_cut, "it has .* of .* bytes"), (_alter, "its checksum is another"), (Path.unlink, "No such file")],
)
def test_a_damaged_result_is_computed_again_with_a_warning(lab, harm, why):
    lab.base(SURVEY)
    harm(_value_file())
    with pytest.warns(UserWarning, match=f"cached .*base is damaged and is computed again .*{why}"):
        again = lab.base(SURVEY)
    np.testing.assert_array_equal(again, 2 * np.arange(100))
    assert lab.computed() == ["base", "base"]
    lab.base(SURVEY)
    assert len(lab.computed()) == 2


def test_a_damaged_note_is_noticed(lab):
    lab.base(SURVEY)
    _value_file().with_name("note.json").write_text("{")
    with pytest.warns(UserWarning, match="is damaged and is computed again"):
        lab.base(SURVEY)
    assert lab.computed() == ["base", "base"]


def test_what_the_machine_refuses_is_no_damage(lab, monkeypatch):
    lab.base(SURVEY)

    def refuse(*args, **options):
        raise OSError(24, "too many open files")

    with monkeypatch.context() as patched, pytest.raises(OSError, match="too many open files"):
        patched.setattr("numpy.load", refuse)
        lab.base(SURVEY)
    lab.base(SURVEY)
    assert lab.computed() == ["base"]


def _wait_for(condition):
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def _unfinished():
    return [path for path in cache.cache_folder().glob("*/*") if path.name.startswith("unfinished")]


def test_a_writer_that_is_killed_leaves_no_result(lab):
    size = 400_000_000 // 8
    process = lab.start(f"lab.slow({size})")
    _wait_for(_unfinished)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not lab.slow.is_cached(size)
    (left,) = cache.cache_info()
    assert left.product == "unfinished" and left.n_bytes < size * 8
    assert lab.slow(1000).sum() == 1000  # the next writer tidies up
    assert not _unfinished()


def test_what_an_earlier_himap_kept_is_listed_and_cleared(lab):
    folder = cache.cache_folder() / "pipeline.cleaned" / ("0" * 32)
    folder.mkdir(parents=True)
    (folder / "value.pkl").write_bytes(b"0" * 1000)
    (folder / "note.json").write_text('{"product": "pipeline.cleaned"}')
    (entry,) = cache.cache_info()
    assert entry.product == "pipeline.cleaned" and entry.n_bytes > 1000
    cache.clear_cache()
    assert not folder.exists()


def test_writers_at_work_are_left_alone(lab):
    lab.base(SURVEY)
    folder = _value_file().parents[1]
    names = {
        host: f"unfinished-{host}-{os.getpid()}-0123abcd" for host in (socket.gethostname(), "elsewhere")
    }
    for name in names.values():
        (folder / name).mkdir()
    lab.base(SURVEY, scale=2.0)
    assert {path.name for path in _unfinished()} == set(names.values())
    assert cache.clear_cache(["unfinished"]) == 0 and not _unfinished()


@pytest.mark.parametrize("is_killed", [False, True])
def test_two_processes_compute_a_result_once(lab, tmp_path, is_killed):
    """The second waits for the first, and takes over where that is killed."""
    gate = str(tmp_path / "gate")
    check = f"assert lab.slow(1000, gate={gate!r}).sum() == 1000"
    processes = [lab.start(check)]
    _wait_for(lambda: lab.computed() == ["slow"])
    processes.append(lab.start(f"lab.note('asks')\n{check}"))
    _wait_for(lambda: len(lab.computed()) == 2)
    time.sleep(0.3)
    assert lab.computed() == ["slow", "asks"]
    if is_killed:
        processes[0].kill()
        _wait_for(lambda: len(lab.computed()) == 3)
    Path(gate).touch()
    assert [process.wait() for process in processes] == [-signal.SIGKILL * is_killed, 0]
    assert lab.slow(1000, gate=gate).sum() == 1000
    assert lab.computed().count("slow") == 1 + is_killed and not list(cache.cache_folder().rglob("*.lock"))


def test_a_folder_that_can_only_be_read_is_read(lab, monkeypatch):
    lab.base(SURVEY)

    def refuse(*args, **options):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "touch", refuse)
    assert lab.base(SURVEY).size == 100
    with pytest.raises(InputError, match="base cannot be kept .*Read-only"):
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


def test_info_and_clear(lab):
    lab.base(SURVEY, scale=4.0)
    lab.pair(SURVEY)
    newest, *_, oldest = cache.cache_info()
    assert newest.product.endswith("pair") and oldest.product.endswith("base")
    assert "scale=4.0" in oldest.arguments.replace(": ", "=") and "n_channels=100" in oldest.arguments
    assert oldest.n_bytes > 400 and time.time() - oldest.created.timestamp() < 60
    assert cache.clear_cache([newest.product]) == newest.n_bytes
    assert {entry.product for entry in cache.cache_info()} == {oldest.product}
    with pytest.raises(InputError, match=f"no spectra; it holds {oldest.product}"):
        cache.clear_cache(["spectra"])
    lab.pair(SURVEY)
    assert lab.computed() == ["base", "pair", "base", "pair"]


def test_a_cache_folder_that_cannot_be(lab, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(InputError, match="HIMAP_CACHE"):
        lab.base(SURVEY)


def test_what_himap_did_not_make_is_not_cleared(lab):
    """HIMAP_CACHE may name a folder that holds other things too."""
    lab.base(SURVEY)
    others = [
        cache.cache_folder() / "project" / name
        for name in ("data/thesis.txt", "unfinished-draft/note.json", "models/value.pkl")
    ]
    for path in others:
        path.parent.mkdir(parents=True)
        path.write_text("{}")
    assert len(cache.cache_info()) == 1
    cache.clear_cache()
    assert all(path.exists() for path in others) and not cache.cache_info()


def _entry_folder():
    return _value_file().parent


def _without_note(folder):
    (folder / "note.json").unlink()


def _empty(folder):
    shutil.rmtree(folder)
    folder.mkdir()


def _a_file(folder):
    shutil.rmtree(folder)
    folder.touch()


@pytest.mark.parametrize("harm", [_without_note, _empty, _a_file])
def test_what_is_left_of_a_result_is_replaced(lab, harm):
    """A deletion that was killed, say; nothing to tell, for there is no result."""
    lab.base(SURVEY)
    folder = _entry_folder()
    harm(folder)
    np.testing.assert_array_equal(lab.base(SURVEY), 2 * np.arange(100))
    lab.base(SURVEY)
    assert lab.computed() == ["base", "base"] and sorted(os.listdir(folder)) == _FILES
    assert not _unfinished()


_FILES = ["0.npy", "note.json", "value.json"]


def test_a_result_that_is_deleted_at_once_is_returned(lab, monkeypatch):
    real = cache.save

    def save(product, key, value, **options):
        real(product, key, value, **options)
        cache.remove(product, key)

    monkeypatch.setattr(cache, "save", save)
    np.testing.assert_array_equal(lab.base(SURVEY), 2 * np.arange(100))


def test_a_result_that_is_deleted_while_it_is_read_is_no_damage(lab, monkeypatch):
    """Two records at once delete the intermediate results that they share; warnings are errors here."""
    lab.base(SURVEY)
    read = cache.read_value
    with monkeypatch.context() as patched:
        patched.setattr(cache, "read_value", lambda folder: lab.base.forget(SURVEY) or read(folder))
        patched.setattr(cache, "save", lambda *args, **options: None)  # what is computed now is gone as well
        np.testing.assert_array_equal(lab.base(SURVEY), 2 * np.arange(100))
    assert lab.computed() == ["base", "base"]


def test_a_deletion_that_is_killed_leaves_no_half_result(lab):
    lab.base(SURVEY)
    kill = "import os, shutil, signal; shutil.rmtree = lambda *a, **b: os.kill(os.getpid(), signal.SIGKILL)"
    process = lab.start(f"{kill}\nfrom himap.store import cache\ncache.clear_cache()")
    assert process.wait() == -signal.SIGKILL
    assert [entry.product for entry in cache.cache_info()] == ["unfinished"]
    lab.base(SURVEY)
    assert not _unfinished()


def test_the_folder_is_for_its_owner_alone(lab):
    before = os.umask(0)
    try:
        lab.base(SURVEY)
    finally:
        os.umask(before)
    folder = _entry_folder()
    assert {stat.S_IMODE(path.stat().st_mode) for path in (folder, *folder.parents[:2])} == {0o700}


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
@pytest.mark.parametrize(
    "use", [lambda lab: lab.base(SURVEY), lambda lab: cache.cache_info(), lambda lab: cache.clear_cache()]
)
def test_a_folder_that_others_can_write_to_is_refused(lab, mode, use):
    lab.base(SURVEY)
    cache.cache_folder().chmod(mode)
    with pytest.raises(InputError, match="other users can write .* `chmod go-w .*HIMAP_CACHE"):
        use(lab)
    cache.cache_folder().chmod(0o755)
    use(lab)


def test_the_folder_of_another_is_refused(lab, monkeypatch):
    lab.base(SURVEY)
    monkeypatch.setattr("os.geteuid", lambda: 12345)
    for use in (lambda: lab.base(SURVEY), cache.cache_info, cache.clear_cache):
        with pytest.raises(InputError, match="belongs to another user .number .*HIMAP_CACHE"):
            use()
    monkeypatch.undo()


def test_arrays_come_from_the_folder_of_the_result(lab, tmp_path):
    lab.base(SURVEY)
    np.save(tmp_path / "secret.npy", np.ones(3))
    tree = _entry_folder() / "value.json"
    tree.write_text(json.dumps({"array": str(tmp_path / "secret.npy")}))
    note = json.loads((tree.parent / "note.json").read_text())
    note["files"]["value.json"] = [tree.stat().st_size, zlib.crc32(tree.read_bytes())]
    (tree.parent / "note.json").write_text(json.dumps(note))
    with pytest.warns(UserWarning, match="is damaged .*no array of this folder"):
        assert lab.base(SURVEY).size == 100


@pytest.mark.parametrize("text", ["[]", "3", "{", '{"seconds": "x", "product": null}', "\0"])
def test_a_note_of_any_text_is_listed(lab, text):
    lab.base(SURVEY)
    (_entry_folder() / "note.json").write_text(text)
    assert len(cache.cache_info()) == 1
    cache.clear_cache()
    assert not cache.cache_info()


def test_links_are_not_followed(lab, tmp_path):
    """Neither one in the place of a product nor one in that of a result."""
    lab.base(SURVEY)
    product = _entry_folder().parent
    shutil.copytree(product, tmp_path / "elsewhere")
    (cache.cache_folder() / "link").symlink_to(tmp_path / "elsewhere")
    (product / ("0" * 32)).symlink_to(next((tmp_path / "elsewhere").iterdir()))
    assert len(cache.cache_info()) == 1
    cache.clear_cache()
    assert sorted(path.name for path in (tmp_path / "elsewhere").glob("*/*")) == _FILES


def test_a_time_in_the_future_is_now(lab):
    lab.base(SURVEY)
    for file in _entry_folder().iterdir():
        os.utime(file, (10**11, 10**11))
    (entry,) = cache.cache_info()
    assert abs(entry.created.timestamp() - time.time()) < 60


def test_what_cannot_be_deleted_is_told_and_not_counted(lab, monkeypatch):
    lab.base(SURVEY)

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(InputError, match="1 of 1 results could not be deleted"):
        cache.clear_cache()


def test_what_may_not_be_read_is_one_clear_error(lab, monkeypatch):
    lab.base(SURVEY)

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("numpy.load", refuse)
    with pytest.raises(InputError, match="base cannot be read .*Permission denied"):
        lab.base(SURVEY)
