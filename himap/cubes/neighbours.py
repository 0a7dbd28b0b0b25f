"""Cross-check of corrected power: the common power of neighbouring channels, in a cube and in its mocks.

Noise is independent between channels, HI and foregrounds are not. The cross power of even and odd channels
therefore measures the noise share of the power.
"""

import numpy as np
import pandas as pd

from himap.cubes.corrected import band_table
from himap.measures.bootstrap import LEVEL, of_others, significance
from himap.measures.diagnostics import bands, plain_band

COLUMNS = ["cube", "mocks", "error", "chance"]
"""Of the result of `in_neighbours`."""


def in_neighbours(transfer):
    """Share of the power of a cleaned cube that neighbouring channels have in common, in each band of l.

    From its `CubeTransfer`.

    Returns
    -------
    DataFrame
        A row per band of l. Columns are `COLUMNS`: the share for the residual of the "cube", and the mean for
        members of its bootstrap, "mocks", both without the estimated foreground residual; the "error" of
        their difference, from the scatter of members, and the "chance", the probability of a difference at
        least as large, both NaN for a single mock.
    """
    rows, powers = [], (transfer.without_foreground, *(mock.output for mock in transfer.mocks))
    for name, (kind, inside) in bands(transfer.degrees, transfer.k).items():
        if kind == "angular":
            weights = (2 * transfer.degrees + 1)[inside]
            shares = [weights @ one.neighbours[inside] / (weights @ one.angular[inside]) for one in powers]
            cube, members = shares[0], np.array(shares[1:])
            known = significance(cube - members.mean(), members - of_others(members))
            rows.append([plain_band(name), cube, members.mean(), *known.values()])
    return pd.DataFrame(rows, columns=["band", *COLUMNS]).set_index("band")


def neighbours_table(shares):
    """A `Table` of the result of `in_neighbours`."""
    rows = [
        [name, *map("{:.4f}".format, numbers), f"{chance:.2g}"]
        for name, *numbers, chance in shares.itertuples()
    ]
    note = (
        "Share of the power that neighbouring channels have in common, for the residual and for the mocks, "
        "without the estimated foreground residual; error of the difference, and probability of a difference "
        "at least as large."
    )
    return band_table(["neighbouring channels", *COLUMNS], rows, note)


def remarks_on_neighbours(shares):
    """Remarks on significant differences, a list of sentences."""
    unlike = shares[shares["chance"] * len(shares) < LEVEL].itertuples()
    listed = "; ".join(f"{one.Index}: {one.cube:.3f} and {one.mocks:.3f}" for one in unlike)
    return [
        "The share of power that neighbouring channels have in common differs from that of the mocks (cube "
        f"and mocks: {listed}). Noise differs from that of the mocks (--mock-noise), or HI "
        "decorrelates at a different rate with frequency."
    ] * bool(listed)
