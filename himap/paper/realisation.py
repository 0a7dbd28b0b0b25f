"""The basis on which claims are judged: every method on every case of one sky, against the truth."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from himap.core.checks import parameter, whole_number
from himap.core.errors import InputError
from himap.core.survey import PRESETS, Survey
from himap.instrument.beams.base import Beam
from himap.instrument.beams.paper import Degraded, Evolving, Oscillating
from himap.measures import diagnostics
from himap.measures.diagnostics import Comparison
from himap.paper import cleaned, evidence, pipeline
from himap.paper.claims.base import BEAMS, CLIPPED, LEFT_IN, METHODS
from himap.paper.methods import BSS, beam_aware_for, methods_for, table_1
from himap.sky.galaxy import Dimming, Galaxy

REGULARISATIONS = (1e-3, 1e-2, 1e-1)
"""Strengths c of the Tikhonov term for which SDecGMCA is compared."""

STRATEGIES = {"matrix": 3, "spectrum": 4}
"""{`coefficients` of SDecGMCA: number of the strategy of C21 in the refinement}."""


@dataclass(frozen=True, kw_only=True)
class Realisation:
    """One sky, observed through the three beams and with a dimmed Galactic plane, and cleaned by all methods.

    Attributes
    ----------
    survey, galaxy
        As in `pipeline.Case`.
    oscillating
        The oscillating beam, or its replacement.
    dimming
        `Dimming` of the dimmed case.
    n_sources
        Numbers of sources in the scan.
    method, options
        The method used as SDecGMCA, a name in `himap.paper.methods.BEAM_AWARE`, and pairs (name, value) of
        its options that differ from their defaults. In the claims its name is "sdecgmca".
    restart
        Which start of this method, 0 or more; only 0 if it has no field `restart`.
    average
        Average of C_l over channels, one of `diagnostics.AVERAGES`.
    polynomial
        Variable of the polynomial fit, as in `himap.removal.Polynomial`.
    """

    survey: Survey = field(default_factory=Survey)
    galaxy: Galaxy = field(default_factory=Galaxy)
    oscillating: Beam = field(default_factory=Oscillating)
    dimming: Dimming = field(default_factory=Dimming)
    n_sources: tuple = tuple(range(2, 21))
    method: str = "sdecgmca"
    options: tuple = ()
    restart: int = 0
    average: str = parameter("means", "of C_l over channels", off="means")
    polynomial: str = parameter("temperature", "variable of the polynomial fit", off="temperature")

    def __post_init__(self):
        self._case(self.oscillating)  # refuses invalid values
        counts = self.n_sources
        if not counts or min(counts) < 1 or max(counts) > self.survey.n_channels:
            raise InputError(
                f"the scan needs numbers of sources from 1 up to the {self.survey.n_channels} channels, "
                f"got {', '.join(map(str, counts)) or 'none; is the least above the most?'}."
            )
        whole_number("restart", self.restart, 0, 10**6)
        if self.average not in diagnostics.AVERAGES:
            known = ", ".join(diagnostics.AVERAGES)
            raise InputError(f"average must be one of {known}, got {self.average!r}.")
        for observed, method, *_ in self.assessments:  # refuses invalid methods and options
            method.check(observed.survey.n_channels)

    def _case(self, beam, dimming=None):
        return pipeline.Case(survey=self.survey, galaxy=self.galaxy, beam=beam, dimming=dimming)

    @cached_property
    def cases(self):
        """{case: (`pipeline.Case`, `mask_peaks`)}, the latter as in `pipeline.basis`."""
        observed = dict(zip(BEAMS, map(self._case, (Degraded(), Evolving(), self.oscillating)), strict=True))
        masked = {beam: (case, True) for beam, case in observed.items()}
        left_in = {LEFT_IN.format(beam): (case, False) for beam, case in observed.items()}
        clipped = {name: (observed["oscillating"], spread) for spread, name in CLIPPED.items()}
        dimmed = self._case(self.oscillating, self.dimming), True
        return masked | left_in | clipped | {"dimmed": dimmed}

    @property
    def assessments(self):
        """Arguments of every `cleaned.assessment` needed by the claims, a list of tuples."""
        calls = [call for case in self.cases for call in self.calls(case).values()]
        settings = self._settings()
        more = *settings.values(), *self._restarts(len(settings))
        return [*calls, *map(self._beyond, BEAMS), *more, *self.scan_calls().values()]

    @cached_property
    def facts(self):
        """Further products needed by the claims, {name: (product of `evidence`, arguments)}."""
        calls, voxels = self.calls("oscillating"), (*BEAMS, *CLIPPED.values())
        return {
            "brightness": (evidence.sky_brightness, (self.survey.sky, self.galaxy)),
            **{("noise", beam): (evidence.noise_and_hi, self.cases[beam][:1]) for beam in BEAMS},
            **{("voxels", case): (evidence.masked_voxels, self.cases[case]) for case in voxels},
            "no sources": (evidence.spectra_without_sources, self.calls("degraded")["parametric"][:2]),
            "flagged": (evidence.error_of_flagged_lines, calls["sdecgmca"]),
            **{("lines", name): (evidence.peak_without_lines, calls[name]) for name in BSS},
            **{("masked", name): (cleaned.post_masked, calls[name]) for name in BSS},
        }

    def _fact(self, what):
        product, arguments = self.facts[what]
        return product(*arguments)

    def calls(self, case):
        """{method: arguments of `cleaned.assessment`} of a case; "sdecgmca" is SDecGMCA or its replacement.

        The two fits are omitted if peaks are masked with another standard deviation.
        """
        observed, peaks = self.cases[case]
        kinds = {"method": self.method, "variable": self.polynomial}
        methods = methods_for(observed.beam, **kinds, **self._options)
        return {
            name: (observed, method, peaks)
            for name, method in zip(METHODS, methods, strict=True)
            if name in BSS or case not in CLIPPED.values()
        }

    def _changed(self, beam, **changed):
        """Arguments of `cleaned.assessment` for SDecGMCA, or its replacement, with other options."""
        case, peaks = self.cases[beam]
        return case, beam_aware_for(case.beam, self.method, **self._options | changed), peaks

    def _beyond(self, beam):
        """The same for SDecGMCA continued beyond l = 200; unchanged if it has no such option."""
        call = self._changed(beam)
        if not hasattr(call[1], "beyond"):
            return call
        try:
            return self._changed(beam, beyond="regularised")
        except InputError:  # its last S has no regularisation to continue
            return self._changed(beam, beyond="projection")

    def scan_calls(self):
        """{n_sources: arguments of `cleaned.assessment`}."""
        return {n: self._changed("oscillating", n_sources=n) for n in self.n_sources}

    def _settings(self):
        """{setting of SDecGMCA's regularisation: arguments of `cleaned.assessment`}, including the default.

        Empty for a method without such settings; settings that agree are listed once.
        """
        own = self._changed("oscillating")
        if not hasattr(own[1], "coefficients"):
            return {}
        changes = {f"c = {c:g}": {"regularisation": c} for c in REGULARISATIONS}
        changes |= {f"strategy {n}": {"coefficients": name} for name, n in STRATEGIES.items()}
        calls = {label: self._changed("oscillating", **changed) for label, changed in changes.items()}
        return {"as it is": own} | {label: call for label, call in calls.items() if call != own}

    def _restarts(self, n):
        """Arguments of `cleaned.assessment` for this start and the following ones, `n` in total, a list."""
        return [self._changed("oscillating", restart=self.restart + k) for k in range(n)]

    @cached_property
    def _options(self):
        return dict(self.options) | ({"restart": self.restart} if self.restart else {})

    def of(self, case):
        """{method: `Comparison`} for one case; methods by their registered name."""
        return {method: self._compare(call) for method, call in self.calls(case).items()}

    def beyond(self, beam):
        """`Comparison` of SDecGMCA continued beyond l = 200 with a regularised inversion of the beam."""
        return self._compare(self._beyond(beam))

    @property
    def scan(self):
        """Comparisons by number of sources, a dict, for SDecGMCA with the oscillating beam."""
        return {n: self._compare(call) for n, call in self.scan_calls().items()}

    def _compare(self, call, masked=False):
        """`Comparison` of an assessment with the truth, up to the last l of the method."""
        if (call, masked) not in self._compared:
            self._compared[call, masked] = cleaned.compared(*call, masked=masked, average=self.average)
        return self._compared[call, masked]

    @cached_property
    def _compared(self):
        return {}

    def assessed(self, method, case="oscillating"):
        """The `Assessment` of a method on a case."""
        return cleaned.assessment(*self.calls(case)[method])

    def masked(self, method):
        """A `Comparison` on the oscillating case without lines of sight with exceptional errors."""
        return self._compare(self.calls("oscillating")[method], masked=True)

    def unmasked(self, method):
        """The `Comparison` of the full sky in the bins of `masked`."""
        return self.of("oscillating")[method].in_bins_of(self.masked(method))

    def flagged(self, method):
        """Those lines of sight, (n_pix,) bool."""
        return diagnostics.flagged_lines(self.assessed(method).line_errors)

    def variance(self, method):
        """Variance over channels of the fractional error of C_l at the l of `of`, on the oscillating case."""
        call = self.calls("oscillating")[method]
        degrees = self._compare(call).degrees.astype(int)
        recovered = self.assessed(method).power_spectra.angular
        true = pipeline.true_spectra(call[0]).angular
        return diagnostics.error_variance(recovered.cl[:, degrees], true.cl[:, degrees])

    def brightness(self):
        """{region of the sky: rms of foregrounds and of HI before the beam, mK}."""
        everywhere, high = self._fact("brightness")
        return {"all sky": tuple(everywhere), f"|b| > {evidence.HIGH_LATITUDE:g}": tuple(high)}

    def masked_voxels(self, case):
        """{"HI", "noise" or "foreground": number of masked voxels in which it is the largest component}."""
        return dict(zip(evidence.STANDING_OUT, self._fact(("voxels", case)).tolist(), strict=True))

    def noise_over_hi(self, beam):
        """`Comparison` of the noise with HI, each alone as in the truth.

        The noise has the power of the paper's channels, see `noise.noise_sigma`, and C_l that of its pixels.
        """
        noise, hi = self._fact(("noise", beam))
        paper, survey = PRESETS["paper"], self.survey
        wider = survey.channel_width / paper.channel_width
        scale = np.sqrt(wider) if survey.noise_reading == "variance" else wider
        found = Comparison.of(noise, hi, l_top=2 * survey.nside, average=self.average)
        angular = found.angular * scale * (survey.nside / paper.nside) ** 2
        return replace(found, angular=angular, frequency=found.frequency * scale / wider)

    def without_sources(self):
        """`Comparison` for the parametric fit on the degraded case of a sky without point sources.

        InputError if the fit refuses these maps.
        """
        found = self._fact("no sources")
        if isinstance(found, str):
            raise InputError(found)
        true = pipeline.true_spectra(self.cases["degraded"][0])
        return Comparison.of(found, true, l_top=2 * self.survey.nside, average=self.average)

    def flagged_error(self):
        """Components of the error of SDecGMCA on its flagged lines: `evidence.error_of_flagged_lines`."""
        return self._fact("flagged")

    def without_brightest(self, method):
        """Excluded shares of the lines of sight with brightest foreground, and highest P/P0 near k = 0.31.

        The last value excludes the share `evidence.CONTROL` of the faintest lines instead.
        """
        k, ratios = self._fact(("lines", method))
        return evidence.BRIGHTEST, [diagnostics.inside(k, row, *diagnostics.BUMP).max() for row in ratios]

    def by_regularisation(self):
        """{setting of the regularisation: `Comparison`} of SDecGMCA with the oscillating beam."""
        return {label: self._compare(call) for label, call in self._settings().items()}

    def by_restart(self, n):
        """`Comparison` of SDecGMCA from this start and the following ones, `n` in total, a list."""
        return [self._compare(call) for call in self._restarts(n)]

    def windows(self, beam):
        """b_l from the sky to the maps, (n_channels, lmax + 1)."""
        return self.cases[beam][0].beam.of_survey(self.survey).total

    def regularisation(self, beam):
        """c of Table 1."""
        return table_1(self.cases[beam][0].beam)["regularisation"]
