"""What is lost of a cube with weights and gaps, and how many sources it has, against slow twins."""

from dataclasses import replace

import numpy as np
import pytest
from cube_files import FREQS, N_PIX, power_law_maps, power_laws, run, write_hdf5

from himap.core.errors import InputError
from himap.cubes import clean_cube, correct, measure_transfer, read_cube, report, suggestion, write_report
from himap.cubes.spectra import check_truth, spectra_of
from himap.measures import n_sources
from himap.paper.patch import PatchPower
from himap.removal.covariance import channel_covariance
from himap.removal.data import Data
from himap.removal.pca import PCA
from himap.removal.polynomial import Polynomial
from himap.removal.weighted_pca import seen_covariance

SHAPE = (len(FREQS), N_PIX)
FEWER = pytest.mark.parametrize("n_pix", [12 * 8**2])
"""For what is the same to rounding, whatever the number of pixels."""


@pytest.fixture
def n_pix():
    return N_PIX


@pytest.fixture
def hits(rng, n_pix):
    return rng.integers(1, 50, n_pix).astype(float)


@pytest.fixture
def flags(rng, n_pix):
    """A tenth of the voxels, a burst in six channels of a quarter of the sky, and one channel altogether."""
    flags = rng.random((len(FREQS), n_pix)) < 0.1
    flags[10:16, : n_pix // 4] = True
    flags[7] = True
    return flags


@pytest.fixture
def cube(rng, hits, flags, tmp_path):
    """Two power laws and noise of 1 mK; what is flagged is bright."""
    maps = np.where(flags, 1e5, power_laws(rng, FREQS, len(hits))).astype(np.float32)
    return read_cube(write_hdf5(tmp_path / "cube.h5", maps), weights=hits, flags=flags)


def mock_of(cube, rng):
    """Noise that is brighter in one part of the sky, and has means."""
    mock = rng.standard_normal(cube.maps.shape) * np.linspace(1, 3, cube.maps.shape[1])
    return (mock + rng.standard_normal(len(mock))[:, None]).astype(np.float32)


class TestTransfer:
    @pytest.mark.parametrize("method", [PCA(n_sources=2), Polynomial(order=4)])
    @pytest.mark.parametrize("share", [1, 0.6])
    def test_is_that_of_two_cubes_that_are_cleaned(self, cube, rng, method, share):
        """Of the foreground with a mock in place of the rest, all 0 in the gaps; of a part of it too."""
        cube = cube.within(np.arange(N_PIX) < share * N_PIX)
        cleaned = clean_cube(cube, method, peaks=False)
        mocks = [mock_of(cube, rng) for _ in range(2)]
        found = measure_transfer(cleaned, mocks)
        seen, bins = cube.on_sphere(~cube.missing), {"channel_width": cube.channel_width, "bin_width": 1}
        power = PatchPower(weights=cube.mask.astype(float), seen=seen, **bins)
        put_in, returned = [], []
        for mock in mocks:
            member = replace(cube, maps=cleaned.foreground + mock)
            both = clean_cube(member, method, peaks=False)
            returned.append(cube.on_sphere(both.residual.astype(float)))
            means = [np.average(one, weights=w) for one, w in zip(mock, cube.weights, strict=True)]
            put_in.append(cube.on_sphere(mock - np.array(means)[:, None]))
        expected = power.share(put_in, returned)
        assert found.frequency[1:] == pytest.approx(expected["frequency"], abs=0.01)
        assert found.angular[2:25].mean() == pytest.approx(expected["angular"][1:24].mean(), abs=0.003)
        assert found.frequency[1] < 0.8

    @FEWER
    @pytest.mark.parametrize("method", [PCA(n_sources=2), Polynomial(order=3)])
    def test_a_mock_counts_nothing_in_a_gap(self, cube, rng, method):
        cleaned = clean_cube(cube, method)
        mock = mock_of(cube, rng)
        disturbed = np.where(cube.missing, np.float32(1e6), mock)
        beams = np.ones((len(cube.freqs), 3 * cube.nside))
        quiet, loud = (measure_transfer(cleaned, [each], beams=beams) for each in (mock, disturbed))
        assert not quiet.drawn and np.array_equal(quiet.powers, loud.powers)
        assert np.array_equal(quiet.frequency, loud.frequency) and np.array_equal(quiet.angular, loud.angular)

    @pytest.mark.parametrize(("n_sources", "close"), [(2, 0.01), (3, 0.02)])
    def test_corrects_what_is_left_through_gaps(self, cube, rng, n_sources, close):
        """Noise of 1 mK is what is to be left: its power, 0 in the gaps, comes out to a percent or two.

        A third component, which the foreground does not have, fits noise: this is not seen in members whose
        foreground has it, so that the corrected power is lower by up to the share of one component.
        """
        cleaned = clean_cube(cube, "pca", n_sources=n_sources, peaks=False)
        mocks = (rng.standard_normal(cube.maps.shape).astype(np.float32) for _ in range(3))
        found = correct(cleaned, measure_transfer(cleaned, mocks), spectra_of(cleaned))["frequency"]
        true = cube.channel_width * np.mean(~cube.missing)
        assert (found.residual / true).mean() < 0.95
        assert (found.corrected / true).mean() == pytest.approx(1, abs=close)


class TestSuggestion:
    @pytest.mark.parametrize(("gaps", "noise"), [(False, 1), (True, 0), (True, 1)])
    @pytest.mark.parametrize("n_components", [2, 4])
    def test_all_views_find_the_number(self, n_components, gaps, noise, hits, flags, rng, tmp_path):
        """Through gaps as well, and then without noise too."""
        spectra = np.linalg.qr((FREQS / 1000)[:, None] ** -np.arange(1.0, n_components + 1))[0]
        maps = spectra @ (1e3 * rng.standard_normal((n_components, N_PIX)))
        maps += noise * rng.standard_normal(SHAPE)
        np.save(tmp_path / "a.npy", np.where(flags & gaps, 1e5, maps))
        given = {"freqs": FREQS, "unit": "mK", "order": "RING"}
        given |= {"weights": hits, "flags": flags} if gaps else {}
        found = suggestion.suggest(read_cube(tmp_path / "a.npy", **given), n_sources=range(1, 6))
        assert found.n_bright == found.best == n_components and found.range == (n_components, n_components)
        assert not noise or found.stable == n_components
        advice = suggestion.advice(found)
        assert f"For pca, consider n_sources = {n_components}, by both" in advice
        assert advice.endswith("this method alone: run it again for a beam-aware method.")
        assert found.eigenvalues[n_components:] == pytest.approx(noise, abs=0.3)
        suggestion.write_suggestion(found, tmp_path / "a.html")
        page = (tmp_path / "a.html").read_text()
        assert ("only observed voxels count as samples" in page) == gaps

    def test_weights_that_hardly_differ_are_none(self, rng, tmp_path):
        path = write_hdf5(tmp_path / "a.h5", power_law_maps(rng))
        alike = np.ones(N_PIX), 1 + 1e-7 * rng.random(N_PIX), 1 + 1e-7 * rng.random(SHAPE)
        cubes = (read_cube(path, weights=weights) for weights in alike)
        plain, *weighted = (suggestion.suggest(one, n_sources=range(1, 5), peaks=False) for one in cubes)
        assert not plain.weighted
        for found in weighted:
            assert found.weighted and found.range == plain.range
            for name in ("eigenvalues", "criterion", "change"):
                assert getattr(found, name) == pytest.approx(getattr(plain, name), rel=1e-3, abs=1e-3), name

    def test_weighted_covariance_against_a_loop(self, cube, rng):
        """Of pixels with weights, of equal weights with any model, and of gaps that a model bridges."""
        maps, weights = cube.maps.astype(np.float64), rng.integers(1, 5, N_PIX).astype(float)
        found = PCA(n_sources=2).separate(Data.of(maps, freqs=cube.freqs, weights=weights))
        expected = np.cov(maps, aweights=weights, ddof=0)
        for one in (weights, np.tile(weights, (len(maps), 1))):
            assert seen_covariance(maps, one, found) == pytest.approx(expected, rel=1e-6)
        equal = seen_covariance(maps, np.ones(maps.shape), found)
        assert equal == pytest.approx(channel_covariance(maps), rel=1e-6)
        faint = np.where(rng.random(maps.shape) < 0.2, 0.0, 1.0)
        smooth = np.array([cube.freqs / 1000, np.ones(len(maps))]).T @ (1e3 * rng.standard_normal((2, N_PIX)))
        noise = rng.standard_normal(maps.shape)
        found = PCA(n_sources=2).separate(Data.of(smooth + noise, freqs=cube.freqs, weights=faint))
        gaps = seen_covariance(np.where(faint > 0, smooth + noise, 0), faint, found)
        values = np.linalg.eigvalsh(gaps)[::-1]
        assert values[:2] == pytest.approx(np.linalg.eigvalsh(np.cov(smooth))[:-3:-1], rel=0.01)
        assert values[2:] == pytest.approx(1, abs=0.3)

    @FEWER
    def test_information_is_of_weighted_variances(self, cube):
        """As `numpy.cov` has them, of the cube cleaned with each number."""
        found = suggestion.suggest(cube, n_sources=range(1, 4), peaks=False)
        left = (clean_cube(cube, "pca", n_sources=n, peaks=False).residual.astype(float) for n in (1, 2, 3))
        each = [zip(one, cube.weights, strict=True) for one in left]
        variances = np.array([[np.cov(row, aweights=w, ddof=0) for row, w in rows] for rows in each])
        n_seen, n_pix = np.count_nonzero(~cube.missing, axis=1), cube.maps.shape[1]
        expected = n_sources.information(variances, np.array([1, 2, 3]), n_pix, n_seen=n_seen)
        assert found.criterion == pytest.approx(expected, rel=1e-6, abs=1e-6)

    @FEWER
    def test_lines_of_sight_with_too_few_channels(self, hits, flags, rng, n_pix, tmp_path):
        """Refused by the library, left out by the command for the largest number that it tries."""
        flags[:20, :30] = True
        path = write_hdf5(tmp_path / "a.h5", power_laws(rng, FREQS, n_pix))
        cube = read_cube(path, weights=hits, flags=flags)
        with pytest.raises(InputError, match="pca needs 5 channels on a line of sight"):
            suggestion.suggest(cube, n_sources=range(1, 5), peaks=False)
        np.save(tmp_path / "w.npy", hits)
        np.save(tmp_path / "f.npy", flags)
        page, weights, bad = (tmp_path / name for name in ("n.html", "w.npy", "f.npy"))
        words = ("--weights", weights, "--flags", bad, "--to", 4, "--keep-peaks", "--overwrite")
        done = run("suggest", path, *words, "-o", page)
        assert "observed in fewer than 5 channels are excluded" in done.output
        assert "For pca, consider n_sources = 2, by both criteria." in done.output
        found = suggestion.suggest(cube.seen_in(5), n_sources=range(1, 5), peaks=False)
        for value in found.criterion:
            assert f"{value:.4f}" in done.output
        said = page.read_text()
        assert "only observed voxels count" in said and said.count("<img alt=") == 1


def test_rms_on_the_page_is_of_what_is_seen(cube, tmp_path):
    cleaned = clean_cube(cube, "pca", n_sources=2)
    kept = ~cube.missing
    pairs = [zip(maps.astype(float), kept, strict=True) for maps in (cube.maps, cleaned.residual)]
    rms = [np.sqrt(np.mean([row[some].var() for row, some in rows])) for rows in pairs]
    write_report(cleaned, tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text()
    assert "<h2>Spectra</h2>" in page and all(f">{value:.4g} mK<" in page for value in rms)


def test_the_map_on_the_page_is_empty_where_the_channel_is(cube, monkeypatch):
    """And its colours are those of what is seen, without zeros for what is not."""
    cleaned, drawn = clean_cube(cube, "pca", n_sources=2), {}
    monkeypatch.setattr(report.plotting, "sky_maps", lambda maps, span: drawn.update(maps=maps, span=span))
    report.maps_figure(cleaned)
    title, middle = next(iter(drawn["maps"])), len(cube.freqs) // 2
    seen = ~cube.missing[middle]
    assert np.array_equal(np.isfinite(drawn["maps"][title][cube.mask]), seen) and not seen.all()
    assert drawn["span"][title] == pytest.approx(np.percentile(cleaned.residual[middle, seen], (1, 99)))


@pytest.mark.parametrize("gaps", [False, True])
def test_a_truth_that_sees_less_is_refused_with_the_way_out(gaps, flags, rng, tmp_path):
    maps = power_laws(rng, FREQS, N_PIX)
    flags[7] = flags[8]  # no dead channel
    cube = read_cube(write_hdf5(tmp_path / "cube.h5", maps), flags=flags if gaps else None)
    truth = read_cube(write_hdf5(tmp_path / "truth.h5", np.where(np.arange(N_PIX) < 9, np.nan, maps / 2)))
    way_out = ", with any values in missing voxels, which are ignored" if gaps else ""
    with pytest.raises(InputError, match=f"^the truth must cover all pixels of the cube{way_out}\\.$"):
        check_truth(cube, truth)
