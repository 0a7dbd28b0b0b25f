"""Cross-check of corrected power: the common power of neighbouring channels, in a cube and in its mocks.

Noise is independent between channels, HI and foregrounds are not. The cross power of even and odd channels
therefore measures the noise share of the power.
"""

from dataclasses import dataclass

import numpy as np

from himap.cubes.corrected import band_table
from himap.measures.bootstrap import LEVEL, chance_of, sigma
from himap.measures.diagnostics import bands, plain_band


@dataclass(frozen=True, kw_only=True)
class Common:
    """Share of the power in a band of l that neighbouring channels have in common.

    Attributes
    ----------
    cube, mocks
        For the residual of the cube, and the mean for members of its bootstrap; the estimated foreground
        residual is subtracted.
    error
        Of the difference, from the scatter of members; NaN for a single mock.
    chance
        Probability of a difference at least as large.
    """

    cube: float
    mocks: float
    error: float
    chance: float


def in_neighbours(transfer):
    """{band of l: `Common`} for a cleaned cube, from its `CubeTransfer`."""
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
    """A `Table` of the result of `in_neighbours`."""
    rows = [
        [name, *map("{:.4f}".format, (one.cube, one.mocks, one.error)), f"{one.chance:.2g}"]
        for name, one in shares.items()
    ]
    note = (
        "Share of the power that neighbouring channels have in common, for the residual and for the mocks, "
        "without the estimated foreground residual; error of the difference, and probability of a difference "
        "at least as large."
    )
    return band_table(["neighbouring channels", "cube", "mocks", "error", "chance"], rows, note)


def remarks_on_neighbours(shares):
    """Remarks on significant differences, a list of sentences."""
    unlike = [
        f"{name}: {one.cube:.3f} and {one.mocks:.3f}"
        for name, one in shares.items()
        if one.chance * len(shares) < LEVEL
    ]
    return [
        "The share of power that neighbouring channels have in common differs from that of the mocks (cube "
        f"and mocks: {'; '.join(unlike)}). Noise differs from that of the mocks (--mock-noise), or HI "
        "decorrelates at a different rate with frequency."
    ] * bool(unlike)
