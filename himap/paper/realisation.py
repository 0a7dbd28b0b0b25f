"""What the claims are judged on: every method on every case of one sky, against the truth."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from himap.errors import InputError
from himap.instrument.beams.base import Beam
from himap.instrument.beams.degraded import Degraded
from himap.instrument.beams.evolving import Evolving
from himap.instrument.beams.oscillating import Oscillating
from himap.measures import diagnostics
from himap.measures.results import Comparison
from himap.paper import pipeline, plan
from himap.paper.methods import BSS, methods_for, sdecgmca_for
from himap.sky.dimming import Dimming
from himap.sky.galaxy import Galaxy
from himap.survey import Survey

__all__ = ["Realisation"]


@dataclass(frozen=True, kw_only=True)
class Realisation:
    """One sky, observed through the three beams and with the Galactic plane dimmed, and cleaned by all.

    Attributes
    ----------
    survey, galaxy
        As in `pipeline.Case`.
    oscillating
        The oscillating beam, or what is put in its place.
    dimming
        Of the dimmed case.
    n_sources
        Numbers of sources of the scan.
    """

    survey: Survey = field(default_factory=Survey)
    galaxy: Galaxy = field(default_factory=Galaxy)
    oscillating: Beam = field(default_factory=Oscillating)
    dimming: Dimming = field(default_factory=Dimming)
    n_sources: tuple = tuple(range(2, 21))

    def __post_init__(self):
        self._case(self.oscillating)  # refuses bad values
        counts = self.n_sources
        if not counts or min(counts) < 1 or max(counts) > self.survey.n_channels:
            raise InputError(
                f"the scan needs numbers of sources from 1 up to the {self.survey.n_channels} channels, "
                f"got {', '.join(map(str, counts)) or 'none; is the least above the most?'}."
            )

    def _case(self, beam, dimming=None):
        return pipeline.Case(survey=self.survey, galaxy=self.galaxy, beam=beam, dimming=dimming)

    @cached_property
    def cases(self):
        """{case: (`pipeline.Case`, whether peaks are masked, whether spectra are post-masked too)}."""
        oscillating = self._case(self.oscillating)
        return {
            "degraded": (self._case(Degraded()), True, False),
            "evolving": (self._case(Evolving()), True, False),
            "oscillating": (oscillating, True, True),
            "peaks left in": (oscillating, False, False),
            "dimmed": (self._case(self.oscillating, self.dimming), True, False),
        }

    def make(self):
        """Compute what is not in the cache yet; returns how many assessments were made now."""
        return plan.make(self.assessments, keep_observations=False)

    @property
    def assessments(self):
        """The arguments of every `pipeline.assessment` that the claims need, a list of tuples."""
        calls = [call for case in self.cases for call in self._calls(case).values()]
        return [*calls, *self._scan().values()]

    def _calls(self, case):
        """{method: arguments of `pipeline.assessment`}."""
        observed, peaks, post = self.cases[case]
        return {
            method.name: (observed, method, peaks, post and method.name in BSS)
            for method in methods_for(observed.beam)
        }

    def _scan(self):
        """{n_sources: arguments of `pipeline.assessment`}."""
        case = self.cases["oscillating"][0]
        return {n: (case, sdecgmca_for(case.beam, n_sources=n), True, False) for n in self.n_sources}

    def of(self, case):
        """{method: `Comparison`} of one case; methods by their registered name."""
        return self._compared[case]

    @cached_property
    def _compared(self):
        return {
            case: {
                method: self._comparison(pipeline.assessment(*call).power_spectra, self._true(case))
                for method, call in self._calls(case).items()
            }
            for case in self.cases
        }

    @cached_property
    def scan(self):
        """{n_sources: `Comparison`} of SDecGMCA through the oscillating beam."""
        return {
            n: self._comparison(pipeline.assessment(*call).power_spectra, self._true("oscillating"))
            for n, call in self._scan().items()
        }

    def masked(self, method):
        """A `Comparison` on the oscillating case without the lines of sight whose error stands out."""
        result = self._assessed(method)
        return self._comparison(result.masked, result.masked_truth)

    def flagged(self, method):
        """Those lines of sight, (n_pix,) bool."""
        return diagnostics.flagged_lines(self._assessed(method).line_errors)

    def correlation(self, method):
        """Pearson r in every channel, (n_channels,), on the oscillating case."""
        return self._assessed(method).correlation

    def variance(self, method):
        """Variance over channels of the fractional error of C_l at the l of `of`, on the oscillating case."""
        true = self._true("oscillating").angular
        inside = np.isin(true.degrees, self.of("oscillating")[method].degrees)
        recovered = self._assessed(method).power_spectra.angular
        return diagnostics.error_variance(recovered.cl[:, inside], true.cl[:, inside])

    def _assessed(self, method):
        return pipeline.assessment(*self._calls("oscillating")[method])

    def _true(self, case):
        return pipeline.true_spectra(self.cases[case][0])

    def _comparison(self, recovered, true):
        return Comparison.of(recovered, true, l_top=2 * self.survey.nside)
