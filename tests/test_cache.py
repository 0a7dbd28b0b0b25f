"""Products, computed once under the right key; and their folder: each complete or not there, made by one."""

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
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from conftest import little_room

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
        (lambda folder: os.truncate(folder / "0.npy", 100), "0.npy has a wrong checksum"),
        (_alter, "0.npy has a wrong checksum"),
        (lambda folder: (folder / "0.npy").unlink(), "No such file"),
        (lambda folder: (folder / "note.json").write_text("{"), ""),
        (_tree('{"array": "/etc/passwd"}'), "not an array of this folder"),
        (_tree('{"class": ["antigravity", "fly"], "fields": {}}'), "antigravity.fly no longer exists"),
        (_tree('{"class": ["himap.core.errors", "InputError"], "fields": {}}'), "InputError no longer"),
        # The rest of a deletion that was killed, say: there is no result.
        (lambda folder: (folder / "note.json").unlink(), None),
        (lambda folder: [file.unlink() for file in folder.iterdir()], None),
        (lambda folder: (shutil.rmtree(folder), folder.touch()), None),
    ],
)
def test_a_damaged_result_is_computed_again_with_a_warning(lab, kept, harm, why):
    """Reading runs and imports nothing; where there is no result there is no warning."""
    harm(kept)
    message = f"cached base is damaged and will be computed again .*{why}"
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


def test_a_workplace_in_use_is_not_cleared(lab):
    with cache.workplace("base", "0" * 32, 10) as folder:
        (folder / "part").write_text("a")
        assert cache.clear_cache() == 0 and (folder / "part").exists()
    with pytest.raises(KeyboardInterrupt), cache.workplace("base", "0" * 32, 10) as folder:
        (folder / "part").write_text("a")
        raise KeyboardInterrupt  # which leaves the folder for the next call
    assert (folder / "part").exists() and cache.clear_cache() == 1 and not folder.exists()


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
    with pytest.raises(InputError, match="base cannot be stored .*Read-only"):
        lab.base(SURVEY, scale=2.0)
    monkeypatch.setenv("HIMAP_CACHE", str(kept / "0.npy" / "cache"))  # below a file
    with pytest.raises(InputError, match="HIMAP_CACHE"):
        lab.base(SURVEY, scale=2.0)
    assert lab.computed() == ["base"]  # said before the work


def test_a_disk_that_is_full_is_one_clear_error(lab):
    said = "slow cannot be stored in .*GB are free. Free space with `himap cache clear`"
    with little_room(10**6), pytest.raises(InputError, match=said):
        lab.slow(10**6)
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
    use(lab)
    monkeypatch.setattr("os.geteuid", lambda: 12345)
    with pytest.raises(InputError, match="belongs to the user with number .*HIMAP_CACHE"):
        use(lab)


@pytest.mark.parametrize("is_large", [False, True])
def test_a_result_is_computed_once_and_mapped_from_disk_if_it_is_large(lab, monkeypatch, is_large):
    if is_large:
        monkeypatch.setattr("himap.store.arrays._MAPPED", 100)
    first, second = lab.base(SURVEY), lab.base(survey=SURVEY, scale=1.0)
    assert lab.computed() == ["base"]
    assert isinstance(second, np.memmap) is is_large and not second.flags.writeable
    np.testing.assert_array_equal(first, 2 * np.arange(100))
    assert second.dtype == np.float32


def test_small_results_that_somebody_holds_keep_no_file_open(lab):
    """An ensemble holds thousands, and many a machine lets a process open 1024."""
    lab.base(SURVEY)
    before = psutil.Process().num_fds()
    held = [lab.base(SURVEY) for _ in range(20)]
    assert len(held) == 20 and psutil.Process().num_fds() == before


def test_every_argument_counts(lab):
    for kwargs in [{}, {"scale": 2.0}, {"options": {"a": (1, None)}}, {"options": {"a": (1, False)}}]:
        lab.base(SURVEY, **kwargs)
    lab.base(replace(SURVEY, seed=1))
    lab.base(SURVEY, options=np.arange(3.0))
    lab.base(SURVEY, options=np.arange(3.0) + 1e-12)
    for options in [{1: 2}, {"1": 2}, {"a": 1, "b": 2}, {"a: 1, b": 2}]:
        lab.base(SURVEY, options=options)
    assert len(lab.computed()) == 11
    lab.base(SURVEY, scale=np.float64(2.0))
    lab.base(SURVEY, options={"a": [1, None]})
    assert len(lab.computed()) == 11


def test_an_argument_can_bring_a_digest(lab, tmp_path):
    template = lab.Template(str(tmp_path / "map.txt"))
    for text, n_computed in [("one", 1), ("one", 1), ("other", 2)]:
        (tmp_path / "map.txt").write_text(text)
        assert lab.of_template(template)[0] == len(text)
        assert len(lab.computed()) == n_computed


def test_arguments_that_have_no_text_are_refused(lab):
    with pytest.raises(InputError, match="got Generator"):
        lab.base(SURVEY, options=np.random.default_rng(0))
    with pytest.raises(InputError, match="scale=1.0.*unexpected keyword argument 'sclae'"):
        lab.base(SURVEY, sclae=2)


def test_all_kinds_of_values_come_back(lab):
    value = lab.odd()
    assert lab.odd.is_cached()
    first, second = value.pairs
    assert first.first.tolist() == [True, False] and first.label == "é"
    assert second.first.shape == (0, 3)
    assert value.table[1] == np.inf and value.table["a"] == 3 + 4j
    assert value.shape == (2, (3,)) and value.nothing is None


@pytest.mark.parametrize(
    ("what", "got"),
    [("object", "ndarray of object"), ("set", "set"), ("Local", "Local"), ("MaskedArray", "MaskedArray")],
)
def test_what_is_no_array_and_no_json_is_refused(lab, what, got):
    with pytest.raises(InputError, match=f"an array of numbers.*got {got}"):
        lab.pickled(what)
    assert not cache.cache_info()


def test_code_edited_under_a_running_process_is_not_cached(lab):
    path = Path(lab.__file__)
    source = path.read_text()
    lab.base(SURVEY)
    path.write_text(source.replace("SCALE = 2.0", "SCALE = 2.0  # a comment"))
    lab.base(SURVEY)
    assert lab.computed() == ["base"]
    path.write_text(source.replace("SCALE = 2.0", "SCALE = 3.0"))
    with pytest.warns(UserWarning, match="changed on disk since it was loaded"):
        assert lab.base(SURVEY)[1] == 2.0
    assert len(cache.cache_info()) == 1
    changed = "from himap.core.survey import PRESETS\nassert lab.base(PRESETS['ci'])[1] == 3"
    assert lab.start(changed).wait() == 0
    assert len(cache.cache_info()) == 2


def test_the_code_of_a_dataclass_that_is_passed_counts(lab):
    for options in [{}, {"method": lab.Method()}]:
        lab.base(SURVEY, options=options)
    path = Path(lab.__file__)
    path.write_text(path.read_text().replace("return 1", "return 2"))
    calls = "for options in [{}, {'method': lab.Method()}]: lab.base(PRESETS['ci'], options=options)"
    assert lab.start(f"from himap.core.survey import PRESETS\n{calls}").wait() == 0
    assert len(lab.computed()) == 3
