"""What the claims are judged on: every method on every case of one realisation, against the truth."""

from dataclasses import dataclass, field

import numpy as np

from himap.errors import InputError
from himap.measures import diagnostics
from himap.measures.results import Comparison
from himap.paper import pipeline
from himap.products.memory import check_memory
from himap.products.parallel import make_all, n_jobs
from himap.removal.fastica import FastICA
from himap.removal.gmca import GMCA
from himap.removal.parametric import Parametric
from himap.removal.pca import PCA
from himap.removal.polynomial import Polynomial
from himap.removal.sdecgmca.method import TABLE_1, SDecGMCA
from himap.sky.dimming import Dimming
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = ["Evidence", "Realisation", "Recovery", "make_realisations", "methods_for"]


_POST_MASKED = ("pca", "fastica", "gmca", "sdecgmca")  # what the paper says of its Fig. 6 is about these


def methods_for(beam, n_sources=None, **sdecgmca):
    """The six methods as the paper uses them for one beam; `sdecgmca` are parameters of SDecGMCA to change.

    The number of sources is that of Table 1 unless given.
    """
    n = TABLE_1[beam]["n_sources"] if n_sources is None else n_sources
    return [
        PCA(n_sources=n),
        FastICA(n_sources=n),
        GMCA(n_sources=n),
        SDecGMCA.for_beam(beam, n_sources=n, **sdecgmca),
        Polynomial(),
        Parametric(),
    ]


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """How well one method did on one case.

    Attributes
    ----------
    spectra
        A `Comparison`.
    masked
        The same without the lines of sight whose error stands out, or None.
    correlation
        Pearson r in every channel, (n_channels,).
    variance
        Variance over channels of the fractional error of C_l, at the l of `spectra`.
    flagged
        Those lines of sight, (n_pix,) bool.
    """

    spectra: Comparison
    masked: Comparison | None
    correlation: np.ndarray
    variance: np.ndarray
    flagged: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Everything that the claims ask of one realisation.

    Attributes
    ----------
    recoveries
        {case: {method: `Recovery`}}; cases as in `Realisation.cases`, methods by their registered name.
    scan
        {n_sources: `Comparison`} of SDecGMCA through the oscillating beam.
    """

    recoveries: dict
    scan: dict

    def of(self, case):
        """{method: `Comparison`} of one case."""
        return {method: found.spectra for method, found in self.recoveries[case].items()}


@dataclass(frozen=True, kw_only=True)
class Realisation:
    """One sky, observed through the three beams and with the Galactic plane dimmed, and cleaned by all.

    Attributes
    ----------
    survey, galaxy, ripple
        As in `pipeline.Case`.
    dimming
        Of the dimmed case.
    n_sources
        Numbers of sources of the scan.
    """

    survey: Survey = field(default_factory=Survey)
    galaxy: Galaxy = field(default_factory=Galaxy)
    ripple: str = "bracket"
    dimming: Dimming = field(default_factory=Dimming)
    n_sources: tuple = tuple(range(2, 21))

    def __post_init__(self):
        pipeline.Case(survey=self.survey, galaxy=self.galaxy, ripple=self.ripple)  # refuses bad values
        counts = self.n_sources
        if not counts or min(counts) < 1 or max(counts) > self.survey.n_channels:
            raise InputError(
                f"the scan needs numbers of sources from 1 up to the {self.survey.n_channels} channels, "
                f"got {', '.join(map(str, counts)) or 'none; is the least above the most?'}."
            )

    @property
    def cases(self):
        """{case: (`pipeline.Case`, whether peaks are masked, whether spectra are post-masked too)}."""
        common = {"survey": self.survey, "galaxy": self.galaxy, "ripple": self.ripple}
        beams = {beam: pipeline.Case(beam=beam, **common) for beam in TABLE_1}
        dimmed = pipeline.Case(beam="oscillating", dimming=self.dimming, **common)
        return {
            "degraded": (beams["degraded"], True, False),
            "evolving": (beams["evolving"], True, False),
            "oscillating": (beams["oscillating"], True, True),
            "peaks left in": (beams["oscillating"], False, False),
            "dimmed": (dimmed, True, False),
        }

    def make(self):
        """Compute what is not in the cache yet; returns how many assessments were made now."""
        return make_realisations([self])

    def evidence(self):
        """The `Evidence`, from the cache where `make` has put it."""
        true = {name: pipeline.true_spectra(case) for name, (case, *_) in self.cases.items()}
        recoveries = {
            name: {
                method: self._recovery(pipeline.assessment(*call), true[name])
                for method, call in calls.items()
            }
            for name, calls in self._calls().items()
        }
        scan = {
            n: self._comparison(pipeline.assessment(*call).spectra, true["oscillating"])
            for n, call in self._scan().items()
        }
        return Evidence(recoveries=recoveries, scan=scan)

    @property
    def assessments(self):
        """The arguments of every `pipeline.assessment` that the claims need, a list of tuples."""
        calls = [call for calls in self._calls().values() for call in calls.values()]
        return [*calls, *self._scan().values()]

    def _calls(self):
        """{case: {method: arguments of `pipeline.assessment`}}."""
        return {
            name: {
                method.name: (case, method, peaks, post and method.name in _POST_MASKED)
                for method in methods_for("oscillating" if name not in TABLE_1 else name)
            }
            for name, (case, peaks, post) in self.cases.items()
        }

    def _scan(self):
        """{n_sources: arguments of `pipeline.assessment`}."""
        case = self.cases["oscillating"][0]
        return {n: (case, SDecGMCA.for_beam("oscillating", n_sources=n), True, False) for n in self.n_sources}

    def _comparison(self, found, true):
        return Comparison.of(found, true, l_top=2 * self.survey.nside)

    def _recovery(self, found, true):
        spectra = self._comparison(found.spectra, true)
        inside = np.isin(true.angular.degrees, spectra.degrees)
        return Recovery(
            spectra=spectra,
            masked=self._comparison(found.masked, found.masked_truth) if found.masked else None,
            correlation=found.correlation,
            variance=diagnostics.error_variance(
                found.spectra.angular.cl[:, inside], true.angular.cl[:, inside]
            ),
            flagged=diagnostics.flagged_lines(found.line_errors),
        )


def make_realisations(realisations):
    """Compute what is not in the cache yet, step by step for all; returns how many assessments were made now.

    The cubes that this makes are deleted again: what is measured on them is enough for the claims, and
    those of many realisations fill a disk. Cubes that were there before stay.
    """
    calls = [call for one in realisations for call in one.assessments]
    if all(pipeline.assessment.is_cached(*call) for call in calls):
        return 0
    check_memory(realisations[0].survey, jobs=n_jobs(), steps=["cleaning"])
    cases = list(dict.fromkeys(case for one in realisations for case, *_ in one.cases.values()))
    steps = [
        (pipeline.hi_of_sky, dict.fromkeys(case.survey.sky for case in cases)),
        (pipeline.hi_alms_of_sky, dict.fromkeys(case.survey.sky for case in cases)),
        (pipeline.noise_alms, dict.fromkeys(case.survey for case in cases)),
        (pipeline.observation, cases),
        (pipeline.peak_masked, cases),
    ]
    made = []
    for product, arguments in steps:
        missing = [(one,) for one in arguments if not product.is_cached(one)]
        made += [(product, call) for call in missing]
        make_all(product, missing, product.name.rpartition(".")[2])
    make_all(pipeline.true_spectra, [(case,) for case in cases], "true spectra")
    done = make_all(pipeline.assessment, calls, "assessments")
    for product, call in made:
        product.forget(*call)
    return done
