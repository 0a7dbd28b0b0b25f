"""Every claim on spectra made up so that each verdict occurs."""

from dataclasses import replace

import numpy as np
import pytest

from himap.maps import sphere
from himap.measures.results import Comparison
from himap.paper.claims import CLAIMS, DIFFERENT, FAILED, REPRODUCED, UNDECIDED
from himap.paper.claims.base import METHODS, Finding

DEGREES = np.arange(2.0, 257)
K = 2 * np.pi * np.arange(1, 126) / 500  # 1/MHz
LOW = K < 0.1
BUMP = (K > 0.25) & (K < 0.38)
NSIDE = 16
IN_PLANE = np.abs(sphere.pixel_latitude(NSIDE)) < 5
BSS = ("pca", "fastica", "gmca", "sdecgmca")
FITS = ("polynomial", "parametric")


def comparison(angular, frequency):
    """Spectra with these ratios to the truth."""
    return Comparison(
        degrees=DEGREES,
        angular=angular * DEGREES**-1.5,
        true_angular=DEGREES**-1.5,
        k=K,
        frequency=frequency / K,
        true_frequency=1 / K,
    )


def ones():
    return {method: {"angular": np.ones(len(DEGREES)), "frequency": np.ones(len(K))} for method in METHODS}


class World:
    """A made-up `Realisation`: ratios of all methods on all cases such that all claims hold; then changed."""

    def __init__(self):
        self.degraded, self.evolving, self.oscillating = ones(), ones(), ones()
        for method in METHODS:
            self.degraded[method]["frequency"][K < 0.03] = 0.9
            self.evolving[method]["frequency"][LOW] = 1.2
        self.evolving["parametric"]["angular"][:] = 1000
        self.evolving["gmca"]["angular"][DEGREES < 60] = 1.5
        self.evolving["gmca"]["frequency"][LOW] = 2
        self.evolving["polynomial"] = {kind: row.copy() for kind, row in self.degraded["polynomial"].items()}
        for method in METHODS:
            one = self.oscillating[method]
            one["angular"][:] = 1.02 if method == "sdecgmca" else 1.3
            one["angular"][DEGREES < 10] = 3
            one["frequency"][BUMP] = 1.5 if method == "sdecgmca" else 3
            one["frequency"][LOW] = 1.6 if method == "sdecgmca" else 1.5
        for method in FITS:
            self.oscillating[method] = {
                "angular": 50 * np.ones(len(DEGREES)),
                "frequency": 50 * np.ones(len(K)),
            }
        for beam in (self.degraded, self.evolving, self.oscillating):
            beam["sdecgmca"]["angular"][DEGREES > 200] = 2
        self.peaks_left_in = self._nearer(dict.fromkeys(METHODS, 1.5))
        self.dimmed = self._nearer(
            dict.fromkeys(METHODS, 0.9) | dict.fromkeys(("pca", "fastica", "sdecgmca"), 0.02)
        )
        for method in ("pca", "fastica"):
            self.dimmed[method]["frequency"][BUMP] = 1.5
        self.without = self._nearer(dict.fromkeys(METHODS, 0.8) | {"sdecgmca": 0.1})
        for method in ("pca", "fastica", "gmca"):
            self.without[method]["frequency"] = self.oscillating[method]["frequency"].copy()
        self.scanned = {n: ones()["pca"] for n in range(2, 21)}
        for n, one in self.scanned.items():
            one["angular"][(DEGREES > 10) & (DEGREES < 100)] += 0.001 * abs(n - 7)
            one["frequency"][LOW] += 0.3 * abs(n - 5)
            one["frequency"][BUMP] += 0.01 * abs(n - 6)
        self.correlations = dict.fromkeys(METHODS, np.full(5, 0.9)) | {"sdecgmca": np.full(5, 0.99)}
        self.variances = {method: np.full(len(DEGREES), 0.01) for method in METHODS}
        self.variances["sdecgmca"] = np.full(len(DEGREES), 0.001)
        self.lines = IN_PLANE

    def _nearer(self, factors):
        """The oscillating case with the distance to 1 multiplied."""
        return {
            method: {kind: 1 + factors[method] * (row - 1) for kind, row in one.items()}
            for method, one in self.oscillating.items()
        }

    def of(self, case):
        return {method: comparison(**ratios) for method, ratios in self._cases[case].items()}

    @property
    def _cases(self):
        return {
            "degraded": self.degraded,
            "evolving": self.evolving,
            "oscillating": self.oscillating,
            "peaks left in": self.peaks_left_in,
            "dimmed": self.dimmed,
        }

    @property
    def scan(self):
        return {n: comparison(**one) for n, one in self.scanned.items()}

    def masked(self, method):
        return comparison(**self.without[method])

    def correlation(self, method):
        return self.correlations[method]

    def variance(self, method):
        return self.variances[method]

    def flagged(self, method):
        return self.lines


