"""What cleaning takes of a cube of one's own, and how it is corrected, in Python and on the command line."""

import csv
import re
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.cosmology import Planck18
from cube_files import FREQS, N_PIX, NSIDE, WIDE, power_law_maps, run, write_hdf5

from himap.core.errors import InputError
from himap.cubes import beams_of, clean_cube, correct, measure_transfer, read_cube
from himap.cubes.brightness import Parts, brightness_table, by_brightness, remarks_on_brightness
from himap.cubes.corrected import (
    HEADER,
    HEADER_OF_TRUTH,
    corrected_table,
    correlation_table,
    in_bands,
    remarks_on,
    write_spectra,
)
from himap.cubes.mocks import draw_mocks, mock_survey, read_mocks
from himap.cubes.neighbours import in_neighbours, neighbours_table, remarks_on_neighbours
from himap.cubes.spectra import compared, spectra_of
from himap.maps import sphere
from himap.maps.masks import bin_matrix
from himap.measures.bootstrap import covariance
from himap.measures.spectra import angular_power, decouple, frequency_power
from himap.measures.transfer import harmonic_power
from himap.removal import GNILC, PCA, Parametric, Polynomial
from himap.removal.smooth_posterior import SmoothForeground, products_of
from himap.removal.smooth_spectra import smooth_basis


def blue(rng, scale=1.0):
    """HI in the place of HI: a field without smooth spectra, mK, less its channel means."""
    cl = np.where(np.arange(2 * NSIDE) > 0, 1 / (1.0 + np.arange(2 * NSIDE)), 0)
    maps = [sphere.synthesise(sphere.gaussian_alm(cl, rng), NSIDE) for _ in FREQS]
    return scale * np.array(maps, dtype=np.float32)


BEAMS = np.ones((len(FREQS), 3 * NSIDE))
POLYNOMIALS = Polynomial(order=4), Polynomial(order=3, variable="logarithm")


def smooth_sky(rng, freqs=FREQS):
    """Two power laws, 1e3 times brighter than `blue`."""
    return (freqs / 1000)[:, None] ** np.array([-2.1, -2.8]) @ (1e3 * rng.lognormal(size=(2, N_PIX)))


def with_maps(cube, maps, **changed):
    return replace(cube, maps=maps.astype(np.float32), **changed)


def by_pca(cube, n_sources=2):
    return clean_cube(cube, "pca", n_sources=n_sources, peaks=False)


def first(share):
    """Which pixels are in a part of the sky."""
    return np.arange(N_PIX) < share * N_PIX


def corrected_by(cleaned, mocks, truth=None, **options):
    """What `correct` makes of a cleaned cube by these mocks, and the transfer function."""
    transfer = measure_transfer(cleaned, mocks, **options)
    return correct(cleaned, transfer, spectra_of(cleaned), truth), transfer


def pulls_of(both):
    """The largest, and with the systematic error, of all bands."""
    rows = [row[-2:] for row in corrected_table(both).rows]
    assert "C(l), l 20-39: up to l = 2 nside" in corrected_table(both).note
    drawn = both["angular"].drawn
    assert drawn or {row[1] for row in rows} == {"–"}  # the systematic error is not known
    pulls = np.abs(np.array(rows if drawn else [row[:1] for row in rows], dtype=float)).T
    assert (pulls[-1] <= pulls[0]).all()
    return pulls.max(axis=1)


@pytest.fixture
def truth(rng):
    return blue(rng)


@pytest.fixture
def cube(rng, truth, tmp_path):
    """The truth is in it."""
    return read_cube(write_hdf5(tmp_path / "cube.h5", (smooth_sky(rng) + truth).astype(np.float32)))


@pytest.fixture
def cleaned(cube):
    """Cleaned of as many spectra as there are."""
    return by_pca(cube)


