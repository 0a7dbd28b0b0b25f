"""Criteria for the number of sources: each by itself, and of a small sky."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from himap.instrument.beams import Evolving
from himap.measures import n_sources
from himap.paper import pipeline
from himap.paper.choice import SETTLED, eigenvalues, recommended, source_number_criteria
from himap.paper.grid import cases_and_methods
from himap.paper.mocks import Mock, own_recovery
from himap.removal import PCA

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}


class TestCriteria:
    @pytest.mark.parametrize(("kind", "price"), [("bic", np.log), ("aic", lambda n: 2.0)])
    @pytest.mark.parametrize("share", [1, 0.4])
    def test_information_is_that_of_a_model_with_known_noise_of_its_own(self, kind, price, share, rng):
        """-2 ln L of independent Gaussian residuals plus the price of each parameter, over all voxels.

        From a share of the voxels of the first channel to all of the last are there.
        """
        n_pix, n_channels, counts = 500, 12, np.array([3, 4])
        seen = rng.random((n_channels, n_pix)) < np.linspace(share, 1, n_channels)[:, None]
        lines = 2.0 * rng.standard_normal((2, n_channels, n_pix)) / np.sqrt(counts)[:, None, None]
        left = [[row[there] for row, there in zip(one, seen, strict=True)] for one in lines]
        n_seen = seen.sum(axis=1)
        expected = [
            -2 * sum(stats.norm.logpdf(row, row.mean(), row.std()).sum() for row in one)
            + price(n_seen.mean()) * n * (n_channels + n_pix)
            for n, one in zip(counts, left, strict=True)
        ]
        variances = np.array([[row.var() for row in one] for one in left])
        given = {"n_seen": n_seen} if share < 1 else {}
        found = n_sources.information(variances, counts, n_pix, kind=kind, **given)
        assert found[1] - found[0] == pytest.approx((expected[1] - expected[0]) / n_seen.sum())
        assert found.min() == 0

    def test_eigenvalues_above_a_line(self):
        values = np.exp(-0.1 * np.arange(50))
        assert n_sources.eigenvalue_line(values) == pytest.approx(values)
        assert n_sources.n_significant(values) == 0
        values[:4] *= [1e4, 1e3, 10, 2.9]
        assert n_sources.n_significant(values) == 3

    @pytest.mark.parametrize("n", [3, 4, 5])
    def test_one_bright_eigenvalue_of_few(self, n):
        assert n_sources.n_significant(np.array([1e10, 1, 0.9, 0.8, 0.7])[:n]) == 1

    def test_changes_and_where_they_settle(self):
        values = ((10.0, 1.0), (2.0, 1.0), (2.0, 0.95), (1.0, 0.95))
        spectra = [(np.full(3, p), np.full(2, q)) for p, q in values]
        change = n_sources.changes(spectra)
        assert change == pytest.approx([0.8, 0.05, 0.5])
        assert n_sources.settled(change, np.array([2, 3, 4, 5])) == 3
        assert n_sources.settled(change, np.array([2, 3, 4, 5]), 0.01) is None


class TestOfASky:
    def test_recommended(self):
        values = np.exp(-0.1 * np.arange(50)) * np.r_[1e6, 1e5, np.ones(48)]
        columns = {
            "bic": [3.0, 1, 0, 0.2, 0.4],
            "aic": [4.0, 3, 2, 1, 0],
            "change": [0.9, 0.5, 0.2, 0.15, np.nan],
            "corrected_change": [0.9, 0.5, SETTLED / 2, 0.2, np.nan],
        }
        found = recommended(pd.DataFrame(columns, index=range(1, 6)), values)
        assert found == {"bic": 3, "aic": 5, "eigenvalues": 2, "stability": None, "mocks": 3}

    def test_of_a_small_sky(self):
        (case,), _ = cases_and_methods(**TINY, n_realisations=1)
        removers = tuple(PCA(n_sources=n) for n in (1, 2, 3))
        criteria = source_number_criteria(case, removers, [Mock(seed=1)])
        assert criteria.index.tolist() == [1, 2, 3]
        assert criteria["change"].notna().tolist() == [True, True, False]
        own = own_recovery(case, removers[1])
        inside = slice(10, 20)
        ratio = own.output.angular[inside].mean() / own.input.angular[inside].mean()
        assert criteria.loc[2, "error"] >= abs(ratio - 1)
        values = np.linalg.eigvalsh(np.cov(pipeline.basis(case, True).astype(float), bias=True))[::-1]
        assert eigenvalues(case)[:3] == pytest.approx(values[:3], rel=1e-3)

    def test_eigenvalues_at_one_resolution(self):
        """Through a beam that changes there are as many bright ones as through one that does not."""
        (case,), _ = cases_and_methods(**TINY, n_realisations=1, beam="degraded")
        changing = replace(case, beam=Evolving())
        aware, blind = (eigenvalues(changing, aware) for aware in (True, False))
        same = eigenvalues(case, True)
        assert aware[3] / aware[0] < 3 * same[3] / same[0] and blind[3] / blind[0] > 3 * aware[3] / aware[0]
