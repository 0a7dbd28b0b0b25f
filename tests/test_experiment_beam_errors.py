"""Methods that assume a wrong beam: which beam that is, what it costs, and how it is shown."""

import math

import numpy as np
import pytest

from himap.core.errors import InputError
from himap.instrument.beams import MeerKAT, Oscillating, PerturbedBeam, Rippled
from himap.measures.diagnostics import JUDGED
from himap.measures.spectra import angular_power
from himap.paper import pipeline
from himap.paper.experiment_figures import beam_errors_figure
from himap.paper.experiments import beam_errors
from himap.paper.experiments.beam_errors import EXPERIMENT, recovery_assuming, tolerated, worst_excess
from himap.paper.mocks import own_recovery

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}
TWO = [["beam_subspace", 3], ["pca", 3]]


def made_up(error, excess, *, kind="width", method="beam_subspace", n_sources=3, seed=7):
    """Rows of one method and error in the judged bands, the excess in the last of them."""
    common = {"seed": seed, "method": method, "n_sources": n_sources, "kind": kind, "error": error}
    return [
        common | {"band": band, "ratio": 0.9 + more, "recovered": 0.9, "excess": more}
        for band, more in zip(JUDGED, [0.0] * (len(JUDGED) - 1) + [excess], strict=True)
    ]


@pytest.mark.parametrize(
    ("beam", "kind", "error", "expected"),
    [
        (Oscillating(), "width", 0.01, PerturbedBeam(beam="oscillating", width=0.01)),
        (Oscillating(), "ripple", 1e-3, PerturbedBeam(beam="oscillating", ripple=1e-3)),
        (Oscillating(), "amplitude", 0.5, Rippled(amplitude=0.15)),
        (Oscillating(), "phase", 0.2, Rippled(phase=0.2)),
        (Oscillating(), "period", 0.1, Rippled(period=22)),
        (Oscillating(), "beam", "meerkat", MeerKAT()),
        (Rippled(amplitude=0.2, period=10), "period", 0.1, Rippled(amplitude=0.2, period=11)),
    ],
)
def test_the_beam_that_is_assumed(beam, kind, error, expected):
    freqs = np.linspace(900, 1400, 30)
    found = beam_errors.assumed_beam(beam, kind, error).windows(freqs, lmax=50).total
    assert found == pytest.approx(expected.windows(freqs, lmax=50).total, rel=1e-12)


@pytest.fixture(scope="module")
def grid():
    """Two skies with two methods and three beams."""
    errors = {"width": [0.001, 0.1], "beam": ["evolving"]}
    return beam_errors.skies(**TINY, methods=TWO, errors=errors, n_realisations=2)


@pytest.fixture(scope="module")
def table(grid):
    return EXPERIMENT.table(grid)


class TestMeasure:
    def test_with_the_true_beam_it_is_what_the_method_gives(self, grid):
        ((case, (aware, _)),) = grid[0].methods.items()
        found, own = recovery_assuming(case, aware, case.beam), own_recovery(case, aware)
        for name in ("input", "output", "cross"):
            assert getattr(found, name).power == pytest.approx(getattr(own, name).power, rel=1e-6)

    def test_with_another_beam_it_is_the_residual_with_that(self, grid):
        """The power of the cube itself, cleaned with the wrong beam."""
        ((case, (aware, _)),) = grid[0].methods.items()
        observed, assumed = pipeline.observation(case), PerturbedBeam(width=0.05)
        cube = aware.clean(
            observed.maps,
            freqs=observed.freqs,
            beams=assumed.of_survey(case.survey).total,
            separate_on=pipeline.basis(case, True),
        )
        expected = angular_power(cube.residual).mean
        found = recovery_assuming(case, aware, assumed).output.angular
        assert found[2:] == pytest.approx(expected[2 : len(found)], rel=0.02)

    def test_rows(self, table):
        own = table[(table["seed"] == 2025) & (table["band"] == "C/C0, 5-9")]
        keys = list(own[["method", "kind", "error"]].itertuples(index=False, name=None))
        aware = [("beam_subspace", "width", error) for error in (0.0, 0.001, 0.1)]
        assert keys == [*aware, ("beam_subspace", "beam", "evolving"), ("pca", "none", 0.0)]
        assert set(table["seed"]) == {2025, 2026}
        assert table["excess"].to_numpy() == pytest.approx(table["ratio"] - table["recovered"])

    def test_more_wrong_is_worse(self, table):
        excess = {key[2:]: value for key, value in worst_excess(table).items() if key[0] != "pca"}
        assert excess["width", 0.1] > 10 * excess["width", 0.0]
        assert excess["width", 0.0] == pytest.approx(excess["width", 0.001], rel=0.5, abs=0.02)


