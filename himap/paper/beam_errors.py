"""Methods that are told another beam than that of the data: what it costs, against the truth, over skies."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.errors import InputError
from himap.instrument.beams import named
from himap.instrument.beams.misjudged import Misjudged
from himap.instrument.beams.oscillating import Oscillating
from himap.instrument.beams.rippled import Rippled
from himap.measures import diagnostics
from himap.measures.transfer import JUDGED, bands, recovery
from himap.paper import cleaned, pipeline, plan
from himap.paper.mocks import own_recovery
from himap.products.parallel import make_all
from himap.products.store import product

__all__ = [
    "HEADER",
    "KINDS",
    "BeamError",
    "by_error",
    "evaluate",
    "misjudged_recovery",
    "most_excess",
    "summary",
    "told_beam",
    "tolerated",
]

KINDS = {
    "width": "relative error of the FWHM",
    "ripple": "relative amplitude of an unknown ripple of 20 MHz",
    "amplitude": "relative error of the ripple's amplitude",
    "phase": "error of the ripple's phase [rad]",
    "period": "relative error of the ripple's period",
    "beam": "another beam",
}
"""What can be wrong of the beam that a method is told."""


@dataclass(frozen=True, kw_only=True)
class BeamError:
    """Power over that of the truth in one band, of one method that is told a wrong beam, on one sky.

    Attributes
    ----------
    seed, method, n_sources, band
        As of `himap.paper.corrections.Correction`.
    kind, error
        What is wrong (`KINDS`), and by how much; of "beam" the name of what is told. A method that does not
        know the beam has one row a band, with the kind "none" and 0.
    ratio, kept, excess
        Means over the band of C/C0 or P/P0; of the share of it that is in common with the truth; and of what
        is more than that, of foreground in the main. What a projection keeps it keeps whole, so that without
        foreground ratio and kept are the same.
    """

    command: ClassVar[str] = "beam-errors"
    seed: int
    method: str
    n_sources: int
    kind: str
    error: float | str
    band: str
    ratio: float
    kept: float
    excess: float


def told_beam(beam, kind, error):
    """The `Beam` that a method is told, where `kind` of `beam` is wrong by `error`.

    Raises
    ------
    InputError
        An unknown kind, an error that is no number, or a ripple where the beam has none.
    """
    if kind == "beam":
        return named(error)
    if kind not in KINDS or isinstance(error, bool) or not isinstance(error, int | float):
        raise InputError(
            f"an error of the beam is one of {', '.join(KINDS)} and a number, got {kind!r} and {error!r}."
        )
    if kind in ("width", "ripple"):
        return Misjudged(beam=str(beam), **{kind: float(error)})
    ripple = Rippled() if beam == Oscillating() else beam
    if not isinstance(ripple, Rippled):
        raise InputError(
            f"the {kind} of a ripple can be wrong of the beams rippled and oscillating, got {beam}."
        )
    own = {name: getattr(ripple, name) for name in ("amplitude", "period", "phase")}
    own[kind] = own[kind] + error if kind == "phase" else own[kind] * (1 + error)
    return Rippled(**own)


@product
def misjudged_recovery(case, remover, told):
    """The `Recovery` of the truth, where a method is told the `Beam` `told`; peaks are masked.

    A method that asks for the noise is told that of the instrument.
    """
    found = cleaned.cleaning(case, remover).with_beams(told.of_survey(case.survey).total).separation
    wrong = cleaned.error_of(case, found)
    return recovery(pipeline.truth_alms(case, found.lmax), wrong, case.survey.channel_width)


def evaluate(cases, removers, errors):
    """The `BeamError` of every band, method, error and case, a list; what is as large as a cube goes.

    Parameters
    ----------
    cases
        `pipeline.Case` each, alike but for the seed.
    removers
        Methods; those that do not know the beam are there for comparison.
    errors
        {kind: [error]}, as of `told_beam`; where nothing is wrong is there in any case, as "width" 0.

    Raises
    ------
    InputError
        No method, or what `told_beam` or a method refuses.
    """
    if not removers:
        raise InputError("there must be methods to tell a wrong beam, got none.")
    told = {("width", 0.0): cases[0].beam}
    for kind, several in errors.items():
        told |= {(kind, error): told_beam(cases[0].beam, kind, error) for error in several}
    for beam in told.values():
        beam.of_survey(cases[0].survey)  # fails now
    rows = []
    for case in cases:
        calls = [
            (case, remover, beam) for remover in removers if "beams" in remover.uses for beam in told.values()
        ]
        blind = [(case, remover) for remover in removers if "beams" not in remover.uses]
        known = [misjudged_recovery.is_cached(*call) for call in calls]
        known += [own_recovery.is_cached(*call) for call in blind]
        with plan.passing_observations([] if all(known) else [case]):
            make_all(misjudged_recovery, calls, "beams")
            make_all(own_recovery, blind, "without beams")
        for remover in removers:
            if "beams" in remover.uses:
                for (kind, error), beam in told.items():
                    found = misjudged_recovery(case, remover, beam)
                    rows += _rows(case, remover, kind, error, found)
            else:
                rows += _rows(case, remover, "none", 0.0, own_recovery(case, remover))
    return rows


def _rows(case, remover, kind, error, found):
    known_at = {"angular": found.put_in.degrees, "frequency": found.put_in.k}
    rows = []
    for band, (spectrum, inside) in bands(**known_at).items():
        back, common, true = (
            getattr(getattr(found, name), spectrum)[inside] for name in ("came_back", "common", "put_in")
        )
        ratio, kept = diagnostics.ratio(back, true), diagnostics.ratio(common, true)
        rows.append(
            BeamError(
                seed=case.survey.seed,
                method=remover.name,
                n_sources=getattr(remover, "n_sources", 0),
                kind=kind,
                error=error,
                band=band,
                ratio=float(ratio.mean()),
                kept=float(kept.mean()),
                excess=float((ratio - kept).mean()),
            )
        )
    return rows


HEADER = (
    "method",
    "what is wrong",
    "by",
    "furthest from 1",
    "in",
    "HI kept there",
    "most excess",
    "in",
)
"""Columns of `summary`."""


def by_error(rows):
    """{(method, n_sources, kind, error): {band: means over skies of (ratio, kept, excess)}}, as judged."""
    found = {}
    for row in rows:
        if row.band in JUDGED:
            key = (row.method, row.n_sources, row.kind, row.error)
            found.setdefault(key, {}).setdefault(row.band, []).append((row.ratio, row.kept, row.excess))
    return {
        key: {band: np.mean(several, axis=0) for band, several in ratios.items()}
        for key, ratios in found.items()
    }


def most_excess(means):
    """The largest excess of any band, from the means of one method and error (`by_error`)."""
    return max(float(excess) for _, _, excess in means.values())


def tolerated(rows, limit=0.01):
    """The error of each kind up to which the largest excess is at most `limit` more than with the exact beam.

    Between the errors that were tried it is interpolated in the logarithms; beyond the largest it is that.

    Returns
    -------
    dict
        {(method, n_sources, kind): error}, NaN where the least error that was tried is too large.
    """
    excess = {key: most_excess(means) for key, means in by_error(rows).items()}
    curves = {}
    for (*method, kind, error), value in excess.items():
        if kind not in ("none", "beam") and error:
            more = value - excess[*method, "width", 0.0]
            curves.setdefault((*method, kind), {})[error] = max(more, limit / 1e6)
    return {key: _crossing(more, limit) for key, more in curves.items()}


def _crossing(more, limit):
    """The error at which a curve {error: value} first comes to `limit`."""
    errors = np.array(sorted(more))
    values = np.array([more[error] for error in errors])
    above = np.flatnonzero(values > limit)
    if not len(above):
        return float(errors[-1])
    if above[0] == 0:
        return math.nan
    pair = slice(above[0] - 1, above[0] + 1)
    return float(np.exp(np.interp(np.log(limit), np.log(values[pair]), np.log(errors[pair]))))


def summary(rows):
    """One line of texts for each method and error, a list of tuples; see `HEADER`."""
    lines = []
    for (method, n_sources, kind, error), means in by_error(rows).items():
        furthest = max(means, key=lambda band: abs(means[band][0] - 1))
        most = max(means, key=lambda band: means[band][2])
        ratio, kept, _ = means[furthest]
        by = error if isinstance(error, str) else f"{error:g}"
        numbers = (f"{ratio:.4g}", furthest, f"{kept:.3f}", f"{means[most][2]:.2%}", most)
        lines.append((f"{method} {n_sources or ''}".strip(), kind, by, *numbers))
    return lines
