"""Methods that are told a wrong beam: which beam that is, what it costs, and how it is told."""

import json
import math
from dataclasses import asdict

import numpy as np
import pytest

from himap.errors import InputError
from himap.instrument.beams import Evolving, MeerKAT, Misjudged, Oscillating, Rippled
from himap.measures.power_spectra import angular_power
from himap.measures.transfer import JUDGED
from himap.paper import beam_errors, cleaned, pipeline
from himap.paper.beam_errors import (
    BeamError,
    by_error,
    evaluate,
    misjudged_recovery,
    most_excess,
    summary,
    told_beam,
    tolerated,
)
from himap.paper.beam_errors_figures import errors_figure
from himap.paper.corrections import cases_and_methods
from himap.paper.mocks import own_recovery
from himap.paper.record_file import read_record, write_record

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}
TWO = [["beam_subspace", 3], ["pca", 3]]


def made_up(error, excess, *, kind="width", method="beam_subspace", n_sources=3, seed=7):
    """Rows of one method and error in the judged bands, the excess in the last of them."""
    common = {"seed": seed, "method": method, "n_sources": n_sources, "kind": kind, "error": error}
    return [
        BeamError(band=band, ratio=0.9 + more, kept=0.9, excess=more, **common)
        for band, more in zip(JUDGED, [0.0] * (len(JUDGED) - 1) + [excess], strict=True)
    ]


class TestToldBeam:
    @pytest.mark.parametrize(
        ("kind", "error", "expected"),
        [
            ("width", 0.01, Misjudged(beam="oscillating", width=0.01)),
            ("ripple", 1e-3, Misjudged(beam="oscillating", ripple=1e-3)),
            ("amplitude", 0.5, Rippled(amplitude=0.15)),
            ("phase", 0.2, Rippled(phase=0.2)),
            ("period", 0.1, Rippled(period=22)),
            ("beam", "meerkat", MeerKAT()),
        ],
    )
    def test_of_the_oscillating_beam(self, kind, error, expected):
        freqs = np.linspace(900, 1400, 30)
        told, wanted = (
            one.windows(freqs, lmax=50).total for one in (told_beam(Oscillating(), kind, error), expected)
        )
        assert told == pytest.approx(wanted, rel=1e-12)

    def test_of_a_ripple_of_ones_own(self):
        told = told_beam(Rippled(amplitude=0.2, period=10, phase=1), "period", 0.1)
        assert (told.amplitude, told.phase) == (0.2, 1) and told.period == pytest.approx(11)

    @pytest.mark.parametrize(
        ("beam", "kind", "error", "message"),
        [
            (Oscillating(), "colour", 1, "one of width, ripple, .* got 'colour' and 1"),
            (Oscillating(), "width", "much", "and a number, got 'width' and 'much'"),
            (Oscillating(), "width", True, "and a number, got 'width' and True"),
            (Evolving(), "phase", 0.1, "the phase of a ripple .* got evolving"),
            (Oscillating(ripple="additive"), "amplitude", 0.1, "got oscillating:ripple=additive"),
            (Oscillating(), "beam", "square", "unknown beam 'square'"),
            (Oscillating(), "width", 2, "at most 0.5, got 2"),
        ],
    )
    def test_refused(self, beam, kind, error, message):
        with pytest.raises(InputError, match=message):
            told_beam(beam, kind, error)


@pytest.fixture(scope="module")
def setting():
    """Cases and methods, two each."""
    return cases_and_methods(**TINY, methods=TWO, n_realisations=2)


@pytest.fixture(scope="module")
def rows(setting):
    return evaluate(*setting, {"width": [0.001, 0.1], "beam": ["evolving"]})


class TestEvaluate:
    def test_told_the_truth_it_is_what_the_method_gives(self, setting):
        cases, (aware, _) = setting
        told, own = misjudged_recovery(cases[0], aware, cases[0].beam), own_recovery(cases[0], aware)
        for name in ("put_in", "came_back", "common"):
            assert getattr(told, name).power == pytest.approx(getattr(own, name).power, rel=1e-6)

    def test_told_another_beam_it_is_what_that_leaves(self, setting):
        """The power of the cube itself, cleaned with the wrong beam."""
        (case, _), (aware, _) = setting
        observed, told = pipeline.observation(case), Misjudged(width=0.05)
        cleaned_cube = aware.clean(
            observed.maps,
            freqs=observed.freqs,
            beams=told.of_survey(case.survey).total,
            separate_on=pipeline.basis(case, True),
        )
        expected = angular_power(cleaned_cube.residual).mean
        found = misjudged_recovery(case, aware, told).came_back.angular
        assert found[2:] == pytest.approx(expected[2 : len(found)], rel=0.02)

    def test_rows(self, rows):
        keys = [
            (row.method, row.kind, row.error) for row in rows if row.seed == 2025 and row.band == "C/C0, 5-9"
        ]
        aware = [("beam_subspace", *told) for told in (("width", 0.0), ("width", 0.001), ("width", 0.1))]
        assert keys == [*aware, ("beam_subspace", "beam", "evolving"), ("pca", "none", 0.0)]
        assert {row.seed for row in rows} == {2025, 2026}

    def test_more_wrong_is_worse(self, rows):
        excess = {key[2:]: most_excess(means) for key, means in by_error(rows).items() if key[0] != "pca"}
        assert excess["width", 0.1] > 10 * excess["width", 0.0]
        assert excess["width", 0.0] == pytest.approx(excess["width", 0.001], rel=0.5, abs=0.02)

    def test_nothing_as_large_as_a_cube_stays(self, setting, tmp_path, monkeypatch):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
        cases, removers = setting
        evaluate(cases[:1], removers, {"width": [0.001]})
        assert misjudged_recovery.is_cached(cases[0], removers[0], cases[0].beam)
        for made in (pipeline.observation, pipeline.peak_masked, cleaned.separation):
            assert not made.is_cached(
                *((cases[0],) if made is not cleaned.separation else (cases[0], removers[0]))
            )

    def test_refused_before_any_work(self, setting, monkeypatch):
        monkeypatch.setattr(beam_errors.plan, "passing_observations", None)
        cases, removers = setting
        with pytest.raises(InputError, match="there must be methods"):
            evaluate(cases, [], {})
        with pytest.raises(InputError, match="got 'colour'"):
            evaluate(cases, removers, {"width": [0.1], "colour": [1]})