def set_to(case, methods, kind, value, where=slice(None)):
    """A change of the world: ratios of some methods on one case."""

    def change(world):
        for method in methods:
            getattr(world, case)[method][kind][where] = value

    return change


def equal_cases(one, other, methods, kind="angular"):
    """A change of the world: some methods do on one case as on the other."""

    def change(world):
        for method in methods:
            getattr(world, one)[method][kind] = getattr(world, other)[method][kind].copy()

    return change


def both(*changes):
    return lambda world: [change(world) for change in changes]


def scan_best(low=5, bump=6, middle=7):
    """A change of the world: where the scan is best, at low k, in the bump and at middle l."""

    def change(world):
        for n, one in world.scanned.items():
            one["angular"][:], one["frequency"][:] = 1, 1
            one["angular"][(DEGREES > 10) & (DEGREES < 100)] += 0.001 * abs(n - middle)
            one["frequency"][LOW] += 0.3 * abs(n - low)
            one["frequency"][BUMP] += 0.01 * abs(n - bump)

    return change


def attribute(name, value):
    return lambda world: setattr(world, name, value)


def highest(name, method, value):
    """A change of the world: a diagnostic of one method, or of one and SDecGMCA in one place."""

    def change(world):
        rows = getattr(world, name)
        rows[method] = np.where(
            np.arange(len(rows[method])) < len(rows[method]) * value[1], value[0], rows[method]
        )

    return change


MID = (DEGREES > 10) & (DEGREES < 200)
ANY = (DEGREES > 50) & (DEGREES < 55)
ABOVE = (K > 0.5) & (K < 0.6)
PCA_ICA_SD = ("pca", "fastica", "sdecgmca")

# {claim: (a change that makes a difference, one that makes it fail)}; None where there is none, because a
# claim of one part holds or fails.
BREAKS = {
    "D1": (
        set_to("degraded", ["gmca"], "angular", 1.2, ANY),
        set_to("degraded", METHODS, "angular", 0.8, ANY),
    ),
    "D2": (
        set_to("degraded", ["gmca"], "frequency", 0.8, ABOVE),
        set_to("degraded", METHODS, "frequency", 2, ABOVE),
    ),
    "D3": (
        set_to("degraded", FITS, "frequency", 1.1, K < 0.02),
        set_to("degraded", METHODS, "frequency", 1.1, LOW),
    ),
    "E1": (
        set_to("evolving", ["parametric"], "angular", 50, ANY),
        set_to("evolving", ["parametric"], "angular", 5, ANY),
    ),
    "E2": (
        set_to("evolving", ["pca"], "angular", 1.2, ANY),
        set_to("evolving", METHODS, "angular", 1.2, ANY),
    ),
    "E3": (set_to("evolving", ["gmca"], "frequency", 1), set_to("evolving", ["gmca"], "angular", 1)),
    "E4": (
        set_to("evolving", ["pca"], "frequency", 1.2, ABOVE),
        set_to("evolving", METHODS, "frequency", 3, K > 0.1),
    ),
    "E5": (
        set_to("evolving", ["polynomial"], "angular", 1.2, ANY),
        both(
            set_to("evolving", ["polynomial"], "angular", 1.2, ANY),
            set_to("evolving", ["polynomial"], "frequency", 1.2, ABOVE),
        ),
    ),
    "O1": (
        set_to("oscillating", ["polynomial"], "angular", 1.5),
        both(*(set_to("oscillating", FITS, kind, 0.8) for kind in ("angular", "frequency"))),
    ),
    "O2": (
        set_to("oscillating", ["pca"], "angular", 1, DEGREES < 10),
        set_to("oscillating", BSS, "angular", 0.9),
    ),
    "O3": (
        set_to("oscillating", ["sdecgmca"], "angular", 0.9, ANY),
        both(
            set_to("oscillating", ["sdecgmca"], "angular", 1.2, MID),
            set_to("oscillating", ["pca", "gmca"], "angular", 1.1, MID),
        ),
    ),
    "O4": (
        set_to("oscillating", ["sdecgmca"], "frequency", 1),
        set_to("oscillating", METHODS, "frequency", 1, BUMP),
    ),
    "O5": (
        set_to("oscillating", ["sdecgmca"], "frequency", 1, LOW),
        set_to("oscillating", BSS, "frequency", 0.9, LOW),
    ),
    "O6": (
        set_to("degraded", ["sdecgmca"], "angular", 1),
        both(*(set_to(beam, ["sdecgmca"], "angular", 1) for beam in ("degraded", "evolving"))),
    ),
    "N1": (None, scan_best(low=8)),
    "N2": (scan_best(low=4, bump=3, middle=4), scan_best(low=2, bump=2)),
    "N3": (scan_best(bump=7), scan_best(low=4, bump=5)),
    "B1": (
        both(
            *(equal_cases("peaks_left_in", "oscillating", ["pca"], kind) for kind in ("angular", "frequency"))
        ),
        both(
            *(equal_cases("peaks_left_in", "oscillating", METHODS, kind) for kind in ("angular", "frequency"))
        ),
    ),
    "M1": (None, attribute("lines", ~IN_PLANE)),
    "M2": (
        set_to("without", ["sdecgmca"], "frequency", 1.7, BUMP),
        set_to("without", ["sdecgmca"], "frequency", 3),
    ),
    "M3": (
        set_to("without", ["pca"], "frequency", 1),
        set_to("without", ["pca", "fastica"], "frequency", 1),
    ),
    "M4": (
        set_to("without", ["pca"], "angular", 1),
        set_to("without", ["pca", "fastica", "sdecgmca"], "angular", 4),
    ),
    "G1": (
        set_to("dimmed", ["pca"], "angular", 9),
        set_to("dimmed", ["pca", "gmca", "polynomial", "parametric"], "angular", 900),
    ),
    "G2": (
        set_to("dimmed", ["sdecgmca"], "frequency", 1.05, BUMP),
        set_to("dimmed", ["pca", "fastica"], "frequency", 1),
    ),
    "G3": (
        equal_cases("dimmed", "oscillating", ["pca"]),
        equal_cases("dimmed", "oscillating", PCA_ICA_SD),
    ),
    "A1": (highest("correlations", "pca", (0.995, 0.2)), highest("correlations", "pca", (0.999, 1.0))),
    "A2": (highest("variances", "gmca", (1e-4, 0.2)), highest("variances", "gmca", (1e-5, 1.0))),
}


