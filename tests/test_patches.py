"""Flat patches of the sphere, and P(k_perp, k_par): from them, and against a slow sum over cells."""

from types import SimpleNamespace

import numpy as np
import pytest
from astropy.wcs import WCS
from cube_files import FREQS, N_PIX, power_law_maps, run, write_hdf5
from matplotlib.figure import Figure

from himap.core.errors import InputError
from himap.cubes import read_cube, report
from himap.cubes.cube import make_cube
from himap.cubes.layout import Layout
from himap.cubes.spectra import patch_power
from himap.figures import planes
from himap.maps import sphere
from himap.maps.patches import patch_centres, patch_pixels
from himap.measures.cylindrical import cell_of, cylindrical_power


@pytest.mark.parametrize("lonlat", [(0.0, 0.0), (120.0, 60.0), (250.0, -89.0)])
def test_cells_are_those_of_zea(lonlat):
    """As a set: astropy's image about the same centre, turned as ours is, has the same pixels."""
    nside, n_cells, side = 64, 30, 0.2
    lon, lat = np.deg2rad(lonlat)
    centre = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    measured = patch_pixels(nside, centre, side, n_cells)
    pole = np.eye(3)[np.argmin(np.abs(centre))]
    wcs = WCS(naxis=2)
    wcs.wcs.ctype, wcs.wcs.crval = ["GLON-ZEA", "GLAT-ZEA"], list(lonlat)
    wcs.wcs.crpix, step = [n_cells / 2 + 0.5] * 2, np.rad2deg(side) / n_cells
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    ours = np.cross(centre, np.cross(pole, centre) / np.linalg.norm(np.cross(pole, centre)))
    turn = np.arctan2(np.cross(north, ours) @ centre, north @ ours)
    wcs.wcs.cd = step * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    expected = wcs.all_pix2world(*np.meshgrid(np.arange(n_cells), np.arange(n_cells)), 0)
    same = sphere.pixel_at(nside, *expected) == measured
    assert same.mean() > 0.995  # the rest lies on an edge between two pixels


def test_patches_do_not_overlap_and_are_seen():
    mask = sphere.pixel_latitude(32) > 10
    centres, shares = patch_centres(mask, 0.25, 12, least=0.9, most=20)
    assert len(centres) == 20 and (shares >= 0.9).all() and (np.diff(shares) <= 0).all()
    assert (centres[:, 2] > 0).all()
    angles = np.arccos(np.clip(centres @ centres.T, -1, 1)) + 9 * np.eye(20)
    assert angles.min() > 0.25 * np.sqrt(2)
    used = [set(patch_pixels(32, centre, 0.25, 40).ravel()) for centre in centres]
    shared = sum(len(one & two) for n, one in enumerate(used) for two in used[:n])
    assert shared == 0


def white_cube(rng, nside, sigma, kept=None):
    n_pix = 12 * nside**2
    maps = (sigma * rng.standard_normal((24, n_pix))).astype("f4")
    if kept is not None:
        maps[:, ~kept] = np.nan
    return make_cube(maps, Layout.of_sphere(maps, nested=False, freqs=FREQS, unit="mK"))


@pytest.mark.parametrize("masked", [False, True])
def test_white_noise_of_pixels(masked, rng):
    """sigma^2 times the volume of a voxel and the window of a square pixel, 1 - (k a)^2 / 12."""
    nside, sigma = 64, 0.7
    cube = white_cube(rng, nside, sigma, np.abs(sphere.pixel_latitude(nside)) > 20 if masked else None)
    measured, n_patches = patch_power(cube, cube.maps)
    assert n_patches == 48 if not masked else 20 < n_patches <= 48
    pixel = np.sqrt(4 * np.pi / (12 * nside**2))
    (along, across, _), _ = cell_of(cube.freqs, (pixel, pixel))
    expected = sigma**2 * along * across**2
    low = measured.k_perp < 0.3 * np.pi / across
    window = 1 - (measured.k_perp[low] * across) ** 2 / 12
    ratio, n_modes = measured.power[:, low] / (expected * window), measured.n_modes[:, low]
    assert np.average(ratio, weights=n_modes) == pytest.approx(1, abs=4 / np.sqrt(n_modes.sum()))
    assert measured.perp_edges[-1] <= np.pi / across


def test_what_has_no_patch_is_refused(rng):
    cube = white_cube(rng, 16, 1.0, sphere.pixel_latitude(16) > 85)
    with pytest.raises(InputError, match="a patch of 14 deg with 80% coverage, and the cube has none"):
        patch_power(cube, cube.maps)