class TestJudged:
    def test_a_failure_on_one_sky_does_not_decide(self):
        rows = [
            row for seed, excess in ((1, 0.2), (2, 0.3), (3, 1e3)) for row in made_up(0.1, excess, seed=seed)
        ]
        low = made_up(0.1, 5.0)[-1] | {"band": "C/C0, 2-4"}  # which is not judged
        table = EXPERIMENT.frame([*rows, low])
        assert worst_excess(table) == {("beam_subspace", 3, "width", 0.1): pytest.approx(0.3)}
        assert beam_errors.median_over_skies(table)["band"].tolist() == list(JUDGED)

    def test_tolerated_between_two_errors(self):
        rows = [*made_up(0.0, 0.05), *made_up(1e-3, 0.051), *made_up(1e-1, 0.15), *made_up(1.0, 1e-4)]
        table = EXPERIMENT.frame(rows)
        assert tolerated(table)["beam_subspace", 3, "width"] == pytest.approx(1e-2)
        assert tolerated(table, 0.001)["beam_subspace", 3, "width"] == pytest.approx(1e-3)

    def test_tolerated_of_both_signs_is_that_of_the_worse(self):
        rows = [*made_up(0.0, 0.05), *made_up(1e-3, 0.051), *made_up(1e-1, 0.15)]
        rows += [*made_up(-1e-3, 0.0), *made_up(-1e-1, 0.06), *made_up(-0.1, 0.2, kind="ripple")]
        rows += made_up(-0.01, 0.05, kind="ripple") + made_up(-0.2, 0.0, kind="phase")
        found = {kind: error for (*_, kind), error in tolerated(EXPERIMENT.frame(rows)).items()}
        assert found["width"] == pytest.approx(1e-2) and 0.01 < found["ripple"] < 0.1
        assert found["phase"] == 0.2

    def test_tolerated_none_or_all(self):
        rows = [*made_up(0.0, 0.0), *made_up(0.1, 0.5)]
        rows += [*made_up(0.1, -0.01, kind="ripple"), *made_up(0.2, 0.0, kind="ripple")]
        found = tolerated(EXPERIMENT.frame([*rows, *made_up(0.0, 0.5, kind="none", method="pca")]))
        assert math.isnan(found.pop(("beam_subspace", 3, "width")))
        assert found == {("beam_subspace", 3, "ripple"): 0.2}

    def test_summary(self):
        rows = [*made_up(0.003, 0.5), *made_up("meerkat", 0.0, kind="beam")]
        first, second = EXPERIMENT.summary(EXPERIMENT.frame(rows)).to_numpy().tolist()
        assert first[:3] == ["BeamSubspace 3", "width", "0.003"]
        assert first[3:] == ["1.4", JUDGED[-1], "0.900", "50.00%", JUDGED[-1]]
        assert second[:5] == ["BeamSubspace 3", "beam", "meerkat", "0.9", JUDGED[0]]


def test_figure():
    """A panel for each kind that is wrong, with the methods' curves; one that uses no beam is level."""
    rows = [*made_up(0.0, 1e-3), *made_up(1e-2, 0.5), *made_up(1e-3, 0.01), *made_up(0.1, 2.0, kind="ripple")]
    rows += made_up(0.0, 0.02, kind="none", method="pca", n_sources=6) + made_up("meerkat", 1.0, kind="beam")
    table = EXPERIMENT.frame(rows)
    width, ripple = beam_errors_figure(table).axes
    assert width.get_xlabel() == "relative error of the FWHM" and width.get_xscale() == "log"
    curves = {line.get_label(): line for line in width.lines}
    assert curves["BeamSubspace 3"].get_xydata() == pytest.approx(np.array([[1e-3, 0.01], [1e-2, 0.5]]))
    assert curves["PCA 6"].get_ydata() == pytest.approx([0.02, 0.02])
    assert "additional ripple" in ripple.get_xlabel()
    with pytest.raises(InputError, match="no error of the beam"):
        beam_errors_figure(EXPERIMENT.frame(made_up(0.0, 1e-3)))
