"""Cubes of one's own: the same maps come in, and come back as they were; cleaned once and many times."""

import csv
import html
import json
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from cube_files import FREQS, N_PIX, NSIDE, run, write_hdf5

from himap import removal
from himap.app.cli.main import main
from himap.cubes import beams_of, clean_cube, measure_transfer, read_cube
from himap.cubes.scatter import PERCENTILES, scatter_of, scatter_table
from himap.cubes.spectra import spectra_of
from himap.instrument import beams
from himap.instrument.beams.base import diffraction_fwhm
from himap.maps import sphere
from himap.removal.base import SeparationWarning
from himap.removal.peaks import mask_peaks
from himap.removal.restarts import RESTARTS, Ensemble

METHODS = removal.available()
QUICK = {"n_sources": 2, "noise": 1.0, "n_warmup": 1, "n_refinement": 1, "n_scales": 2}
QUICK |= {"warmup_tolerance": 1e9, "tolerance": 1e9}  # two iterations of SDecGMCA


@pytest.fixture
def path(maps, tmp_path):
    return write_hdf5(tmp_path / "cube.h5", maps)


@pytest.fixture
def cube(path):
    return read_cube(path)


@pytest.mark.parametrize("missing", [np.nan, np.inf, hp.UNSEEN])
def test_pixels_that_one_channel_does_not_see_are_masked_in_all(maps, missing, tmp_path):
    """For methods that take weights too, if they are few; a blind channel is no gap."""
    maps[3, 7] = missing
    maps[20, :] = missing
    path = write_hdf5(tmp_path / "a.h5", maps)
    for scattered in (False, True):
        cube = read_cube(path, scattered=scattered)
        assert cube.weights is None and cube.mask.sum() == N_PIX - 1 and not cube.mask[7]
        assert len(cube.freqs) == 23 and "1 of 24 channels have no data" in cube.remarks[0]


@pytest.mark.parametrize("n_channels", range(28, 34))
def test_it_is_said_where_no_peak_can_be_masked(rng, n_channels, tmp_path):
    """A bright peak in each channel of one pixel each shows whether one can."""
    freqs = np.linspace(900, 1000, n_channels)
    maps = rng.normal(size=(n_channels, N_PIX))
    maps[:, :n_channels] += 1e6 * np.eye(n_channels)
    cube = read_cube(write_hdf5(tmp_path / "a.h5", maps, freqs))
    cleaned, kept = (clean_cube(cube, "polynomial", peaks=peaks) for peaks in (True, False))
    said = f"In {n_channels} channels no value can exceed 5 standard deviations of all: no peak is"
    assert [one.startswith(said) for one in cleaned.remarks] == [True] * (cleaned.flagged == 0)
    assert (cleaned.flagged > 0) == (n_channels > 29) and not kept.remarks


class TestCleaning:
    @pytest.mark.usefixtures("no_pages")
    @pytest.mark.parametrize("name", ["pca", "beam_subspace"])
    def test_with_a_mask_through_the_command(self, name, maps, path, tmp_path):
        """A NESTED mask; what is left is that of the library, UNSEEN outside, with all that was said."""
        kept = np.abs(sphere.pixel_latitude(NSIDE)) > 15
        mask = hp.reorder(kept.astype(np.float32), r2n=True)
        hp.write_map(tmp_path / "m.fits", mask, nest=True, dtype=np.float32)
        options = ["--method", name, "-p", "n_sources=2", "--beam", "oscillating"]
        done = run("clean", path, *options, "--mask", tmp_path / "m.fits", "-o", tmp_path / "c.fits")
        assert f"{kept.mean():.1%} of the sky is kept by the mask" in done.output
        found = np.array(hp.read_map(tmp_path / "c.fits", field=None, dtype=None))
        basis = np.where(kept, maps, 0).astype(np.float32)
        basis[:, kept] = mask_peaks(maps[:, kept], FREQS).maps
        seen = beams_of(read_cube(path), "oscillating")
        options = {"beams": seen, "separate_on": basis, "mask": kept}
        expected = removal.create(name, n_sources=2).clean(maps, freqs=FREQS, **options).residual
        assert found[:, kept] == pytest.approx(expected[:, kept], abs=1e-5)
        assert (found[:, ~kept] == hp.UNSEEN).all()
        history = "".join("".join(fits.getheader(tmp_path / "c.fits", 1)["HISTORY"]).split())
        table = (tmp_path / "c_mixing.txt").read_text()
        said = [one for one in done.stderr.splitlines() if not one.endswith(" remain")]  # progress, if slow
        parameters = json.dumps(asdict(removal.create(name, n_sources=2)))
        for one in (*said, f"parameters: {parameters}"):
            assert "".join(one.split()) in history and f"# {one}\n" in table

    def test_a_cube_with_holes_by_a_method_that_looks_at_the_sky(self, maps, cube, tmp_path):
        """As the same cube under a mask, and mocks can be put into it."""
        kept = np.abs(sphere.pixel_latitude(NSIDE)) > 15
        holes = read_cube(write_hdf5(tmp_path / "a.h5", np.where(kept, maps, np.nan)))
        seen = beams_of(cube, "oscillating")[:, : 2 * NSIDE + 1]  # as far as it looks
        options = {"method": "beam_subspace", "beams": seen, "n_sources": 2}
        one, two = (clean_cube(each, **options) for each in (holes, cube.within(kept)))
        assert np.array_equal(one.residual, two.residual)
        assert one.residual.shape == one.maps.shape == (24, kept.sum())
        mock = 1e-3 * maps[:, kept]
        found = measure_transfer(one, [mock])
        assert np.isfinite(found.angular).all() and np.isfinite(found.frequency).all()

    def test_what_is_written_adds_up(self, maps, tmp_path):
        path = write_hdf5(tmp_path / "a.h5", maps / 1e3, unit="K", ordering="RING")
        truth = write_hdf5(tmp_path / "t.h5", maps / 1e6, unit="K", ordering="RING")
        options = ["--method", "polynomial", "-p", "order=4", "--truth", truth]
        done = run("clean", path, *options, "-o", tmp_path / "c.h5")
        with h5py.File(tmp_path / "c.h5") as file:
            assert file["residual"][...] + file["foreground"][...] == pytest.approx(maps / 1e3, rel=1e-6)
            assert file["mixing"].shape == (24, 5) and file["residual"].attrs["unit"] == "K"
            assert json.loads(file.attrs["parameters"])["order"] == 4
            said = done.stderr.splitlines()
            assert said and file.attrs["remarks"].splitlines() == said
        page = (tmp_path / "c.html").read_text()
        assert all(html.escape(sentence) in page for sentence in said)
        assert page.count("<img alt=") == 3 and "C/C0" in page and "http" not in page


