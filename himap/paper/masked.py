"""A mask within the separation, compared with other treatments of a bright plane, on the same pixels.

Every treatment is measured on pixels of a `Region` that are farther than a margin from its edge: emission
mixed across the edge by a beam is visible there, and no method is expected to remove it.
"""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.checks import checked_fields, parameter
from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.low_rank import scattered
from himap.measures import diagnostics
from himap.measures.diagnostics import Comparison
from himap.measures.low_rank_spectra import (
    Moments,
    difference,
    line_errors,
    masked_alms,
    masked_power,
    recovered_power,
)
from himap.measures.spectra import PowerSpectra, frequency_power
from himap.paper import cleaned, pipeline
from himap.sky.galaxy import Dimming
from himap.store.store import product

WAYS = ("no mask", "post-masked", "dimmed", "inside")
"""Foreground estimated on the full sky; the same without lines of sight with exceptional errors (paper,
Sect. 5.1); with the plane dimmed in the sky itself (Sect. 5.2); and estimated on the region only."""


@dataclass(frozen=True, kw_only=True)
class Region:
    """The part of the sky beyond a Galactic latitude, north and south, or north only."""

    latitude: float = parameter(10.0, "least |b| that is kept, deg", minimum=0, maximum=89)
    north: bool = parameter(False, "whether the south is excluded, as in a survey of a cap")

    def __post_init__(self):
        checked_fields(self)

    def depth(self, nside):
        """Distance of each pixel from the edge, deg, negative outside, (n_pix,)."""
        latitude = sphere.pixel_latitude(nside)
        return (latitude if self.north else np.abs(latitude)) - self.latitude

    def mask(self, nside, margin=0.0):
        """Pixels farther inside than `margin`, deg, (n_pix,) bool."""
        return self.depth(nside) > margin


@product(name="masked_separation")
def separation(case, remover, region):
    """The `Separation` on the pixels of a region of a case, like `cleaned.separation` on all pixels."""
    return cleaned.cleaning(case, remover).on(region.mask(case.survey.nside)).separation


def residual(case, remover, region, way):
    """The residual of one of `WAYS`, mK, (n_channels, n_pix) float32; not stored; 0 outside for "inside".

    InputError for another way, or a method that ends at some multipole.
    """
    if way not in WAYS:
        raise InputError(f"a way must be {', '.join(WAYS[:-1])} or {WAYS[-1]}, got {way!r}.")
    if getattr(remover, "beyond", None) == "cut":
        raise InputError(f"the residual of {remover.name} ends at some l, which a mask mixes with others.")
    if way == "dimmed":
        case = replace(case, dimming=Dimming())
    if way != "inside":
        return cleaned.residual(case, remover)
    kept = region.mask(case.survey.nside)
    cleaning = cleaned.cleaning(case, remover).on(kept)
    return scattered(separation(case, remover, region).residual(cleaning.data.maps, cleaning.basis), kept)


@product(name="masked_comparison")
def compared(case, remover, region, way, margin=4.0):
    """The `Comparison` of the residual of one of `WAYS` with the truth, inside of a `Region`.

    The Galaxy of the case is not dimmed, and the method has no last l. Spectra use pixels at least `margin`,
    deg, inside of the edge; C_l are decoupled (MASTER), in bins of 1 / f_sky.
    """
    inside = region.mask(case.survey.nside, margin)
    left, true = residual(case, remover, region, way), pipeline.truth(case)
    if way == "post-masked":
        inside &= ~diagnostics.flagged_lines(line_errors(cleaned.error(case, remover)))
    alms, error = masked_alms(true, mask=inside), difference(left, true, mask=inside)
    survey = case.survey
    along = frequency_power(true, survey.channel_width, mask=inside, taper=survey.taper)
    more = Moments.of(true, error, mask=inside).frequency_power(along, survey.channel_width)
    recovered = PowerSpectra(angular=recovered_power(alms, error, mask=inside), frequency=more)
    spectra = PowerSpectra(angular=masked_power(alms, inside), frequency=along)
    return Comparison.of(recovered, spectra, l_top=2 * case.survey.nside)


@product(name="masked_by_depth")
def by_depth(case, remover, region, way, edges=(0.0, 1.0, 2.0, 4.0, 8.0, 90.0)):
    """Rms of the residual less the truth, mK, in ranges of distance from the edge, deg, (n - 1,)."""
    left, depth = residual(case, remover, region, way), region.depth(case.survey.nside)
    kept = depth > 0
    wrong = left[:, kept] - pipeline.truth(case)[:, kept]
    wrong -= wrong.mean(axis=1, keepdims=True)
    number = np.digitize(depth[kept], edges) - 1
    squares = np.mean(wrong**2, axis=0)
    return np.array([np.sqrt(squares[number == n].mean()) for n in range(len(edges) - 1)])
