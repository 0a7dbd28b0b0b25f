"""How many sources to remove: what `suggest` and `himap suggest` say of skies where it is known."""

import re
from dataclasses import replace

import numpy as np
import pytest
from cube_files import FREQS, N_PIX, NSIDE, run, write_hdf5
from skies import maps_through

from himap.cubes import beams_of, clean_cube, read_cube, spectra, suggestion
from himap.instrument.beams import named
from himap.maps import sphere
from himap.paper.study import Study
from himap.removal import available
from himap.removal.base import REGISTRY

COUNTED = [name for name in available() if "n_sources" in REGISTRY[name].__dataclass_fields__]


def cube_of(folder, maps, freqs=FREQS):
    np.save(folder / "a.npy", maps)
    return read_cube(folder / "a.npy", freqs=freqs, unit="mK", order="RING")


def made_up(**changed):
    """A suggestion for 1 to 5 sources whose criterion and eigenvalues say 3."""
    given = {"eigenvalues": np.ones(24), "line": np.ones(24), "n_bright": 3, "method": "pca"}
    given |= {"n_sources": range(1, 6), "criterion": [5, 1, 0, 0.1, 0.2], "stable": None}
    given |= {"change": [1, 0.5, 0.12, 0.13], "at_one_resolution": False} | changed
    arrays = {name: np.array(given[name]) for name in ("n_sources", "criterion", "change")}
    return suggestion.Suggestion(**given | arrays)


VIEWS = {
    "n_sources": range(2, 7),
    "criterion": [5, 0.2, 0, 0.1, 0.2],
    "change": [1, 0.3, 0.03, 0.02],
    "stable": 5,
}
KNOWING = VIEWS | {"widths": (1.0, 2.0), "at_one_resolution": True}
FALLING = {"criterion": range(0, -5, -1), "change": [0.5, 0.2, 0.05, 0.03], "stable": 3}
EVEN = {"criterion": range(4), "change": [0.01] * 3}
FEW = {"n_sources": [1, 2], "criterion": [1, 0], "change": [1], "eigenvalues": np.ones(3)}


@pytest.mark.parametrize(
    ("changed", "expected", "said"),
    [
        # The criterion, of what a method leaves, decides where spectra change little after its number.
        (KNOWING, (4, 4), "consider n_sources = 4, by the residual of this method."),
        (KNOWING | {"change": [1, 0.3, 0.2, 0.02]}, (3, 4), "n_sources = 3 to 4, and look at the page"),
        (VIEWS, (3, 4), "n_sources = 3 to 4, and look at the page"),
        # Where it still falls it is not said that no number is stable: the table has one that is.
        (FALLING | {"n_bright": 7}, None, "The criterion still falls at 5, the last tested number"),
        (FALLING | {"n_bright": 2}, (2, 5), "The criterion still falls at 5"),
        (
            FALLING | {"n_bright": 7, "criterion": [1, 0, 1, 2, 3]},
            (2, 5),
            "7 eigenvalues exceed HI and noise: try",
        ),
        # What both say counts where nothing is stable: with few channels each source takes too much HI.
        ({}, (3, 3), "consider n_sources = 3, by both criteria."),
        ({}, (3, 3), "himap transfer"),
        ({"n_bright": 4}, None, "try larger ones, or a method that knows the beam."),
        # The smallest that was tried is no agreement, and there are no more sources than channels.
        (
            EVEN | {"n_sources": range(5, 9), "stable": 5, "n_bright": 2},
            (5, 5),
            "5, the smallest tested number",
        ),
        (
            EVEN | {"n_sources": range(1, 5), "stable": 1, "n_bright": 0},
            (1, 1),
            "1, if any: no eigenvalue exceeds",
        ),
        (FEW, None, "there are too few channels for more."),
    ],
)
def test_advice(changed, expected, said):
    found = made_up(**changed)
    assert found.range == expected and said in suggestion.advice(found)