def test_beams_by_dish_and_of_a_file_in_the_order_of_the_cube(maps, rng, tmp_path):
    """A file of b_l; one of widths has the contract of all beams (test_beams.py)."""
    shuffled = rng.permutation(len(FREQS))
    np.save(tmp_path / "a.npy", maps[shuffled])
    cube = read_cube(tmp_path / "a.npy", freqs=FREQS[shuffled], unit="mK", order="RING")
    expected = sphere.gaussian_beam(diffraction_fwhm(FREQS, 20), 3 * NSIDE - 1)
    assert beams_of(cube, "evolving", dish=20) == pytest.approx(expected)
    worst = beams_of(cube, "degraded", dish=20)
    assert worst[-1] == pytest.approx(expected[0])
    transfer = sphere.gaussian_beam(np.deg2rad(np.linspace(2, 1, 24)), 60)
    np.save(tmp_path / "b.npy", transfer[shuffled])
    assert beams_of(cube, tmp_path / "b.npy") == pytest.approx(transfer[:, : 3 * NSIDE])


def test_frequencies_of_other_channels_are_no_obstacle_to_those_that_are_given(path):
    with h5py.File(path, "a") as file:
        del file["sky/freq"]
        file["freq"] = np.arange(900.0, 925)
    assert np.array_equal(read_cube(path, freqs=FREQS).freqs, FREQS)


def test_the_help_lists_what_there_is():
    out = " ".join(run("clean", "--help").output.split())
    assert all(name in out for name in (*beams.available(), *METHODS))
    more = run("clean", "--help-files").output
    hidden = [option.opts[0] for option in main.commands["clean"].params if getattr(option, "hidden", False)]
    assert "--help-files" in out and hidden and all(f"{name} NAME" in more for name in hidden)


def unlike(cleaned, n_members=3):
    """A `CleanedCube` with an ensemble of cleanings that differ, though not by their start."""
    n = cleaned.method.n_sources
    ensemble = Ensemble(members=tuple(cleaned.with_sources(n + k) for k in range(n_members)))
    shown = replace(ensemble.medoid)
    vars(shown).update(separation=ensemble.medoid.separation, ensemble=ensemble)
    return shown


@pytest.mark.parametrize("kept", [1.0, 0.6])
def test_spectra_of_members_are_those_of_their_residuals(cube, kept):
    """To 1 % in C_l from l = 1, of the whole sky and of a part, though no residual is analysed but one."""
    cube = cube if kept == 1 else cube.within(np.arange(N_PIX) < kept * N_PIX)
    shown = unlike(clean_cube(cube, "pca", n_sources=1, peaks=False))
    scatter = scatter_of(shown)
    for k, member in enumerate(shown.ensemble.members):
        alone = spectra_of(member)
        l_top = 32  # 2 nside
        low = (alone.angular.degrees >= 1) & (alone.angular.degrees <= l_top)
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
    first, second = frequency[:, scatter.x["frequency"] > 0.1].mean(axis=1)
    assert rows["P(k), k > 0.1"][1] == pytest.approx(np.mean([1, second / first]), rel=1e-3)


def test_several_by_default_in_python(cube):
    beams = beams_of(cube, "evolving")
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

    def test_what_is_written(self, path, rng, monkeypatch):
        monkeypatch.chdir(path.parent)
        mock = write_hdf5("mock.h5", rng.standard_normal((24, N_PIX)).astype(np.float32))
        done = run("clean", path, *self.WORDS, "--restarts", 3, "--mocks", mock, "-o", "c.h5")
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
