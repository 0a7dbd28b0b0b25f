"""The folder of results: each whole or not at all, listed and cleared."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from himap.errors import InputError
from himap.products import cache
from himap.survey import PRESETS

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


def test_two_processes_at_once(lab, tmp_path):
    gate = str(tmp_path / "gate")
    check = f"assert lab.slow(1000, gate={gate!r}).sum() == 1000"
    processes = [lab.start(check) for _ in range(2)]
    _wait_for(lambda: lab.computed() == ["slow", "slow"])
    Path(gate).touch()
    assert [process.wait() for process in processes] == [0, 0]
    assert lab.slow(1000, gate=gate).sum() == 1000
    assert len(lab.computed()) == 2
    assert not _unfinished()


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
