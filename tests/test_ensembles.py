"""Statistics, tables and figures of ensembles of SDecGMCA, and the stored runs of the authors' code."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ks_2samp

from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.instrument.beams.paper import Oscillating
from himap.paper import ensembles
from himap.paper.authors_code import read_authors_ensemble
from himap.paper.ensembles import compare_samples
from himap.paper.ensembles_figures import distributions_figure, growth_figure, variants_figure
from himap.paper.experiments import authors
from himap.paper.pipeline import Case
from himap.sky.galaxy import Galaxy

FILE = Path(__file__).parent / "data" / "authors_ensemble.json"
TINY = {"preset": "ci", "survey": {"nside": 16, "n_channels": 64, "box_cells": 16}, "n_realisations": 1}


class TestTwoSamples:
    def test_p_is_the_exact_one_of_each_quantity(self, rng):
        one, two = rng.normal(size=(8, 3)), rng.normal([0, 1, 2], size=(16, 3))
        distances, p, _ = compare_samples(one, two, n_permutations=20_000)
        for n in range(3):
            exact = ks_2samp(one[:, n], two[:, n], method="exact")
            assert distances[n] == pytest.approx(exact.statistic)
            assert p[n] == pytest.approx(exact.pvalue, abs=5 * np.sqrt(exact.pvalue / 20_000) + 1e-4)

    def test_p_of_all_is_uniform_for_one_distribution_however_they_depend(self, rng):
        found = []
        for _ in range(200):
            values = rng.normal(size=(20, 1)) + 0.1 * rng.normal(size=(20, 4))
            found.append(compare_samples(values[:8], values[8:], n_permutations=99)[2])
        assert 0.4 < np.mean(found) < 0.6 and np.mean(np.array(found) <= 0.1) < 0.25

    def test_equal_values_are_one_step(self):
        distances, p, p_all = compare_samples(np.zeros((4, 1)), np.zeros((6, 1)), n_permutations=99)
        assert distances == pytest.approx([0]) and p.tolist() == [1] and p_all == 1

    def test_a_chance_is_never_0(self, rng):
        """The samples as they are count as one of the permutations."""
        one, two = rng.normal(size=(20, 2)), rng.normal(5, size=(20, 2))
        assert compare_samples(one, two, n_permutations=99)[2] == pytest.approx(1 / 100)


@pytest.mark.parametrize("text", [None, "no JSON", "{}", '{"keys": [], "x": {"a": [1]}, "runs": [[[1, 2]]]}'])
def test_another_file_than_that_of_the_authors_ensemble(tmp_path, text):
    if text is not None:
        (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match="does not hold the ensemble of the authors' code"):
        read_authors_ensemble(tmp_path / "a.json")


def of_restarts(errors, **changed):
    """Rows of the experiment `restarts`, a restart for each mean error."""
    first = {"reading": "code", "case": "oscillating", "n_sources": 5, "seed": 7, "quantity": "mean error"}
    return pd.DataFrame([first | {"restart": k, "value": v} | changed for k, v in enumerate(errors)])


def test_failures_by_reading_case_and_number_of_sources():
    rows = pd.concat(
        [
            of_restarts([0.05, 0.2, np.nan, 0.099]),
            of_restarts([0.5, 0.01], seed=8),
            of_restarts([0.01, 0.02], reading="letter"),
            of_restarts([9.0] * 4, quantity="bump"),
        ]
    )
    first, second = ensembles.failures(rows).to_dict("records")
    assert (first["reading"], first["failed"], first["members"]) == ("code", 3, 6)
    assert first["low"] < 0.5 < first["high"] and first["high"] - first["low"] > 0.5
    assert (second["reading"], second["failed"], second["low"]) == ("letter", 0, 0)


def test_curves_of_two_skies_are_not_averaged():
    rows = pd.concat([of_restarts([1.0, 2.0], x=0.0), of_restarts([3.0], seed=8, x=0.0)])
    assert ensembles.curves(rows, "mean error")[0.0].tolist() == [1, 2, 3]
    assert ensembles.curves(rows.drop(columns="seed")[:2], "mean error").index.tolist() == [0, 1]


@pytest.mark.parametrize(("value", "inside"), [(1.0, True), (15.0, True), (20.0, False), (0.05, False)])
def test_range_widened_by_half(value, inside):
    """From 1 to 10 it is 10^-0.25 to 10^1.25."""
    assert ensembles.any_within([value], [1.0, 3.0, 10.0]) == inside
    assert ensembles.any_within([value, 2.0], [1.0, 3.0, 10.0])


def test_the_measure_on_a_tiny_sky():
    """Every number of both kinds is there, angles of all restarts but the plain one."""
    (sky,) = authors.skies(**TINY, n_restarts=2, n_sources=3)
    table = authors.EXPERIMENT.table([sky])
    assert set(table["restart"]) == {0, 1}
    quantities = set(read_authors_ensemble(FILE)["quantity"])
    assert set(table["quantity"]) == quantities
    angles = ensembles.curves(table, "angle")
    assert angles.index.tolist() == [(sky.survey.seed, 1)] and angles.shape[1] == authors.N_ITERATIONS + 1
    assert angles.iloc[0, 0] == pytest.approx(1e-10, rel=0.9)
    assert ensembles.curves(table, "mean error").columns.tolist() == sorted(authors.FLOORS)
    assert set(authors.EXPERIMENT.summary(table)["quantity"]) == quantities - {"angle"}


class TestVariants:
    CASE = Case(
        survey=Survey.preset("ci", nside=16, n_channels=16, box_cells=16),
        galaxy=Galaxy(source="synthetic"),
        beam=Oscillating(),
    )
    SMALL = {"n_sources": 3, "pixels": "grid"}

    def test_without_thresholds_all_is_kept_and_nothing_grows(self):
        options = ensembles.VARIANTS["no thresholds"] | self.SMALL
        assert ensembles.first_kept(self.CASE, options) == pytest.approx(1)
        rows = ensembles.variant_growth(self.CASE, options, 2)
        assert rows.query("quantity == 'angle'")["value"].max() < 1e-5

    def test_thresholds_of_the_code_leave_sources_nearly_empty(self):
        kept = ensembles.first_kept(self.CASE, self.SMALL)
        without_share = ensembles.first_kept(self.CASE, ensembles.VARIANTS["no $K$"] | self.SMALL)
        assert kept.max() < 0.02 and np.all(kept < without_share)


class TestFigures:
    ROWS = read_authors_ensemble(FILE).query("preset == 'ci' and thresholds == 'mad' and sign == 'free'")

    def test_growth_and_variants(self):
        rows = self.ROWS.query("galaxy == 'synthetic' and alms == 'own'")
        figure = growth_figure({"one": rows, "two": rows})
        assert [axes.get_title() for axes in figure.axes] == ["one", "two"]
        variants = variants_figure({"a": rows, "b": rows})
        assert {axes.get_yscale() for axes in variants.axes} == {"log"}
        for one, names in ((figure, ("one", "two")), (variants, ("a", "b"))):
            text, (legend,) = one._repr_mimebundle_()["text/csv"], one.legends
            assert all(f",{name}, restarts: 50 %," in text.replace('"', "") for name in names)
            assert legend.get_texts()[0].get_text() == "restarts"

    def test_distributions_rise_from_0_to_1(self):
        rows = self.ROWS.query("galaxy == 'templates'")
        figure = distributions_figure({"a": rows, "b": rows}, {1e-9: "code", 1e-14: "rounding"})
        shown = [axes for axes in figure.axes if axes.get_visible()]
        assert len(shown) == len(ensembles.MEASURES) + 1
        for axes in shown:
            line = axes.lines[0]
            assert line.get_ydata()[[0, -1]].tolist() == [0, 1] and np.all(np.diff(line.get_xdata()) >= 0)
