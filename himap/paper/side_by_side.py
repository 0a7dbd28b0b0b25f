"""All methods side by side over many skies: ratios to the truth along l and k, as left and corrected."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from himap.errors import InputError
from himap.measures import diagnostics
from himap.measures.transfer import bands
from himap.paper.corrections import cases_and_methods, recoveries

__all__ = [
    "HEADER",
    "Curve",
    "band_means",
    "curves",
    "evaluate",
    "furthest",
    "grouped",
    "skies_and_methods",
    "summary",
]

_WIDTH = 1.2  # of a bin: its end over its beginning, but for the narrowest


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Power over that of the truth along l or k, of one method on one sky, in bins.

    Attributes
    ----------
    seed, beam
        Of the sky; name of the beam.
    method, n_sources
        Its number is 0 if it has none.
    corrected
        Whether it is divided by the transfer function of mocks (of cross power).
    kind
        "angular", C/C0, or "frequency", P/P0.
    step
        Distance of two neighbours on the axis: 1 for l; that of two wavenumbers, 1/MHz.
    edges
        Of the bins, in steps, (n_bins + 1,): one begins at its edge and ends before the next.
    ratio
        Means of the ratio over the bins, (n_bins,).
    """

    command: ClassVar[str] = "side-by-side"
    seed: int
    beam: str
    method: str
    n_sources: int
    corrected: bool
    kind: str
    step: float
    edges: list
    ratio: list

    @property
    def at(self):
        """Middles of the bins, l or 1/MHz, (n_bins,)."""
        edges = np.array(self.edges)
        return self.step * (edges[:-1] + edges[1:] - 1) / 2

    @cached_property
    def means(self):
        """{band: mean of the ratio over it}, bands as of `himap.measures.transfer.bands`."""
        within = np.arange(self.edges[0], self.edges[-1])
        every = np.repeat(self.ratio, np.diff(self.edges))
        known_at = {"angular": np.empty(0), "frequency": np.empty(0)} | {self.kind: within * self.step}
        return {name: float(every[inside].mean()) for name, (_, inside) in bands(**known_at).items()}


def curves(case, remover, own, transfer=None):
    """The `Curve` of C/C0 and of P/P0 of a method on a case, a list.

    Parameters
    ----------
    case, remover
        `pipeline.Case` and method.
    own
        The `Recovery` of the truth.
    transfer
        The `TransferFunction` to correct them with; they are as the method leaves them without.
    """
    rows = []
    known_at = {"angular": own.put_in.degrees, "frequency": own.put_in.k}
    for kind, x in known_at.items():
        edges = _edges([inside for its, inside in bands(**known_at).values() if its == kind])
        shown = slice(edges[0], edges[-1])
        powers = [getattr(power, kind)[shown] for power in (own.came_back, own.put_in)]
        ratio = diagnostics.ratio(*powers)
        if transfer is not None:
            ratio = diagnostics.ratio(ratio, getattr(transfer, kind)[shown])
        sums = np.add.reduceat(ratio, edges[:-1] - edges[0])
        rows.append(
            Curve(
                seed=case.survey.seed,
                beam=case.beam.name,
                method=remover.name,
                n_sources=getattr(remover, "n_sources", 0),
                corrected=transfer is not None,
                kind=kind,
                step=float(x[1] - x[0]),
                edges=edges.tolist(),
                ratio=(sums / np.diff(edges)).tolist(),
            )
        )
    return rows


def _edges(parts):
    """Edges of bins of even logarithmic width that do not cross the ends of neighbouring parts of an axis."""
    edges = set()
    for inside in parts:
        (found,) = np.nonzero(inside)
        low, high = found[0], found[-1] + 1
        n_bins = math.ceil(math.log(high / low) / math.log(_WIDTH))
        edges |= set(np.round(np.geomspace(low, high, n_bins + 1)).astype(int).tolist())
    return np.array(sorted(edges))


