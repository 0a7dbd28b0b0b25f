"""A cube of one's own cleaned from several starts: the medoid, and the scatter of the spectra."""

import csv
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from astropy.io import fits
from cube_files import N_PIX, power_law_maps, run, write_hdf5

from himap.cubes import beams_of, clean_cube, read_cube
from himap.cubes.scatter import PERCENTILES, scatter_of, scatter_table
from himap.cubes.spectra import spectra_of
from himap.instrument.beams import named
from himap.removal.base import SeparationWarning
from himap.removal.restarts import RESTARTS, Ensemble

QUICK = {"n_sources": 2, "noise": 1.0, "n_warmup": 1, "n_refinement": 1, "n_scales": 2}
QUICK |= {"warmup_tolerance": 1e9, "tolerance": 1e9}  # two iterations


@pytest.fixture
def path(rng, tmp_path):
    return write_hdf5(tmp_path / "cube.h5", power_law_maps(rng))


@pytest.fixture
def cube(path):
    return read_cube(path)


def unlike(cleaned, n_members=3):
    """A `CleanedCube` with an ensemble of cleanings that differ, though not by their start."""
    n = cleaned.method.n_sources
    ensemble = Ensemble(members=tuple(cleaned.with_sources(n + k) for k in range(n_members)))
    shown = replace(ensemble.medoid)
    vars(shown).update(separation=ensemble.medoid.separation, ensemble=ensemble)
    return shown


@pytest.mark.parametrize("kept", [1.0, 0.6])
def test_spectra_of_members_are_those_of_their_residuals(cube, kept):
    """To 1 % in C_l, of the whole sky and of a part, though no residual is analysed but one."""
    cube = cube if kept == 1 else cube.within(np.arange(N_PIX) < kept * N_PIX)
    shown = unlike(clean_cube(cube, "pca", n_sources=1, peaks=False))
    scatter = scatter_of(shown)
    for k, member in enumerate(shown.ensemble.members):
        alone = spectra_of(member)
        l_top = 32  # 2 nside
        low = (alone.angular.degrees > 0) & (alone.angular.degrees <= l_top)
        assert scatter.x["angular"][: low.sum()] == pytest.approx(alone.angular.degrees[low])
        assert scatter.powers["angular"][k][: low.sum()] == pytest.approx(alone.angular.mean[low], rel=0.01)
        assert scatter.powers["frequency"][k] == pytest.approx(alone.frequency.power[1:], rel=1e-3)
    assert np.ptp(scatter.powers["frequency"][:, 0]) > 0.1 * scatter.powers["frequency"][0, 0]


def test_the_table_is_over_the_medoid(cube):
    shown = unlike(clean_cube(cube, "pca", n_sources=1, peaks=False), n_members=2)
    scatter = scatter_of(shown)
    assert scatter.medoid == 0
    rows = {row[0]: [float(number) for number in row[1:]] for row in scatter_table(scatter).rows}
    angular, frequency = scatter.powers.values()
    upper = scatter.columns("angular", scatter.x["angular"])["restarts_84"]
    assert upper == pytest.approx(np.percentile(angular, 84, axis=0))
    inside = (scatter.x["angular"] > 19.5) & (scatter.x["angular"] < 39.5)
    ratio = angular[1, inside].mean() / angular[0, inside].mean()
    expected = np.percentile([1, ratio], PERCENTILES)
    assert rows["C(l), l 20-39"] == pytest.approx(expected, rel=1e-3)
    assert rows["P(k), k > 0.1"][1] == pytest.approx(
        np.mean([1, np.divide(*(power[scatter.x["frequency"] > 0.1].mean() for power in frequency[::-1]))]),
        rel=1e-3,
    )


class TestPython:
    def test_several_by_default(self, cube):
        beams = beams_of(cube, named("evolving"))
        with pytest.warns(SeparationWarning, match="is chaotic|this is restart"):
            cleaned = clean_cube(cube, "sdecgmca", beams=beams, restarts=1, **QUICK)
        assert cleaned.ensemble is None and "--restarts 8" in cleaned.remarks[0]
        several = cleaned.with_restarts(RESTARTS)
        assert len(several.ensemble.members) == RESTARTS
        assert several.method == several.ensemble.medoid.method
        assert several.residual is several.ensemble.medoid.residual
        assert f"the medoid of {RESTARTS}" in several.remarks[0]
        assert not any("before it converged" in remark for remark in several.remarks)


class TestCommand:
    OPTIONS = [word for name, value in QUICK.items() for word in ("-p", f"{name}={value}")]
    WORDS = ["--method", "sdecgmca", "--beam", "evolving", *OPTIONS]

    def test_what_is_written(self, path, monkeypatch):
        monkeypatch.chdir(path.parent)
        done = run("clean", path, *self.WORDS, "--restarts", 3, "--mocks", 1, "-o", "c.h5")
        assert "over the medoid" in done.output and "the medoid of 3, of which" in done.output
        with h5py.File("c.h5") as file:
            about = dict(file.attrs)
        assert about["restarts"] == 3 and 0 <= about["failed"] <= 3 and about["restart"] in range(3)
        page = Path("c.html").read_text()
        assert "<h2>Restarts</h2>" in page and "the medoid of 3, of which" in page
        with open("c.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        low, middle, high = (np.array([float(row[f"restarts_{n}"]) for row in rows]) for n in PERCENTILES)
        assert ((low <= middle * 1.000001) & (middle <= high * 1.000001)).all()
        left = np.array([float(row["residual"]) for row in rows])
        assert middle == pytest.approx(left, rel=0.1)  # two iterations do not part them

    @pytest.mark.usefixtures("no_pages")
    def test_one(self, path, monkeypatch):
        monkeypatch.chdir(path.parent)
        done = run("clean", path, *self.WORDS, "--restarts", 1, "-o", "c.fits")
        assert "one run is one draw" in done.output and "over the medoid" not in done.output
        assert "RESTARTS" not in fits.getheader("c.fits", 1)
        run("clean", path, *self.WORDS, "--restarts", 2, "-o", "d.fits")
        assert fits.getheader("d.fits", 1)["RESTARTS"] == 2
