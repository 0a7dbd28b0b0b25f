"""How many sources to remove: what `suggest` and `himap suggest` say of skies where it is known."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cube_files import FREQS, N_PIX, NSIDE, himap, power_law_maps, write_hdf5

from himap.cubes import beams_of, clean_cube, cleaning, read_cube, report, suggestion
from himap.maps import sphere


@pytest.fixture
def maps(rng):
    return power_law_maps(rng)


class TestSuggestion:
    """On skies whose number of foreground components is known."""

    @pytest.mark.parametrize("n_components", [2, 4])
    def test_all_views_find_the_number(self, n_components, rng, tmp_path):
        smooth = np.linalg.qr((FREQS / 1000)[:, None] ** -np.arange(1.0, n_components + 1))[0]
        bright = smooth @ (1e3 * rng.standard_normal((n_components, N_PIX)))
        np.save(tmp_path / "a.npy", bright + rng.standard_normal((24, N_PIX)))
        cube = read_cube(tmp_path / "a.npy", freqs=FREQS, unit="mK", order="RING")
        found = suggestion.suggest(cube, "pca", n_sources=range(1, 8))
        assert found.n_bright == found.stable == found.n_sources[found.criterion.argmin()] == n_components
        assert found.range == (n_components, n_components)
        assert f"For pca, consider n_sources = {n_components}, by both" in suggestion.advice(found)

    @pytest.mark.parametrize("share", [0, 0.3])
    def test_spectra_beside_those_of_another_number(self, share, maps, rng, tmp_path):
        """From the few spectra by which two cleaned cubes differ, as if each were analysed anew."""
        maps[:, rng.random(N_PIX) < share] = np.nan
        np.save(tmp_path / "a.npy", maps)
        cube = read_cube(tmp_path / "a.npy", freqs=FREQS, unit="mK", order="RING")
        three, two, one = (clean_cube(cube, "pca", n_sources=n) for n in (3, 2, 1))
        beside = report.SpectraBeside(three)
        for cleaned, tolerance in ((three, 1e-6), (two, 1e-3), (one, 1e-3)):
            found, expected = beside(cleaned), report.spectra_of(cleaned)
            inside = expected.angular.degrees <= 2 * NSIDE
            assert found.angular.degrees == pytest.approx(expected.angular.degrees)
            means = found.angular.mean[inside], expected.angular.mean[inside]
            assert means[0] == pytest.approx(means[1], rel=tolerance)
            assert np.array_equal(found.frequency.power, expected.frequency.power)

    def test_peaks_and_modes_are_found_once_for_all_numbers(self, maps, tmp_path, monkeypatch):
        np.save(tmp_path / "a.npy", maps)
        cube = read_cube(tmp_path / "a.npy", freqs=FREQS, unit="mK", order="RING")
        calls = []
        for name in ("mask_peaks", "analysed"):
            work = getattr(cleaning, name)
            counted = partial(lambda name, work, *args: calls.append(name) or work(*args), name, work)
            monkeypatch.setattr(cleaning, name, counted)
        suggestion.suggest(cube, "beam_subspace", n_sources=range(1, 4), beams=beams_of(cube, "evolving"))
        assert sorted(calls) == ["analysed", "mask_peaks"]

    def test_what_a_beam_adds_does_not_count_for_a_method_that_knows_it(self, rng, tmp_path):
        """Two spectra through beams that differ much: PCA sees more components, BeamSubspace two."""
        windows = sphere.gaussian_beam(np.deg2rad(np.linspace(16, 10, 24)), 3 * NSIDE - 1)
        spectra = (FREQS / 1000)[:, None] ** np.array([-2.1, -2.8])
        power = 1e6 / np.arange(1.0, 2 * NSIDE + 2) ** 2
        alms = spectra @ np.stack([sphere.gaussian_alm(power, rng) for _ in range(2)])
        seen = zip(alms, windows, strict=True)
        maps = [sphere.synthesise(sphere.multiply_beam(alm, window), NSIDE) for alm, window in seen]
        np.save(tmp_path / "a.npy", maps + rng.standard_normal((24, N_PIX)))
        cube = read_cube(tmp_path / "a.npy", freqs=FREQS, unit="mK", order="RING")
        blind = suggestion.suggest(cube, "pca", n_sources=range(1, 5))
        knowing = suggestion.suggest(cube, "beam_subspace", n_sources=range(1, 5), beams=windows)
        assert blind.n_bright > 3
        assert knowing.n_bright == 2 and knowing.range == (2, 2)

    def test_where_nothing_is_stable_it_says_so(self, rng, tmp_path):
        falling = 10.0 ** -np.arange(24)[:, None] * rng.standard_normal((24, N_PIX))
        np.save(tmp_path / "a.npy", (np.linalg.qr(rng.standard_normal((24, 24)))[0] @ falling).astype("f4"))
        cube = read_cube(tmp_path / "a.npy", freqs=FREQS, unit="mK", order="RING")
        found = suggestion.suggest(cube, "pca", n_sources=range(1, 4))
        assert found.range is None
        assert suggestion.advice(found).endswith("try larger ones, or a method that knows the beam.")
        assert suggestion.advice(replace(found, knows_beam=True)).endswith("try larger ones.")

    def test_from_the_shell(self, maps, tmp_path):
        path = write_hdf5(tmp_path / "a.h5", maps, unit="mK", order="RING")
        page = tmp_path / "n.html"
        done = himap("suggest", path, "--to", 4, "-o", page)
        assert done.exit_code == 0 and "For pca, consider n_sources = 2, by both criteria." in done.output
        assert page.read_text().count("<img alt=") == 1
        again = himap("suggest", path, "-o", page)
        assert again.exit_code == 2 and "give --overwrite" in again.output

    def test_from_the_shell_with_a_beam(self, maps, tmp_path):
        path = write_hdf5(tmp_path / "a.h5", maps, unit="mK", order="RING")
        done = himap("suggest", path, "--method", "beam_subspace", "--beam", "oscillating", "--to", 4)
        assert done.exit_code == 0 and "2 eigenvalues stand above HI and noise." in done.output, done.output

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["--from", 5, "--to", 5], "--to must be more than --from"),
            (["--method", "polynomial"], "no parameter 'n_sources'"),
            (["--method", "beam_subspace"], "give --beam"),
            (["--to", 30], "at most the number of channels"),
            (["-o", "n.txt"], "is a .html file"),
        ],
    )
    def test_what_it_refuses(self, options, message, maps, tmp_path):
        path = write_hdf5(tmp_path / "a.h5", maps, unit="mK", order="RING")
        done = himap("suggest", path, *options)
        assert done.exit_code == 2 and message in done.output