def skies_and_methods(*, beams, methods, n_realisations=20, **options):
    """[{case: [method]}], a dict for each sky with a case for each beam.

    Parameters
    ----------
    beams
        Names of beams.
    methods
        Pairs (name, number of sources), the number a list where it differs from beam to beam; None for a
        method without.
    n_realisations, options
        As in `himap.paper.corrections.cases_and_methods`.

    Raises
    ------
    InputError
        A number is missing, or what `cases_and_methods` refuses.
    """
    if not isinstance(beams, list | tuple) or not beams or len(set(beams)) < len(beams):
        raise InputError(f"beams must be a list of names, each once, got {beams!r}.")
    skies = []
    for place, beam in enumerate(beams):
        own = []
        for pair in methods:
            one = _of_beam(pair, place, len(beams))
            own += [one] if one not in own else []
        cases, removers = cases_and_methods(beam=beam, methods=own, n_realisations=n_realisations, **options)
        skies = skies or [{} for _ in cases]
        for sky, case in zip(skies, cases, strict=True):
            sky[case] = removers
    return skies


def _of_beam(pair, place, n_beams):
    """A pair (name, number of sources) of the beam at `place`."""
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        return pair  # refused with the others
    name, number = pair
    if isinstance(number, list | tuple):
        if len(number) != n_beams:
            raise InputError(f"{name} has {len(number)} numbers of sources for {n_beams} beams: one each.")
        number = number[place]
    return name, number


def evaluate(skies, mocks, corrected=()):
    """The `Curve` of every method on every sky, a list; what is as large as a cube does not stay.

    Parameters
    ----------
    skies
        As of `skies_and_methods`.
    mocks
        Of other seeds than the skies; none if nothing is corrected.
    corrected
        Names of the methods that are corrected too.

    Raises
    ------
    InputError
        What is to be corrected is not there, or what `recoveries` refuses.
    """
    there = {remover.name for sky in skies for removers in sky.values() for remover in removers}
    if unknown := set(corrected) - there:
        absent, present = (", ".join(sorted(names)) for names in (unknown, there))
        raise InputError(f"to be corrected is {absent}, but the methods are {present}.")
    rows = []
    for sky in skies:
        for case, remover, own, transfer in recoveries(sky, mocks, corrected):
            rows += curves(case, remover, own)
            if transfer is not None:
                rows += curves(case, remover, own, transfer)
    return rows


def grouped(rows):
    """{(beam, method, n_sources, corrected, kind): [`Curve` of each sky]}, in the order of the rows."""
    found = {}
    for row in rows:
        found.setdefault((row.beam, row.method, row.n_sources, row.corrected, row.kind), []).append(row)
    return found


def band_means(rows):
    """{(beam, method, n_sources, corrected): {band: [mean of the band on each sky]}}."""
    found = {}
    for (*key, _), several in grouped(rows).items():
        own = found.setdefault(tuple(key), {})
        own |= {band: [row.means[band] for row in several] for band in several[0].means}
    return found


def furthest(means, of):
    """(band, mean, scatter) of the band, of those in `of`, whose mean over skies is furthest from 1.

    `means` is {band: [mean on each sky]}; the scatter is the standard deviation over skies, nan of one.
    """
    judged = {band: values for band, values in means.items() if band in of}
    band = max(judged, key=lambda name: abs(np.mean(judged[name]) - 1))
    scatter = np.std(judged[band], ddof=1) if len(judged[band]) > 1 else math.nan
    return band, float(np.mean(judged[band])), float(scatter)


HEADER = ("beam", "method", "spectra", "band", "left / truth", "scatter")
"""Columns of `summary`."""


def summary(rows):
    """The mean over skies of every band, a list of tuples of texts; see `HEADER`."""
    lines = []
    for (beam, method, n_sources, corrected), found in band_means(rows).items():
        name, made = f"{method} {n_sources or ''}".strip(), "corrected" if corrected else "as left"
        for band, values in found.items():
            scatter = np.std(values, ddof=1) if len(values) > 1 else math.nan
            lines.append((beam, name, made, band, f"{np.mean(values):.4f}", f"{scatter:.4f}"))
    return lines
