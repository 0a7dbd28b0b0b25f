"""SDecGMCA against what its authors' public code gives, step by step (tests/data/sdecgmca_small.npz).

16 channels, l <= 64, nside 32, 4 sources, beams three times MeerKAT's width; four variants. The numbers come
from the code of Carloni Gertosio & Bobin (2021) with these inputs; see the chapter on readings.
"""

import itertools
from pathlib import Path

import numpy as np
import pytest
import sdecgmca_twin as twin
from scipy.linalg import subspace_angles

from himap.core.errors import InputError
from himap.paper.authors_code import CHANGE, ITERATIONS, VARIANTS, AuthorsCode, difference
from himap.removal import harmonic

NSIDE = 32
CODE = AuthorsCode.read(Path(__file__).parent / "data" / "sdecgmca_small.npz")
REFERENCE = CODE.arrays
problem, reference, scales_of, method_of = CODE.problem, CODE.mixing, CODE.scales, CODE.method


def mixing_after(method, start, n_iterations):
    return CODE.mixings(method, start, n_iterations)[-1]


class TestFile:
    def test_another_file(self, tmp_path):
        with pytest.raises(InputError, match="does not hold the numbers of the authors' code"):
            AuthorsCode.read(tmp_path / "none.npz")
        np.savez(tmp_path / "other.npz", alms=0)
        with pytest.raises(InputError, match="it lacks beams, noise"):
            AuthorsCode.read(tmp_path / "other.npz")

    def test_what_the_chapter_shows(self):
        """Far below what a change of the start by 1e-12 makes, and both grow."""
        found, moved = CODE.compared("mad")
        assert len(found) == len(moved) == len(ITERATIONS)
        assert found[:4] < moved[:4] and max(found[:4]) < 1e-6
        assert CHANGE < moved[0] < moved[-1] and found[0] < found[-1]
        start = reference("mad", 0)
        assert found[1] == difference(mixing_after(method_of("mad"), start, 2), reference("mad", 2))


@pytest.mark.parametrize("variant", VARIANTS)
class TestAuthorsCode:
    def test_start(self, variant):
        """Their start adds 1e-10 to H and takes eigenvalues of sums that span ten digits: five agree."""
        found = problem().start(4, "first")
        assert subspace_angles(found, reference(variant, 0)).max() < 1e-4

    @pytest.mark.parametrize(("done", "ends"), [(0, (1, 2, 3, 5)), (5, (10,))])
    def test_mixing_after_some_iterations(self, variant, done, ends):
        """A to 1e-6, or to what a change of the 12th digit of the start does, where that is more."""
        method, start = method_of(variant), reference(variant, done)
        changes = 1 + 1e-12 * np.random.default_rng(0).standard_normal((5, *start.shape))
        starts = start, *(start * change for change in changes)
        runs = [CODE.mixings(method, one, ends[-1], done=done) for one in starts]
        for n in ends:
            found, *others = (run[n - done - 1] for run in runs)
            moved = max(difference(other, found) for other in others)
            apart = difference(found, reference(variant, n))
            assert apart < max(1e-6, 3 * moved)
            if n <= 5 or variant in ("mad", "matrix"):
                assert apart < 1e-6

    def test_mixing_after_the_last(self, variant):
        """200 iterations on, the three brighter sources are the same; the faintest is HI and noise as it is.

        From starts that differ in the tenth digit the two largest angles come out between 0.07 and 0.8, and
        between 0.001 and 0.1: no two computers can agree better.
        """
        assert list(REFERENCE[f"{variant}_lengths"]) == [150, 200]
        found = mixing_after(method_of(variant), reference(variant, 0), 200)
        angles = np.sin(subspace_angles(found, REFERENCE[f"{variant}_mixing"][-1]))
        assert angles[1] < 0.2
        assert angles[2] < 0.01

    def test_last_sources(self, variant):
        method = method_of(variant)
        mixing = REFERENCE[f"{variant}_mixing"][-1]
        found, _ = method.last_sources(problem(), None, mixing, None)
        expected = harmonic.to_modes(REFERENCE[f"{variant}_sources_alm"])
        assert np.abs(found - expected).max(axis=1) == pytest.approx(0, abs=1e-5 * expected.std())
        assert np.all(np.abs(found - expected).max(axis=1) < 1e-5 * expected.std(axis=1))


OPTIONS = {
    "as the code": {},
    "all scales": {"mixing_scales": "all"},
    "nonnegative": {"sign": "nonnegative"},
    "analytic": {"thresholds": "analytic"},
    "starlets": {"wavelets": "cascade"},
    "none kept": {"least_kept": 0},
    "no reweighting": {"reweighted": False},
    "matrices": {"coefficients": "matrix"},
}


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_a_warm_up_and_two_refinements_by_a_slow_twin(options):
    method = method_of("mad", **options, n_warmup=1, warmup_tolerance=1e300)
    mixing, sources, memory, apart = reference("mad", 5), None, None, []
    steps = method.iterate(problem(), scales_of(method), mixing)
    for step in itertools.islice(steps, 4):
        mixing, sources, memory = twin.iteration(
            REFERENCE["alms"], problem(), method, NSIDE, mixing, sources, memory, refining=step.refining
        )
        apart.append(difference(step.mixing, mixing))
    assert [step.refining, len(apart)] == [True, 4]
    assert apart[0] < 1e-7
    assert max(apart) < 1e-4
