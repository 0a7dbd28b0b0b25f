"""What numba compiles of himap is kept in a folder of ours, and is never in the way."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import himap

TOY = """
import sys
sys.path.insert(0, {root!r})
import himap
from numba import njit

def double(x):
    return 2 * x

sys.modules[{name!r}] = sys.modules["__main__"]
double.__module__ = {name!r}
double = njit(cache=True)(double)
assert double(21) == 42
print(double._cache.cache_path, sum(double.stats.cache_hits.values()))
"""


@pytest.fixture
def start(tmp_path):
    """Run the toy where neither its folder nor HOME can be written; the folder it is kept in, and whether
    it was found there."""
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__pycache__").touch()

    def call(cache, *, name="himap.toy", code="", **variables):
        toy = tmp_path / "package" / "toy.py"
        toy.write_text(code + TOY.format(root=str(Path(himap.__file__).parents[1]), name=name))
        clean = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA_", "XDG_"))}
        environment = clean | {"HOME": "/dev/null", "HIMAP_CACHE": str(cache)} | variables
        done = subprocess.run([sys.executable, str(toy)], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        *_, folder, hits = done.stdout.split()
        return folder, hits == "1", done.stderr

    return call


def test_it_is_kept_for_the_owner_alone_and_found_again(start, tmp_path):
    folder, found, said = start(tmp_path / "cache")
    assert Path(folder).parent == tmp_path / "cache" / "numba" and not found and not said
    assert stat.S_IMODE((tmp_path / "cache" / "numba").stat().st_mode) == 0o700
    assert start(tmp_path / "cache") == (folder, True, "")


def test_where_nothing_can_be_written_nothing_is_kept_and_that_is_said(start):
    folder, found, said = start("/dev/null/cache")
    assert folder == "None" and not found
    assert said.count("can be kept nowhere") == 1 and "HIMAP_CACHE" in said


def test_the_users_own_folder_comes_first(start, tmp_path):
    folder, _, _ = start(tmp_path / "cache", NUMBA_CACHE_DIR=str(tmp_path / "chosen"))
    assert Path(folder).parent == tmp_path / "chosen"


def test_a_folder_that_others_can_write_to_is_not_read(start, tmp_path):
    start(tmp_path / "cache")
    (tmp_path / "cache" / "numba").chmod(0o777)
    folder, found, said = start(tmp_path / "cache")
    assert folder == "None" and not found and "can be kept nowhere" in said


@pytest.mark.parametrize(
    ("ending", "harm"),
    [("nbi", "cut"), ("nbc", "altered"), ("nbc", "gone"), ("json", "cut"), ("json", "gone")],
)
def test_what_is_damaged_is_compiled_again(start, tmp_path, ending, harm):
    folder, _, _ = start(tmp_path / "cache")
    (file,) = Path(folder).glob(f"*.{ending}")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content if harm == "altered" else content[: len(content) // 2])
    if harm == "gone":
        file.unlink()
    assert start(tmp_path / "cache") == (folder, False, "")
    assert start(tmp_path / "cache") == (folder, True, "")


def test_a_full_disk_is_no_error(start, tmp_path):
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100,) * 2)\n"
    folder, _, said = start(tmp_path / "cache", code=limit)
    assert not said and not list(Path(folder).glob("*.tmp*"))
    start(tmp_path / "cache")
    assert start(tmp_path / "cache")[1]


def test_functions_of_others_are_kept_as_numba_keeps_them(start, tmp_path):
    folder, _, _ = start(tmp_path / "cache", name="theirs.toy", NUMBA_CACHE_DIR=str(tmp_path / "theirs"))
    assert Path(folder).parent == tmp_path / "theirs" and not list(Path(folder).glob("*.json"))
