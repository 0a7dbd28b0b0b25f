"""Weights and flags of cubes of one's own: read by strict rules, cleaned with, written and refused."""

import h5py
import healpy as hp
import numpy as np
import pytest
from cube_files import FREQS, N_CHANNELS, N_PIX, N_X, N_Y, SKY, WIDE, run, write_hdf5, write_image

from himap.core.errors import InputError
from himap.cubes import clean_cube, correct, measure_transfer, read_cube, save_cleaned
from himap.cubes.cleaning import with_enough_channels
from himap.cubes.files import read_truth
from himap.cubes.spectra import compared, spectra_of
from himap.measures.spectra import frequency_power
from himap.removal.pca import PCA
from himap.removal.polynomial import Polynomial

SHAPE = (len(FREQS), N_PIX)
DOWN = ("FREQ", 1018e6, 1.0, -2e6, "Hz")


@pytest.fixture
def hits(rng):
    """Of pixels; a fifth of the sky has none."""
    hits = rng.integers(1, 50, N_PIX).astype(float)
    hits[: N_PIX // 5] = 0
    return hits


@pytest.fixture
def flags(rng):
    """5 % of the voxels, and one channel altogether."""
    flags = rng.random(SHAPE) < 0.05
    flags[7] = True
    return flags


@pytest.fixture(autouse=True)
def cube(here, maps):
    write_hdf5("cube.h5", maps)


def nested(rows):
    return hp.reorder(rows, r2n=True)


def write_fits(path, rows, **options):
    hp.write_map(path, rows, dtype=np.float64, **options)


class TestReading:
    def test_what_a_cube_holds_then(self, maps, hits, flags):
        cube = read_cube("cube.h5", weights=hits, flags=flags)
        kept = np.arange(len(FREQS)) != 7
        weights = np.where(flags, 0, hits)[kept][:, hits > 0]
        assert np.array_equal(cube.mask, hits > 0) and np.array_equal(cube.weights, weights)
        assert np.array_equal(cube.maps, np.where(weights > 0, maps[kept][:, hits > 0], 0))
        assert np.array_equal(cube.missing, weights == 0)
        one, some, missing, *_ = cube.remarks
        assert one.startswith("1 of 24 channels have no data")
        assert "(80.0% of the sky) are seen in some" in some
        assert missing.startswith(f"{np.mean(weights == 0):.2%} of the voxels")
        masked = cube.within(np.arange(N_PIX) % 3 > 0)
        assert np.array_equal(masked.mask, cube.mask & (np.arange(N_PIX) % 3 > 0))
        assert np.array_equal(masked.weights, weights[:, masked.mask[cube.mask]])

    @pytest.mark.parametrize("kind", ["npy", "npy turned", "ring.fits", "nested.fits", "h5", "own.h5"])
    def test_all_formats_say_the_same(self, kind, hits, flags):
        given = {"weights": np.where(flags, 0, hits) + 0.5 * (hits > 0), "flags": flags}
        expected, files = read_cube("cube.h5", **given), {}
        for word, rows in given.items():
            files[word] = name = "cube.h5" if kind == "own.h5" else f"{word}.{kind.partition(' ')[0]}"
            if name.endswith("npy"):
                np.save(name, rows.T if "turned" in kind else rows)
            elif name.endswith("fits"):
                nest = "nested" in kind
                write_fits(name, nested(rows.astype(float)) if nest else rows.astype(float), nest=nest)
            else:
                with h5py.File(name, "a") as file:
                    file[f"beside/{word}"] = rows
        cube = read_cube("cube.h5", **files)
        assert np.array_equal(cube.weights, expected.weights) and np.array_equal(cube.maps, expected.maps)
        assert np.array_equal(cube.mask, expected.mask)

    @pytest.mark.parametrize("order", ["RING", "NESTED"])
    def test_a_cube_in_another_order(self, maps, hits, order):
        """Arrays are in the order of the cube, FITS in its own; channels in the order of the file."""
        shuffled = np.random.default_rng(2).permutation(len(FREQS))
        own = nested if order == "NESTED" else np.array
        np.save("other.npy", own(maps[shuffled]))
        weights = np.arange(1, 25)[:, None] * hits
        expected = read_cube("cube.h5", weights=weights)
        write_fits("w.fits", weights[shuffled])
        for given in (own(weights[shuffled]), "w.fits"):
            cube = read_cube("other.npy", freqs=FREQS[shuffled], unit="mK", order=order, weights=given)
            assert np.array_equal(cube.weights, expected.weights) and np.array_equal(cube.mask, hits > 0)
            assert np.array_equal(cube.maps, expected.maps)

    def test_unseen_pixels_of_fits(self, hits):
        """Have no weight, and are bad."""
        write_fits("w.fits", np.where(hits > 0, hits, hp.UNSEEN))
        write_fits("f.fits", np.where(hits > 0, 0, hp.UNSEEN))
        assert np.array_equal(read_cube("cube.h5", weights="w.fits").mask, hits > 0)
        flagged = read_cube("cube.h5", flags="f.fits")
        assert np.array_equal(flagged.mask, hits > 0) and flagged.weights is None

    def test_voxels_that_are_nan_are_missing_alone(self, maps):
        gaps = np.arange(24)[:, None] == np.arange(N_PIX) % 24
        maps[gaps] = np.nan
        write_hdf5("gaps.h5", maps)
        said = r"gaps.h5: no pixel is observed in every .*\(parametric, pca, poly"
        with pytest.raises(InputError, match=said):
            read_cube("gaps.h5")
        assert np.array_equal(read_cube("gaps.h5", scattered=True).missing, gaps)
        cube = read_cube("gaps.h5", weights=np.ones(N_PIX))
        assert np.array_equal(cube.missing, gaps) and cube.whole_sky

    def test_equal_weights_are_no_weights(self):
        cube = read_cube("cube.h5", weights=np.full(N_PIX, 3), flags=np.zeros(SHAPE, bool))
        assert cube.weights is None and cube.missing is None and cube.remarks == read_cube("cube.h5").remarks
        left = [clean_cube(one, "gmca", n_sources=2).residual for one in (cube, read_cube("cube.h5"))]
        assert np.array_equal(*left)

    def test_weights_of_voxels_without_gaps_miss_nothing(self, rng):
        cube = read_cube("cube.h5", weights=rng.integers(1, 5, SHAPE))
        assert cube.weights.shape == SHAPE and cube.missing is None

    def test_channels_and_remarks_are_those_that_a_mask_leaves(self, flags):
        """A channel of which it leaves nothing is left out, and said, as where a file has it empty."""
        kept = np.arange(N_PIX) < N_PIX // 2
        some, flags[:] = flags.copy(), False
        flags[:, ~kept], flags[4, kept], flags[7] = some[:, ~kept], True, False
        cube = read_cube("cube.h5", flags=flags)
        (said,) = (remark for remark in cube.remarks if "voxels" in remark)
        assert not any("apart" in remark for remark in cube.remarks)
        part = cube.within(kept)
        assert np.array_equal(part.freqs, np.delete(FREQS, 4))
        assert any("1 channels without data there are excluded" in remark for remark in part.remarks)
        assert said not in part.remarks and not any("voxels" in remark for remark in part.remarks)
        (uneven,) = (remark for remark in part.remarks if "MHz apart; P(k)" in remark)

    def test_pixels_that_too_few_channels_see(self, hits, flags):
        hits[-4:], flags[:, -4:] = 1, True
        flags[:3, -4:], flags[:7, -2:] = False, False
        cube = read_cube("cube.h5", weights=hits, flags=flags)
        with pytest.raises(InputError, match="pca needs 5 channels on a line of sight .* and 2 of"):
            clean_cube(cube, "pca", n_sources=4, peaks=False)
        fewer = with_enough_channels(cube, PCA(n_sources=4), peaks=False)
        assert fewer.mask.sum() == cube.mask.sum() - 2 and "2 pixels observed in fewer" in fewer.remarks[-1]
        assert with_enough_channels(cube, PCA(n_sources=4)).mask.sum() == cube.mask.sum() - 4
        clean_cube(fewer, "pca", n_sources=4, peaks=False)
        with pytest.raises(InputError, match="no pixel is observed in 25 channels or more"):
            cube.seen_in(25)


class TestCleaning:
    @pytest.mark.parametrize("peaks", [True, False])
    @pytest.mark.parametrize("method", [PCA(n_sources=2), Polynomial(order=3)])
    def test_as_the_library_does(self, maps, hits, flags, method, peaks):
        cube = read_cube("cube.h5", weights=hits, flags=flags)
        cleaned = clean_cube(cube, method, peaks=peaks)
        own = method.clean(cube.maps, freqs=cube.freqs, weights=cube.weights)
        if not peaks:
            assert np.array_equal(cleaned.residual, own.residual)
        assert not cleaned.residual[cube.missing].any()
        assert np.array_equal(np.isnan(cleaned.residual_with_nan), cube.missing)
        true = np.delete(maps, 7, axis=0)[:, cube.mask]
        assert (cleaned.foreground - true)[cube.missing].std() < 2  # its noise is 1 mK

    def test_a_truth_and_mocks(self, maps, hits, flags, rng):
        """The truth is 0 where the cube is missing, and so is a mock; its means have no power in the gaps."""
        true = 5 + rng.standard_normal(SHAPE).astype(np.float32)
        write_hdf5("truth.h5", true)
        cube = read_cube(write_hdf5("both.h5", maps + true), weights=hits, flags=flags)
        cleaned = clean_cube(cube, "pca", n_sources=2)
        found = compared(cleaned, read_truth("truth.h5", cube=cube))
        kept = np.arange(24) != 7
        seen = true[kept][:, cube.mask]
        zeroed = np.where(cube.missing, 0, seen - np.average(seen, axis=1, weights=cube.weights)[:, None])
        mean = frequency_power(zeroed, cube.channel_width).power[1:].mean()
        assert found.true_frequency.mean() == pytest.approx(mean, rel=1e-5)
        mocks = [rng.standard_normal(cube.maps.shape).astype(np.float32) for _ in range(2)]
        measured = measure_transfer(cleaned, mocks)
        assert 0.7 < measured.frequency[1:].mean() < 1
        corrected = correct(cleaned, measured, spectra_of(cleaned))
        assert np.isfinite(corrected["frequency"].corrected).all()


@pytest.mark.usefixtures("no_pages")
class TestCommands:
    def test_clean(self, hits, flags):
        np.save("hits.npy", hits)
        np.save("flags.npy", flags)
        words = ("--method", "pca", "-p", "n_sources=2", "--weights", "hits.npy", "--flags", "flags.npy")
        outcome = run("clean", "cube.h5", *words, "-o", "out.h5")
        assert "1 of 24 channels have no data and are left out." in outcome.output
        cleaned = clean_cube(read_cube("cube.h5", weights=hits, flags=flags), "pca", n_sources=2)
        save_cleaned(cleaned, "own.h5")
        with h5py.File("out.h5") as one, h5py.File("own.h5") as two:
            assert np.array_equal(one["residual"], two["residual"], equal_nan=True)
            assert np.array_equal(np.isnan(one["residual"]), flags | (hits == 0))
            blind = (hits == 0) | (np.arange(24) == 7)[:, None]
            assert np.array_equal(np.isnan(one["foreground"]), blind)

    def test_transfer(self, maps, flags, rng):
        """Of mocks from files, and of such that are made, the channel that is left out is left out."""
        np.save("flags.npy", flags)
        for name, rows in (("cube", maps), ("mock", rng.standard_normal(SHAPE).astype(np.float32))):
            write_hdf5(f"{name}.h5", rows, WIDE)
        words = ["--method", "polynomial", "-p", "order=3", "--beam", "meerkat:band=L"]
        for n, mocks in enumerate(("mock.h5", "1")):
            files = ["--flags", "flags.npy", "--mocks", mocks, "-o", f"out{n}.html"]
            outcome = run("transfer", "cube.h5", *words, *files)
            assert "The beams, meerkat:band=L, have a FWHM of 1.4" in outcome.output


class TestImages:
    """Of one image for all channels, or of one for each."""

    @pytest.fixture(autouse=True)
    def cube(self, images, here):
        write_image("cube.fits", images)

    @pytest.fixture
    def hits(self, rng):
        hits = rng.integers(1, 50, (N_Y, N_X)).astype(np.float32)
        hits[:2] = 0
        return hits

    @pytest.fixture
    def flags(self, rng):
        return rng.random((N_CHANNELS, N_Y, N_X)) < 0.05

    def test_one_image_for_all_channels(self, images, hits, flags):
        """Alone, as FITS; as array and .npy with flags of each."""
        cube = read_cube("cube.fits", weights=write_image("hits.fits", hits, axes=SKY["SIN"], BUNIT=""))
        seen = hits.ravel() > 0
        assert np.array_equal(cube.mask, seen) and np.array_equal(cube.weights, hits.ravel()[seen])
        lines = images.reshape(N_CHANNELS, -1)[:, seen]
        expected = PCA(n_sources=2).clean(lines, freqs=cube.freqs, weights=hits.ravel()[seen]).residual
        assert clean_cube(cube, "pca", n_sources=2, peaks=False).residual == pytest.approx(expected, abs=1e-4)
        np.save("hits.npy", hits)
        np.save("flags.npy", flags.astype("u1"))
        expected = np.where(flags, 0, hits).reshape(N_CHANNELS, -1)[:, seen]
        for weights, bad in ((hits, flags), ("hits.npy", "flags.npy")):
            assert np.array_equal(read_cube("cube.fits", weights=weights, flags=bad).weights, expected)

    def test_one_for_each_channel_by_its_own_header(self, images, flags):
        """In a file whose frequencies descend as those of the cube; NaN is bad."""
        write_image("down.fits", images, axes=(*SKY["SIN"], DOWN))
        bad = flags.astype(np.float32)
        bad[bad == 1] = np.nan
        write_image("flags.fits", bad, axes=(*SKY["SIN"], DOWN))
        cube = read_cube("down.fits", flags="flags.fits")
        assert np.array_equal(cube.missing, flags[::-1].reshape(N_CHANNELS, -1))
        with pytest.raises(InputError, match="must have the channels of the cube in the order of its file"):
            read_cube("cube.fits", flags="flags.fits")