class TestMade:
    def test_band_and_box_are_those_of_the_cube(self, cube):
        survey = mock_survey(cube)
        assert survey.freqs == pytest.approx(cube.freqs)
        assert (survey.nside, survey.n_channels) == (NSIDE, 24)
        low = replace(cube, freqs=np.linspace(500, 600, 24))
        assert mock_survey(low).box_size > 2 * mock_survey(cube).box_size > 5000

    @pytest.mark.parametrize(("width", "coarse"), [(16.0, False), (2.0, False), (0.5, True)])
    def test_cells_are_no_larger_than_channels_are_deep(self, cube, width, coarse):
        """Coarser ones smooth HI along the line of sight: of channels of 2 MHz 64 cells leave little."""
        fine, said = replace(cube, freqs=1000 + width * np.arange(24)), []
        survey = mock_survey(fine)
        depths = [Planck18.comoving_distance(1420.4 / (1000 + x) - 1).value for x in (0, width)]
        depth = 0.6766 * (depths[0] - depths[1])
        assert bool(survey.box_size / survey.box_cells > 1.1 * depth) is coarse
        assert survey.box_cells <= 1024 and survey.box_cells >= 4 * NSIDE
        draw_mocks(fine, np.ones((24, 3 * NSIDE)), 1, tell=said.append)
        assert len(said) == coarse and all("HI power is too low at large k" in one for one in said)

    def test_beam_noise_and_seeds(self, cube):
        cube = replace(cube, freqs=WIDE)
        beams = beams_of(cube, "degraded")
        one, two = draw_mocks(cube, beams, 2)
        again, *_ = draw_mocks(cube, beams, 1)
        (noisy,) = draw_mocks(cube, beams, 1, noise=0.5)
        assert one.shape == cube.maps.shape and one.dtype == np.float32
        assert np.array_equal(one, again) and abs(np.corrcoef(one[3], two[3])[0, 1]) < 0.2
        assert (noisy - one).std() == pytest.approx(0.5, rel=0.01)
        blurred = sphere.power_spectrum(sphere.analyse(one[0]))
        (sharp,) = draw_mocks(cube, np.ones_like(beams), 1)
        ratio = blurred[1:30] / sphere.power_spectrum(sphere.analyse(sharp[0]))[1:30]
        assert ratio == pytest.approx(beams[0, 1:30] ** 2, rel=0.05, abs=0.01)


