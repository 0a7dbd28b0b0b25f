"""A patch of sky with uneven hits: what it is made of, and what its spectra say."""

import numpy as np
import pytest

from himap.core.survey import Survey
from himap.figures.plotting import sky_maps
from himap.measures.spectra import angular_power, frequency_power
from himap.paper.patch import Patch, PatchPower, interpolated, noise_by_hits

NSIDE = 32
FIELD = Patch()
HITS = FIELD.hits(NSIDE)
SURVEY = Survey(nside=NSIDE, n_channels=12, t_obs=62, n_dishes=64, f_sky=0.0074)


@pytest.mark.parametrize("nside", [32, 64, 128])
def test_the_patch_is_where_and_as_large_as_it_says(nside):
    ra, dec = FIELD.offsets(nside)
    hits = FIELD.hits(nside)
    edges = np.sin(np.deg2rad([-35, -25]))
    area = np.deg2rad(FIELD.width) * np.ptp(edges) / (4 * np.pi)
    assert np.mean(hits > 0) == pytest.approx(area, rel=0.1) and hits.max() == 1
    assert np.abs(ra[hits > 0]).max() < 19 and np.abs(dec[hits > 0]).max() < 6


def test_offsets_against_healpys_rotator():
    import healpy as hp

    lon, lat = hp.pix2ang(NSIDE, np.arange(12 * NSIDE**2), lonlat=True)
    lon, lat = hp.Rotator(coord=["G", "C"])(lon, lat, lonlat=True)
    ra, dec = FIELD.offsets(NSIDE)
    assert dec + FIELD.dec == pytest.approx(lat, abs=1e-3)
    assert np.cos(np.deg2rad(ra + FIELD.ra - lon)) == pytest.approx(1, abs=1e-6)


def test_hits_are_many_in_the_middle_and_follow_the_seed():
    ra, _ = FIELD.offsets(NSIDE)
    assert HITS[np.abs(ra) < 4].max() == 1 and HITS[(HITS > 0) & (np.abs(ra) > 14)].mean() < 0.3
    assert np.array_equal(HITS, Patch().hits(NSIDE)) and not np.array_equal(HITS, Patch(seed=3).hits(NSIDE))


def test_flags():
    """Whole channels, single voxels, and with nothing asked for none."""
    nothing = {"n_channels": 0, "n_bursts": 0, "voxels": 0}
    assert not Patch(**nothing).flags(NSIDE, 50).any()
    lost = Patch(**nothing | {"n_channels": 4}).flags(NSIDE, 50)
    assert lost.all(axis=1).sum() == 4 and lost.sum() == 4 * len(HITS)
    assert Patch(**nothing | {"voxels": 0.1}).flags(NSIDE, 50).mean() == pytest.approx(0.1, rel=0.05)
    bursts = Patch(**nothing | {"n_bursts": 30}).flags(NSIDE, 50)
    assert 0.01 < bursts[:, HITS > 0].mean() < 0.3 and not bursts.all(axis=1).any()


def test_noise_falls_with_the_root_of_hits(rng):
    noise = np.concatenate([noise_by_hits(SURVEY, HITS, rng) for _ in range(40)])
    deviation, seen = noise.std(axis=0), HITS > 0
    assert not noise[:, ~seen].any()
    assert (deviation[seen] * np.sqrt(HITS[seen])).std() < 0.1 * deviation[seen].mean()


def test_interpolation_is_numpys():
    maps = np.arange(12.0).reshape(6, 2) ** 2
    gaps = np.zeros((6, 2), bool)
    gaps[[2, 3, 5], 0] = True
    out = interpolated(maps, gaps)
    assert out[:, 0] == pytest.approx(np.interp(range(6), [0, 1, 4], maps[[0, 1, 4], 0]))
    assert np.array_equal(out[:, 1], maps[:, 1])


class TestPower:
    @pytest.fixture
    def power(self):
        seen = (HITS > 0) & ~FIELD.flags(NSIDE, 12)
        return PatchPower(weights=HITS, seen=seen, channel_width=2.0, bin_width=24)

    def test_is_that_of_the_measures(self, power, rng):
        maps = rng.standard_normal((12, 12 * NSIDE**2)).astype(np.float32)
        found, zeroed = power(maps), np.where(power.seen, maps, 0)
        angular = angular_power(zeroed, mask=HITS, bin_width=24)
        assert np.array_equal(found["angular"][1], angular.mean[1:])
        assert np.array_equal(found["frequency"][1], frequency_power(zeroed, 2.0, mask=HITS).power[1:])
        assert np.array_equal(power(np.where(power.seen, maps, 9))["angular"][1], found["angular"][1])
        more = power.alms(maps) + power.alms(2 * maps)
        assert power(maps, more)["angular"][1] == pytest.approx(9 * found["angular"][1])

    def test_share_of_mocks_that_come_back_fainter_and_with_something_else(self, power, rng):
        mocks = [rng.standard_normal((12, 12 * NSIDE**2)) for _ in range(3)]
        share = power.share(mocks, [0.6 * mock for mock in mocks])
        assert share["frequency"] == pytest.approx(0.6) and share["angular"] == pytest.approx(0.6)
        known = power.share(mocks, [0.6 * mock for mock in mocks], [power.alms(mock) for mock in mocks])
        assert np.array_equal(known["angular"], share["angular"])
        twice = [power.alms(2 * mock) for mock in mocks]
        assert power.share(mocks, mocks, twice)["angular"] == pytest.approx(0.5)
        other = [0.6 * mock + rng.standard_normal(mock.shape) for mock in mocks]
        assert power.share(mocks, other)["frequency"].mean() == pytest.approx(0.6, abs=0.15)


def test_maps_are_drawn_where_they_are():
    """A map of declinations, drawn: rows from the south to the north, right ascension to the left."""
    ra, dec = FIELD.offsets(NSIDE)
    figure = sky_maps({"dec": dec, "ra": ra}, box=FIELD.box)
    north, east = (axes.images[0].get_array() for axes in figure.axes[:2])
    assert np.diff(north.mean(axis=1))[5:-5].mean() > 0 and east[:, 0].mean() > 15 > -15 > east[:, -1].mean()
    assert figure.axes[0].images[0].get_extent()[0] > figure.axes[0].images[0].get_extent()[1]
