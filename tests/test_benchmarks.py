"""The benchmarks run, and compare with code that does the same work; kills and full disks are counted.

No test reads a clock.
"""

import json
import random
from collections import Counter
from copy import copy
from types import SimpleNamespace

import click
import numpy as np
import pytest
from click.testing import CliRunner
from sklearn import decomposition

from benchmarks import __main__ as chain_of_steps
from benchmarks import alternatives, endurance, floors, methods, scaling, steps, whole
from benchmarks.floors import Machine, Needs
from benchmarks.measure import Measured, measured
from benchmarks.places import Place
from himap import removal
from himap.core.survey import PRESETS
from himap.maps import sphere
from himap.paper.methods import TABLE_1, paper_beams
from himap.removal.blurred_mixture import BlurredMixture
from himap.removal.parametric import Parametric
from himap.removal.pca import PCA
from himap.removal.peaks import smooth_baselines
from himap.store.provenance import Provenance

TINY = {"nside": "8", "n_channels": "30", "box_cells": "16"}
COMPARED = {"sdecgmca", "peak masking", "pca", "fastica", "gmca", "polynomial", "parametric"}
FREQS = np.linspace(900, 1400, 60)


@pytest.fixture
def maps(rng):
    """Two power laws, noise, and here and there a peak; (60, 768) float32, mK."""
    x = FREQS[:, None] / 1150
    first, second = 100 * rng.random((2, 768)) + 100
    maps = first * x**-2.13 + 10 * second * x**-2.8 + 0.1 * rng.standard_normal((60, 768))
    maps[rng.integers(60, size=40), rng.choice(768, 40, replace=False)] += 50
    return maps.astype(np.float32)


def measured_here(step, case, *, alternatives=True):
    """A `Measured` without a process of its own, which takes long to start, and without a clock."""
    result, others = step.work(case), []
    for name, work, times in step.alternatives(case, result) if alternatives and step.alternatives else ():
        work()
        others.append((name, 2.0, 1 / times))
    needs = step.needs and step.needs(case.survey, result)
    return Measured(seconds=1.0, memory=10**9, needs=needs, alternatives=others)


def table(command, *options):
    """The lines that a benchmark prints for a small sky."""
    survey = [word for pair in TINY.items() for word in ("--survey", *pair)]
    return CliRunner().invoke(command, [*options, *survey], catch_exceptions=False).output.splitlines()


def test_the_table_has_every_method(monkeypatch):
    monkeypatch.setattr(methods, "measured", measured_here)
    monkeypatch.setattr(alternatives, "N_LINES", 8)
    lines = [*table(methods.main, "--preset", "ci", "--beam", "evolving"), "end"]
    for name in COMPARED | set(removal.available()):
        (here,) = [n for n, line in enumerate(lines) if line.startswith(f"{name}  ")]
        assert "1.00 GB" in lines[here]
        assert (" 2.00 x  " in lines[here + 1]) == (name in COMPARED), name
    assert sum("line by line (from 0.01 of it)" in line for line in lines) == 3


@pytest.mark.parametrize("beam", TABLE_1)
def test_numbers_of_components_are_those_of_the_paper(beam):
    used = [steps.method_of(paper_beams()[beam], name) for name in removal.available()]
    n_sources = {one.n_sources for one in used if hasattr(one, "n_sources")}
    assert n_sources == {TABLE_1[beam]["n_sources"]}


def test_plain_decomposition_does_what_pca_does(maps):
    ours = PCA(n_sources=2).clean(maps, freqs=FREQS).residual
    plain = alternatives.plain_residual(decomposition.PCA(2), maps, maps)
    assert np.allclose(plain, ours, atol=1e-3)  # float32 of 4000 mK


@pytest.mark.parametrize("at_once", [True, False])
def test_plain_polynomials_are_the_baselines(maps, at_once):
    found = smooth_baselines(maps, FREQS)
    assert found.flagged.any(axis=0).sum() >= 20
    ours = found.basis @ found.second
    plain = alternatives.plain_polynomials
    assert np.allclose(plain(maps) if at_once else np.hstack([plain(line) for line in maps.T]), ours)


