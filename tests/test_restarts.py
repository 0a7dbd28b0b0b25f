"""Ensembles of restarts: distances, the medoid, and flags that need no truth."""

from types import SimpleNamespace

import numpy as np
import pytest
from sparse_problem import BEAMS, make_problem, noisy

from himap.removal.base import SeparationWarning
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data
from himap.removal.pca import PCA
from himap.removal.restarts import Ensemble, contrast, line_powers, remarks_on_one
from himap.removal.sdecgmca.method import SDecGMCA
from himap.removal.separation import Separation

N_CHANNELS, N_PIX = 12, 3072
FREQS = np.linspace(900, 1400, N_CHANNELS)
QUICK = {"n_sources": 4, "n_warmup": 3, "n_refinement": 1, "noise": 0.5, "n_scales": 3}


@pytest.fixture
def planted(rng):
    """A function that makes a `Cleaning` of one sky that subtracts its foreground less some error maps."""
    signal = rng.standard_normal((N_CHANNELS, N_PIX))
    sources = 1e5 * np.exp(rng.standard_normal((1, N_PIX)))
    mixing = (FREQS[:, None] / 1000) ** -2.7
    data = Data.of(signal + mixing @ sources, freqs=FREQS)

    def plant(restart=0, error=0.0):
        method = SimpleNamespace(name="chaotic", restart=restart)
        one, means = Cleaning(data=data, method=method), np.zeros(N_CHANNELS)
        vars(one)["separation"] = Separation(mixing=mixing, sources=sources - error, means=means)
        return one

    plant.follows = 3 * sources / sources.std()
    plant.anywhere = rng.standard_normal((1, N_PIX))
    return plant


@pytest.fixture
def ensemble(planted):
    """Restart 2 is between the others; 4 has foreground in it, 5 an error that is the same everywhere."""
    errors = [0.1 * k * planted.anywhere for k in (0, 2, 1, 1)]
    errors += [planted.follows, 2 * planted.anywhere]
    return Ensemble(members=tuple(planted(restart, error) for restart, error in enumerate(errors)))


class TestEnsemble:
    def test_distances_are_those_of_the_residuals(self, ensemble):
        residuals = [member.residual.astype(float) for member in ensemble.members]
        for i, j in ((0, 1), (2, 3), (0, 4), (5, 1)):
            rms = np.sqrt(np.mean((residuals[i] - residuals[j]) ** 2))
            assert ensemble.distances[i, j] == ensemble.distances[j, i] == pytest.approx(rms, abs=1e-4)

    def test_medoid_and_flags(self, ensemble):
        """Restarts 2 and 3 are the same, and the first of the two is the medoid."""
        assert ensemble.medoid_index == 2
        assert ensemble.flags == [[], [], [], [], ["contrast", "distance"], ["distance"]]
        assert [one["distance"] for one in ensemble.values[2:4]] == pytest.approx([0, 0], abs=1e-9)
        rms = np.sqrt(np.mean((FREQS / 1000) ** -5.4))  # of the error that is the same everywhere
        assert ensemble.values[5]["distance"] == pytest.approx(1.9 * rms, rel=0.1)

    def test_what_is_said(self, ensemble):
        """The way out comes where half look failed, or the medoid does."""
        (said,) = ensemble.remarks
        assert "restart 2, the medoid of 6, of which 2 look failed: the residual is strong where" in said
        assert "brightest (restart 4), the residual is far from that of the medoid (restart 4, 5)." in said
        assert "beam_subspace" in Ensemble(members=ensemble.members[2:]).remarks[1]
        most = Ensemble(members=ensemble.members[3:]).remarks
        assert "do not use it" in most[1] and "beam_subspace" in most[2]

    def test_no_cube_of_a_member_is_kept(self, ensemble):
        _ = ensemble.flags
        kept = ["residual" in vars(member) for member in ensemble.members]
        assert kept == [k == ensemble.medoid_index for k in range(6)]


def test_contrast(planted):
    """1 of noise, whatever the foreground, and of nothing; of a change the residual with it counts."""
    one = planted(error=planted.follows)
    foreground = one.separation.foreground
    assert contrast(*line_powers(planted().residual, foreground)) == pytest.approx(1, abs=0.1)
    assert contrast(*line_powers(0 * one.residual, foreground)) == 1
    found = contrast(*line_powers(one.residual, foreground))
    assert found > 2
    change = planted().separation.foreground + -foreground
    assert contrast(*line_powers(planted().residual, foreground, change)) == pytest.approx(found, rel=1e-3)


def test_a_run_whose_sources_vanished_looks_failed(planted):
    """The residual is then all of the data, and not strong where the estimated foreground is brightest."""
    collapsed = planted(error=planted().separation.sources)
    flags = [[*one] for one in Ensemble(members=(collapsed, collapsed)).flags]
    assert flags == [["remaining"]] * 2
    assert "hardly any foreground was subtracted" in remarks_on_one(collapsed)[1]


def test_one_run_says_that_it_is_one(planted):
    assert "--restarts" in remarks_on_one(planted())[0] and len(remarks_on_one(planted())) == 1
    assert "is brightest. Take beam_subspace" in remarks_on_one(planted(error=planted.follows))[1]
    assert remarks_on_one(Cleaning(data=planted().data, method=PCA(n_sources=1))) == []


@pytest.fixture
def sparse(rng):
    seen = noisy(make_problem(rng)[0], 10, rng)
    return Data.of(seen, freqs=np.linspace(900, 1400, 8), beams=BEAMS)


def test_ensemble_of_sdecgmca(sparse):
    """Its starts follow that of the method, members are what they are by themselves, and all differ."""
    cleaning = Cleaning(data=sparse, method=SDecGMCA(**QUICK, restart=2))
    ensemble = Ensemble.of(cleaning, 3)
    assert ensemble.members[0] is cleaning
    assert [member.method.restart for member in ensemble.members] == [2, 3, 4]
    alone = cleaning.with_restart(4).separation
    assert np.array_equal(ensemble.members[2].separation.mixing, alone.mixing)
    assert (ensemble.distances[np.triu_indices(3, 1)] > 0).all()


def test_cleaning_once_warns(sparse):
    method, given = SDecGMCA(**QUICK), {"freqs": sparse.freqs, "beams": BEAMS}
    with pytest.warns(SeparationWarning, match="one run is one draw") as caught:
        method.clean(sparse.maps, **given)
    assert all(one.filename == __file__ for one in caught)
    method.separate(sparse)  # which products call: no warning
