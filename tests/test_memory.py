"""What a run needs in memory, and the refusal of one that does not fit."""

import shutil
import sys
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import pytest
from conftest import run_python

from himap.core import memory
from himap.core.errors import InputError
from himap.core.files import cache_folder
from himap.core.memory import LIMIT_VARIABLE, check_memory, estimate, memory_limit, parse_size
from himap.core.survey import PRESETS
from himap.instrument.beams import Degraded
from himap.paper import pipeline
from himap.paper.study import Study
from himap.removal import PCA
from himap.store.parallel import JOBS_VARIABLE

PAPER = PRESETS["paper"]


def test_sizes():
    texts = {"16GB": 16e9, "1.5 TB": 1.5e12, "500M": 5e8, "7": 7, "8kB": 8e3}
    assert {text: parse_size(text) for text in texts} == texts


def test_what_is_free_is_the_limit_by_default(monkeypatch):
    monkeypatch.delenv(LIMIT_VARIABLE, raising=False)
    assert 0 < memory_limit() < 1e14
    monkeypatch.setenv(LIMIT_VARIABLE, "2GB")
    assert memory_limit() == 2e9


LARGE_BOX, IN_FILES = replace(PAPER, box_cells=2048), {"in_files": True}
FINE = replace(LARGE_BOX, nside=2048)


@pytest.mark.parametrize(
    ("limit", "survey", "step", "options", "refusal"),
    [
        *(("13GB", PAPER, step, {"jobs": 2}, None) for step in estimate(PAPER)),
        ("24GB", LARGE_BOX, "HI light cone", {}, r"HI light cone needs about 7\d.\d GB .* smaller box_cells"),
        ("24GB", LARGE_BOX, "cleaning", {}, None),
        ("12GB", LARGE_BOX, "HI light cone", IN_FILES, None),
        ("12GB", FINE, "HI light cone", IN_FILES, "HI .* about .*: a smaller box_cells, nside"),
        ("12GB", PAPER, "cleaning", {"jobs": 2}, "2 jobs, and 12 GB .* fewer --jobs need less.*--max-memory"),
    ],
)
def test_what_fits_and_what_would(monkeypatch, limit, survey, step, options, refusal):
    """The paper into 24 GB, and a box of 2048 cells in files."""
    monkeypatch.setenv(LIMIT_VARIABLE, limit)
    with pytest.raises(InputError, match=refusal) if refusal else nullcontext():
        check_memory(survey, step, **options)


def test_a_box_that_memory_does_not_hold_is_in_files(monkeypatch):
    survey = PRESETS["ci"]
    in_memory = pipeline.hi_of_sky.compute(survey)
    needs = estimate(survey)
    monkeypatch.setattr(pipeline, "memory_limit", lambda: needs["HI light cone"] - 1)
    monkeypatch.setattr(pipeline, "check_memory", lambda *call, **options: None)
    assert pipeline.hi_of_sky.compute(survey) == pytest.approx(in_memory, rel=1e-5)
    assert not list((cache_folder() / "hi_of_sky").glob("unfinished*"))
    nearly_full = SimpleNamespace(free=1_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: nearly_full)
    message = "hi_of_sky needs 0.0168 GB of temporary disk space, and 0.001 GB are free"
    with pytest.raises(InputError, match=message):
        pipeline.hi_of_sky.compute(survey)


@pytest.mark.parametrize("step", ["sky", "study"])
def test_long_work_asks_first(monkeypatch, step):
    """Nothing is computed: the survey is the paper's."""
    monkeypatch.setenv(LIMIT_VARIABLE, "1GB")
    monkeypatch.setenv(JOBS_VARIABLE, "1")
    with pytest.raises(InputError, match="and 1 GB may be used"):
        if step == "sky":
            pipeline.hi_of_sky(PAPER)
        else:
            study = Study(preset="paper")
            study.prepare({Degraded(): [PCA()]})


PEAK = """
import re, pathlib
from himap.core import memory
from himap.paper import pipeline
from himap.core.survey import Survey
survey = Survey(nside=64, n_channels=100, box_cells=256)
steps = memory.estimate(survey)
pipeline.hi_of_sky(Survey(nside=4, n_channels=20, box_cells=16))  # compiles
pipeline.hi_of_sky(survey)
status = pathlib.Path("/proc/self/status").read_text()  # what `resource` says counts the parent process too
print(int(re.search(r"VmHWM:\\s*(\\d+)", status)[1]) * 1024, steps["HI light cone"])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak from /proc")
def test_the_estimate_is_near_the_peak():
    peak, expected = map(float, run_python("-c", PEAK).stdout.split())
    assert 0.4 * expected < peak < 1.2 * expected


@pytest.mark.parametrize(
    ("codes", "kills", "expected"),
    [
        ([-9, -9], 3, "signal 9 (SIGKILL), because memory ran out"),
        ([-9], 4, "signal 9 (SIGKILL)"),
        ([-11], 3, "signal 11 (SIGSEGV)"),
        ([-11, 3], 3, "signal 11 (SIGSEGV) or exit code 3"),
        ([-9], None, "signal 9 (SIGKILL)"),
        ([-40], 3, "signal 40"),
        ([], 0, "an unknown cause"),
    ],
)
def test_memory_is_a_cause_of_death_only_where_it_ran_out(codes, kills, expected, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "_KILLS", tmp_path / "vmstat")
    if kills is not None:
        (tmp_path / "vmstat").write_text("pgfault 12\noom_kill 4\nother 7\n")
        assert memory.memory_kills() == 4
    assert memory.cause_of_death(codes, kills or 0) == expected


def test_a_small_box_in_files_needs_no_more_than_in_memory():
    for survey, less in ((PRESETS["ci"], False), (LARGE_BOX, True)):
        needs = [estimate(survey, in_files=in_files)["HI light cone"] for in_files in (False, True)]
        assert (needs[1] < needs[0]) == less and needs[1] <= needs[0]