def test_on_the_page(rng, tmp_path):
    maps = power_law_maps(rng)
    truth = rng.standard_normal((len(FREQS), N_PIX)).astype("f4")
    cube = write_hdf5(tmp_path / "a.h5", maps, unit="mK", order="RING")
    words = ["--truth", write_hdf5(tmp_path / "t.h5", truth, unit="mK", order="RING"), "--patches"]
    run("clean", cube, "--method", "pca", *words, "-o", tmp_path / "c.h5")
    page = (tmp_path / "c.html").read_text()
    assert page.count("<img alt=") == 4 and "flat patches of 14 deg" in page
    assert read_cube(cube).whole_sky


def test_the_truth_is_missing_where_the_cube_is(rng, tmp_path, monkeypatch):
    """The residual of the truth itself, flagged and less its means, has the power of the truth."""
    maps = power_law_maps(rng)
    np.save(tmp_path / "flags.npy", rng.random(maps.shape) < 0.3)
    truth = rng.standard_normal(maps.shape).astype("f4")
    path = write_hdf5(tmp_path / "a.h5", maps, unit="mK", order="RING")
    cube = read_cube(path, flags=tmp_path / "flags.npy")
    given = read_cube(write_hdf5(tmp_path / "t.h5", truth, unit="mK", order="RING"))
    doubled = SimpleNamespace(cube=cube, residual=2 * cube.without_gaps(truth))
    shown = []
    monkeypatch.setattr(planes, "power_planes", lambda powers, **_: shown.append(powers.values()) or Figure())
    report.cylindrical_part(doubled, given)
    ((residual, true),) = shown
    assert np.array_equal(residual, 4 * true, equal_nan=True)


def place_of(found, k_perp, k_par):
    return tuple(
        np.searchsorted(edges, k) - 1 for edges, k in ((found.par_edges, k_par), (found.perp_edges, k_perp))
    )


@pytest.mark.parametrize("with_gaps", [True, False])
@pytest.mark.parametrize("n_channels", [6, 7])
def test_as_a_slow_sum(n_channels, with_gaps, rng):
    """Every mode by a sum over all cells, less channel means, with and without a Nyquist k_par."""
    shape, cell = (n_channels, 8, 7), np.array([1.5, 2.0, 1.0])
    mask = rng.random(shape[1:]) > 0.2 if with_gaps else np.ones(shape[1:], dtype=bool)
    maps = np.where(mask, rng.standard_normal(shape) + 3 * np.arange(n_channels)[:, None, None], np.nan)
    given = {"mask": mask} if with_gaps else {}
    found = cylindrical_power(maps, cell, **given)
    seen = np.where(mask, maps - maps[:, mask].mean(axis=1)[:, None, None], 0)
    total, share = np.zeros((2, *found.power.shape))
    count = np.zeros(found.power.shape, dtype=int)
    for numbers in np.ndindex(3, 8, 7):
        n, m, q = np.array(numbers) - (-1, 4, 3)
        k = 2 * np.pi * np.array([n, m, q]) / shape
        mode = (seen * np.exp(-1j * np.tensordot(k, np.indices(shape), 1))).sum()
        row, column = place_of(found, np.hypot(*(k / cell)[1:]), (k / cell)[0])
        if (m or q) and column < len(found.k_perp):
            total[row, column] += abs(mode) ** 2 * np.prod(cell) / (seen.size * mask.mean())
            count[row, column] += 1
            window = (mask * np.exp(-1j * np.tensordot(k[1:], np.indices(shape[1:]), 1))).sum()
            share[row, column] += 1 - abs(window / mask.sum()) ** 2  # what the means leave of white noise
    assert np.array_equal(count, found.n_modes)
    along, across = 2 * np.pi / (n_channels * cell[0]), np.pi / cell[1] / 4  # few: in steps, to Nyquist in y
    assert found.par_edges == pytest.approx(along * (np.arange(4) + 0.5))
    assert found.k_par == pytest.approx(along * np.arange(1, 4))
    assert found.perp_edges == pytest.approx(across * (np.arange(5) + 0.5))
    expected = total[count > 0] / share[count > 0]
    assert found.power[count > 0] == pytest.approx(expected, rel=1e-10)
    single = cylindrical_power(maps.astype("f4"), cell, **given)
    assert single.power[count > 0] == pytest.approx(expected, rel=1e-4)


def test_white_noise_with_a_mask_is_white(rng):
    """Though the mean of every channel, which is subtracted, has much of what varies as widely as it."""
    mask, cell = np.zeros((24, 24), dtype=bool), (1.0, 1.0, 1.0)
    mask[:12, :16] = True
    powers = [cylindrical_power(rng.standard_normal((64, 24, 24)), cell, mask=mask).power for _ in range(40)]
    assert np.nanmean(powers, axis=(0, 1)) == pytest.approx(1, abs=0.05)
