"""A cross-check of corrected power: what neighbouring channels have in common, in a cube and in its mocks.

Noise is independent in each channel; HI and foregrounds are not. So the cross power of even and odd channels
says which share of the power is noise.
"""

from dataclasses import dataclass

import numpy as np

from himap.cubes.corrected import band_table, plain_band
from himap.measures.bootstrap import LEVEL, chance_of, sigma
from himap.measures.diagnostics import bands


@dataclass(frozen=True, kw_only=True)
class Common:
    """The share of the power in one band of l that neighbouring channels have in common.

    Attributes
    ----------
    cube, mocks
        In the residual of the cube, and the mean of those of members of its bootstrap; less what was
        estimated as foreground.
    error
        Of the difference, the scatter of members; NaN where one mock is all.
    chance
        That it is as large.
    """

    cube: float
    mocks: float
    error: float
    chance: float


def in_neighbours(transfer):
    """{band of l: `Common`} of a cleaned cube, by its `CubeTransfer`."""
    shares, n_mocks = {}, len(transfer.mocks)
    for name, (kind, inside) in bands(transfer.degrees, transfer.k).items():
        if kind == "angular":
            weights, powers = (2 * transfer.degrees + 1)[inside], [mock.output for mock in transfer.mocks]
            own, *members = (
                float(weights @ one.neighbours[inside] / (weights @ one.angular[inside]))
                for one in (transfer.without_foreground, *powers)
            )
            members, error, chance = np.array(members), np.nan, np.nan
            if n_mocks > 1:
                error = float(sigma((members - members.mean()) * n_mocks / (n_mocks - 1)))
                chance = float(chance_of(abs(own - members.mean()) / error, n_mocks))
            mean = float(members.mean())
            shares[plain_band(name)] = Common(cube=own, mocks=mean, error=error, chance=chance)
    return shares


def neighbours_table(shares):
    """A `Table` of what `in_neighbours` gives."""
    rows = [
        [name, *map("{:.4f}".format, (one.cube, one.mocks, one.error)), f"{one.chance:.2g}"]
        for name, one in shares.items()
    ]
    note = (
        "Share of the power that neighbouring channels have in common: of the residual and of the mocks, "
        "less what was estimated as foreground; the error of the difference, and the chance that it is as "
        "large."
    )
    return band_table(["neighbouring channels", "cube", "mocks", "error", "chance"], rows, note)


def remarks_on_neighbours(shares):
    """What the user should know of it, a list of sentences."""
    unlike = [
        f"{name}: {one.cube:.3f} and {one.mocks:.3f}"
        for name, one in shares.items()
        if one.chance * len(shares) < LEVEL
    ]
    return [
        "Neighbouring channels have another share of their power in common than those of the mocks (cube "
        f"and mocks: {'; '.join(unlike)}). Noise is not that of the mocks (--mock-noise), or HI changes "
        "faster or slower with frequency."
    ] * bool(unlike)