def verdict(id, change=None):
    world = World()
    if change:
        change(world)
    return CLAIMS[id].check(world)


def test_every_claim_is_there():
    assert list(CLAIMS) == [
        "D1", "D2", "D3", "E1", "E2", "E3", "E4", "E5", "O1", "O2", "O3", "O4", "O5", "O6", "N1", "N2", "N3",
        "B1", "M1", "M2", "M3", "M4", "G1", "G2", "G3", "A1", "A2",
    ]  # fmt: skip
    assert set(BREAKS) == set(CLAIMS)


@pytest.mark.parametrize("id", CLAIMS)
def test_the_world_of_the_paper_is_reproduced(id):
    found = verdict(id)
    assert found.verdict == REPRODUCED, found
    assert np.isfinite(found.value)
    assert CLAIMS[id].reading
    assert found.sentence.endswith(".")


@pytest.mark.parametrize("id", [id for id, (difference, _) in BREAKS.items() if difference])
def test_one_part_broken_is_a_difference(id):
    found = verdict(id, BREAKS[id][0])
    assert found.verdict == DIFFERENT, found


@pytest.mark.parametrize("id", CLAIMS)
def test_most_parts_broken_is_a_failure(id):
    found = verdict(id, BREAKS[id][1])
    assert found.verdict == FAILED, found


def test_maps_that_end_below_200_leave_the_peak_beyond_undecided():
    world = World()
    whole = world.of
    world.of = lambda case: {
        method: replace(one, degrees=one.degrees * 128 / 256) for method, one in whole(case).items()
    }
    found = CLAIMS["O6"].check(world)
    assert found.verdict == UNDECIDED
    assert found.sentence == "These maps end at l = 128."


@pytest.mark.parametrize(("id", "lacking"), [("N1", "5"), ("N2", "2, 3, 10"), ("N3", "5, 7")])
def test_a_scan_that_is_too_short_leaves_it_undecided(id, lacking):
    world = World()
    world.scanned = {n: one for n, one in world.scanned.items() if str(n) not in lacking.split(", ")}
    found = CLAIMS[id].check(world)
    assert found.verdict == UNDECIDED
    assert found.sentence == f"The scan does not hold n_s = {lacking}."


def test_no_flagged_line_of_sight_is_undecided():
    assert verdict("M1", attribute("lines", np.zeros_like(IN_PLANE))).verdict == UNDECIDED


@pytest.mark.parametrize(
    ("held", "expected"),
    [((1, 1), REPRODUCED), ((1, 0), DIFFERENT), ((1, 0, 0), FAILED), ((0,), FAILED), ((), UNDECIDED)],
)
def test_verdicts(held, expected):
    parts = {f"part {n}": bool(value) for n, value in enumerate(held)}
    assert Finding(value=1.0, parts=parts, sentence="").verdict == expected
