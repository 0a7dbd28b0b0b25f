"""What is lost of a cube with weights and gaps, and how many sources it has, against slow twins."""

from dataclasses import replace

import numpy as np
import pytest
from cube_files import FREQS, N_PIX, power_law_maps, write_hdf5

from himap.cubes import clean_cube, correct, measure_transfer, read_cube
from himap.cubes.report import spectra_of
from himap.paper.patch import PatchPower

SAID = {"unit": "mK", "order": "RING"}
SHAPE = (len(FREQS), N_PIX)


@pytest.fixture
def hits(rng):
    return rng.integers(1, 50, N_PIX).astype(float)


@pytest.fixture
def flags(rng):
    """A tenth of the voxels, a burst in six channels of a quarter of the sky, and one channel altogether."""
    flags = rng.random(SHAPE) < 0.1
    flags[10:16, : N_PIX // 4] = True
    flags[7] = True
    return flags


@pytest.fixture
def cube(rng, hits, flags, tmp_path):
    """Two power laws and noise of 1 mK; what is flagged is bright."""
    maps = np.where(flags, 1e5, power_law_maps(rng)).astype(np.float32)
    return read_cube(write_hdf5(tmp_path / "cube.h5", maps, **SAID), weights=hits, flags=flags)


def mock_of(cube, rng):
    """Noise that is brighter in one part of the sky, and has means."""
    mock = rng.standard_normal(cube.maps.shape) * np.linspace(1, 3, cube.maps.shape[1])
    return (mock + rng.standard_normal(len(mock))[:, None]).astype(np.float32)


class TestTransfer:
    @pytest.mark.parametrize(
        ("method", "parameters"), [("pca", {"n_sources": 4}), ("polynomial", {"order": 4})]
    )
    @pytest.mark.parametrize("share", [1, 0.6])
    def test_is_that_of_two_cubes_that_are_cleaned(self, cube, rng, method, parameters, share):
        """Left with the mock less left without, over the mock, all 0 in the gaps; of a part of it too."""
        cube = cube.within(np.arange(N_PIX) < share * N_PIX)
        cleaned = clean_cube(cube, method, peaks=False, **parameters)
        mocks = [mock_of(cube, rng) for _ in range(2)]
        found = measure_transfer(cleaned, mocks, peaks=False)
        power = PatchPower(
            weights=cube.mask.astype(float),
            seen=cube.on_sphere(~cube.missing),
            channel_width=cube.channel_width,
            bin_width=1,
        )
        put_in, returned = [], []
        for mock in mocks:
            both = clean_cube(replace(cube, maps=cube.maps + mock), method, peaks=False, **parameters)
            returned.append(cube.on_sphere(both.residual.astype(float) - cleaned.residual))
            means = [np.average(one, weights=w) for one, w in zip(mock, cube.weights, strict=True)]
            put_in.append(cube.on_sphere(mock - np.array(means)[:, None]))
        expected = power.share(put_in, returned)
        assert found.frequency[1:] == pytest.approx(expected["frequency"], abs=0.01)
        assert found.angular[2:25].mean() == pytest.approx(expected["angular"][1:24].mean(), abs=0.003)
        assert found.frequency[1] < 0.8

    def test_what_mocks_have_in_a_gap_counts_nothing(self, cube, rng):
        cleaned = clean_cube(cube, "pca", n_sources=2, peaks=False)
        mock = mock_of(cube, rng)
        disturbed = np.where(cube.missing, np.float32(1e6), mock)
        one, two = (measure_transfer(cleaned, [each], peaks=False) for each in (mock, disturbed))
        assert np.array_equal(one.frequency, two.frequency) and np.array_equal(one.angular, two.angular)

    def test_corrects_what_is_left_through_gaps(self, cube, rng):
        """Noise of 1 mK is what is to be left: its power, 0 in the gaps, comes out to a percent or two."""
        cleaned = clean_cube(cube, "pca", n_sources=6, peaks=False)
        mocks = (rng.standard_normal(cube.maps.shape).astype(np.float32) for _ in range(3))
        found = correct(spectra_of(cleaned), measure_transfer(cleaned, mocks, peaks=False))["frequency"]
        true = cube.channel_width * np.mean(~cube.missing)
        assert (found.left / true).mean() < 0.8
        assert (found.corrected / true).mean() == pytest.approx(1, abs=0.02)
