"""Criteria for the number of sources against the truth: each by itself, and over a small sky."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from himap.core.errors import InputError
from himap.instrument.beams import Evolving
from himap.instrument.noise import noise_sigma
from himap.measures import n_sources
from himap.paper import cleaned, pipeline
from himap.paper.choice import SETTLED, SourceNumberCriteria, eigenvalues, minka, source_number_criteria
from himap.paper.experiments.n_sources import CRITERIA, EXPERIMENT, skies
from himap.paper.grid import cases_and_methods
from himap.paper.mocks import Mock, own_recovery
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
            found = n_sources.information(variances, np.array([3, 4]), n_pix, kind=kind)
            assert found[1] - found[0] == pytest.approx((expected[1] - expected[0]) / (n_pix * n_channels))
            assert found.min() == 0

    def test_eigenvalues_above_a_line(self):
        values = np.exp(-0.1 * np.arange(50))
        assert n_sources.eigenvalue_line(values) == pytest.approx(values)
        assert n_sources.n_significant(values) == 0
        values[:4] *= [1e4, 1e3, 10, 2.9]
        assert n_sources.n_significant(values) == 3

    def test_changes_and_where_they_settle(self):
        spectra = [
            (np.full(3, p), np.full(2, q)) for p, q in ((10.0, 1.0), (2.0, 1.0), (2.0, 0.95), (1.0, 0.95))
        ]
        change = n_sources.changes(spectra)
        assert change == pytest.approx([0.8, 0.05, 0.5])
        assert n_sources.settled(change, np.array([2, 3, 4, 5])) == 3
        assert n_sources.settled(change, np.array([2, 3, 4, 5]), 0.01) is None


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
    return SourceNumberCriteria(**values | changed)


class TestOfASky:
    def test_advised_and_best(self):
        criteria = made_up()
        assert criteria.recommended() == {"bic": 3, "aic": 5, "eigenvalues": 2, "stability": None, "mocks": 3}
        assert criteria.best == 4

    def test_of_a_small_sky(self):
        (case,), _ = cases_and_methods(**TINY, n_realisations=1)
        removers = tuple(PCA(n_sources=n) for n in (1, 2, 3))
        criteria = source_number_criteria(case, removers, [Mock(seed=1)])
        assert (
            list(criteria.counts) == [1, 2, 3] and len(criteria.change) == len(criteria.corrected_change) == 2
        )
        own = own_recovery(case, removers[1])
        inside = slice(10, 20)
        ratio = own.output.angular[inside].mean() / own.input.angular[inside].mean()
        assert criteria.error[1] >= abs(ratio - 1)
        values = np.linalg.eigvalsh(np.cov(pipeline.basis(case, True).astype(float), bias=True))[::-1]
        assert criteria.eigenvalues[:3] == pytest.approx(values[:3], rel=1e-3)

    def test_eigenvalues_at_one_resolution(self):
        """Through a beam that changes there are as many bright ones as through one that does not."""
        (case,), _ = cases_and_methods(**TINY, n_realisations=1, beam="degraded")
        changing = replace(case, beam=Evolving())
        aware, blind = (eigenvalues(changing, aware) for aware in (True, False))
        same = eigenvalues(case, True)
        assert aware[3] / aware[0] < 3 * same[3] / same[0] and blind[3] / blind[0] > 3 * aware[3] / aware[0]


class TestMeasure:
    GRID = TINY | {"beams": ["degraded"], "noises": [1], "methods": ["pca"], "n_mocks": 1, "n_sources_max": 3}

    def test_rows(self):
        grid = skies(**self.GRID | {"noises": [1, 10], "methods": ["pca", "beam_subspace"]}, n_realisations=2)
        table = EXPERIMENT.table(grid)
        assert len(table) == 2 * 2 * (6 + 5)
        assert not table.duplicated(["seed", "noise", "method", "criterion"]).any()
        assert table["noise"].round(6).unique().tolist() == [1, 10]
        assert set(table.loc[table["method"] == "pca", "criterion"]) == set(CRITERIA)
        assert table["best"].between(1, 3).all()
        assert (table["bias"].notna() == table["recommended"].between(1, 3)).all()
        assert (table["bias"].dropna() >= table["least_bias"][table["bias"].notna()]).all()
        right = table[table["recommended"] == table["best"]]
        assert right["bias"].tolist() == right["least_bias"].tolist() and len(right)
        assert minka(next(iter(grid[0].methods))) in range(1, 17)

    def test_each_method_separates_a_sky_once(self, tmp_path, monkeypatch):
        monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
        found, separate = [], PCA.separate
        monkeypatch.setattr(
            PCA, "separate", lambda *args, **own: found.append(args[0]) or separate(*args, **own)
        )
        (sky,) = skies(**self.GRID | {"n_sources_max": 2}, n_realisations=1)
        EXPERIMENT.table([sky])
        numbers = [remover.n_sources for remover in found]
        assert sorted(numbers) == [1, 1, 2, 2]  # the sky, and the sky with the mock
        ((case, _),) = sky.methods.items()
        assert not cleaned.separation.is_cached(case, PCA(n_sources=1))

    def test_cases(self):
        found = skies(**self.GRID | {"beams": ["degraded", "evolving"], "noises": [1, 3]}, n_realisations=2)
        assert [[case.survey.seed for case in sky.methods] for sky in found] == [[2025] * 4, [2026] * 4]
        first, second, *others = found[0].methods
        assert [case.beam.name for case in (first, second, *others)] == ["degraded"] * 2 + ["evolving"] * 2
        assert noise_sigma(second.survey) == pytest.approx(3 * noise_sigma(first.survey))
        assert found[0].survey == first.survey

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            *(({"noises": noises}, "1 first") for noises in ([], [3], [1, 0], [1, "much"], [1, True])),
            ({"beams": []}, "there must be beams"),
            ({"methods": []}, "there must be methods"),
            ({"methods": ["gnilc"]}, "no parameter 'n_sources'"),
            ({"n_sources_max": 1}, "between 2 and 100"),
            ({"n_sources_max": 17}, "at most the number of channels"),
            ({"n_mocks": 0}, "between 1 and 1000"),
        ],
    )
    def test_refused(self, given, message):
        with pytest.raises(InputError, match=message):
            skies(**self.GRID | given)


def test_summary():
    nan = float("nan")
    first = {"seed": 7, "beam": "degraded", "noise": 1.0, "method": "pca", "criterion": "bic"}
    first |= {"best": 3, "least_bias": 0.1}
    pairs = [(4, 0.2), (3, 0.1), (9, nan), (0, nan), (2, 0.4), (1, 0.5)]
    table = EXPERIMENT.frame([first | {"recommended": number, "bias": bias} for number, bias in pairs])
    (row,) = EXPERIMENT.summary(table).to_numpy().tolist()
    assert row == ["PCA", "information criterion (BIC)", "1", "1", "1", "1", "1", "1", "0.300", "0.100"]
    (row,) = EXPERIMENT.summary(table[2:4]).to_numpy().tolist()
    assert row[-2:] == ["", ""]
