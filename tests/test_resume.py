"""Work that is killed at any point goes on where it stopped, and ends as if nothing had happened."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import himap
from himap.store import cache

ROOT = Path(himap.__file__).parents[1]

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
# %% [markdown]
# # A toy

# %% tags=["parameters"]
preset: str = "ci"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
n_sources: int = 2  # components to remove

# %%
from himap.paper import cleaned, pipeline
from himap.removal.pca import PCA
from himap.core.survey import Survey

case = pipeline.Case(survey=Survey.preset(preset, **survey))
found = cleaned.assessment(case, PCA(n_sources=n_sources)).power_spectra
print(found.angular.mean.tolist(), found.frequency.power.tolist())
"""

COMMAND = """
import sys, pathlib
from himap.app.cli.main import main as cli
from himap.app import notebooks
notebooks._PACKAGE = pathlib.Path({package!r})
cli.main()
"""


def environment(folder):
    return os.environ | {"HIMAP_CACHE": str(folder), "PYTHONPATH": str(ROOT)}


def checksums():
    """{(product, key): checksums} of everything in the cache."""
    notes = cache.cache_folder().glob("*/[0-9a-f]*/note.json")  # not what is being written
    return {note.parts[-3:-1]: json.loads(note.read_text())["files"] for note in notes}


def kill_when(process, ready):
    """SIGKILL a process and its children as soon as `ready()`; whether it was still at work."""
    deadline = time.monotonic() + 120
    while process.poll() is None and not ready():
        assert time.monotonic() < deadline
        time.sleep(0.002)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


def start(command, folder):
    return subprocess.Popen(
        [sys.executable, *command], env=environment(folder), start_new_session=True, stdout=subprocess.DEVNULL
    )


def test_products(monkeypatch, tmp_path):
    """Killed again and again, after so many products; the results are the same, bit for bit."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "killed"))
    unfinished = partial(cache.cache_folder().glob, "*/unfinished-*")
    for n_whole in (1, 5):
        process = start(["-c", CHAIN], tmp_path / "killed")
        assert kill_when(process, partial(_so_many_are_there, n_whole))
    left = list(unfinished())
    assert start(["-c", CHAIN], tmp_path / "killed").wait() == 0
    found = checksums()
    assert not any(path.exists() for path in left) and not any(unfinished())
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "undisturbed"))
    assert start(["-c", CHAIN], tmp_path / "undisturbed").wait() == 0
    expected = checksums()
    assert found == expected and len(found) > 10


def _so_many_are_there(n_whole):
    return len(checksums()) >= n_whole


def test_all_notebooks(monkeypatch, tmp_path):
    """`himap run --all`, killed in its second notebook, does not run the first again."""
    (tmp_path / "notebooks").mkdir()
    for name, n_sources in (("01_one", 2), ("02_two", 3)):
        text = NOTEBOOK.replace("n_sources: int = 2", f"n_sources: int = {n_sources}")
        (tmp_path / "notebooks" / f"{name}.py").write_text(text)
    script = COMMAND.format(package=str(tmp_path / "himap"))
    size = ["-p", "nside=16", "-p", "n_channels=40", "-p", "box_cells=32"]
    command = ["-c", script, "run", "--all", "--preset", "ci", *size]
    outputs = {}
    for kind in ("killed", "undisturbed"):
        (tmp_path / kind).mkdir()
        monkeypatch.chdir(tmp_path / kind)
        results = tmp_path / kind / "results"
        if kind == "killed":
            kill_when(start(command, tmp_path / kind / "cache"), partial(_one_is_there, results))
            (first,) = results.glob("*.ipynb")
            written = first.stat().st_mtime_ns
        done = subprocess.run(
            [sys.executable, *command],
            env=environment(tmp_path / kind / "cache"),
            capture_output=True,
            text=True,
            check=True,
        )
        if kind == "killed":
            assert done.stdout.splitlines()[0].endswith("(done before)")
            assert first.stat().st_mtime_ns == written
        outputs[kind] = [json.loads(path.read_text())["cells"] for path in sorted(results.glob("*.ipynb"))]
    assert len(outputs["killed"]) == 2 and outputs["killed"] == outputs["undisturbed"]


def _one_is_there(results):
    return any(results.glob("01_*.ipynb"))
