"""Criteria for the number of sources against the truth: each by itself, and over a small sky."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from himap.errors import InputError
from himap.instrument.beams import Degraded, Evolving
from himap.instrument.noise import noise_sigma
from himap.measures import how_many
from himap.paper import cleaned, pipeline, suggestions
from himap.paper.choice import SETTLED, Views, eigenvalues, minka, views_of
from himap.paper.corrections import cases_and_methods
from himap.paper.mocks import Mock, own_recovery
from himap.paper.record_file import read_record, write_record
from himap.paper.suggestions import Suggested, cases_over, confusion, evaluate, summary
from himap.removal import PCA

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}
COUNTS = np.arange(1, 6)


class TestCriteria:
    def test_information_is_that_of_a_model_with_known_noise_of_its_own(self):
        """-2 ln L of independent Gaussian residuals plus the price of each parameter, over all voxels."""
        rng = np.random.default_rng(3)
        n_pix, n_channels = 500, 12
        residuals = rng.standard_normal((2, n_channels, n_pix)) * np.array([2.0, 1.5])[:, None, None]
        variances = residuals.var(axis=2)
        for kind, price in (("bic", np.log(n_pix)), ("aic", 2.0)):
            expected = [
                -2
                * stats.norm.logpdf(
                    one, one.mean(axis=1, keepdims=True), one.std(axis=1, keepdims=True)
                ).sum()
                + price * n * (n_channels + n_pix)
                for n, one in zip((3, 4), residuals, strict=True)
            ]
            found = how_many.information(variances, np.array([3, 4]), n_pix, kind=kind)
            assert found[1] - found[0] == pytest.approx((expected[1] - expected[0]) / (n_pix * n_channels))
            assert found.min() == 0

    def test_eigenvalues_above_a_line(self):
        values = np.exp(-0.1 * np.arange(50))
        assert how_many.eigenvalue_line(values) == pytest.approx(values)
        assert how_many.n_above(values) == 0
        values[:4] *= [1e4, 1e3, 10, 2.9]
        assert how_many.n_above(values) == 3

    def test_changes_and_where_they_settle(self):
        spectra = [
            (np.full(3, p), np.full(2, q)) for p, q in ((10.0, 1.0), (2.0, 1.0), (2.0, 0.95), (1.0, 0.95))
        ]
        change = how_many.changes(spectra)
        assert change == pytest.approx([0.8, 0.05, 0.5])
        assert how_many.settled(change, np.array([2, 3, 4, 5])) == 3
        assert how_many.settled(change, np.array([2, 3, 4, 5]), 0.01) is None


def made_up(**changed):
    values = {
        "counts": COUNTS,
        "bic": np.array([3.0, 1, 0, 0.2, 0.4]),
        "aic": np.array([4.0, 3, 2, 1, 0]),
        "eigenvalues": np.exp(-0.1 * np.arange(50)) * np.r_[1e6, 1e5, np.ones(48)],
        "change": np.array([0.9, 0.5, 0.2, 0.15]),
        "corrected_change": np.array([0.9, 0.5, SETTLED / 2, 0.2]),
        "error": np.array([9, 2, 0.3, 0.1, 0.2]),
        "corrected_error": np.array([9, 2, 0.1, 0.1, 0.1]),
    }
    return Views(**values | changed)


class TestViews:
    def test_advised_and_best(self):
        views = made_up()
        assert views.advised() == {"bic": 3, "aic": 5, "eigenvalues": 2, "stability": None, "mocks": 3}
        assert views.best == 4

    def test_of_a_small_sky(self):
        (case,), _ = cases_and_methods(**TINY, n_realisations=1)
        removers = tuple(PCA(n_sources=n) for n in (1, 2, 3))
        views = views_of(case, removers, [Mock(seed=1)])
        assert list(views.counts) == [1, 2, 3] and len(views.change) == len(views.corrected_change) == 2
        own = own_recovery(case, removers[1])
        inside = slice(10, 20)
        ratio = own.came_back.angular[inside].mean() / own.put_in.angular[inside].mean()
        assert views.error[1] >= abs(ratio - 1)
        values = np.linalg.eigvalsh(np.cov(pipeline.basis(case, True).astype(float), bias=True))[::-1]
        assert views.eigenvalues[:3] == pytest.approx(values[:3], rel=1e-3)

    def test_eigenvalues_at_one_resolution(self):
        """Through a beam that changes there are as many bright ones as through one that does not."""
        (case,), _ = cases_and_methods(**TINY, n_realisations=1, beam="degraded")
        changing = replace(case, beam=Evolving())
        aware, blind = (eigenvalues(changing, aware) for aware in (True, False))
        same = eigenvalues(case, True)
        assert aware[3] / aware[0] < 3 * same[3] / same[0] and blind[3] / blind[0] > 3 * aware[3] / aware[0]


class TestEvaluate:
    def test_rows(self):
        (first,), _ = cases_and_methods(**TINY, n_realisations=1)
        cases = cases_over(first, beams=[Degraded()], noises=[1, 10], n_realisations=2)
        rows = evaluate(cases, ["pca", "beam_subspace"], [Mock(seed=1)], range(1, 4))
        keys = [(row.seed, round(row.noise), row.method, row.criterion) for row in rows]
        assert len(set(keys)) == len(keys) == 2 * 2 * (6 + 5)
        assert {row.criterion for row in rows if row.method == "pca"} == set(suggestions.CRITERIA)
        for row in rows:
            assert row.best in (1, 2, 3) and (row.cost is None) == (row.advised not in (1, 2, 3))
            assert row.cost is None or row.cost >= row.least
        assert minka(cases[0]) in range(1, 17)
        for made in (pipeline.observation, pipeline.peak_masked):
            assert not made.is_cached(cases[-1])

    def test_each_method_separates_a_sky_once(self, tmp_path, monkeypatch):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
        (first,), _ = cases_and_methods(**TINY, n_realisations=1)
        found, separate = [], PCA.separate
        monkeypatch.setattr(
            PCA, "separate", lambda *args, **own: found.append(args[0]) or separate(*args, **own)
        )
        evaluate([first], ["pca"], [Mock(seed=1)], range(1, 3))
        numbers = [remover.n_sources for remover in found]
        assert sorted(numbers) == [1, 1, 2, 2]  # the sky, and the sky with the mock
        assert not cleaned.separation.is_cached(first, PCA(n_sources=1))

    def test_cases(self):
        (first,), _ = cases_and_methods(**TINY, n_realisations=1)
        cases = cases_over(first, beams=[Degraded(), Evolving()], noises=[1, 3], n_realisations=2)
        assert [case.survey.seed for case in cases] == [2025] * 4 + [2026] * 4
        assert [case.beam.name for case in cases[:4]] == ["degraded"] * 2 + ["evolving"] * 2
        assert noise_sigma(cases[1].survey) == pytest.approx(3 * noise_sigma(cases[0].survey))

    @pytest.mark.parametrize("noises", [[], [3], [1, 0], [1, "much"], [1, True]])
    def test_noises_that_are_refused(self, noises):
        (first,), _ = cases_and_methods(**TINY, n_realisations=1)
        with pytest.raises(InputError, match="factors on the noise, 1 first"):
            cases_over(first, beams=[Degraded()], noises=noises, n_realisations=1)


ROW = Suggested(
    seed=7, beam="degraded", noise=1.0, method="pca", criterion="bic", advised=4, best=3, cost=0.2, least=0.1
)


def test_confusion_and_summary():
    rows = [ROW, replace(ROW, advised=3, cost=0.1), replace(ROW, advised=9, cost=None)]
    rows += [
        replace(ROW, advised=0, cost=None),
        replace(ROW, advised=2, cost=0.4),
        replace(ROW, advised=1, cost=0.5),
    ]
    assert confusion(rows) == {("pca", "bic"): {1: 1, 0: 1, 6: 1, None: 1, -1: 1, -2: 1}}
    (line,) = summary(rows)
    assert line == ("PCA", "information criterion (BIC)", "1", "1", "1", "1", "1", "1", "0.300", "0.100")


def test_file(tmp_path):
    rows = [ROW, replace(ROW, cost=None)]
    write_record(rows, tmp_path / "a.json", {"preset": "ci"})
    assert read_record(Suggested, tmp_path / "a.json") == (rows, {"preset": "ci"})