def test_plain_power_laws_are_the_parametric_fit(maps):
    lines = maps[:, :20]
    ours = Parametric().clean(lines, freqs=FREQS)
    x = FREQS / 1150
    plain = [alternatives.plain_power_laws(line, x, -4, -2.2) for line in lines.T.astype(float)]
    fits = np.stack([a1 * x**-2.13 + a2 * x**beta for a1, a2, beta in plain], axis=1)
    assert np.allclose(fits, ours.foreground, atol=0.01)


def test_plain_sources_are_those_of_sdecgmca(rng):
    beams, mixing = sphere.gaussian_beam(np.linspace(0.1, 0.2, 6), 12), rng.random((6, 3))
    modes = rng.standard_normal((6, 13**2))
    mixture = BlurredMixture(modes, beams)
    ours = mixture.sources(mixture.least_squares(mixing))
    assert np.allclose(alternatives.plain_sources(mixture.matrices(mixing), modes), ours)


def test_floors_add_up():
    rates = {"bandwidth": 1e9, "operations": 1e10, "operations_single": 2e10}
    machine = Machine(**rates, transform=0.01, transform_single=0.005)
    needs = Needs(transforms=10, transforms_single=20, n_bytes=3e9, operations=1e10, operations_single=1e10)
    assert needs.floor(machine) == pytest.approx(0.1 + 0.1 + 3 + 1 + 0.5)


def test_the_floor_of_pca_grows_with_its_sources():
    three, seven = (floors.pca(PRESETS["ci"], SimpleNamespace(mixing=np.zeros((100, n)))) for n in (3, 7))
    products = 2 * 2 * 100 * 12 * 32**2  # of one source, with the cube and back, two operations each
    assert seven.operations - three.operations == 4 * products


def test_steps_in_processes_of_their_own(tmp_path, monkeypatch):
    """As from the shell, one of them in a process: the table, and the file, with what the machine can do."""
    monkeypatch.setattr(floors, "_BYTES", 2**22)  # measured with arrays that are soon done
    monkeypatch.setattr(floors, "_SIDE", 300)

    def measure(step, case, **options):
        return (measured if step.name == "PCA" else measured_here)(step, case, **options)

    monkeypatch.setattr(chain_of_steps, "measured", measure)
    path = tmp_path / "steps.json"
    only = ["--only", "PCA", "--only", "all measures"]
    lines = table(chain_of_steps.main, "--preset", "paper", *only, "-o", str(path))
    first, second = [line for line in lines if line.startswith("| ") and "× " in line]
    assert "PCA" in first and "8\N{NO-BREAK SPACE}s" in first and "scikit-learn PCA" in first
    assert "6\N{NO-BREAK SPACE}s" in second and "healpy anafast" in second
    found = json.loads(path.read_text())
    for row in found["steps"]:
        assert row["seconds"] > 0 and 0.1 < row["memory_gb"] < 5 and row["floor_seconds"] > 0
        assert row["alternative"]["seconds"] > 0 and 0 < row["alternative"]["measured_share"] <= 1
    assert found["about"]["preset"] == "paper"
    can = Machine(**found["machine"])
    assert 1e8 < can.bandwidth < 1e12 and 1e8 < can.operations < can.operations_single * 3
    assert can.transform > 0


def test_all_commands_of_the_paper_in_one(tmp_path, monkeypatch):
    command = "run 03_peak_masking -p nside=16 -p n_channels=50 -p box_cells=32"
    monkeypatch.setattr(whole, "COMMANDS", {"peaks": command})
    path = tmp_path / "whole.json"
    options = ["--preset", "ci", "--folder", str(tmp_path / "kept"), "-o", str(path)]
    done = CliRunner().invoke(whole.main, options, catch_exceptions=False)
    found = json.loads(path.read_text())
    assert [row["step"] for row in found["commands"]] == ["peaks"] and "peaks" in done.output
    assert found["seconds"] == found["commands"][0]["seconds"] > 0 and 0.1 < found["memory_gb"] < 5
    assert [one.suffix for one in (tmp_path / "kept").glob("results/03_peak_masking*")] == [".ipynb"]
    monkeypatch.setattr(whole, "COMMANDS", {"ledger": "measure claims --check nothing.json"})
    assert "ended with 2" in CliRunner().invoke(whole.main, ["--preset", "ci"]).output


