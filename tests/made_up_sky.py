"""A made-up realisation on which all claims hold, and changes of it that break some."""

from types import SimpleNamespace

import numpy as np

from himap.maps import sphere
from himap.measures.diagnostics import Comparison
from himap.paper.claims.base import BEAMS, CLIPPED, LEFT_IN, METHODS

DEGREES = np.arange(2.0, 257)
K = 2 * np.pi * np.arange(1, 126) / 500  # 1/MHz
LOW = K < 0.1
BUMP = (K > 0.25) & (K < 0.38)
LARGE = DEGREES < 10
NSIDE = 16
IN_PLANE = np.abs(sphere.pixel_latitude(NSIDE)) < 5
BSS = ("pca", "fastica", "gmca", "sdecgmca")
FITS = ("polynomial", "parametric")


def comparison(angular, frequency, shrink=1):
    """Spectra with these ratios to the truth, on maps whose multipoles are `shrink` times smaller."""
    return Comparison(
        degrees=DEGREES / shrink,
        angular=angular * DEGREES**-1.5,
        true_angular=DEGREES**-1.5,
        k=K,
        frequency=frequency / K,
        true_frequency=1 / K,
    )


def ones():
    return {method: {"angular": np.ones(len(DEGREES)), "frequency": np.ones(len(K))} for method in METHODS}


def both_kinds(value):
    return {"angular": value, "frequency": value}


def nearer(case, factors):
    """A case with the distance to 1 multiplied, {method: factor}."""
    return {
        method: {kind: 1 + factors[method] * (row - 1) for kind, row in one.items()}
        for method, one in case.items()
    }


