"""Work that is killed at any point goes on where it stopped, and ends as if nothing had happened."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from test_cli import command_script

import himap
from himap.store import cache

CHAIN = """
from himap.instrument.beams import Degraded, Oscillating
from himap.paper import cleaned, pipeline
from himap.removal.gmca import GMCA
from himap.removal.pca import PCA
from himap.core.survey import Survey

for beam in (Degraded(), Oscillating()):
    case = pipeline.Case(survey=Survey(nside=16, n_channels=40, box_cells=32), beam=beam)
    for remover in (PCA(n_sources=2), GMCA(n_sources=2)):
        cleaned.assessment(case, remover)
"""

NOTEBOOK = """\
# %% tags=["parameters"]
n_sources: int = 2  # components to remove

# %%
print(2 * n_sources)
"""


def checksums():
    """{(product, key): checksums} of everything in the cache."""
    notes = cache.cache_folder().glob("*/[0-9a-f]*/note.json")  # not what is being written
    return {note.parts[-3:-1]: json.loads(note.read_text())["files"] for note in notes}


def start(*command):
    """A process, in a session of its own."""
    words = [sys.executable, "-c", *command]
    return subprocess.Popen(words, start_new_session=True, stdout=subprocess.DEVNULL)


def kill_when(process, ready):
    """SIGKILL a process and its children as soon as `ready()`; whether it was still at work."""
    deadline = time.monotonic() + 120
    while process.poll() is None and not ready():
        assert time.monotonic() < deadline
        time.sleep(0.002)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


@pytest.fixture(autouse=True)
def this_library(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(himap.__file__).parents[1]))


def test_products(monkeypatch, tmp_path):
    """Killed after some products; the results are the same, bit for bit."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "killed"))
    unfinished = partial(cache.cache_folder().glob, "*/unfinished-*")
    assert kill_when(start(CHAIN), lambda: len(checksums()) >= 5)
    left = list(unfinished())
    assert start(CHAIN).wait() == 0
    found = checksums()
    assert not any(path.exists() for path in left) and not any(unfinished())
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "undisturbed"))
    assert start(CHAIN).wait() == 0
    assert found == checksums() and len(found) > 10


def test_all_notebooks(monkeypatch, tmp_path):
    """`himap run --all`, killed in its second notebook, does not run the first again."""
    (tmp_path / "notebooks").mkdir()
    for name, n_sources in (("01_one", 2), ("02_two", 3)):
        text = NOTEBOOK.replace("n_sources: int = 2", f"n_sources: int = {n_sources}")
        (tmp_path / "notebooks" / f"{name}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    command = [command_script(tmp_path), "run", "--all"]
    outputs = []
    for is_killed in (True, False):
        before = {}
        if is_killed:
            kill_when(start(*command), lambda: any(Path("results").glob("01_*.ipynb")))
            before = {path: path.stat().st_mtime_ns for path in Path("results").glob("*.ipynb")}
        words = [sys.executable, "-c", *command]
        out = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        assert ("(done before)" in out.splitlines()[0]) == is_killed == (len(before) == 1)
        assert all(path.stat().st_mtime_ns == time for path, time in before.items())
        outputs.append([json.loads(path.read_text())["cells"] for path in sorted(Path("results").iterdir())])
        Path("results").rename(str(is_killed))
    assert len(outputs[0]) == 2 and outputs[0] == outputs[1]