class TestJudged:
    def test_means_over_skies(self):
        rows = made_up(0.1, 0.2, seed=1) + made_up(0.1, 0.4, seed=2)
        ((key, means),) = by_error(rows).items()
        assert key == ("beam_subspace", 3, "width", 0.1)
        assert most_excess(means) == pytest.approx(0.3)
        other = [row for row in made_up(0.1, 5.0) if row.band == JUDGED[-1]]
        assert most_excess(by_error([*rows, BeamError(**asdict(other[0]) | {"band": "C/C0, 2-4"})])[key]) < 1

    def test_tolerated_between_two_errors(self):
        rows = [*made_up(0.0, 0.05), *made_up(1e-3, 0.051), *made_up(1e-1, 0.15), *made_up(1.0, 1e-4)]
        assert tolerated(rows)["beam_subspace", 3, "width"] == pytest.approx(1e-2)
        assert tolerated(rows, 0.001)["beam_subspace", 3, "width"] == pytest.approx(1e-3)

    def test_tolerated_none_or_all(self):
        rows = [*made_up(0.0, 0.0), *made_up(0.1, 0.5)]
        rows += [*made_up(0.1, -0.01, kind="ripple"), *made_up(0.2, 0.0, kind="ripple")]
        found = tolerated([*rows, *made_up(0.0, 0.5, kind="none", method="pca")])
        assert math.isnan(found.pop(("beam_subspace", 3, "width")))
        assert found == {("beam_subspace", 3, "ripple"): 0.2}

    def test_summary(self):
        (line,) = summary(made_up(0.003, 0.5))
        assert line == (
            "beam_subspace 3",
            "width",
            "0.003",
            "1.4",
            JUDGED[-1],
            "0.900",
            "50.00%",
            JUDGED[-1],
        )
        (line,) = summary(made_up("meerkat", 0.0, kind="beam"))
        assert line[:5] == ("beam_subspace 3", "beam", "meerkat", "0.9", JUDGED[0])


def test_figure():
    """A panel for each kind that is wrong, with the methods' curves; one that knows no beam is level."""
    rows = [*made_up(0.0, 1e-3), *made_up(1e-2, 0.5), *made_up(1e-3, 0.01), *made_up(0.1, 2.0, kind="ripple")]
    rows += made_up(0.0, 0.02, kind="none", method="pca", n_sources=6) + made_up("meerkat", 1.0, kind="beam")
    figure = errors_figure(rows)
    width, ripple = figure.axes
    assert width.get_xlabel() == "relative error of the FWHM" and width.get_xscale() == "log"
    curves = {line.get_label(): line for line in width.lines}
    assert curves["BeamSubspace 3"].get_xydata() == pytest.approx(np.array([[1e-3, 0.01], [1e-2, 0.5]]))
    assert curves["PCA 6"].get_ydata() == pytest.approx([0.02, 0.02])
    assert "unknown ripple" in ripple.get_xlabel()
    assert len(errors_figure(rows, kinds=["ripple"]).axes) == 1


class TestFile:
    def test_there_and_back(self, tmp_path):
        rows = [*made_up(0.1, 0.5), *made_up("meerkat", 0.5, kind="beam")]
        path = tmp_path / "beam_errors.json"
        write_record(rows, path, {"preset": "ci"})
        assert read_record(BeamError, path) == (rows, {"preset": "ci"})
        assert list(json.loads(path.read_text())) == ["format", "about", "columns", "beam_errors"]

    def test_of_another_command(self, tmp_path):
        path = tmp_path / "other.json"
        path.write_text(json.dumps({"format": 2, "about": {}, "columns": [], "corrections": [[]]}))
        with pytest.raises(InputError, match="not a file that `himap record beam-errors` wrote"):
            read_record(BeamError, path)