class TestMeasured:
    @pytest.mark.parametrize("share", [1, 0.6])
    def test_what_comes_back_is_that_of_the_cubes(self, cube, rng, share):
        """Of the foreground with the mock in place of the rest, cleaned; on a part of the sky as well."""
        cube, mock = cube.within(first(share)), blue(rng)[:, first(share)]
        cleaned = by_pca(cube, 3)
        back = by_pca(replace(cube, maps=cleaned.foreground + mock), 3).residual.astype(float)
        found = measure_transfer(cleaned, [mock])
        output = found.mocks[0].ratios("output")
        on_sphere = cube.on_sphere(back - back.mean(axis=1, keepdims=True))
        put_in = cube.on_sphere(mock - mock.mean(axis=1, keepdims=True))
        spectra = [angular_power(maps).mean[2:25] for maps in (on_sphere, put_in)]
        assert output["angular"][2:25] == pytest.approx(spectra[0] / spectra[1], abs=0.01)
        spectra = [frequency_power(maps, cube.channel_width).power for maps in (back, mock)]
        assert output["frequency"][1:] == pytest.approx(spectra[0][1:] / spectra[1][1:], abs=0.02)
        assert found.frequency[1] < 0.8 < found.frequency[-1]

    @pytest.mark.parametrize(("share", "windows"), [(1, None), (1, BEAMS), (0.4, BEAMS)])
    def test_corrected_spectra_are_those_of_the_truth(self, cube, truth, rng, windows, share):
        """With as many sources as there are; the foreground as the method has it, or drawn."""
        seen = first(share)
        cleaned = by_pca(cube.within(seen))
        comparison = compared(cleaned, replace(cleaned.cube, maps=truth[:, seen]))
        mocks = (blue(rng)[:, seen] for _ in range(6))
        both, transfer = corrected_by(cleaned, mocks, comparison, beams=windows)
        assert transfer.drawn == (share == 1 and windows is not None)
        angular, frequency = both["angular"], both["frequency"]
        low = angular.x < 29
        true = np.interp(angular.x[low], comparison.degrees, comparison.true_angular)
        off = {
            name: abs((getattr(angular, name)[low] / true).mean() - 1) for name in ("corrected", "residual")
        }
        assert off["corrected"] < 0.02 < 0.07 < off["residual"]
        ratio = frequency.corrected / comparison.true_frequency
        assert ratio[1:] == pytest.approx(1, abs=0.1 if transfer.drawn else 0.05)
        parts = angular.share * (angular.corrected + angular.systematic)
        assert angular.residual == pytest.approx(parts, rel=1e-3)  # bins of T times power
        assert pulls_of(both)[0] < 4 and not remarks_on(both)

    def test_foreground_residual_is_known_with_the_beam(self, cube, truth, rng):
        """Of a third power law, of which a method that removes two leaves half of HI at the smallest k."""
        third = (FREQS / 1000)[:, None] ** -4 * 300 * rng.lognormal(size=N_PIX)
        cleaned = by_pca(with_maps(cube, cube.maps + third))
        comparison, mocks = compared(cleaned, replace(cube, maps=truth)), [blue(rng) for _ in range(8)]
        with_beams, _ = corrected_by(cleaned, mocks, comparison, beams=BEAMS)
        without, _ = corrected_by(cleaned, mocks, comparison)
        assert pulls_of(with_beams)[1] < 4 < 12 < pulls_of(without)[0]

    def test_error_bars_are_those_of_hi_alone_however_much_foreground_remains(self, cube, truth, rng):
        """Of a third smooth spectrum, as bright as HI and 16 times, the power is estimated from the cube.

        So is its chance correlation with HI, and only that of HI by itself is not known.
        """
        basis, bars = smooth_basis(FREQS, 3), []
        bright = basis[:, :2] @ (1e3 * rng.standard_normal((2, N_PIX)))
        mocks, source = [blue(rng) for _ in range(8)], blue(rng)[:1]
        for amplitude in (0, 1, 4):
            maps = bright + amplitude * basis[:, 2:] @ source + truth
            both, _ = corrected_by(by_pca(with_maps(cube, maps)), mocks, beams=BEAMS)
            of_bands = in_bands(both).items()
            bars.append([one.sigma([i / i.sum()])[0] for name, (one, i) in of_bands if "20-39" not in name])
        for factor in bars[1:] / np.array(bars[0]):
            assert 0.6 < np.exp(np.mean(np.log(factor))) < 1.8

    @pytest.mark.parametrize("n_mocks", [1, 3])
    def test_the_foreground_of_a_member_has_the_other_mocks(self, cleaned, rng, n_mocks, monkeypatch):
        """It is estimated with those that are not its own truth; with one mock with that."""
        mocks, given, of_member = [blue(rng) for _ in range(n_mocks)], [], SmoothForeground.of_member

        def spy(*args):
            given.append(of_member(*args))
            return given[-1]

        monkeypatch.setattr(SmoothForeground, "of_member", spy)
        measure_transfer(cleaned, mocks, beams=BEAMS)
        lmax, fields = 3 * NSIDE - 1, [sphere.analyse(mock, 3 * NSIDE - 1) for mock in mocks]
        for n, one in enumerate(given):
            others = products_of(fields[:n] + fields[n + 1 :] or fields, lmax)
            assert one.products == pytest.approx(others, rel=1e-3, abs=1e-3 * others.max())
        assert len(given) == n_mocks

    @pytest.mark.parametrize("drawn", [True, False])
    def test_foreground_beyond_the_multipoles_is_subtracted(self, cleaned, rng, drawn):
        """Pixels have more power than multipoles: noise at all k alike, foreground at few of them.

        The noise is that of pixels also where most of what multipoles have is foreground.
        """
        transfer = measure_transfer(cleaned, [blue(rng)], beams=BEAMS if drawn else None)
        if drawn:
            transfer = replace(transfer, left=replace(transfer.residual, power=0.9 * transfer.residual.power))
        usual, within = spectra_of(cleaned), transfer.residual.frequency
        white, bump = 0.1 * np.median(within), 5 * within * (np.arange(len(within)) == 1)
        some, more = (
            correct(cleaned, transfer, replace(usual, frequency=replace(usual.frequency, power=power)))[
                "frequency"
            ]
            for power in (within + white, within + white + bump)
        )
        subtracted = (more.systematic - some.systematic) * some.share
        known = transfer.corrected("frequency", transfer.without_foreground.frequency)[1:]
        assert some.corrected == pytest.approx(known + white, rel=1e-3)
        assert more.corrected == pytest.approx(some.corrected, rel=1e-12)
        assert subtracted == pytest.approx(bump[1:], rel=1e-9, abs=1e-12 * bump.max())

    def test_noise_beyond_the_multipoles_is_as_in_mocks_not_as_in_the_residual(self, cube, rng):
        """Gaps put noise of all multipoles at small k, where nothing else comes back."""
        weights = np.where(rng.random(cube.maps.shape) < 0.1, 0, rng.uniform(0.5, 1.5, cube.maps.shape))

        def noisy():
            noise = 0.3 * rng.standard_normal(weights.shape) / np.sqrt(np.maximum(weights, 0.5))
            return (blue(rng) + noise).astype(np.float32)

        truth = noisy()
        gaps = with_maps(cube, np.where(weights > 0, smooth_sky(rng) + truth, 0), weights=weights)
        cleaned = clean_cube(gaps, "polynomial", order=6, peaks=False)
        both, transfer = corrected_by(cleaned, [noisy() for _ in range(2)])
        seen = gaps.without_gaps(truth)
        within = harmonic_power(sphere.analyse(seen), cube.channel_width).frequency[1:]
        ratio = frequency_power(seen, cube.channel_width).power[1:] / within
        found = transfer.corrected("frequency", transfer.residual.frequency)[1:]
        assert both["frequency"].share[1] < 0.1
        assert (both["frequency"].corrected / found)[1:] == pytest.approx(ratio[1:], rel=0.02)

    @pytest.mark.parametrize("method", [PCA(n_sources=3), *POLYNOMIALS, Parametric(), GNILC()])
    def test_no_method_leaves_more_foreground_than_there_is_power(self, cube, rng, method):
        """Also if its spectra are not those of a linear fit."""
        freqs = np.linspace(900, 1300, len(FREQS))
        wide = with_maps(cube, smooth_sky(rng, freqs) + blue(rng), freqs=freqs)
        cleaned = clean_cube(wide, method, peaks=False)
        left = measure_transfer(cleaned, [blue(rng)], beams=BEAMS).left
        power = harmonic_power(sphere.analyse(cleaned.residual), wide.channel_width)
        assert (left.frequency[1:4] < 0.9 * power.frequency[1:4]).all()

    @pytest.mark.filterwarnings("ignore::himap.removal.base.SeparationWarning")
    @pytest.mark.parametrize(("method", "more"), [("beam_subspace", {}), ("smooth_spectra", {"n_smooth": 4})])
    def test_a_method_leaves_what_the_beams_that_it_assumes_do(self, cube, rng, method, more):
        """Which may not be those of the cube, and end at another l: here nearly all of the residual."""
        own = np.exp(-0.02 * np.arange(3 * NSIDE) * (FREQS / 1000)[:, None])
        bright = 1e5 * smooth_basis(FREQS, 2) @ np.vstack([blue(rng)[:1], blue(rng)[:1]])
        rows = zip(bright, own, strict=True)
        maps = [sphere.synthesise(sphere.multiply_beam(sphere.analyse(m), b), NSIDE) for m, b in rows]
        some = with_maps(cube, np.array(maps) + blue(rng))
        cleaned = clean_cube(some, method, n_sources=2, beams=own**1.1, peaks=False, **more)
        left = measure_transfer(cleaned, [blue(rng)], beams=own[:, : 2 * NSIDE]).left
        power = harmonic_power(sphere.analyse(cleaned.residual), cube.channel_width)
        assert left.angular[4:24].sum() == pytest.approx(power.angular[4:24].sum(), rel=0.3)

    def test_table_and_file_of_spectra(self, cube, cleaned, truth, rng, tmp_path):
        comparison, mocks = compared(cleaned, replace(cube, maps=truth)), [blue(rng) for _ in range(2)]
        both, _ = corrected_by(cleaned, mocks, comparison)
        one = replace(both["angular"], systematic=0.3 * both["angular"].corrected, drawn=True)
        rows = {row[0]: row for row in corrected_table(both | {"angular": one}).rows}
        assert rows["P(k), k 0.03-0.1"][HEADER.index("systematic")] == "not known"  # was not drawn
        row = rows["C(l), l 10-19"]
        inside = (one.x >= 10) & (one.x < 20)
        bar = one.sigma([inside / inside.sum()])[0]
        pull = ((one.corrected / one.truth)[inside].mean() - 1) / np.array([bar, np.hypot(bar, 0.3)])
        assert row[HEADER.index("systematic")] == "30.00%"
        assert [float(cell) for cell in row[-2:]] == pytest.approx(pull, abs=0.051)
        write_spectra(both, tmp_path / "a.csv")
        rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
        angular = [row for row in rows if row["spectrum"] == "angular"]
        assert [float(row["x"]) for row in angular] == both["angular"].x.tolist()
        assert float(angular[3]["corrected"]) == pytest.approx(both["angular"].corrected[3])
        assert float(angular[3]["truth"]) == pytest.approx(comparison.true_angular[3])
        assert angular[-1]["truth"] == "nan"  # beyond 2 nside
        sample = both["angular"].sigma(np.eye(len(both["angular"].x))[3:4], "sample")[0]
        assert float(angular[3]["sample"]) == pytest.approx(sample, rel=1e-6)
        errors = [float(angular[3][f"error_{n}"]) for n in (1, 2)]
        assert covariance(np.array([errors]).T).item() == pytest.approx(float(angular[3]["sigma"]) ** 2)

    @pytest.mark.parametrize(("n_sources", "beams"), [(1, False), (1, True), (2, False), (2, True)])
    def test_foreground_that_members_do_not_have_is_said(self, cube, rng, n_sources, beams):
        """Without the beam they have the foreground of the method: here of one of two power laws.

        The residual then is that of the other, so that its power goes with its square; else HI alone.
        """
        cleaned, mocks = by_pca(cube, n_sources), (blue(rng) for _ in range(6))
        both, transfer = corrected_by(cleaned, mocks, beams=BEAMS if beams else None)
        found = by_brightness(cleaned, transfer, both)
        said = remarks_on(both) + remarks_on_brightness(found)
        if n_sources == 2 or beams:
            assert len(said) == (n_sources == 1) and all("Most of the residual" in one for one in said)
            assert ((found["no foreground"] - 1).abs() < 3 * found["error"]).all()
            assert n_sources == 1 or (found["error"] < 0.1).all()
        else:
            assert "C(l), l 5-9: " in said[0] and "foreground residual" in said[0] and "k > 0.1" in said[1]
            assert (found["faintest"] < 0.1).all() and (found["brightest"] > 3).all()
            assert (found["no foreground"] < 0.5).all()

    def test_residual_in_parts_is_compared_with_mocks_and_with_the_corrected_power(self, cleaned, rng):
        """Twice the power of mocks in a part halves its ratio; half of foreground doubles all of them."""
        both, transfer = corrected_by(cleaned, [blue(rng), blue(rng)])
        one = both["frequency"]
        left = one.residual / one.share
        none, half = (both | {"frequency": replace(one, systematic=x * left)} for x in (0, 0.5))
        factors = np.array([1, 1, 1, 1, 2])
        uneven = replace(transfer, powers=transfer.powers * factors[:, None])
        pairs = (transfer, none), (transfer, half), (uneven, none)
        found = [by_brightness(cleaned, *pair) for pair in pairs]
        usual, doubled, fainter = (one.iloc[:, : len(factors)].to_numpy() for one in found)
        assert usual.mean(axis=1) == pytest.approx(1, abs=0.02)
        assert doubled == pytest.approx(2 * usual)
        assert np.ptp(fainter * factors / usual, axis=1).max() < 1e-6
        assert found[1]["error"].min() > 0.4 > 2 * found[0]["error"].max()

    @pytest.mark.parametrize(("noise", "said"), [(3, False), (1.5, True), (4.5, True)])
    def test_neighbouring_channels_tell_noise_that_is_not_that_of_the_mocks(self, cube, rng, noise, said):
        """HI that is the same in two channels has half of its power in common, and noise none."""

        def hi_and_noise(level):
            hi = blue(rng)
            return hi + np.roll(hi, 1, axis=0) + level * rng.standard_normal(hi.shape).astype("f")

        cleaned = by_pca(with_maps(cube, smooth_sky(rng) + hi_and_noise(noise)))
        found = in_neighbours(measure_transfer(cleaned, [hi_and_noise(3) for _ in range(6)]))
        assert [*found.index] == ["C(l), l 2-4", "C(l), l 5-9", "C(l), l 10-19", "C(l), l 20-39"]
        last = found.loc["C(l), l 20-39"]
        assert 0.1 < last.mocks < 0.25 and (last.cube < last.mocks - last.error) == (noise > 3)
        remarks = remarks_on_neighbours(found)
        assert len(remarks) == said and all("l 20-39: 0." in one for one in remarks)
        assert neighbours_table(found).rows[-1][:2] == ["C(l), l 20-39", f"{last.cube:.4f}"]

    def test_power_without_foreground_is_that_of_a_line(self, cleaned):
        """Whose slope does not matter, from parts with as many pixels, the faintest first."""
        parts = Parts.of(cleaned)
        squares = np.mean(np.square(cleaned.foreground, dtype=float), axis=0)
        assert np.array_equal(np.sort(np.concatenate(parts.pixels)), np.arange(N_PIX))
        ends = [squares[part].max() for part in parts.pixels[:-1]]
        starts = [squares[part].min() for part in parts.pixels[1:]]
        assert {*map(len, parts.pixels)} <= {N_PIX // 5, N_PIX // 5 + 1}
        assert all(end <= start * (1 + 1e-6) for end, start in zip(ends, starts, strict=True))
        means = [squares[part].mean() / squares.mean() for part in parts.pixels]
        assert parts.brightness == pytest.approx(means, rel=1e-5)
        lines = np.array([[2.0], [3.0]]) + np.array([[0.5], [-0.1]]) * parts.brightness
        assert parts.without(lines) == pytest.approx([2, 3])
        assert parts.without(lines[1]) == pytest.approx(3)

    @pytest.mark.parametrize(("scale", "n_mocks", "said"), [(2.0, 6, True), (1.0, 6, False), (2.0, 2, False)])
    def test_mocks_unlike_the_data(self, cleaned, rng, scale, n_mocks, said):
        """Of four times the power; two mocks are too few to tell; where nothing is lost it does no harm."""
        both, _ = corrected_by(cleaned, (blue(rng, scale) for _ in range(n_mocks)))
        remarks = " ".join(remarks_on(both))
        assert ("differs from that of the mocks" in remarks) == said
        assert not said or re.search(r"C\(l\), l 5-9: 0\.2\d?\b", remarks)
        no_loss = {kind: replace(one, share=np.ones_like(one.share)) for kind, one in both.items()}
        assert "differs from that of the mocks" not in " ".join(remarks_on(no_loss))
        assert both["angular"].expected[3:10] == pytest.approx(scale**2 / (6 + np.arange(7)), rel=0.3)
        bright = {kind: replace(one, expected=1e6 * one.expected) for kind, one in both.items()}
        (remark,) = remarks_on(bright)
        assert re.search(r"the power of the residual .* in the unit that the file", remark)

    def test_data_like_the_mocks_where_power_falls_steeply(self, cleaned, rng):
        """Scatter that has no mean over a band is not held against its brightest multipoles alone."""
        both, _ = corrected_by(cleaned, [blue(rng) for _ in range(6)])
        alike = {}
        for kind, one in both.items():
            steep, ratio = 1 / (1 + one.x) ** 3, 1 + 0.1 * rng.standard_normal(len(one.x))
            for inside in (inside for of, inside in in_bands(both).values() if of is one):
                ratio[inside] /= ratio[inside].mean()
            small = np.full_like(one.errors, 1e-3) * np.array([1, -1] * 3)[:, None]
            errors = {"errors": small, "sample": small, "systematic": 0 * steep}
            alike[kind] = replace(one, corrected=steep * ratio, expected=steep, **errors)
        assert not any("differs from that of the mocks" in remark for remark in remarks_on(alike))

    def test_one_mock_has_no_error_bar(self, cleaned, rng):
        both, transfer = corrected_by(cleaned, [blue(rng)])
        assert np.isnan(both["angular"].sigma(np.eye(len(both["angular"].x)))).all()
        assert all(row[3] == "needs two mocks" for row in corrected_table(both).rows)
        found = by_brightness(cleaned, transfer, both)
        assert not remarks_on_brightness(found)
        assert all(row[-2:] == ["–", "–"] for row in brightness_table(found).rows)
        found = in_neighbours(transfer)
        assert not remarks_on_neighbours(found)
        assert all(row[-2:] == ["–", "–"] for row in neighbours_table(found).rows)

    def test_of_another_cube(self, cleaned, cube, rng):
        transfer = measure_transfer(cleaned, [blue(rng)])
        other = by_pca(cube.within(first(0.5)))
        with pytest.raises(InputError, match=f"belongs to another cube, with {N_PIX} pixels"):
            correct(other, transfer, spectra_of(other))

    def test_no_room_for_mocks(self, cleaned, rng, monkeypatch):
        def no_room(*_):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(np, "save", no_room)
        with pytest.raises(InputError, match="the mocks cannot be stored in .*TMPDIR"):
            measure_transfer(cleaned, [blue(rng)], beams=BEAMS)

    def test_bins_of_a_mask_have_all_their_multipoles(self, cube, rng):
        part = clean_cube(cube.within(first(0.3)), "pca", n_sources=2)
        both, transfer = corrected_by(part, [blue(rng)[:, part.cube.mask]])
        lmax = len(transfer.degrees) - 1
        bins = bin_matrix(lmax, round(np.median(np.diff(spectra_of(part).angular.degrees))))
        assert bins.astype(bool).sum(axis=1)[2] > 3
        expected = bins @ np.where(np.arange(lmax + 1) < 2, 0, transfer.angular)
        assert both["angular"].share[1:] == pytest.approx(expected[2:], rel=1e-9)

    def test_errors_with_a_mask_are_those_of_decoupled_spectra(self, cube, rng):
        """Which scatter more than the spectra of the masked maps."""
        part = clean_cube(cube.within(first(0.3)), "pca", n_sources=2)
        mocks = [blue(rng)[:, part.cube.mask] for _ in range(3)]
        both, transfer = corrected_by(part, mocks)
        found = both["angular"]
        powers = np.array(
            [angular_power(part.cube.on_sphere(one), mask=part.cube.sky_mask).mean for one in mocks]
        )
        expected = (powers / powers.mean(axis=0) - 1) * np.sqrt(3 / 2)
        assert found.sample == pytest.approx(expected[:, 1 : 1 + len(found.x)], abs=1e-3)
        put_in = np.array([mock.input.angular for mock in transfer.mocks])
        corrected, true = (
            decouple(power, part.cube.sky_mask.astype(float)).cl
            for power in (put_in * (1 + transfer.errors("angular")), put_in)
        )
        expected = corrected / true - 1
        assert found.errors == pytest.approx(expected[:, 1 : 1 + len(found.x)], abs=1e-6)

    def test_few_channels_have_the_foreground_of_the_method(self, cube, rng):
        few = by_pca(replace(cube, maps=cube.maps[:6], freqs=cube.freqs[:6]))
        assert not measure_transfer(few, [blue(rng)[:6]], beams=BEAMS[:6]).drawn

    @pytest.mark.parametrize("windows", [None, BEAMS])
    def test_mocks_that_are_refused_leave_no_files(self, cleaned, rng, windows, tmp_path, monkeypatch):
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        before, one, two = {*tmp_path.iterdir()}, blue(rng), blue(rng)
        for mocks, message in (
            ([], "one or more, got none"),
            ([one, two[1:]], r"the cube, \(24, 3072\), got \(23, 3072\)"),
            ([one, two, one.copy()], "must differ, but number 3 repeats an earlier one"),
        ):
            with pytest.raises(InputError, match=message):
                measure_transfer(cleaned, mocks, beams=windows)
            assert {*tmp_path.iterdir()} == before

    def test_one_multipole_without_signal_is_not_known_alone(self, cleaned, rng):
        transfer = measure_transfer(cleaned, [blue(rng), blue(rng)])
        for mock in transfer.mocks:
            mock.cross.power[12] *= -1
        one = correct(cleaned, transfer, spectra_of(cleaned))["angular"]
        assert one.x[np.isnan(one.corrected)] == [12]

    def test_errors_are_those_of_the_transfer_function_and_bands_have_correlations(self, cleaned, rng):
        """So is the sample variance."""
        both, transfer = corrected_by(cleaned, (blue(rng) for _ in range(3)))
        for kind, first in (("angular", 2), ("frequency", 1)):
            one = both[kind]
            inside = slice(first, first + len(one.x))
            assert one.errors == pytest.approx(transfer.errors(kind)[:, inside], rel=1e-9)
            assert one.sample == pytest.approx(transfer.sample(kind)[:, inside], rel=1e-9)
        table = correlation_table(both)
        matrix = np.array([[float(cell) for cell in row[1:]] for row in table.rows])
        assert table.header[1:] == [row[0] for row in corrected_table(both).rows]
        assert (matrix == matrix.T).all() and (np.diag(matrix) == 1).all() and np.abs(matrix).max() <= 1
        of_band = both["angular"].errors[:, both["angular"].x < 5].mean(axis=1)
        ends = both["frequency"].errors[:, both["frequency"].x > 0.1].mean(axis=1)
        expected = of_band @ ends / np.sqrt((of_band @ of_band) * (ends @ ends))
        assert matrix[0, -1] == pytest.approx(expected, abs=0.006)


class TestCommands:
    @pytest.fixture
    def here(self, tmp_path, monkeypatch, rng, truth):
        monkeypatch.chdir(tmp_path)
        write_hdf5("cube.h5", power_law_maps(rng) + truth, WIDE)
        write_hdf5("truth.h5", truth, WIDE)
        for n in range(2):
            write_hdf5(f"mock{n}.h5", blue(rng), WIDE)
        return tmp_path

    def test_transfer_with_made_mocks(self, here):
        words = ("--method", "beam_subspace", "--beam", "degraded", "-p", "n_sources=2", "--mocks", 2)
        result = run("transfer", "cube.h5", *words, "--truth", "truth.h5", "-o", "t.html")
        assert "t.html  t.csv  (" in result.stdout and "The mocks have no noise" in result.output
        assert "The mocks have the foreground" not in result.output
        names = (*HEADER, *HEADER_OF_TRUTH, "C(l), l 2-4", "P(k), k > 0.1", "fifths of the sky")
        assert all(name in result.stdout for name in names)
        page = Path("t.html").read_text()
        assert "Corrected spectra" in page and page.count("<img") == 4
        names = "cube.h5 mock0.h5 mock1.h5 t.csv t.html truth.h5"
        assert sorted(path.name for path in here.iterdir()) == names.split()

    def test_clean_with_mocks_from_files(self, here):
        words = ("--method", "pca", "-p", "n_sources=2", "--mocks", "mock0.h5", "--mocks", "mock1.h5")
        result = run("clean", "cube.h5", *words, "-o", "c.h5")
        assert "c.h5  c.html  c.csv  (" in result.stdout and HEADER_OF_TRUTH[-1] not in result.stdout
        assert "The mocks have the foreground estimated by pca" in result.output
        page = Path("c.html").read_text()
        assert "Corrected spectra" in page and "fifths of the sky" in page

    def test_mocks_are_checked_before_the_cube_is_cleaned(self, here, rng, monkeypatch):
        monkeypatch.setattr("himap.cubes.cleaning.clean_cube", None)
        write_hdf5("mock1.h5", np.where(np.arange(N_PIX) < 10, np.nan, blue(rng)), WIDE)
        words = ("--method", "pca", "--mocks", "mock0.h5", "--mocks", "mock1.h5", "-o", "c.h5")
        result = run("clean", "cube.h5", *words, code=2)
        assert "mock1.h5: a mock must cover all pixels of the cube" in result.output


@pytest.mark.parametrize("factor", [0, 0.9])
@pytest.mark.parametrize("n_seen", [N_PIX, 2000])
def test_mocks_from_files(cube, rng, tmp_path, factor, n_seen):
    """Each of one file, in the pixels that the cube sees; one with foreground is remarked on."""
    mocks, said = [(factor * cube.maps + blue(rng)).astype(np.float32) for _ in range(2)], []
    seen = np.arange(N_PIX) < n_seen
    paths = [write_hdf5(tmp_path / f"{n}.h5", mock) for n, mock in enumerate(mocks)]
    read = read_mocks(cube.within(seen), paths, tell=said.append)
    assert all(map(np.array_equal, read, [mock[:, seen] for mock in mocks]))
    assert any("mocks are HI and noise only" in one for one in said) == bool(factor)


def test_a_mock_with_foreground_of_a_cube_with_gaps(cube, rng, tmp_path):
    """Gaps, which are 0, are not compared with a sky far from 0."""
    sky, said = cube.maps + 100 * cube.maps.std(), []
    weights = (rng.random(sky.shape) > 0.2).astype(np.float32)
    gaps = with_maps(cube, np.where(weights > 0, sky, 0).astype(np.float32), weights=weights)
    path = write_hdf5(tmp_path / "mock.h5", 0.9 * sky)
    assert gaps.missing.any() and list(read_mocks(gaps, [path], tell=said.append))
    assert any("mocks are HI and noise only" in one for one in said)
