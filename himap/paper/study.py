"""Common basis of the notebooks: one survey and sky observed through several beams.

A notebook makes one `Study` from its parameters, and gets cases and cleaned cubes from it; the figures
are in `himap.paper.study_figures`.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.survey import Survey
from himap.figures import plotting, styles
from himap.figures.numbers import of_restarts
from himap.paper import cleaned, pipeline
from himap.removal.restarts import has_restarts
from himap.sky.galaxy import Dimming, Galaxy
from himap.store.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class Study:
    """The observations of one sky; the fields are the parameters common to all notebooks."""

    preset: str = "quick"
    overrides: dict = field(default_factory=dict)  # the `Survey` fields that differ from the preset
    galaxy: str = "synthetic"  # this and the next two as in `Galaxy`
    template_dir: str | None = None
    small_scales: bool = True
    dimming: Dimming | None = None  # of the foregrounds along the Galactic plane
    n_restarts: int = 1  # of a chaotic method; each is a separate method, see `members`

    def __post_init__(self):
        whole_number("n_restarts", self.n_restarts, 1, 10_000)

    @cached_property
    def survey(self):
        """The `Survey`."""
        return Survey.preset(self.preset, **self.overrides)

    @property
    def l_top(self):
        """2 nside: the largest multipole that the pixels represent well."""
        return 2 * self.survey.nside

    @cached_property
    def milky_way(self):
        """The `Galaxy`."""
        return Galaxy(source=self.galaxy, template_dir=self.template_dir, small_scales=self.small_scales)

    def case(self, beam):
        """The `Case` of one `Beam`; InputError for an invalid survey field, Galaxy or beam."""
        return pipeline.Case(survey=self.survey, galaxy=self.milky_way, beam=beam, dimming=self.dimming)

    def observed(self, beam):
        """The `Observation` through one beam."""
        return pipeline.observation(self.case(beam))

    def truth(self, beam):
        """The `PowerSpectra` of the truth, HI plus noise through the beam."""
        return pipeline.true_spectra(self.case(beam))

    def separation(self, beam, remover, **options):
        """The `Separation` by `remover`; options as in `cleaned.separation`."""
        return cleaned.separation(self.case(beam), remover, **options)

    def residual(self, beam, remover, *, mask_peaks=True, channels=slice(None)):
        """The residual cube of `remover`, (n_channels, n_pix) float32, mK, or some channels; not stored."""
        self.separation(beam, remover, mask_peaks=mask_peaks)
        return cleaned.residual(self.case(beam), remover, mask_peaks, channels)

    def assessed(self, beam, remover, *, mask_peaks=True):
        """The `Assessment` of `remover`."""
        return cleaned.assessment(self.case(beam), remover, mask_peaks)

    def compared(self, beam, remover, *, mask_peaks=True, masked=False):
        """Both spectra against the truth, a `Comparison`.

        With `masked`, lines of sight with exceptional errors are excluded, in the residual and in the truth.
        """
        return cleaned.compared(self.case(beam), remover, mask_peaks, masked=masked)

    def members(self, remover):
        """`remover` with each of `n_restarts` starts, its own first; only itself without restarts: a list."""
        if not has_restarts(remover):
            return [remover]
        return [replace(remover, restart=remover.restart + k) for k in range(self.n_restarts)]

    def ensemble(self, beam, remover, **options):
        """`compared` of all `members`, a list of `Comparison`."""
        return [self.compared(beam, member, **options) for member in self.members(remover)]

    def medoid(self, beam, remover):
        """The representative of the `members` if only one is shown (`himap.removal.restarts.Ensemble`)."""
        members = self.members(remover)
        if len(members) == 1:
            return remover
        return members[cleaned.ensemble([(self.case(beam), member) for member in members]).medoid_index]

    def stamped(self, figure, **parameters):
        """The figure with a line on its provenance, including `parameters` of the figure.

        The reading of SDecGMCA, `reading`, is stated unless it is the default.
        """
        if parameters.get("reading") == "default":
            del parameters["reading"]
        made = Provenance.of(self.survey, galaxy=self.milky_way, preset=self.preset, parameters=parameters)
        return plotting.stamp(figure, made)

    def prepare(self, removers, *more, mask_peaks=True):
        """Assess the members of {beam: [method, ...]} in as many processes as set by `himap run --jobs`.

        `more` are other products with the same arguments, such as `cleaned.post_masked`.
        """
        calls = [
            (self.case(beam), member, mask_peaks)
            for beam, methods in removers.items()
            for method in methods
            for member in self.members(method)
        ]
        cleaned.make([(wanted, call) for wanted in (cleaned.assessment, *more) for call in calls])

    def check(self, removers):
        """Refuse methods that do not fit the survey early, before the simulation.

        InputError as in `ForegroundRemover.check`, or for a beam that does not fit.
        """
        for beam, methods in removers.items():
            self.case(beam)
            for remover in methods:
                remover.check(self.survey.n_channels)
        if not removers:
            raise InputError("there is nothing to clean: give {beam: [method, ...]}.")

    def ratios(self, beam, remover, **options):
        """(l, C/C0, k, P/P0) of one method, from l = 2 to 2 nside and from the first k above 0."""
        result = self.compared(beam, remover, **options)
        return result.degrees, result.angular_ratio, result.k, result.frequency_ratio

    def bands(self, beam, remover, **options):
        """`Comparison.wide_band_means` of one method, {name: value}."""
        return self.compared(beam, remover, **options).wide_band_means()

    def band_entries(self, beam, remover, *, tolerance=0.02, **options):
        """Entries of `bands` for `numbers.show`, over all `members`; `tolerance` is relative, and absolute
        below 1.
        """
        members = [one.wide_band_means() for one in self.ensemble(beam, remover, **options)]
        entries = [
            {name: (value, tolerance * max(1, value)) for name, value in one.items()} for one in members
        ]
        return over_restarts(remover, entries)

    def band_numbers(self, removers, **options):
        """`band_entries` of all methods of {beam: [method, ...]}, for `numbers.show`."""
        return {
            f"{beam}, {styles.method_style(method)['label']}: {name}": entry
            for beam, methods in removers.items()
            for method in methods
            for name, entry in self.band_entries(beam, method, **options).items()
        }


def over_restarts(remover, entries):
    """One entry, or dictionary of entries, for `numbers.show` from those of all members of a method.

    It has medians and ranges (`himap.figures.numbers.of_restarts`); without restarts, the single entry.
    """
    return of_restarts(entries) if has_restarts(remover) else entries[0]
