"""The counts of what kills and full disks do: right where nothing is lost, and where something is."""

import random
from collections import Counter
from copy import copy

import pytest

from benchmarks import endurance
from benchmarks.places import Place

CLEAN = ["clean", "cube.h5", "--method", "pca", "-p", "n_sources=2", "-o", "cleaned.npy"]
LOST = ("reruns_that_failed", "other_results", "processes_left")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A trial whose command has run once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(endurance, "_N_CHANNELS", 10)
        patch.setattr(endurance, "_NSIDE", 8)
        yield endurance.Trial("clean", CLEAN, tmp_path_factory.mktemp("trial"))


@pytest.fixture
def trial(undisturbed, tmp_path):
    """The same, with a folder, counts and expectations of its own."""
    trial = copy(undisturbed)
    trial.home, trial.counts, trial.expected = tmp_path, Counter(), dict(undisturbed.expected)
    return trial


def test_a_killed_command_loses_nothing(trial):
    assert set(trial.expected) == {
        "cube.h5",
        *(f"cleaned{end}" for end in (".npy", ".html", "_foreground.npy", "_mixing.txt")),
    }
    endurance.kill(trial, 2, random.Random(1))
    counts = trial.counts
    assert counts["kills"] == 2 and counts["finished"] >= 1
    assert not any(counts[name] for name in LOST) and not any(name.startswith("left") for name in counts)


def test_a_full_disk_is_counted(trial):
    class Small(random.Random):
        def uniform(self, *ends):
            return 3  # 1000 bytes: more than is said, less than a cube

    endurance.fill_disk(trial, 1, Small())
    assert trial.counts["full_disks"] == trial.counts["told_in_a_sentence"] == trial.counts["finished"] == 1
    assert not trial.counts["done_all_the_same"] and not any(trial.counts[name] for name in LOST)


def test_what_is_lost_or_left_is_counted(trial, monkeypatch):
    trial.expected["cleaned.npy"] = "other bits"
    place = trial.place()
    (place.folder / "tmp" / "left").touch()
    (place.folder / "work" / ".himap-left").mkdir()
    (place.folder / "cache" / "product" / "unfinished-left").mkdir(parents=True)
    monkeypatch.setattr(Place, "gone", lambda self: 1)
    trial.finish(place)
    left = {f"left_{name}": 1 for name in ("beside_outputs", "in_the_cache", "in_temporary_folders")}
    assert trial.counts == {"other_results": 1, "processes_left": 1, "finished": 1, **left}
    assert not place.folder.exists()
