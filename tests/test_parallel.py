"""Products made several at a time."""

import os

import numpy as np
import psutil
import pytest
from joblib.externals.loky import get_reusable_executor

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.paper import cleaned, pipeline
from himap.removal.pca import PCA
from himap.store.parallel import JOBS_VARIABLE, make_all, n_jobs

CASE = pipeline.Case(survey=Survey(nside=8, n_channels=20, box_cells=16))
CALLS = [(CASE, PCA(n_sources=n), True) for n in (1, 2, 3)]
WORK = [(cleaned.assessment, call) for call in CALLS]


def test_what_is_missing_is_made_once_and_the_same_by_processes(monkeypatch, tmp_path):
    """Processes that live on follow the settings."""
    found = []
    for folder, jobs in (("one", "1"), ("two", "2"), ("three", "2")):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / folder))
        monkeypatch.setenv(JOBS_VARIABLE, jobs)
        cleaned.assessment(*CALLS[1])
        assert make_all(WORK, "test") == 2
        assert make_all(WORK, "test") == 0
        assert all(cleaned.assessment.is_cached(*call) for call in CALLS)
        found.append([cleaned.assessment(*call).power_spectra.angular.cl for call in CALLS])
    assert all(np.array_equal(found[0], other) for other in found[1:])


def test_processes_share_the_cores(lab, monkeypatch):
    """New processes find how many threads a transform may have, not this one, which gets their warnings."""
    monkeypatch.setenv(JOBS_VARIABLE, "2")
    monkeypatch.delenv("DUCC0_NUM_THREADS", raising=False)
    monkeypatch.setattr("joblib.cpu_count", lambda: 8)
    get_reusable_executor().shutdown()
    with pytest.warns(RuntimeWarning, match="this is number"):
        make_all([(lab.threads, (1,)), (lab.threads, (2,))], "test")
    assert lab.threads(1) == lab.threads(2) == 4 and "DUCC0_NUM_THREADS" not in os.environ


@pytest.mark.parametrize("at_once", [1, 2])
def test_no_more_at_once_than_the_memory_holds(lab, monkeypatch, at_once):
    """`cleaned.make` asks for as many: see test_making.py."""
    monkeypatch.setenv(JOBS_VARIABLE, "3")
    get_reusable_executor().shutdown()  # so that new ones find the module
    make_all([(lab.worker, (n,)) for n in range(3)], "test", at_once=at_once)
    makers = {int(lab.worker(n)) for n in range(3)}
    assert len(makers) <= at_once and (os.getpid() in makers) == (at_once == 1)


@pytest.mark.parametrize("text", ["0", "-1", "two", "1.5"])
def test_bad_number_of_processes(monkeypatch, text):
    monkeypatch.setenv(JOBS_VARIABLE, text)
    with pytest.raises(InputError, match="HIMAP_JOBS must be a positive number of processes"):
        n_jobs()
    monkeypatch.delenv(JOBS_VARIABLE)
    assert n_jobs() == 1


def test_a_process_that_is_killed_is_one_clear_error(lab, monkeypatch):
    monkeypatch.setenv(JOBS_VARIABLE, "2")
    get_reusable_executor().shutdown()  # so that new ones find the module
    with pytest.raises(InputError, match=r"2 processes died of signal 9 \(SIGKILL\) while computing dying"):
        make_all([(lab.dying, (1,)), (lab.dying, (2,))], "test")
    assert make_all([(lab.slow, (1,)), (lab.slow, (2,))], "test") == 2


def test_processes_end_with_the_one_that_asked(lab, monkeypatch, tmp_path):
    """Killed, it leaves nobody that goes on for hours."""
    monkeypatch.setenv(JOBS_VARIABLE, "2")
    gate = str(tmp_path / "never")
    code = "from himap.store.parallel import make_all\n"
    asking = lab.start(f"{code}make_all([(lab.slow, (1, {gate!r})), (lab.slow, (2, {gate!r}))], 'test')")
    lab.wait_for(lambda: lab.computed() == ["slow", "slow"])
    working = psutil.Process(asking.pid).children(recursive=True)
    asking.kill()
    asking.wait()
    assert len(working) >= 2
    _, alive = psutil.wait_procs(working, timeout=60)
    assert not alive
