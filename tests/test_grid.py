"""Skies and methods of experiments, and what is made for them: on a small sky."""

from dataclasses import replace

import pytest

from himap.core.errors import InputError
from himap.paper import cleaned, mocks, pipeline
from himap.paper.grid import Sky, cases_and_methods, measured_recoveries
from himap.paper.mocks import Mock, own_recovery
from himap.removal import GNILC, PCA, SDecGMCA

TINY = {"preset": "ci", "survey": {"nside": 8, "n_channels": 16, "box_cells": 16}}


@pytest.fixture
def sky(tmp_path, monkeypatch):
    """Of PCA and two mocks; nothing is in the cache."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path))
    (case,), removers = cases_and_methods(**TINY, methods=[["pca", 3]], n_realisations=1)
    return Sky(methods={case: removers}, mocks=(Mock(seed=1), Mock(seed=2)))


class TestCases:
    def test_seeds_and_methods(self):
        cases, removers = cases_and_methods(
            **TINY, methods=[["pca", 3], ["sdecgmca", 4], ["gnilc", None]], reading="letter", n_realisations=2
        )
        assert [case.survey.seed for case in cases] == [2025, 2026]
        pca, sdecgmca, gnilc = removers
        assert (pca, gnilc) == (PCA(n_sources=3), GNILC())
        assert isinstance(sdecgmca, SDecGMCA) and (sdecgmca.n_sources, sdecgmca.thresholds) == (4, "mad")

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"methods": [["pca"]]}, "[name, number of sources]"),
            ({"methods": ["pca"]}, "[name, number of sources]"),
            ({"methods": [["pca", 17]]}, "at most the number of channels"),
            ({"methods": [["kpca", 3]]}, "unknown method"),
            ({"n_realisations": 0}, "between 1 and 1000"),
            ({"n_realisations": "2"}, "n_realisations"),
            ({"beam": "square"}, "square"),
        ],
    )
    def test_refused(self, given, message):
        with pytest.raises(InputError) as caught:
            cases_and_methods(**TINY | given)
        assert message in str(caught.value)

    def test_a_sky_has_methods(self):
        cases, _ = cases_and_methods(**TINY, methods=(), n_realisations=1)
        with pytest.raises(InputError, match="there must be methods"):
            Sky(methods={cases[0]: []})


class TestMaking:
    def test_observations_and_separations_are_deleted(self, sky):
        measured_recoveries(sky)
        ((case, (pca,)),) = sky.methods.items()
        assert own_recovery.is_cached(case, pca)
        assert not cleaned.separation.is_cached(case, pca)
        assert not any(made.is_cached(case) for made in (pipeline.observation, pipeline.peak_masked))

    def test_what_was_there_before_stays(self, sky):
        ((case, (pca,)),) = sky.methods.items()
        cleaned.separation(case, pca)
        measured_recoveries(sky)
        assert cleaned.separation.is_cached(case, pca) and pipeline.observation.is_cached(case)

    @pytest.mark.parametrize("known", [False, True])
    def test_each_method_separates_a_sky_once(self, sky, monkeypatch, known):
        """Also where only the mocks are new."""
        ((case, (pca,)),) = sky.methods.items()
        if known:
            own_recovery(case, pca)
        calls, separate = [], PCA.separate
        monkeypatch.setattr(PCA, "separate", lambda *args, **own: calls.append(1) or separate(*args, **own))
        measured_recoveries(sky)
        assert len(calls) == 3 - known  # the sky, unless it was kept, and the sky with each mock

    def test_what_fails_leaves_no_cubes(self, sky, monkeypatch):
        monkeypatch.setattr(mocks, "mock_power", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            measured_recoveries(sky)
        assert not pipeline.observation.is_cached(next(iter(sky.methods)))

    def test_nothing_is_observed_for_what_is_there(self, sky, monkeypatch):
        before = measured_recoveries(sky)
        monkeypatch.setattr(pipeline.observation, "_function", lambda case: 1 / 0)
        ((*_, own, transfer),) = measured_recoveries(sky)
        assert (own.output.power == before[0][2].output.power).all()
        assert len(transfer.mocks) == 2

    def test_only_some_have_a_transfer_function(self, sky):
        ((_, _, _, transfer),) = measured_recoveries(replace(sky, corrected=("gnilc",)))
        assert transfer is None
