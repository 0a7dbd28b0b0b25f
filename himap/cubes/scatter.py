"""Scatter of the power spectra of a cleaned cube between restarts of a chaotic method."""

from dataclasses import dataclass

import numpy as np

from himap.core.progress import progress
from himap.cubes.corrected import band_table
from himap.cubes.report import figure, panel
from himap.cubes.spectra import analysed, power_spectra
from himap.figures import plotting, styles
from himap.measures.diagnostics import bands, plain_band

PERCENTILES = (16, 50, 84)
"""Of the members: the limits of the band, and the median."""

_TEXT = (
    "Each thin line is a restart, whose start is perturbed by 1e-10; the thick line is the median, and the "
    "band the 16 to 84 % range. Restarts differ in foreground residual or signal loss. The output is the "
    "medoid, whose residual is closest to those of all others. Errors common to all restarts do not appear "
    "here."
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
        Index of the medoid.
    """

    x: dict
    powers: dict
    medoid: int

    def columns(self, kind, x):
        """Table columns: `PERCENTILES` of the power at `x`, {"restarts_16": (n,)} and so on."""
        powers = zip(PERCENTILES, np.percentile(self.powers[kind], PERCENTILES, axis=0), strict=True)
        return {f"restarts_{percent}": np.interp(x, self.x[kind], power) for percent, power in powers}


def scatter_of(cleaned):
    """The `Scatter` of a `CleanedCube` with an ensemble.

    Members differ from the medoid by a few spectra times maps: C_l is computed from these alone.
    """
    cube, residual, ensemble = cleaned.cube, cleaned.residual, cleaned.ensemble
    near, powers = analysed(cube, residual), []
    for k in progress(range(len(ensemble.members)), "spectra of restarts"):
        spectra = power_spectra(cube, residual + ensemble.change(k).cube(), near)
        angular = spectra.angular.upto(cleaned.separation.lmax)
        powers.append((angular.mean[angular.degrees >= 1], spectra.frequency.power[1:]))
    x = {"angular": angular.degrees[angular.degrees >= 1], "frequency": spectra.frequency.k[1:]}
    powers = dict(zip(x, map(np.array, zip(*powers, strict=True)), strict=True))
    return Scatter(x=x, powers=powers, medoid=ensemble.medoid_index)


def scatter_table(scatter):
    """A `Table` of the power of the members relative to that of the medoid in each band."""
    rows = []
    for name, (kind, inside) in bands(*scatter.x.values()).items():
        power = scatter.powers[kind][:, inside].mean(axis=1)
        ratios = np.percentile(power / power[scatter.medoid], PERCENTILES)
        rows.append([plain_band(name), *(f"{ratio:.4g}" for ratio in ratios)])
    return band_table(["over the medoid", "16 %", "median", "84 %"], rows)


def scatter_parts(scatter):
    """Parts of a page: both spectra of all members with median and band, and the table."""
    look = {"label": "restarts", "color": styles.BLUE}
    panels = [panel(kind, [(x, scatter.powers[kind], look)]) for kind, x in scatter.x.items()]
    picture = figure(plotting.lines(panels), "Spectra of restarts", _TEXT, title="Restarts")
    return [picture, scatter_table(scatter)]
