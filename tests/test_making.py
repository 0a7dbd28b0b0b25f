"""What is made for some products, and what of it stays on disk."""

from collections import Counter
from dataclasses import replace

import pytest

from himap.core.memory import estimate
from himap.core.survey import Survey
from himap.instrument.beams import Degraded, Oscillating
from himap.paper import cleaned, evidence
from himap.paper.pipeline import Case
from himap.removal import PCA
from himap.store import cache
from himap.store.parallel import JOBS_VARIABLE
from himap.store.store import MADE

SURVEY = Survey(nside=8, n_channels=20, box_cells=16)
SKIES = [replace(SURVEY, seed=seed) for seed in (1, 2)]
CASES = [Case(survey=survey, beam=beam) for survey in SKIES for beam in (Degraded(), Oscillating())]
METHODS = PCA(n_sources=2), PCA(n_sources=3)
CALLS = [(cleaned.assessment, (case, method)) for case in CASES for method in METHODS]
FACTS = [(evidence.masked_voxels, (case,)) for case in CASES[:2]]
FACTS += [(evidence.sky_brightness, (case.survey.sky, case.galaxy)) for case in CASES[::2]]
SMALL = {"true_spectra": 4, "components_of_sky": 2, "assessment": 8, "masked_voxels": 2, "sky_brightness": 2}


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))


def _held():
    return Counter(entry.product for entry in cache.cache_info())


def _watch(monkeypatch):
    """The largest number of each product that is there at once."""
    most, make_all = Counter(), cleaned.make_all

    def watched(*args, **options):
        made = make_all(*args, **options)
        most.update({name: n - most[name] for name, n in _held().items() if n > most[name]})
        return made

    monkeypatch.setattr(cleaned, "make_all", watched)
    return most


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_one_case_after_the_other_where_observations_do_not_stay(monkeypatch, jobs):
    monkeypatch.setenv(JOBS_VARIABLE, jobs)
    most, work = _watch(monkeypatch), FACTS + CALLS
    cleaned.make_by_case(work)
    assert {most[name] for name in ("observation", "hi_of_sky", "hi_alms_of_sky", "foreground_seen")} == {1}
    assert most["separation"] == 2
    assert _held() == SMALL
    n_made = len(MADE)
    cleaned.make_by_case(work)
    assert len(MADE) == n_made


def test_a_cluster_gets_all_cases_at_once(monkeypatch):
    most = _watch(monkeypatch)
    monkeypatch.setattr(cleaned, "dask_address", lambda: "tcp://somewhere:1")
    cleaned.make_by_case(CALLS)
    assert most["observation"] == 4 and _held()["observation"] == 0


@pytest.mark.parametrize("fit", [1, 2])
def test_light_cones_come_first_and_no_more_at_once_than_the_memory_holds(monkeypatch, fit):
    """In a process that makes one, no other is at work on what else an observation needs."""
    needed, order, make_all = estimate(SURVEY), [], cleaned.make_all

    def watched(work, *args, at_once=None):
        order.append(({product.name.rpartition(".")[2] for product, _ in work}, at_once))
        return make_all(work, *args, at_once=at_once)

    monkeypatch.setattr(cleaned, "make_all", watched)
    monkeypatch.setenv("HIMAP_MAX_MEMORY", f"{(fit + 0.5) * max(needed.values()) / 1e9:.3f}GB")
    cleaned.make(CALLS[:4])
    assert order == [({"hi_alms_of_sky"}, fit), ({"peak_masked"}, fit), ({"assessment"}, None)]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_products_of_several_kinds_are_made_side_by_side(monkeypatch, jobs):
    """What needs another makes it, or waits for the process that does."""
    monkeypatch.setenv(JOBS_VARIABLE, jobs)
    calls = [(CASES[0], method, True) for method in METHODS]
    kinds = cleaned.post_masked, cleaned.assessment
    cleaned.make([(kind, call) for kind in kinds for call in calls])
    assert _held()["post_masked"] == _held()["assessment"] == _held()["separation"] == 2


def test_what_was_there_before_stays():
    cleaned.separation(CASES[0], METHODS[0])
    before = _held()
    cleaned.make_by_case(CALLS)
    assert {name: n for name, n in _held().items() if name not in SMALL} == {
        name: n for name, n in before.items() if name not in SMALL
    }


def test_what_fails_leaves_no_cubes():
    with pytest.raises(ZeroDivisionError):
        cleaned.make_by_case([*CALLS[:1], (_Failing(), (CASES[0],))])
    assert _held().keys() <= SMALL.keys()


class _Failing:
    name = "failing"

    def is_cached(self, *call):
        return False

    def __call__(self, *call):
        return 1 / 0


def test_all_stays_by_default():
    cleaned.make(CALLS[:2])
    assert _held()["observation"] == 1 and _held()["separation"] == 2