def test_a_command_that_fails_leaves_what_was_timed_before_it(tmp_path, monkeypatch):
    def run(arguments, *_):
        if "claims" in arguments:
            raise click.ClickException("no ledger")
        return {"seconds": 2.0, "memory_gb": 1.0}

    monkeypatch.setattr(whole, "_run", run)
    path = tmp_path / "whole.json"
    options = ["--preset", "ci", "--folder", str(tmp_path), "-o", str(path)]
    assert "no ledger" in CliRunner().invoke(whole.main, options).output
    found = json.loads(path.read_text())
    assert len(found["commands"]) == len(whole.COMMANDS) - 1 == found["seconds"] / 2
    path.unlink()
    (tmp_path / "ledger.json").touch()
    assert "ledger.json exists" in CliRunner().invoke(whole.main, options).output and not path.exists()


@pytest.mark.parametrize(
    ("command", "options"),
    [
        (chain_of_steps.main, ["--survey", "nside", "7"]),
        (methods.main, ["--beam", "nonsense"]),
        (whole.main, ["--galaxy", "templates"]),
    ],
)
def test_bad_input_ends_in_a_sentence(command, options):
    done = CliRunner().invoke(command, options)
    assert done.exit_code == 1 and done.output.startswith("Error: ") and done.output.count("\n") == 1


def test_counts_of_one_file_have_one_provenance(tmp_path, monkeypatch):
    monkeypatch.setattr(endurance, "kill", lambda *_: None)
    trials = {name: ("run", endurance.kill) for name in ("run_killed", "clean_killed")}
    monkeypatch.setattr(endurance, "_TRIALS", trials)
    monkeypatch.setattr(endurance, "Trial", lambda *_: SimpleNamespace(seconds=1.0, counts={"kills": 1}))
    path = tmp_path / "endurance.json"

    def count(name, *options):
        options = ["--only", name, "-o", str(path), *options]
        return CliRunner().invoke(endurance.main, options)

    assert count("run_killed").exit_code == count("clean_killed").exit_code == 0
    before = path.read_bytes()
    assert set(json.loads(before)["found"]) == set(trials)
    assert "other parameters" in count("run_killed", "-p", "nside=8").output
    assert count("run_kiled").exit_code == 2 and path.read_bytes() == before


def test_times_of_a_machine_that_slows_down_are_brought_to_one_pace():
    assert scaling.at_one_pace([(2.0, 1.0), (24.0, 3.0)]) == pytest.approx([2, 8])


def test_exponents():
    sizes = np.array([32, 64, 128])
    assert scaling.exponents(sizes, 0.1 * sizes**2.5) == pytest.approx(2.5)


def test_growth_says_at_which_preset_what_grows(tmp_path, monkeypatch):
    monkeypatch.setattr(scaling, "measure", lambda steps: {})
    CliRunner().invoke(scaling.main, ["-o", str(tmp_path / "cost.json")], catch_exceptions=False)
    about = json.loads((tmp_path / "cost.json").read_text())["about"]
    assert Provenance.of_stored(about).footer().startswith("nside at ci, n_channels at laptop · synthetic")


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


@pytest.mark.parametrize(("code", "said"), [(1, "Error: no room"), (2, "Traceback"), (2, "Error: Traceback")])
def test_an_end_without_a_sentence_is_no_sentence(trial, code, said):
    place = trial.place()
    place.errors.write_text(said)
    endurance._count_end(trial, place, SimpleNamespace(wait=lambda: code), "Error: ")
    assert trial.counts["told_in_a_sentence"] == trial.counts["done_all_the_same"] == 0


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