class World:
    """Ratios of all methods on all cases such that all claims hold, but for E4; then changed."""

    def __init__(self):
        self.degraded, self.evolving, self.oscillating = ones(), ones(), ones()
        for method in METHODS:
            self.degraded[method]["frequency"][K < 0.03] = 0.9
            self.evolving[method]["frequency"][LOW] = 1.2
            for beam in (self.degraded, self.evolving):
                beam[method]["angular"][DEGREES < 4] = 1.12
        self.evolving["parametric"]["angular"][:] = 1000
        self.evolving["gmca"]["angular"][DEGREES < 60] = 1.5
        self.evolving["gmca"]["frequency"][LOW] = 2
        self.evolving["gmca"]["frequency"][(K > 0.1) & (K < 0.2)] = 1.15
        self.evolving["polynomial"] = {kind: row.copy() for kind, row in self.degraded["polynomial"].items()}
        for method in METHODS:
            one = self.oscillating[method]
            one["angular"][:] = 1.02 if method == "sdecgmca" else 1.3
            one["angular"][LARGE] = 3
            one["frequency"][BUMP] = 1.5 if method == "sdecgmca" else 3
            one["frequency"][LOW] = 1.6 if method == "sdecgmca" else 1.5
        for method in FITS:
            for row in self.oscillating[method].values():
                row[:] = 50
        self._masks()
        self.going_on = {beam: np.where(DEGREES > 245, 2.0, 1.5) for beam in BEAMS}
        self.scanned = {n: ones()["pca"] for n in range(2, 21)}
        scan_best()(self)
        self.correlations = dict.fromkeys(METHODS, np.full(100, 0.9)) | {"sdecgmca": np.full(100, 0.99)}
        self.variances = {method: np.full(len(DEGREES), 0.01) for method in METHODS}
        self.variances["sdecgmca"] = np.full(len(DEGREES), 0.001)
        self.lines = IN_PLANE
        self.bright = {"all sky": (5000.0, 0.1), "|b| > 30": (2000.0, 0.1)}
        self.voxels = {beam: {"HI": 60, "noise": 5, "foreground": 35} for beam in BEAMS}
        self.clipped = {}
        self.n_degrees, self.shrink = 321, 1
        self.limits = dict.fromkeys(BEAMS, 240)
        self.difference = 1e-3
        self._further()

    def _masks(self):
        """Peaks left in, lines of sight left out, and the Galaxy dimmed."""
        worse = dict.fromkeys(METHODS, 1.5)
        self.left_in = {beam: nearer(getattr(self, beam), worse) for beam in BEAMS}
        for one in self.left_in.values():
            for method in METHODS:
                one[method]["frequency"] += 0.5
        for method in BSS:
            self.left_in["oscillating"][method]["angular"][LARGE] = 1.2
        better = dict.fromkeys(METHODS, 0.9) | {"pca": 0.4, "fastica": 0.4, "sdecgmca": 0.02}
        self.dimmed = nearer(self.oscillating, better)
        for method in ("pca", "fastica"):
            self.dimmed[method]["angular"][DEGREES == 100] = 1
        self.without = nearer(self.oscillating, dict.fromkeys(METHODS, 0.8) | {"sdecgmca": 0.1})
        for method in ("pca", "fastica", "gmca"):
            self.without[method]["frequency"] = self.oscillating[method]["frequency"].copy()
        self.without["sdecgmca"]["angular"][(DEGREES > 3) & LARGE] = 1.05

    def _further(self):
        """The iteration, the error of flagged lines, noise, point sources, bright lines, and settings."""
        stages = {"n_warmup": 101, "warmup_change": 5e-3, "n_refinement": 30, "refinement_change": 5e-5}
        self.stages = {beam: dict(stages) for beam in BEAMS}
        self.error = {"n_spectra": 5, "error": 4.0, "in spectra": 3.0, "foreground residual": 3.5}
        self.error |= {"signal loss": 0.5, "truth": 1.0, "truth in spectra": 0.1}
        self.sourceless = {kind: row + 0.05 for kind, row in self.degraded["parametric"].items()}
        self.noise = {beam: {kind: 0.5 * row for kind, row in ones()["pca"].items()} for beam in BEAMS}
        self.tops = {method: [3.0, 2.8, 2.5, 1.5, 1.2, 3.0] for method in BSS}
        self.settings = {
            "as it is": both_kinds(0),
            "c = 0.1": both_kinds(0.05),
            "strategy 3": both_kinds(0.2),
        }
        self.starts = [both_kinds(shift) for shift in (0, 0.04, 0.02)]

    def of(self, case):
        cases = {beam: getattr(self, beam) for beam in (*BEAMS, "dimmed")}
        cases |= {LEFT_IN.format(beam): one for beam, one in self.left_in.items()}
        cases |= dict.fromkeys(CLIPPED.values(), self.oscillating) | self.clipped
        return {method: comparison(**ratios) for method, ratios in cases[case].items()}

    @property
    def scan(self):
        return {n: comparison(**one, shrink=self.shrink) for n, one in self.scanned.items()}

    def beyond(self, beam):
        return comparison(self.going_on[beam], np.ones(len(K)), self.shrink)

    def masked(self, method):
        return comparison(**self.without[method])

    def unmasked(self, method):
        return self.of("oscillating")[method]

    def assessed(self, method, case="oscillating"):
        """Of two sources that only the second channel tells apart."""
        mixing = np.array([[1.0, 1.0], [0.0, self.difference]])
        found = {"correlation": self.correlations[method], "diagnostics": self.stages.get(case)}
        return SimpleNamespace(mixing=mixing, **found)

    def variance(self, method):
        return self.variances[method]

    def flagged(self, method):
        return self.lines

    def brightness(self):
        return self.bright

    def masked_voxels(self, case):
        return self.voxels[case if case in self.voxels else "oscillating"]

    def flagged_error(self):
        return self.error

    def without_sources(self):
        return comparison(**self.sourceless)

    def noise_over_hi(self, beam):
        return comparison(**self.noise[beam])

    def without_brightest(self, method):
        return (0.0, 0.01, 0.05, 0.1, 0.25), self.tops[method]

    def by_regularisation(self):
        return {name: self._shifted(shift) for name, shift in self.settings.items()}

    def by_restart(self, n):
        return [self._shifted(shift) for shift in self.starts[:n]]

    def _shifted(self, shift):
        """SD on the oscillating case with its ratios shifted."""
        return comparison(**{kind: row + shift[kind] for kind, row in self.oscillating["sdecgmca"].items()})

    def windows(self, beam):
        """The second channel falls to a twentieth at the limit of the beam, and stays."""
        windows = np.ones((2, self.n_degrees))
        windows[1, self.limits[beam] :] = 0.05
        return windows

    def regularisation(self, beam):
        return 1e-2


def set_to(case, methods, kind, value, where=slice(None)):
    """A change of the world: ratios of some methods on one case."""

    def change(world):
        for method in methods:
            getattr(world, case)[method][kind][where] = value

    return change


def as_with_masking(methods, kinds=("angular", "frequency"), beams=BEAMS):
    """A change of the world: some methods do without peak masking as with it."""

    def change(world):
        for beam in beams:
            for method in methods:
                for kind in kinds:
                    world.left_in[beam][method][kind] = getattr(world, beam)[method][kind].copy()

    return change


def as_full_galaxy(*methods):
    """A change of the world: C/C0 of some methods is that of the full Galaxy."""

    def change(world):
        for method in methods:
            world.dimmed[method]["angular"] = world.oscillating[method]["angular"].copy()

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


def put(*path):
    """A change of the world: the last of `path` is the new value of what the others lead to."""
    *way, last, value = path

    def change(world):
        place = vars(world)
        for name in way:
            place = place[name]
        place[last] = value

    return change


def first_share(name, method, value, share):
    """A change of the world: the first share of the rows of a diagnostic of one method."""

    def change(world):
        rows = getattr(world, name)
        rows[method] = np.where(np.arange(len(rows[method])) < share * len(rows[method]), value, rows[method])

    return change
