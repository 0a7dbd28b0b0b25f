"""What is made in which order, and what stays on disk."""

from collections import Counter
from dataclasses import replace

import pytest

from himap.core.survey import Survey
from himap.instrument.beams import Degraded, Oscillating
from himap.paper import cleaned, evidence, pipeline, plan
from himap.paper.pipeline import Case
from himap.removal import PCA, SDecGMCA
from himap.store import cache

SURVEY = Survey(nside=8, n_channels=20, box_cells=16)
CASES = [Case(survey=SURVEY, beam=beam) for beam in (Degraded(), Oscillating())]
QUICK = SDecGMCA(n_sources=2, n_warmup=1, n_refinement=1, noise=0.1)
CALLS = [(case, method, True, False) for case in CASES for method in (PCA(n_sources=2), QUICK)]
FACTS = [(evidence.masked_voxels, (case,)) for case in CASES]
SMALL = {
    "true_spectra",
    "components_of_sky",
    "assessment",
    "masked_voxels",
}


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))


def _held():
    return Counter(entry.product for entry in cache.cache_info())


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_one_case_after_the_other_where_observations_do_not_stay(monkeypatch):
    most = Counter()

    def watched(*args):
        done = make_all(*args)
        most.update({name: n - most[name] for name, n in _held().items() if n > most[name]})
        return done

    make_all = plan.make_all
    monkeypatch.setattr(plan, "make_all", watched)
    assert plan.make(CALLS, facts=FACTS, keep_observations=False) == 4
    large = {name: n for name, n in most.items() if name not in SMALL}
    assert large["observation"] == large["analysis"] == large["hi_of_sky"] == 1
    assert set(large.values()) == {1}
    assert set(_held()) <= SMALL
    assert _held()["assessment"] == 4 and _held()["masked_voxels"] == 2
    assert plan.make(CALLS, facts=FACTS, keep_observations=False) == 0


def test_facts_of_a_sky_are_made_with_its_cases(monkeypatch):
    """Were they made before, the HI of all skies would be on disk, and stay."""
    skies = [replace(SURVEY, seed=seed) for seed in (1, 2)]
    cases = [Case(survey=survey) for survey in skies]
    facts = [(evidence.sky_brightness, (case.survey.sky, case.galaxy)) for case in cases]
    calls = [(case, PCA(n_sources=2), True, False) for case in cases]
    assert plan.make(calls, facts=facts, keep_observations=False) == 2
    assert _held()["sky_brightness"] == 2 and "hi_of_sky" not in _held()


def test_a_cluster_gets_all_cases_at_once(monkeypatch):
    asked = []
    monkeypatch.setattr(plan, "dask_address", lambda: "tcp://somewhere:1")
    monkeypatch.setattr(plan, "make_all", lambda product, calls, label: asked.append((product, len(calls))))
    plan.make(CALLS, keep_observations=False)
    assert (pipeline.observation, 2) in asked and (cleaned.assessment, 4) in asked


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_what_was_there_before_stays():
    plan.make_observations(CASES[:1])
    before = _held()
    assert plan.make(CALLS, keep_observations=False) == 4
    assert {name: n for name, n in _held().items() if name in before and name not in SMALL} == {
        name: n for name, n in before.items() if name not in SMALL
    }
    assert plan.make(CALLS[:1], keep_separations=True) == 0
    assert _held()["separation"] == 1


@pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
def test_all_stays_unless_told():
    assert plan.make(CALLS) == 4
    assert _held()["observation"] == 2
