"""Cubes of one's own: whatever way they are stored, the same maps come in, and come back as they were."""

import html
import json

import h5py
import healpy as hp
import numpy as np
import pytest
from astropy.io import fits
from cube_files import FREQS, N_PIX, NSIDE, run, write_hdf5

from himap import removal
from himap.app.cli.main import main
from himap.core.errors import InputError
from himap.cubes import beams_of, clean_cube, measure_transfer, read_cube, save_cleaned
from himap.cubes.report import write_report
from himap.instrument import beams
from himap.instrument.beams.base import diffraction_fwhm
from himap.maps import sphere
from himap.removal.peaks import mask_peaks

METHODS = removal.available()


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
    said = f"In {n_channels} channels none can stand out by 5 standard deviations of them all: no peak is"
    assert [one.startswith(said) for one in cleaned.remarks] == [True] * (cleaned.flagged == 0)
    assert (cleaned.flagged > 0) == (n_channels > 29) and not kept.remarks


class TestCleaning:
    @pytest.mark.usefixtures("no_pages")
    @pytest.mark.parametrize("name", ["pca", "beam_subspace"])
    def test_with_a_mask_through_the_command(self, name, maps, tmp_path):
        """A NESTED mask; what is left is that of the library, UNSEEN outside, with all that was said."""
        kept = np.abs(sphere.pixel_latitude(NSIDE)) > 15
        path = write_hdf5(tmp_path / "a.h5", maps)
        mask = hp.reorder(kept.astype(np.float32), r2n=True)
        hp.write_map(tmp_path / "m.fits", mask, nest=True, dtype=np.float32)
        options = ["--method", name, "-p", "n_sources=2", "--beam", "oscillating"]
        done = run("clean", path, *options, "--mask", tmp_path / "m.fits", "-o", tmp_path / "c.fits")
        assert f"{kept.mean():.1%} of the sky is kept by the mask" in done.output
        found = np.array(hp.read_map(tmp_path / "c.fits", field=None, dtype=None))
        basis = np.where(kept, maps, 0).astype(np.float32)
        basis[:, kept] = mask_peaks(maps[:, kept], FREQS).maps
        seen = beams_of(read_cube(path), "oscillating")
        expected = removal.create(name, n_sources=2).clean(
            maps, freqs=FREQS, beams=seen, separate_on=basis, mask=kept
        )
        assert found[:, kept] == pytest.approx(expected.residual[:, kept], abs=1e-5)
        assert (found[:, ~kept] == hp.UNSEEN).all()
        history = "".join("".join(fits.getheader(tmp_path / "c.fits", 1)["HISTORY"]).split())
        table = (tmp_path / "c_mixing.txt").read_text()
        said = [one for one in done.stderr.splitlines() if not one.endswith(" remain")]  # progress, if slow
        for one in said:
            assert "".join(one.split()) in history and f"# {one}\n" in table

    def test_a_cube_with_holes_by_a_method_that_looks_at_the_sky(self, maps, tmp_path):
        """As the same cube under a mask, and mocks can be put into it."""
        kept = np.abs(sphere.pixel_latitude(NSIDE)) > 15
        holes = read_cube(write_hdf5(tmp_path / "a.h5", np.where(kept, maps, np.nan)))
        whole = read_cube(write_hdf5(tmp_path / "b.h5", maps))
        seen = beams_of(whole, "oscillating")
        options = {"method": "beam_subspace", "beams": seen, "n_sources": 2}
        one, two = (clean_cube(cube, **options) for cube in (holes, whole.within(kept)))
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


def test_frequencies_of_other_channels_are_no_obstacle_to_those_that_are_given(maps, tmp_path):
    path = write_hdf5(tmp_path / "more.h5", maps)
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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda cube: clean_cube("a.h5", "pca"), "must be a Cube, as read_cube gives it, got str"),
        (lambda cube: clean_cube(cube, "pca", peaks="no"), "peaks must be True or False"),
        (lambda cube: clean_cube(cube, "fastica", n_sources=2, seed="x"), "seed must be a whole number"),
        (lambda cube: save_cleaned(cube, "a.h5"), "takes a CleanedCube, .* got Cube"),
        (lambda cube: write_report(None, "a.html"), "takes a CleanedCube, .* got NoneType"),
        (lambda cube: read_cube(np.zeros((3, 48))), "must be given by its path, got ndarray"),
        (lambda cube: clean_cube(cube, "pca", n_sources=24), "below the number of channels, 24"),
    ],
)
def test_other_types_are_refused(maps, tmp_path, call, message):
    cube = read_cube(write_hdf5(tmp_path / "a.h5", maps))
    with pytest.raises(InputError, match=message):
        call(cube)


@pytest.mark.parametrize("n_degrees", [5, 8])
def test_beams_that_end_too_early_are_refused(maps, tmp_path, n_degrees):
    cube = read_cube(write_hdf5(tmp_path / "a.h5", maps))
    beams = np.ones((len(cube.freqs), 3 * cube.nside))
    assert clean_cube(cube, "beam_subspace", n_sources=2, beams=beams[:, : 2 * cube.nside + 1]).cube is cube
    with pytest.raises(InputError, match=f"to 2 nside = {2 * cube.nside} at least, got {n_degrees}"):
        clean_cube(cube, "beam_subspace", n_sources=2, beams=beams[:, :n_degrees])
