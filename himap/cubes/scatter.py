"""How the power spectra of a cleaned cube scatter between the restarts of a method that is chaotic."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.progress import progress
from himap.cubes.corrected import plain_band
from himap.cubes.report import figure, panel
from himap.cubes.transfer import alms_of, faint_variance
from himap.figures import plotting, styles
from himap.figures.tables import Table
from himap.measures.diagnostics import bands
from himap.measures.low_rank_spectra import Moments, recovered_power
from himap.measures.spectra import frequency_power

PERCENTILES = (16, 50, 84)
"""Of the members: the ends of the band, and the median between them."""

_TEXT = (
    "Each thin line is a restart, whose start differs by 1e-10; the thick line is their median, and the band "
    "is from their 16 to their 84 %. They differ in foreground residual or signal loss. "
    "The one that was written is the medoid, whose residual is nearest to those of all others. What all "
    "restarts have in common is not seen here."
)


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Power spectra of each member of an ensemble.

    Attributes
    ----------
    x
        {"angular": l, "frequency": k in 1/MHz}, without 0.
    powers
        {kind: power, (n_members, n_x)}, mK^2 and mK^2 MHz.
    medoid
        Which member is the medoid.
    """

    x: dict
    powers: dict
    medoid: int

    def percentiles(self, kind):
        """The `PERCENTILES` of the power, (3, n_x)."""
        return np.percentile(self.powers[kind], PERCENTILES, axis=0)

    def columns(self, kind, x):
        """Those of a table, `percentiles` at places `x`: {"restarts_16": (n,)} and so on."""
        powers = zip(PERCENTILES, self.percentiles(kind), strict=True)
        return {f"restarts_{percent}": np.interp(x, self.x[kind], power) for percent, power in powers}


def scatter_of(cleaned):
    """The `Scatter` of a `CleanedCube` with an ensemble.

    Members differ from the medoid by a few spectra times maps, and so only these are transformed.
    """
    cube, residual, ensemble = cleaned.cube, cleaned.residual, cleaned.ensemble
    alms, own = alms_of(cube, residual), frequency_power(residual, cube.channel_width)
    faint, spectra = faint_variance(residual), []
    for k in progress(range(len(ensemble.members)), "spectra of restarts"):
        change = ensemble.change(k).truncate(faint)
        seen = replace(change, maps=cube.on_sphere(change.maps))
        angular = recovered_power(alms, seen, mask=cube.sky_mask).upto(cleaned.separation.lmax)
        power = Moments.of(residual, change).frequency_power(own, cube.channel_width).power
        spectra.append((angular.mean[angular.degrees > 0], power[1:]))
    x = {"angular": angular.degrees[angular.degrees > 0], "frequency": own.k[1:]}
    powers = dict(zip(x, map(np.array, zip(*spectra, strict=True)), strict=True))
    return Scatter(x=x, powers=powers, medoid=ensemble.medoid_index)


def scatter_table(scatter):
    """A `Table` with the power of the members over that of the medoid in each band."""
    rows = []
    for name, (kind, inside) in bands(*scatter.x.values()).items():
        power = scatter.powers[kind][:, inside].mean(axis=1)
        ratios = np.percentile(power / power[scatter.medoid], PERCENTILES)
        rows.append([plain_band(name), *(f"{ratio:.4g}" for ratio in ratios)])
    return Table(["over the medoid", "16 %", "median", "84 %"], rows, align="lrrr")


def scatter_parts(scatter):
    """Parts of a page: both spectra of all members with their median and band, and the table."""
    look = {"label": "restarts", "color": styles.BLUE}
    panels = [panel(kind, [(x, scatter.powers[kind], look)]) for kind, x in scatter.x.items()]
    picture = figure(plotting.lines(panels), "Spectra of restarts", _TEXT, title="Restarts")
    return [picture, scatter_table(scatter)]
