"""Products made by the workers of a Dask cluster."""

import json
import threading
import time
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from test_parallel import CALLS, CASE, WORK

from himap.core.errors import InputError
from himap.paper import cleaned
from himap.removal.pca import PCA
from himap.store import cache
from himap.store.parallel import DASK_VARIABLE, make_all

distributed = pytest.importorskip("distributed")

TWO = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
ONE = TWO | {"n_workers": 1}


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes of one thread on this machine."""
    with distributed.LocalCluster(**TWO) as two:
        yield two


@pytest.fixture
def address(cluster, monkeypatch):
    monkeypatch.setenv(DASK_VARIABLE, cluster.scheduler_address)
    return cluster.scheduler_address


def test_errors_come_back(address, monkeypatch, tmp_path):
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    too_many = [(cleaned.assessment, (CASE, PCA(n_sources=30), True))]
    with pytest.raises(InputError, match="n_sources must be at most the number of channels, 20"):
        make_all(too_many, "test")


KILL = """
import os, signal
from pathlib import Path
from himap.removal.pca import PCA

def fatal(self, *args, **options):
    try:
        Path(os.environ["HIMAP_TEST_VICTIM"]).open("x").close()
    except FileExistsError:
        return fatal.real(self, *args, **options)
    os.kill(os.getpid(), signal.SIGKILL)

fatal.real, PCA._separate = PCA._separate, fatal
"""
MEND = """
from himap.removal.pca import PCA

PCA._separate = getattr(PCA._separate, "real", PCA._separate)  # a new worker has it
"""


def test_what_a_worker_had_that_dies_is_done_by_another(address, monkeypatch, tmp_path):
    """The first worker that cleans kills itself; the results are those of an undisturbed run."""
    victim = tmp_path / "victim"
    monkeypatch.setenv("HIMAP_TEST_VICTIM", str(victim))
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "cache"))
    with distributed.Client(address) as client:
        client.run(exec, KILL, {})
        assert make_all(WORK, "test") == len(CALLS)
        client.run(exec, MEND, {})
    assert victim.exists()
    assert "unfinished" not in {entry.product for entry in cache.cache_info()}
    monkeypatch.delenv(DASK_VARIABLE)
    found = [cleaned.assessment(*call).power_spectra.angular.cl for call in CALLS]
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "undisturbed"))
    expected = [cleaned.assessment(*call).power_spectra.angular.cl for call in CALLS]
    assert all(np.array_equal(one, two) for one, two in zip(expected, found, strict=True))


@pytest.mark.filterwarnings("default")
def test_a_web_server_is_no_scheduler(monkeypatch, himap_command):
    """It waits for more to be said, as the client does."""
    with ThreadingHTTPServer(("127.0.0.1", 0), SimpleHTTPRequestHandler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        monkeypatch.setattr(server, "block_on_close", False)
        address = f"tcp://127.0.0.1:{server.server_port}"
        started = time.monotonic()
        status, _, said = himap_command("measure", "claims", "--preset", "ci", "--dask", address)
        server.shutdown()
    assert time.monotonic() - started < 15  # 4 s, where nothing else runs
    assert status == 2 and f"no Dask scheduler at {address} (no answer" in " ".join(said.split())


def test_a_record_is_the_same_as_without(cluster, monkeypatch, himap_command, tmp_path):
    """But for what says when it was made."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    size = ["nside=8", "n_channels=20", "box_cells=16", "n_realisations=2", "n_mocks=1"]
    size += ['methods=[["pca", 3]]', 'beams=["degraded", "evolving"]', "corrected=[]"]
    pairs, found = [part for pair in size for part in ("-p", pair)], []
    for label, way in (("with", ["--dask", cluster.scheduler_address]), ("without", [])):
        status, _, said = himap_command("measure", "methods", *pairs, "-o", f"{label}.json", *way)
        assert status == 0, said
        found.append(json.loads(Path(f"{label}.json").read_text()))
        assert cache.clear_cache()
    assert found[0]["rows"] == found[1]["rows"] and found[0]["columns"] == found[1]["columns"]


def test_workers_that_write_elsewhere(address, monkeypatch, tmp_path):
    """As on machines that do not share a disk: what the workers make does not show up here."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    monkeypatch.setattr(cleaned.assessment, "is_cached", lambda *call: False)
    with pytest.raises(InputError, match=f"do not share the cache folder {tmp_path}"):
        make_all(WORK[:1], "test")


def test_workers_that_die_again_and_again(lab, monkeypatch):
    with distributed.LocalCluster(**ONE) as one:
        monkeypatch.setenv(DASK_VARIABLE, one.scheduler_address)
        with pytest.raises(InputError, match=r"4 workers of tcp.* one after the other while computing dying"):
            make_all([(lab.dying, (1,))], "test")


def test_a_scheduler_that_goes_away(lab, monkeypatch, tmp_path, capfd):
    """One error, without what the package tells of its connection."""
    one = distributed.LocalCluster(**ONE)
    monkeypatch.setenv(DASK_VARIABLE, one.scheduler_address)
    gate = str(tmp_path / "gate")  # that nobody opens
    threading.Timer(3, one.close).start()
    with pytest.raises(InputError, match="the Dask scheduler at tcp.* is gone. Finished results are stored"):
        make_all([(lab.slow, (n, gate)) for n in (1, 2)], "test")
    assert "distributed.client" not in capfd.readouterr().err