class TestSuggestion:
    """On skies whose number of foreground components is known."""

    @pytest.mark.parametrize("share", [0, 0.3])
    def test_spectra_by_difference_those_of_another_number(self, share, maps, rng, tmp_path):
        """From the few spectra by which two cleaned cubes differ, as if each were analysed anew."""
        maps[:, rng.random(N_PIX) < share] = np.nan
        cube = cube_of(tmp_path, maps)
        three, two, one = (clean_cube(cube, "pca", n_sources=n) for n in (3, 2, 1))
        near = spectra.analysed(cube, three.residual)
        for cleaned, tolerance in ((three, 1e-6), (two, 1e-3), (one, 1e-3)):
            found, expected = spectra.spectra_of(cleaned, near), spectra.spectra_of(cleaned)
            inside = expected.angular.degrees <= 2 * NSIDE
            assert found.angular.degrees == pytest.approx(expected.angular.degrees)
            means = found.angular.mean[inside], expected.angular.mean[inside]
            assert means[0] == pytest.approx(means[1], rel=tolerance)
            assert np.array_equal(found.frequency.power, expected.frequency.power)

    def test_what_a_beam_adds_does_not_count_for_a_method_that_knows_it(self, rng, tmp_path):
        """Two spectra through beams that differ much: PCA sees more components, BeamSubspace two."""
        windows = sphere.gaussian_beam(np.deg2rad(np.linspace(16, 10, 24)), 3 * NSIDE - 1)
        spectra = (FREQS / 1000)[:, None] ** np.array([-2.1, -2.8])
        power = 1e6 / np.arange(1.0, 2 * NSIDE + 2) ** 2
        alms = spectra @ np.stack([sphere.gaussian_alm(power, rng) for _ in range(2)])
        cube = cube_of(tmp_path, maps_through(windows, alms, NSIDE) + rng.standard_normal((24, N_PIX)))
        blind = suggestion.suggest(cube, "pca", n_sources=range(1, 5))
        knowing = suggestion.suggest(cube, "beam_subspace", n_sources=range(1, 5), beams=windows)
        assert blind.n_bright > 3
        assert knowing.n_bright == 2 and knowing.range == (2, 2)
        advice = suggestion.advice(knowing)
        assert "For beam_subspace with a beam of 10 to 16 deg FWHM, consider n_sources = 2, by both" in advice
        assert advice.endswith("this method and beam alone: run it again for others.")

    def test_on_a_part_of_the_sky_the_criterion_alone_counts_for_a_method_that_knows_the_beam(self, tmp_path):
        """There eigenvalues have what the beam adds, as for PCA."""
        observation = Study(preset="ci").observed(named("oscillating"))
        latitudes = sphere.pixel_latitude(sphere.nside_of(observation.maps))
        seen = np.where(np.abs(latitudes) > 15, observation.maps, np.nan)
        cube = cube_of(tmp_path, seen, observation.freqs)
        beams = beams_of(cube, "oscillating")
        found = suggestion.suggest(cube, "beam_subspace", n_sources=range(1, 7), beams=beams)
        assert found.n_bright > found.best and found.range == (found.best, found.best)
        advice = f"consider n_sources = {found.best}, by the residual of this method."
        assert advice in suggestion.advice(found)

    def test_where_nothing_is_stable_it_says_so(self, rng, tmp_path):
        falling = 10.0 ** -np.arange(24)[:, None] * rng.standard_normal((24, N_PIX))
        mixed = np.linalg.qr(rng.standard_normal((24, 24)))[0] @ falling
        cube = cube_of(tmp_path, mixed.astype("f4"))
        found = suggestion.suggest(cube, "pca", n_sources=range(1, 4))
        assert found.range is None
        assert suggestion.advice(found).endswith("try larger ones, or a method that knows the beam.")
        assert suggestion.advice(replace(found, widths=(1.0, 2.0))).endswith("try larger ones.")

    def test_with_a_beam_from_the_shell(self, maps, tmp_path):
        path = write_hdf5(tmp_path / "a.h5", maps)
        done = run("suggest", path, "--method", "beam_subspace", "--beam", "oscillating", "--to", 4)
        assert "2 eigenvalues exceed HI and noise." in done.output


def test_the_help_has_the_methods_with_sources():
    names = re.search(r"--method NAME\s+(.*?)\.", run("suggest", "--help").output, re.DOTALL)[1]
    assert names.split() == [f"{name}," for name in COUNTED[:-1]] + COUNTED[-1:]
