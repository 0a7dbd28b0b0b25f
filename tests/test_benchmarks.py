"""The benchmarks run, and compare with code that does the same work. No test reads a clock."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from sklearn import decomposition

from himap import removal
from himap.maps import sphere
from himap.paper.methods import TABLE_1, paper_beams
from himap.removal.blurred_mixture import BlurredMixture
from himap.removal.parametric import Parametric
from himap.removal.pca import PCA
from himap.removal.peaks import smooth_baselines

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # benchmarks/ is not installed

from benchmarks import __main__ as chain_of_steps
from benchmarks import alternatives, methods, scaling
from benchmarks.machine import Machine, Needs
from benchmarks.measure import Measured, measured

TINY = {"nside": "8", "n_channels": "30", "box_cells": "16"}
COMPARED = {"sdecgmca", "peak masking", "pca", "fastica", "gmca", "polynomial", "parametric", "beam_subspace"}
FREQS = np.linspace(900, 1400, 60)


@pytest.fixture
def maps(rng):
    """Two power laws, noise, and here and there a peak; (60, 768) float32, mK."""
    x = FREQS[:, None] / 1150
    first, second = 100 * rng.random((2, 768)) + 100
    maps = first * x**-2.13 + 10 * second * x**-2.8 + 0.1 * rng.standard_normal((60, 768))
    maps[rng.integers(60, size=40), rng.choice(768, 40, replace=False)] += 50
    return maps.astype(np.float32)


def test_the_table_has_every_method(monkeypatch):
    monkeypatch.setattr(methods, "alone", lambda function, *args: function(*args))
    monkeypatch.setattr(alternatives, "N_LINES", 8)
    survey = [word for pair in TINY.items() for word in ("--survey", *pair)]
    options = ["--preset", "ci", "--beam", "evolving", *survey]
    outcome = CliRunner().invoke(methods.main, options, catch_exceptions=False)
    lines = [*outcome.output.splitlines(), "end"]
    for name in COMPARED | set(removal.available()):
        (here,) = [n for n, line in enumerate(lines) if line.startswith(f"{name}  ")]
        assert " GB" in lines[here]
        beside = next(line for line in lines[here + 1 :] if "warning: " not in line)
        assert " x  " in beside or name not in COMPARED, f"{name} has no alternative"
    assert sum("sampled: 8 of 768 lines, scaled up" in line for line in lines) == 3


@pytest.mark.parametrize("beam", TABLE_1)
def test_numbers_of_components_are_those_of_the_paper(beam):
    used = methods.methods(paper_beams()[beam]).values()
    n_sources = {one.n_sources for one in used if hasattr(one, "n_sources")}
    assert n_sources == {TABLE_1[beam]["n_sources"]}


def test_a_method_has_a_process_of_its_own(monkeypatch):
    monkeypatch.setattr(methods, "PRELOADED", [])  # saves time, changes nothing
    assert len({os.getpid(), methods.alone(os.getpid), methods.alone(os.getpid)}) == 3


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
    machine = Machine(
        bandwidth=1e9, operations=1e10, operations_single=2e10, transform=0.01, transform_single=0.005
    )
    needs = Needs(transforms=10, transforms_single=20, n_bytes=3e9, operations=1e10, operations_single=1e10)
    assert needs.floor(machine) == pytest.approx(0.1 + 0.1 + 3 + 1 + 0.5)


@pytest.fixture
def small_trials(monkeypatch):
    """The machine is measured with arrays that are soon done."""
    monkeypatch.setattr("benchmarks.machine._BYTES", 2**22)
    monkeypatch.setattr("benchmarks.machine._SIDE", 300)


def test_what_the_machine_can_do(small_trials):
    found = Machine.measured(8)
    assert 1e8 < found.bandwidth < 1e12 and 1e8 < found.operations < found.operations_single * 3
    assert found.transform > 0


def test_steps_in_processes_of_their_own(tmp_path, small_trials, monkeypatch):
    """As from the shell, one of them in a process, which takes long to start: the table, and the file."""

    def measured_here(step, case, *, beside):
        if step.name == "PCA":
            return measured(step, case, beside=beside)
        needs, (name, work, times) = step.needs(case.survey, step.work(case)), step.beside(case)
        work()
        return Measured(seconds=1.0, memory=10**9, needs=needs, alternative=(name, 1.0, 1 / times))

    monkeypatch.setattr(chain_of_steps, "measured", measured_here)
    sizes = [word for pair in TINY.items() for word in ("--survey", *pair)]
    only = ["--only", "PCA", "--only", "all measures"]
    path = tmp_path / "steps.json"
    outcome = CliRunner().invoke(
        chain_of_steps.main, ["--preset", "paper", *sizes, *only, "-o", str(path)], catch_exceptions=False
    )
    table = [line for line in outcome.output.splitlines() if line.startswith(("PCA", "all measures"))]
    assert len(table) == 2 and "8 s" in table[0] and "scikit-learn PCA" in table[0]
    assert "6 s" in table[1] and "healpy anafast" in table[1]
    found = json.loads(path.read_text())
    for row in found["steps"]:
        assert row["seconds"] > 0 and 0.1 < row["memory_gb"] < 5 and row["floor_seconds"] > 0
        assert row["alternative"]["seconds"] > 0 and 0 < row["alternative"]["measured_share"] <= 1
    assert found["about"]["preset"] == "paper" and found["machine"]["bandwidth"] > 0


def test_times_of_a_machine_that_slows_down_are_brought_to_one_pace():
    assert scaling.at_one_pace([(2.0, 1.0), (24.0, 3.0)]) == pytest.approx([2, 8])


def test_exponents():
    sizes = np.array([32, 64, 128])
    assert scaling.exponents(sizes, 0.1 * sizes**2.5) == pytest.approx(2.5)
